"""Pages of the main window: how they are made, connected, saved and restored; actions of result cards; the visible specimen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar, cast

from PySide6.QtCore import QSettings, Signal

from app.config import BenchConfig
from app.gui import bench_page as bench_pages
from app.gui import campaign as campaign_pages
from app.gui import explore as explore_pages
from app.gui import laboratory as laboratory_pages
from app.gui import runs as runs_pages
from app.gui import specimen as specimen_pages
from app.gui.campaign import CampaignController
from app.gui.laboratory import FolderThreshold
from app.gui.measure import MeasurePage, OperatorOfToday, PresetStore, presets_path
from app.gui.results import ReportJob
from app.gui.shell.page_host import BENCH, CAMPAIGN, EXPLORE, LABORATORY, MEASURE, RUNS, TITLES, Page, PageHost
from app.gui.status import SessionController
from app.gui.widgets import SheetIndicators, at_end, tell
from app.identification import SpecimenLabel, compare_label
from app.live import Overlay
from app.session import WindowState
from protocols.base import Protocol

if TYPE_CHECKING:
    from protocols.runner import RunRequest

P = TypeVar("P")


class CreatedPage(Generic[P]):
    """Attribute of the tabs: one of their pages, created if necessary."""

    def __init__(self, index: int) -> None:
        self._index = index

    def __get__(self, tabs: PageHost, _: object = None) -> P:
        return cast("P", tabs.page(self._index))


class MainTabs(PageHost):
    """Makes the pages, connects them, and saves and restores their state; the Measure page is made immediately."""

    bench_chosen = Signal(str)
    """Path or name of the bench to open."""
    identification_requested = Signal()
    """The specimen of the visible page is to be identified."""

    campaign: CreatedPage[campaign_pages.CampaignPage] = CreatedPage(CAMPAIGN)
    explore: CreatedPage[explore_pages.ExplorePage] = CreatedPage(EXPLORE)
    runs: CreatedPage[runs_pages.RunsPage] = CreatedPage(RUNS)
    bench: CreatedPage[bench_pages.BenchPage] = CreatedPage(BENCH)
    laboratory: CreatedPage[laboratory_pages.LaboratoryPage] = CreatedPage(LABORATORY)

    def __init__(
        self,
        protocol: Protocol,
        controller: SessionController,
        config: BenchConfig,
        settings: QSettings,
        open_bench: str,
    ) -> None:
        super().__init__(settings)
        self._config, self._open_bench = config, open_bench
        self._controller, self._adapter = controller, controller.adapter
        self.overlay = Overlay(amplifier=config.amplifier.amplifier_map)
        for each in (self.overlay, self._adapter.feed.running_curve):
            at_end(self, each.close)
        self.measure = MeasurePage(
            protocol,
            self._adapter.feed,
            self.overlay,
            config.amplifier.amplifier_map,
            lambda: self._adapter.session.bench,
            PresetStore(presets_path()),
            config.simulation_parameters.modes if config.simulated else None,
        )
        self.results, self.subject = ResultActions(self), VisibleSubject(self)
        panel = self.measure.run_panel
        panel.result_card.requested.connect(self.results.perform)
        panel.label_scanned.connect(self._compare_label)
        self._operator = OperatorOfToday(panel, self._worker, self)
        self._threshold = FolderThreshold(self._worker, self.created_pages.values, self.show_message)
        self.page_created.connect(self._threshold.show_on_new)
        makers: tuple[Callable[[], Page], ...] = (
            lambda: self.measure,
            self._make_campaign,
            self._make_explore,
            self._make_runs,
            self._make_bench,
            self._make_laboratory,
        )
        for title, make in zip(TITLES, makers, strict=True):
            self.add_page(title, make)
        self.page(MEASURE)
        self.sheets = SheetIndicators(self._worker, self)
        self.sheets.add(panel.sheet_button, lambda: (self.folder, self.specimen))
        for edit in (panel.specimen_edit, panel.folder_edit):
            edit.textChanged.connect(self.sheets.update)
        for changed in (panel.folder_edit.textChanged, self.currentChanged):
            changed.connect(lambda _: self._threshold.read(self.folder))
        self.currentChanged.connect(self.sheets.update)

    def set_state(self, view: WindowState) -> None:
        ended = self._state is not None and view.outcome is not None and self._state.outcome is None
        super().set_state(view)
        if ended:  # the first run of a simulated specimen writes its sheet
            self.sheets.update()

    @property
    def folder(self) -> Path:
        """Folder for run files."""
        return self.measure.run_panel.folder

    @property
    def specimen(self) -> str:
        return self.measure.run_panel.specimen

    # -- interface to the main window ---------------------------------------------------------------------------------

    def preload_pages(self) -> None:
        """Import the other pages in the background, which takes a second, and create them."""
        self._operator.read()
        modules = [f"app.gui.{name}.page" for name in ("campaign", "explore", "runs", "bench_page", "laboratory")]
        self.load_pages(modules, self.sheets.start, self.measure.live_pane.prepare)

    def _compare_label(self, label: SpecimenLabel) -> None:
        folder = self.folder
        self._worker.submit(
            lambda: compare_label(folder, label), self.show_message, lambda error: self.show_message(str(error))
        )

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
        super().save_state()

    # -- inside --------------------------------------------------------------------------------------------------------

    def _make_campaign(self) -> campaign_pages.CampaignPage:
        controller = CampaignController(lambda: self._adapter.session.bench, self.overlay.amplifier)
        self._adapter.events.subscribe(controller.observe)
        page = campaign_pages.CampaignPage(
            controller, self._adapter.feed, self.overlay, lambda: (self.folder, self.specimen)
        )
        controller.setParent(page)
        controller.run_requested.connect(self._start_campaign_run)
        page.run_open_requested.connect(self.results.open_run)
        page.board.decision.card.requested.connect(self.results.perform)
        page.explore_requested.connect(lambda path: self.results.overlay_runs([path]))
        page.restore_state(self._settings)
        self.sheets.add(page.board.header.sheet_button, lambda: self.subject.specimen_of(controller))
        controller.changed.connect(self.sheets.update_changed)
        card = self.measure.run_panel.result_card

        def show_on_card() -> None:
            summary = controller.summary
            following = None if summary is None else summary.next_item
            card.offer_acceptance(frozenset() if summary is None else summary.acceptable.keys())
            card.offer_next("" if following is None else following.state.title)

        controller.changed.connect(show_on_card)
        return page

    def _make_explore(self) -> explore_pages.ExplorePage:
        from app.explore import fit_runs  # slow to import, and not visible when the window opens

        page = explore_pages.ExplorePage(fit_runs)
        page.runs_requested.connect(self.results.choose_runs)
        page.card.requested.connect(self.results.perform)
        page.folder, page.specimen = lambda: self.folder, lambda: (self.folder, self.specimen)
        self.sheets.add(page.toolbar.sheet_button, lambda: (self.folder, self.specimen))
        page.toolbar.identify_button.clicked.connect(lambda _=False: self.identification_requested.emit())
        page.restore_state(self._settings)
        return page

    def _make_runs(self) -> runs_pages.RunsPage:
        page = runs_pages.RunsPage(lambda: self.folder, lambda: self.specimen, self._config.amplifier, self.overlay)
        page.explore_requested.connect(self.results.overlay_runs)
        page.continue_requested.connect(self._continue_run)
        for card in (page.details.card, page.viewer.card):
            card.requested.connect(self.results.perform)
        return page

    def _make_bench(self) -> bench_pages.BenchPage:
        page = bench_pages.BenchPage(self._controller, self._config, self._open_bench)
        page.restore_state(self._settings)
        page.bench_chosen.connect(self.bench_chosen)
        page.run_requested.connect(self.start_run)
        return page

    def _make_laboratory(self) -> laboratory_pages.LaboratoryPage:
        page = laboratory_pages.LaboratoryPage(lambda: self.folder)
        page.run_open_requested.connect(self.results.open_run)
        page.restore_state(self._settings)
        return page

    def start_run(self, protocol: Protocol) -> None:
        """Start a run of the specimen of the Measure page, if one can begin."""
        self._controller.start_run(protocol, self.folder, self.specimen)

    def repeat_entries(self, entries: tuple[int, ...] = ()) -> None:
        """Measure some entries of the last run again, or without any the missing ones."""
        self._controller.repeat_entries(entries, self.folder)

    def _start_campaign_run(self, request: RunRequest) -> None:
        if self._controller.can_start:
            self._controller.start_campaign_run(request, self.campaign.accept_run(request))

    def _continue_run(self, path: Path) -> None:
        """Continue a stopped run, and show it on the Measure page."""
        self.setCurrentIndex(MEASURE)
        self._controller.continue_run(path, (), self.folder)

    def show_message(self, text: str) -> None:
        """Tell the user something in the status line."""
        tell(self, text)


class ResultActions:
    """Shows a result on another page, or writes its report.

    Args:
        tabs: the pages.
    """

    def __init__(self, tabs: MainTabs) -> None:
        self._tabs, self._report_job = tabs, ReportJob(tabs.show_message, tabs)

    def perform(self, action: str, path: Path) -> None:
        """Carry out an action of a result card."""
        tabs = self._tabs
        actions: dict[str, Callable[[], object]] = {
            "again": tabs.measure.run_panel.run_pressed.emit,
            "continue": tabs.repeat_entries,
            "budget": tabs.identification_requested.emit,
            "open": lambda: self.open_run(path),
            "explore": lambda: self.overlay_runs([path]),
            "accept": lambda: self._accept(path.name),
            "next": lambda: tabs.setCurrentIndex(CAMPAIGN),
            "report": lambda: self._report_job.start_of(path),
        }
        actions[action]()

    def _accept(self, run: str) -> None:
        controller = self._tabs.campaign.controller
        if controller.summary is not None and (name := controller.summary.acceptable.get(run)):
            controller.modify(lambda plan: plan.accept(name, run), f"{name} is accepted")

    def open_run(self, path: Path) -> None:
        """Open a run on the Runs page."""
        self._tabs.setCurrentIndex(RUNS)
        self._tabs.runs.open_run(path)

    def choose_runs(self) -> None:
        """Show the list of runs, to choose those to lay over the model's curves."""
        self._tabs.setCurrentIndex(RUNS)
        self._tabs.runs.go_back()
        self._tabs.runs.details.show_message(
            "Select one or several runs, then press Explore (E): they are laid over the model's curves."
        )

    def overlay_runs(self, paths: Sequence[Path]) -> None:
        """Lay runs over the curves of the Explore page."""
        self._tabs.setCurrentIndex(EXPLORE)
        self._tabs.explore.overlaid.add(paths)


