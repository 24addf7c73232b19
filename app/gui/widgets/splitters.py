"""How a page's room is divided, kept between starts: every splitter that has a name, under that name."""

from collections.abc import Iterator

from PySide6.QtCore import QByteArray, QSettings
from PySide6.QtWidgets import QSplitter, QWidget


def restore_splitters(page: QWidget, settings: QSettings) -> None:
    """Divide a page as it was divided last."""
    for splitter in _named_splitters(page):
        state = settings.value(splitter.objectName())
        if isinstance(state, QByteArray):
            splitter.restoreState(state)


def save_splitters(page: QWidget, settings: QSettings) -> None:
    """Remember how a page is divided."""
    for splitter in _named_splitters(page):
        settings.setValue(splitter.objectName(), splitter.saveState())


def _named_splitters(page: QWidget) -> Iterator[QSplitter]:
    every = page.findChildren(QSplitter)
    yield from (each for each in ([page, *every] if isinstance(page, QSplitter) else every) if each.objectName())
