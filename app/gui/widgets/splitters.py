"""Saves and restores the splitter positions of a page, by object name."""

from collections.abc import Iterator

from PySide6.QtCore import QByteArray, QSettings
from PySide6.QtWidgets import QSplitter, QWidget


def restore_splitters(page: QWidget, settings: QSettings) -> None:
    """Restore the saved splitter positions of a page."""
    for splitter in _named_splitters(page):
        state = settings.value(splitter.objectName())
        if isinstance(state, QByteArray):
            splitter.restoreState(state)


def save_splitters(page: QWidget, settings: QSettings) -> None:
    """Save the splitter positions of a page."""
    for splitter in _named_splitters(page):
        settings.setValue(splitter.objectName(), splitter.saveState())


def _named_splitters(page: QWidget) -> Iterator[QSplitter]:
    every = page.findChildren(QSplitter)
    yield from (each for each in ([page, *every] if isinstance(page, QSplitter) else every) if each.objectName())