class VisibleSubject:
    """Reads the specimen of the visible page: the open campaign's, or the Measure page's."""

    def __init__(self, tabs: MainTabs) -> None:
        self._tabs = tabs

    @property
    def specimen(self) -> tuple[Path, str]:
        """Folder and name of the specimen that the visible page is about."""
        return (
            self.specimen_of(self._tabs.campaign.controller)
            if self._shows(CAMPAIGN)
            else (self._tabs.folder, self._tabs.specimen)
        )

    def describe_next(self) -> tuple[str, str]:
        """Return the specimen of the visible page, and the next step of the open campaign as text."""
        step = self._tabs.campaign.board.step if CAMPAIGN in self._tabs.created_pages else None
        return self.specimen[1], "" if step is None else step.heading

    @property
    def identification(self) -> specimen_pages.IdentificationSubject:
        """Runs to identify from the visible page: overlaid runs, valid runs of the campaign, or all runs of the specimen."""
        folder, specimen = self.specimen
        runs: tuple[Path, ...] = ()
        if self._shows(EXPLORE):
            runs = tuple(run.path for run in self._tabs.explore.overlaid.runs)
        elif self._shows(CAMPAIGN):
            runs = self._tabs.campaign.controller.counting_runs
        return specimen_pages.IdentificationSubject(runs[0].parent if runs else folder, specimen, runs)

    def specimen_of(self, controller: CampaignController) -> tuple[Path, str]:
        """Return folder and specimen of the open campaign; of the Measure page without one."""
        summary = controller.summary
        return (self._tabs.folder, self._tabs.specimen) if summary is None else (summary.path.parent, summary.specimen)

    def _shows(self, index: int) -> bool:
        """Whether a page is created and visible."""
        return self._tabs.currentIndex() == index and index in self._tabs.created_pages
