"""The window's pages behind tabs; a single page needs none."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Protocol, cast

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtWidgets import QLabel, QTabWidget, QVBoxLayout, QWidget

from app.gui.form import mark
from app.gui.keys import bind
from app.gui.theme import Theme
from app.view import View


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
