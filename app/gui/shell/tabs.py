"""Tabs of the main window: the pages, created when they are first needed."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from PySide6.QtCore import QSettings, QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtWidgets import QLabel, QTabWidget, QVBoxLayout, QWidget

from app.common import UsageError, remember_conditions, remembered_conditions
from app.config import BenchConfig
from app.gui.campaign.controller import CampaignController
from app.gui.laboratory.folder_threshold import FolderThreshold
from app.gui.measure.page import MeasurePage
from app.gui.measure.presets import PresetStore, presets_path
from app.gui.results.report_job import ReportJob
from app.gui.specimen.indicators import SheetIndicators
from app.gui.widgets import (
    ACTIONS,
    BackgroundWorker,
    Toast,
    WindowTheme,
    column,
    configure,
    make_scroll_area,
    splitters,
)
from app.identification.specimen_label import SpecimenLabel, compare_label
from app.live import Overlay, SessionAdapter
from app.session import WindowState
from protocols.base import Protocol as Measurement
from protocols.base import RunConditions

if TYPE_CHECKING:
    from app.gui.bench_page.page import BenchPage
    from app.gui.campaign.page import CampaignPage
    from app.gui.explore.page import ExplorePage
    from app.gui.laboratory.page import LaboratoryPage
    from app.gui.runs.page import RunsPage
    from app.gui.specimen.identification_page import IdentificationSubject


class Page(Protocol):
    """Interface of a page: a widget that shows window states."""

    def set_state(self, view: WindowState) -> None: ...

    def tick(self) -> None: ...

    def activate(self) -> None:
        """Take the keyboard focus, without which the page's shortcuts do nothing."""


MEASURE, CAMPAIGN, EXPLORE, RUNS, BENCH, LABORATORY = range(6)
"""Index of each page."""

OPERATOR_POLL_MS = 30_000
"""Interval at which today's operator is read again: another program may set it, and it expires at midnight."""

PRELOAD_PAUSE_MS = 30
"""Between the creation of two pages."""

TITLES = ("Measure", "Campaign", "Explore", "Runs", "Bench", "Laboratory")


