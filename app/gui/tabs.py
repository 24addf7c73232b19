"""The window's four pages: made when they are first looked at, kept between starts, ended with the window.

The window's pages behind tabs; a single page needs none.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from PySide6.QtCore import QSettings, QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtWidgets import QLabel, QTabWidget, QVBoxLayout, QWidget

from app.config.bench_file import BenchConfig
from app.gui.campaign.controller import CampaignDesk
from app.gui.measure.page import MeasurePage
from app.gui.measure.presets import Presets, presets_path
from app.gui.widgets import splitters
from app.gui.widgets.background import Jobs
from app.gui.widgets.form import mark
from app.gui.widgets.shortcuts import bind
from app.gui.widgets.theme import Theme
from app.live.overlay import Overlay
from app.live.session_link import Link
from app.session.state import View
from protocols.base.protocol import Protocol as Measurement

if TYPE_CHECKING:
    from app.campaign.queue import Order
    from app.gui.campaign.page import CampaignPage
    from app.gui.explore.page import ExplorePage
    from app.gui.runs.page import RunsPage


class Page(Protocol):
    """What the window does with a page: a widget that shows views."""

    def show_view(self, view: View) -> None: ...

    def set_theme(self, theme: Theme) -> None: ...

    def refresh(self) -> None: ...

    def enter(self) -> None:
        """It is looked at from now on: take the keyboard, without which its keys do nothing."""


class Pages(QTabWidget):
    """Shows one page at a time and passes on what all of them must hear.

    Args:
        pages: title and maker of each. The first is made at once, another when it is first looked at or asked for.
    """

    def __init__(self, pages: Sequence[tuple[str, Callable[[], Page]]], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setDocumentMode(True)
        self.setTabBarAutoHide(True)
        self._makers = tuple(make for _, make in pages)
        self._made: dict[int, Page] = {}
        self._places: list[QVBoxLayout] = []
        self._view: View | None = None
        self._theme: Theme | None = None
        for title, _ in pages:
            place = QWidget()
            layout = QVBoxLayout(place)
            layout.setContentsMargins(0, 0, 0, 0)
            self._places.append(layout)
            at = self.addTab(place, title)
            self.setTabToolTip(at, f"Ctrl+{at + 1}")
            bind(self, f"Page {title}", partial(self.go_to, at), f"Ctrl+{at + 1}")
        self.page(0)
        self.currentChanged.connect(lambda at: self.page(at).enter())

    def go_to(self, at: int) -> None:
        """Look at a page, and have the keyboard there."""
        if at == self.currentIndex():
            self.page(at).enter()
        self.setCurrentIndex(at)

    def begin_at(self, at: int) -> None:
        """Turn to a page without making it: until somebody does, its place says that it comes."""
        with QSignalBlocker(self):
            self.setCurrentIndex(at)
        if at not in self._made:
            comes = QLabel(f"{self.tabText(at)} …", alignment=Qt.AlignmentFlag.AlignCenter)
            mark(comes, "note")
            self._places[at].addWidget(comes)

    def page(self, at: int) -> Page:
        """A page, made by now."""
        if at not in self._made:
            self._made[at] = page = self._makers[at]()
            assert isinstance(page, QWidget)
            if self._theme is not None:
                page.set_theme(self._theme)
            if self._view is not None:
                page.show_view(self._view)
            while (comes := self._places[at].takeAt(0)) is not None:
                cast("QWidget", comes.widget()).deleteLater()
            self._places[at].addWidget(page)
            page.show()
        return self._made[at]

    @property
    def made(self) -> Mapping[int, Page]:
        """The pages that somebody has looked at, by their place."""
        return self._made

    @property
    def present(self) -> Page:
        """The page that is seen."""
        return self.page(self.currentIndex())

    def show_view(self, view: View) -> None:
        self._view = view
        for page in self._made.values():
            page.show_view(view)

    def set_theme(self, theme: Theme) -> None:
        self._theme = theme
        for page in self._made.values():
            page.set_theme(theme)

    def refresh(self) -> None:
        """Let what can be seen move."""
        if (page := self._made.get(self.currentIndex())) is not None:
            page.refresh()


MEASURE, CAMPAIGN, EXPLORE, RUNS = range(4)
"""Places of the pages."""


class Book(Pages):
    """Knows each page by its name; the pages know nothing of each other."""

    ordered = Signal(object)
    """An `Order` of the campaign that the session shall carry out now."""

    def __init__(
        self, protocol: Measurement, link: Link, config: BenchConfig, settings: QSettings, theme: Theme
    ) -> None:
        overlay = Overlay(amplifier=config.amplifier.map)
        measure = MeasurePage(
            protocol,
            link.feed,
            overlay,
            config.amplifier.map,
            lambda: link.session.bench,
            Presets(presets_path()),
            theme,
        )
        makers: tuple[tuple[str, Callable[[], Any]], ...] = (
            ("Measure", lambda: measure),
            ("Campaign", self._make_campaign),
            ("Explore", self._make_explore),
            ("Runs", self._make_runs),
        )
        super().__init__(makers)
        self.measure, self.overlay = measure, overlay
        self._link, self._settings, self._first_theme = link, settings, theme
        self._amplifier = config.amplifier
        self._jobs = Jobs("pages", self)

    # -- the pages -----------------------------------------------------------------------------------------------------

    @property
    def campaign(self) -> CampaignPage:
        """The page about the measurements of one specimen, made by now."""
        return cast("CampaignPage", self.page(CAMPAIGN))

    @property
    def explore(self) -> ExplorePage:
        """The page about the model, made by now."""
        return cast("ExplorePage", self.page(EXPLORE))

    @property
    def runs(self) -> RunsPage:
        """The page about the runs of the folder, made by now."""
        return cast("RunsPage", self.page(RUNS))

    @property
    def folder(self) -> Path:
        """Where run files go."""
        return Path(self.measure.panel.folder.text().strip()).expanduser()

    @property
    def specimen(self) -> str:
        return self.measure.panel.specimen.text().strip()

    # -- what the window does with them --------------------------------------------------------------------------------

    def make_ahead(self) -> None:
        """Make the pages before somebody looks at them. What they import takes a second, which the window does not wait."""

        def load() -> None:
            for name in ("campaign", "explore", "runs"):
                importlib.import_module(f"app.gui.{name}.page")

        def make(_: object) -> None:
            for at in sorted(range(RUNS + 1), key=lambda at: at != self.currentIndex()):  # first what is looked at
                QTimer.singleShot(0, self, partial(self._make, at))

        self._jobs.do(load, make)

    def beside(self, work: Callable[[], object]) -> None:
        """Do something that reads files, beside the window."""
        self._jobs.do(work)

    def back(self) -> None:
        """A step back on the page that is seen."""
        if self.currentIndex() == RUNS:
            self.runs.back()
        elif self.currentIndex() == CAMPAIGN:
            self.campaign.back()

    def writing(self, path: Path | None) -> None:
        """The file that this program is writing."""
        if RUNS in self.made:
            self.runs.writing(path)
        if CAMPAIGN in self.made:
            self.campaign.desk.writing = path

    def restore(self, folder: Path | None, specimen: str | None, asked: bool) -> None:
        """Be as it was; a folder or specimen that is given counts more, and a protocol that was `asked` for is to be seen."""
        self.measure.restore(self._settings, form=not asked)
        splitters.restore(self.measure, self._settings)
        last = str(self._settings.value("window/page", ""))
        if not asked and last.isdigit() and int(last) < self.count():
            self.begin_at(int(last))
        kept = self._settings.value("run/folder", "runs")
        self.measure.panel.folder.setText(str(folder if folder is not None else kept))
        self.measure.panel.specimen.setText(
            str(specimen if specimen is not None else self._settings.value("run/specimen", ""))
        )

    def save(self) -> None:
        """Remember how everything is."""
        self._settings.setValue("run/folder", self.measure.panel.folder.text())
        self._settings.setValue("run/specimen", self.measure.panel.specimen.text())
        self._settings.setValue("window/page", self.currentIndex())
        self.measure.save(self._settings)
        for made in self.made.values():
            splitters.save(cast("QWidget", made), self._settings)
        for page in self._that_can("save"):
            page.save(self._settings)

    def end(self) -> None:
        """End what works beside the window."""
        self._jobs.close()
        self.overlay.close()
        self.measure.end()
        for page in self._that_can("end"):
            page.end()

    # -- inside --------------------------------------------------------------------------------------------------------

    def _make(self, at: int) -> None:
        if self._jobs.closed:  # what is made after the end would not be ended
            return
        waited = at == self.currentIndex() and at not in self.made
        page = self.page(at)
        if waited:
            page.enter()

    def _that_can(self, what: str) -> Iterator[Any]:
        return (page for at, page in self.made.items() if at != MEASURE and hasattr(page, what))

    def _make_campaign(self) -> CampaignPage:
        from app.gui.campaign.page import CampaignPage

        desk = CampaignDesk(lambda: self._link.session.bench, self.overlay.amplifier)
        self._link.listeners.append(desk.hear)
        page = CampaignPage(
            desk, self._link.feed, self.overlay, lambda: (self.folder, self.specimen), self._first_theme
        )
        desk.setParent(page)
        desk.ordered.connect(self._take)
        page.open_asked.connect(self._open)
        page.restore(self._settings)
        splitters.restore(page, self._settings)
        return page

    def _make_explore(self) -> ExplorePage:
        from app.explore.fit import fit_runs  # not seen when the window opens
        from app.gui.explore.page import ExplorePage

        page = ExplorePage(self._first_theme, fit_runs)
        page.restore(self._settings)
        splitters.restore(page, self._settings)
        return page

    def _make_runs(self) -> RunsPage:
        from app.gui.runs.page import RunsPage

        page = RunsPage(lambda: self.folder, lambda: self.specimen, self._amplifier, self.overlay, self._first_theme)
        page.explore_asked.connect(self._lay_over)
        splitters.restore(page, self._settings)
        return page

    def _take(self, order: Order) -> None:
        self.ordered.emit(order)

    def _open(self, path: Path) -> None:
        self.setCurrentIndex(RUNS)
        self.runs.open_path(path)

    def _lay_over(self, paths: list[Path]) -> None:
        self.setCurrentIndex(EXPLORE)
        self.explore.lay_over(paths)
