"""Page host: pages that are created when they are first needed."""

import importlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Protocol, cast

from PySide6.QtCore import QByteArray, QSettings, QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtWidgets import QLabel, QSplitter, QStackedWidget, QVBoxLayout, QWidget

from app.gui.widgets import BackgroundWorker, clear_layout, column, configure, make_scroll_area
from app.session import WindowState

MEASURE, CAMPAIGN, EXPLORE, RUNS, BENCH, LABORATORY = range(6)
"""Index of each page."""

TITLES = ("Measure", "Campaign", "Explore", "Runs", "Bench", "Laboratory")

PRELOAD_PAUSE_MS = 30
"""Between the creation of two pages."""


class Page(Protocol):
    """Interface of a page: a widget that shows window states."""

    def set_state(self, view: WindowState) -> None: ...

    def tick(self) -> None: ...

    def activate(self) -> None:
        """Take the keyboard focus, without which the page's shortcuts do nothing."""


class PageHost(QStackedWidget):
    """Creates each page when it is first selected or requested; pages do not refer to each other.

    A page may also have `go_back`, `set_active_file` and `save_state`.
    """

    page_created = Signal(object)
    page_selected = Signal(int)
    """A page is visible, or is as soon as it is made."""

    def __init__(self, settings: QSettings) -> None:
        super().__init__()
        self._settings = settings
        self._worker = BackgroundWorker("pages", self)
        self._state: WindowState | None = None
        self._active_file: object = None
        self._factories: list[Callable[[], Page]] = []
        self._layouts: list[QVBoxLayout] = []
        self.created_pages: dict[int, Page] = {}
        """The pages created so far, by index."""
        self.setAccessibleName("pages")
        self.currentChanged.connect(self.page_selected)
        self.currentChanged.connect(lambda index: self.page(index).activate())

    def add_page(self, title: str, make: Callable[[], Page]) -> None:
        """Add a page that is made when it is first needed."""
        place = QWidget()
        place.setAccessibleName(title)
        self._factories.append(make)
        margins = (8, 8, 8, 4) if len(self._factories) > 1 else (0, 0, 0, 0)  # the first one has its own
        self._layouts.append(column(parent=place, margins=margins))
        with QSignalBlocker(self):  # the first one is selected when it is added
            self.addWidget(place)

    def select_page(self, index: int) -> None:
        """Select a page and give it the focus."""
        if index == self.currentIndex():
            self.page(index).activate()
        self.setCurrentIndex(index)

    def show_page_later(self, index: int) -> None:
        """Select a page without creating it; a placeholder is shown until then."""
        with QSignalBlocker(self):
            self.setCurrentIndex(index)
        self.page_selected.emit(index)
        if index not in self.created_pages:
            title = QLabel(f"{TITLES[index]} …", alignment=Qt.AlignmentFlag.AlignCenter)
            self._layouts[index].addWidget(configure(title, kind="note"))

    def page(self, index: int) -> Page:
        """Return a page, created if necessary."""
        if index not in self.created_pages:
            self.created_pages[index] = page = self._factories[index]()
            assert isinstance(page, QWidget)
            for splitter in _named_splitters(page):
                if isinstance(sizes := self._settings.value(splitter.objectName()), QByteArray):
                    splitter.restoreState(sizes)
            if self._state is not None:
                page.set_state(self._state)
            self._tell_active_file(page)
            self.page_created.emit(page)
            clear_layout(self._layouts[index])  # of its placeholder
            # A page keeps its smallest size, and scrolls in a window that is too small for it. It is put into an area that has
            # its size, which would otherwise divide the page's splitters anew, and is visible, so that the page takes the focus.
            area = make_scroll_area(focusPolicy=Qt.FocusPolicy.NoFocus)
            self._layouts[index].addWidget(area)
            area.show()
            self._layouts[index].activate()
            area.setWidget(page)
            page.show()
        return self.created_pages[index]

    @property
    def title(self) -> str:
        """Title of the visible page."""
        return TITLES[self.currentIndex()]

    @property
    def current_page(self) -> Page:
        """The visible page."""
        return self.page(self.currentIndex())

    def set_state(self, view: WindowState) -> None:
        """Show a window state on every page."""
        self._state = view
        for page in self.created_pages.values():
            page.set_state(view)

    def set_active_file(self, path: object) -> None:
        """Inform the pages about the run file that this program is writing."""
        if path != self._active_file:
            self._active_file = path
            for page in self.created_pages.values():
                self._tell_active_file(page)

    def _tell_active_file(self, page: Page) -> None:
        if callable(tell_file := getattr(page, "set_active_file", None)):
            tell_file(self._active_file)

    def tick(self) -> None:
        """Refresh the visible page."""
        if (page := self.created_pages.get(self.currentIndex())) is not None:
            page.tick()

    def go_back(self) -> None:
        """Go one step back on the visible page."""
        if callable(go_back := getattr(self.current_page, "go_back", None)):
            go_back()

    def run_in_background(self, work: Callable[[], object]) -> None:
        """Run a job that reads files in the background."""
        self._worker.submit(work)

    def save_state(self) -> None:
        """Save settings."""
        self._settings.setValue("window/page", self.currentIndex())
        for page in self.created_pages.values():
            for splitter in _named_splitters(cast("QWidget", page)):
                self._settings.setValue(splitter.objectName(), splitter.saveState())
            if callable(save := getattr(page, "save_state", None)):
                save(self._settings)

    def release_pages(self) -> list[QWidget]:
        """Forget the pages other than the first, after `end_all`, and return them to be deleted."""
        return [cast("QWidget", self.created_pages.pop(index)) for index in sorted(self.created_pages) if index]

    def load_pages(
        self, modules: Sequence[str], on_loaded: Callable[[], object], on_made: Callable[[], object]
    ) -> None:
        """Import the modules of pages in the background, which takes a second, and create the pages, the selected one first."""

        def load() -> None:
            for name in modules:
                importlib.import_module(name)

        def make(_: object) -> None:
            on_loaded()
            self._preload_page(self.currentIndex(), on_made)

        self._worker.submit(load, make)

    def _preload_page(self, index: int, on_made: Callable[[], object]) -> None:
        """Create a page, and later the next missing one: in between, the window paints and responds."""
        if self._worker.closed:  # a page created after `end_all` would not be ended
            return
        awaited = index == self.currentIndex() and index not in self.created_pages
        page = self.page(index)
        if awaited and cast("QWidget", page).isVisible():  # not below the welcome page, which has the keyboard
            page.activate()
        missing = next((at for at in range(self.count()) if at not in self.created_pages), None)
        following = on_made if missing is None else partial(self._preload_page, missing, on_made)
        QTimer.singleShot(PRELOAD_PAUSE_MS, self, following)


def _named_splitters(page: QWidget) -> Iterator[QSplitter]:
    every = page.findChildren(QSplitter)
    yield from (each for each in ([page, *every] if isinstance(page, QSplitter) else every) if each.objectName())
