"""Files that are dropped on a widget from a file manager."""

from collections.abc import Callable, Collection
from pathlib import Path
from typing import cast

from PySide6.QtCore import QEvent, QObject
from PySide6.QtGui import QDropEvent
from PySide6.QtWidgets import QWidget

RUN_SUFFIXES = frozenset({".h5"})
TABLE_SUFFIXES = frozenset({".csv", ".tsv", ".txt", ".dat", ".mat"})


class FileDrops(QObject):
    """Accepts files that are dropped on a widget.

    Args:
        widget: the files are dropped on it.
        suffixes: of the files that are accepted.
        receive: takes their paths.
        own: accept drags that begin in this program.
    """

    def __init__(
        self, widget: QWidget, suffixes: Collection[str], receive: Callable[[list[Path]], object], own: bool = True
    ) -> None:
        super().__init__(widget)
        self._suffixes, self._receive, self._own = suffixes, receive, own
        widget.setAcceptDrops(True)
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() not in (QEvent.Type.DragEnter, QEvent.Type.Drop):
            return super().eventFilter(watched, event)
        drop = cast("QDropEvent", event)
        every = [Path(url.toLocalFile()) for url in drop.mimeData().urls() if url.isLocalFile()]
        paths = [path for path in every if path.suffix.lower() in self._suffixes]
        if event.type() == QEvent.Type.Drop and paths:
            self._receive(paths)
        if event.type() == QEvent.Type.Drop or (paths and (self._own or drop.source() is None)):
            drop.acceptProposedAction()
        return True