class MainTabs(QTabWidget):
    """Creates the pages, connects them, and saves and restores their state.

    The Measure page is built immediately, another when it is first selected or requested. Pages do not refer to each other.
    """

    run_requested = Signal(object)
    """A `RunRequest` of the campaign for the session."""
    continue_requested = Signal(object)
    """Path of a stopped run to continue."""
    bench_chosen = Signal(str)
    """Path or name of the bench to open."""
    bench_run_requested = Signal(object)
    """A protocol of the Bench page for the session."""
    commissioning_requested = Signal(object)
    """A `CommissioningJob`."""
    stop_requested = Signal()
    identification_requested = Signal()
    """The specimen of the visible page is to be identified."""
    speed_requested = Signal(object)
    """Speed of the simulated bench; None is the virtual clock."""

    def __init__(
        self,
        protocol: Measurement,
        adapter: SessionAdapter,
        config: BenchConfig,
        settings: QSettings,
        theme: WindowTheme,
        open_bench: str,
    ) -> None:
        super().__init__()
        self._config, self._open_bench = config, open_bench
        self._adapter, self._settings, self._theme = adapter, settings, theme
        self._amplifier = config.amplifier
        self._worker = BackgroundWorker("pages", self)
        self._state: WindowState | None = None
        self.overlay = Overlay(amplifier=config.amplifier.amplifier_map)
        self.measure = MeasurePage(
            protocol,
            adapter.feed,
            self.overlay,
            config.amplifier.amplifier_map,
            lambda: adapter.session.bench,
            PresetStore(presets_path()),
            theme,
        )
        self.measure.run_panel.result_card.requested.connect(self._on_card_requested)
        self._toast = Toast(self)
        self._report_job = ReportJob(self._toast.show_message, self)
        self.measure.run_panel.operator_named.connect(self._remember_operator)
        self.measure.run_panel.label_scanned.connect(self._compare_label)
        self._operator_timer = QTimer(self, interval=OPERATOR_POLL_MS)
        self._operator_timer.timeout.connect(self.show_operator)
        self._operator_timer.start()
        self._factories: tuple[Callable[[], Page], ...] = (
            lambda: self.measure,
            self._make_campaign,
            self._make_explore,
            self._make_runs,
            self._make_bench,
            self._make_laboratory,
        )
        self._created: dict[int, Page] = {}
        self._threshold = FolderThreshold(self._worker, self._created.values, self.show_message)
        self._page_layouts: list[QVBoxLayout] = []
        self.setAccessibleName("pages")
        self.setDocumentMode(True)
        self.setTabBarAutoHide(True)
        for index, title in enumerate(TITLES):
            place = QWidget()
            self._page_layouts.append(column(parent=place, margins=(0, 0, 0, 0)))
            self.addTab(place, title)
            action_id = f"page.{title.lower()}"
            self.setTabToolTip(index, ACTIONS[action_id].shortcut)
        self.page(MEASURE)
        self.sheets = SheetIndicators(self._worker, self)
        self.sheets.add(self.measure.run_panel.sheet_button, lambda: (self.folder, self.specimen))
        for edit in (self.measure.run_panel.specimen_edit, self.measure.run_panel.folder_edit):
            edit.textChanged.connect(self.sheets.update)
        self.measure.run_panel.folder_edit.textChanged.connect(lambda _: self._threshold.read(self.folder))
        self.currentChanged.connect(lambda index: self.page(index).activate())
        self.currentChanged.connect(lambda _: self._threshold.read(self.folder))
        self.currentChanged.connect(self.sheets.update)

    def select_page(self, index: int) -> None:
        """Select a page and give it the focus."""
        if index == self.currentIndex():
            self.page(index).activate()
        self.setCurrentIndex(index)

    def show_page_later(self, index: int) -> None:
        """Select a page without creating it; a placeholder is shown until then."""
        with QSignalBlocker(self):
            self.setCurrentIndex(index)
        if index not in self._created:
            title = QLabel(f"{self.tabText(index)} …", alignment=Qt.AlignmentFlag.AlignCenter)
            self._page_layouts[index].addWidget(configure(title, kind="note"))

    def page(self, index: int) -> Page:
        """Return a page, created if necessary."""
        if index not in self._created:
            self._created[index] = page = self._factories[index]()
            assert isinstance(page, QWidget)
            splitters.restore_splitters(page, self._settings)
            if self._state is not None:
                page.set_state(self._state)
            if self._threshold.threshold is not None:
                self._threshold.show_on(page)
            while (placeholder := self._page_layouts[index].takeAt(0)) is not None:
                cast("QWidget", placeholder.widget()).deleteLater()
            # A page keeps its least size, and scrolls in a window that is too small for it. It is put into an area that has
            # its size, which would otherwise divide the page's splitters anew, and is visible, so that the page takes the focus.
            area = make_scroll_area(focusPolicy=Qt.FocusPolicy.NoFocus)
            self._page_layouts[index].addWidget(area)
            area.show()
            self._page_layouts[index].activate()
            area.setWidget(page)
            page.show()
        return self._created[index]

    @property
    def created_pages(self) -> Mapping[int, Page]:
        """The pages created so far, by index."""
        return self._created

    @property
    def current_page(self) -> Page:
        """The visible page."""
        return self.page(self.currentIndex())

    def set_state(self, view: WindowState) -> None:
        ended = self._state is not None and view.outcome is not None and self._state.outcome is None
        self._state = view
        if ended:  # the first run of a simulated specimen writes its sheet
            self.sheets.update()
        for page in self._created.values():
            page.set_state(view)

    def tick(self) -> None:
        """Refresh the visible page."""
        if (page := self._created.get(self.currentIndex())) is not None:
            page.tick()

    # -- the pages -----------------------------------------------------------------------------------------------------

    @property
    def campaign(self) -> CampaignPage:
        """The Campaign page, created if necessary."""
        return cast("CampaignPage", self.page(CAMPAIGN))

    @property
    def explore(self) -> ExplorePage:
        """The Explore page, created if necessary."""
        return cast("ExplorePage", self.page(EXPLORE))

    @property
    def runs(self) -> RunsPage:
        """The Runs page, created if necessary."""
        return cast("RunsPage", self.page(RUNS))

    @property
    def bench(self) -> BenchPage:
        """The Bench page, created if necessary."""
        return cast("BenchPage", self.page(BENCH))

    @property
    def laboratory(self) -> LaboratoryPage:
        """The Laboratory page, created if necessary."""
        return cast("LaboratoryPage", self.page(LABORATORY))

    @property
    def folder(self) -> Path:
        """Folder for run files."""
        return Path(self.measure.run_panel.folder_edit.text().strip()).expanduser()

    @property
    def specimen(self) -> str:
        return self.measure.run_panel.specimen_edit.text().strip()

    @property
    def shown_specimen(self) -> tuple[Path, str]:
        """Folder and name of the specimen that the visible page is about."""
        on_campaign = self.currentIndex() == CAMPAIGN and CAMPAIGN in self._created
        return self._specimen_of(self.campaign.controller) if on_campaign else (self.folder, self.specimen)

    def describe_next(self) -> tuple[str, str]:
        """Return the specimen of the visible page, and the next step of the open campaign as text."""
        step = self.campaign.board.step if CAMPAIGN in self._created else None
        return self.shown_specimen[1], "" if step is None else step.heading

    @property
    def identification_subject(self) -> IdentificationSubject:
        """What is identified from the visible page: overlaid runs, those that count in the campaign, or all of the specimen."""
        from app.gui.specimen.identification_page import IdentificationSubject

        folder, specimen = self.shown_specimen
        runs: tuple[Path, ...] = ()
        if self.currentIndex() == EXPLORE and EXPLORE in self._created:
            runs = tuple(run.path for run in self.explore.overlaid.runs)
        elif self.currentIndex() == CAMPAIGN and CAMPAIGN in self._created:
            runs = self.campaign.controller.counting_runs
        return IdentificationSubject(runs[0].parent if runs else folder, specimen, runs)

    # -- interface to the main window ---------------------------------------------------------------------------------

    def preload_pages(self) -> None:
        """Import the other pages in the background, which takes a second, and create them."""

        def load() -> None:
            for name in ("campaign", "explore", "runs", "bench_page", "laboratory"):
                importlib.import_module(f"app.gui.{name}.page")

        self.show_operator()

        def make(_: object) -> None:
            self.sheets.start()
            self._preload_page(self.currentIndex())  # the selected page first

        self._worker.submit(load, make)

    def show_operator(self) -> None:
        """Show who measures today; the file is read in the background."""

        def show(found: object) -> None:
            if isinstance(found, RunConditions):
                self.measure.run_panel.show_operator(found.operator)

        self._worker.submit(remembered_conditions, show)

    def _remember_operator(self, name: str) -> None:
        def remember() -> None:
            with suppress(UsageError):  # a name that cannot be stored is not; the login is
                remember_conditions(name)

        self._worker.submit(remember)

    def _compare_label(self, label: SpecimenLabel) -> None:
        folder = self.folder
        self._worker.submit(
            lambda: compare_label(folder, label), self.show_message, lambda error: self.show_message(str(error))
        )

    def run_in_background(self, work: Callable[[], object]) -> None:
        """Run a job that reads files in the background."""
        self._worker.submit(work)

    def go_back(self) -> None:
        """Go one step back on the visible page."""
        if self.currentIndex() == RUNS:
            self.runs.go_back()
        elif self.currentIndex() == CAMPAIGN:
            self.campaign.go_back()

    def set_active_file(self, path: Path | None) -> None:
        """Set the run file that this program is writing."""
        if RUNS in self.created_pages:
            self.runs.set_active_file(path)
        if CAMPAIGN in self.created_pages:
            self.campaign.controller.active_file = path
        if LABORATORY in self.created_pages:
            self.laboratory.set_active_file(path)

    def restore_state(self, folder: Path | None, specimen: str | None, protocol_requested: bool) -> None:
        """Restore saved settings; a given folder or specimen has precedence, and a requested protocol is shown."""
        self.measure.restore_state(self._settings, restore_form=not protocol_requested)
        last = str(self._settings.value("window/page", ""))
        if not protocol_requested and last.isdigit() and int(last) < self.count():
            self.show_page_later(int(last))
        folder_text = str(folder) if folder is not None else str(self._settings.value("run/folder", "runs"))
        self.measure.run_panel.folder_edit.setText(folder_text)
        specimen_text = specimen if specimen is not None else str(self._settings.value("run/specimen", ""))
        self.measure.run_panel.specimen_edit.setText(specimen_text)

    def save_state(self) -> None:
        """Save settings."""
        self._settings.setValue("run/folder", self.measure.run_panel.folder_edit.text())
        self._settings.setValue("run/specimen", self.measure.run_panel.specimen_edit.text())
        self._settings.setValue("window/page", self.currentIndex())
        for made in self.created_pages.values():
            splitters.save_splitters(cast("QWidget", made), self._settings)
        for page in self._pages_with("save_state"):
            page.save_state(self._settings)

    def release_pages(self) -> list[QWidget]:
        """Forget the pages other than Measure, after `shutdown`, and return them to be deleted."""
        return [cast("QWidget", self._created.pop(index)) for index in sorted(self._created) if index != MEASURE]

    def shutdown(self) -> None:
        """Stop background threads."""
        self._worker.close()
        self._report_job.shutdown()
        self.overlay.close()
        self._adapter.feed.running_curve.close()
        for page in self._pages_with("shutdown"):
            page.shutdown()

    # -- inside --------------------------------------------------------------------------------------------------------

    def _preload_page(self, index: int) -> None:
        """Create a page, and later the next one that is missing: in between, the window paints and answers."""
        if self._worker.closed:  # a page created after shutdown would not be shut down
            return
        awaited = index == self.currentIndex() and index not in self.created_pages
        page = self.page(index)
        if awaited and cast("QWidget", page).isVisible():  # not below the welcome page, which has the keyboard
            page.activate()
        missing = next((at for at in range(self.count()) if at not in self._created), None)
        if missing is not None:
            QTimer.singleShot(PRELOAD_PAUSE_MS, self, partial(self._preload_page, missing))
        else:
            QTimer.singleShot(PRELOAD_PAUSE_MS, self, self.measure.live_pane.prepare)

    def _specimen_of(self, controller: CampaignController) -> tuple[Path, str]:
        summary = controller.summary
        return (self.folder, self.specimen) if summary is None else (summary.path.parent, summary.specimen)

    def _pages_with(self, method: str) -> Iterator[Any]:
        return (page for page in self.created_pages.values() if hasattr(page, method))

    def _make_campaign(self) -> CampaignPage:
        from app.gui.campaign.page import CampaignPage

        controller = CampaignController(lambda: self._adapter.session.bench, self.overlay.amplifier)
        self._adapter.events.subscribe(controller.observe)
        page = CampaignPage(
            controller, self._adapter.feed, self.overlay, lambda: (self.folder, self.specimen), self._theme
        )
        controller.setParent(page)
        controller.run_requested.connect(self.run_requested)
        page.run_open_requested.connect(self.open_run)
        page.board.details.review_pane.card.requested.connect(self._on_card_requested)
        page.explore_requested.connect(lambda path: self._overlay_runs([path]))
        page.restore_state(self._settings)
        self.sheets.add(page.board.header.sheet_button, lambda: self._specimen_of(controller))
        controller.changed.connect(self.sheets.update_changed)
        page.board.header.identify_button.clicked.connect(lambda _=False: self.identification_requested.emit())
        return page

    def _make_explore(self) -> ExplorePage:
        from app.explore import fit_runs  # slow to import, and not visible when the window opens
        from app.gui.explore.page import ExplorePage

        page = ExplorePage(self._theme, fit_runs)
        page.runs_wanted.connect(self._choose_runs)
        page.card.requested.connect(self._on_card_requested)
        page.folder, page.specimen = lambda: self.folder, lambda: (self.folder, self.specimen)
        self.sheets.add(page.toolbar.sheet_button, lambda: (self.folder, self.specimen))
        page.toolbar.identify_button.clicked.connect(lambda _=False: self.identification_requested.emit())
        page.restore_state(self._settings)
        return page

    def _make_runs(self) -> RunsPage:
        from app.gui.runs.page import RunsPage

        page = RunsPage(lambda: self.folder, lambda: self.specimen, self._amplifier, self.overlay, self._theme)
        page.explore_requested.connect(self._overlay_runs)
        page.continue_requested.connect(self.continue_requested)
        for card in (page.details.card, page.viewer.card):
            card.requested.connect(self._on_card_requested)
        return page

    def _make_bench(self) -> BenchPage:
        from app.gui.bench_page.page import BenchPage

        page = BenchPage(self._adapter, self._config, self._open_bench, self._theme)
        page.restore_state(self._settings)
        page.bench_chosen.connect(self.bench_chosen)
        page.run_requested.connect(self.bench_run_requested)
        page.commissioning_requested.connect(self.commissioning_requested)
        page.stop_requested.connect(self.stop_requested)
        page.speed_requested.connect(self.speed_requested)
        return page

    def _make_laboratory(self) -> LaboratoryPage:
        from app.gui.laboratory.page import LaboratoryPage

        page = LaboratoryPage(lambda: self.folder, self._theme)
        page.run_open_requested.connect(self.open_run)
        page.restore_state(self._settings)
        return page

    def _on_card_requested(self, action: str, path: Path) -> None:
        """Carry out an action of a result card that starts no run."""
        if action == "open":
            self.open_run(path)
        elif action == "explore":
            self._overlay_runs([path])
        elif action == "next":
            self.setCurrentIndex(CAMPAIGN)
        elif action == "report":
            self._write_report(path)

    def _choose_runs(self) -> None:
        """Show the list of runs, to choose those to lay over the model's curves."""
        self.setCurrentIndex(RUNS)
        self.runs.go_back()
        self.runs.details.show_message(
            "Select one or several runs, then press Explore (E): they are laid over the model's curves."
        )

    def show_message(self, text: str) -> None:
        """Show a short message in the corner of the pages."""
        self._toast.show_message(text)

    def _write_report(self, path: Path) -> None:
        """Write the report of the specimen of a run."""

        def read() -> str:
            from app.archive import load_run

            return load_run(path, with_traces=False).specimen

        self._worker.submit(
            read,
            lambda specimen: self._report_job.start(path.parent, specimen),
            lambda error: self._toast.show_message(str(error)),
        )

    def open_run(self, path: Path) -> None:
        """Open a run on the Runs page."""
        self.setCurrentIndex(RUNS)
        self.runs.open_run(path)

    def _overlay_runs(self, paths: list[Path]) -> None:
        self.setCurrentIndex(EXPLORE)
        self.explore.overlaid.add(paths)
