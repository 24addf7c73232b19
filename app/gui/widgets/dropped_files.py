"""Files that are dropped on a widget from a file manager."""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import cast

from PySide6.QtCore import QEvent, QObject
from PySide6.QtGui import QDropEvent
from PySide6.QtWidgets import QWidget

RUN_SUFFIXES = frozenset({".h5"})
TABLE_SUFFIXES = frozenset({".csv", ".tsv", ".txt", ".dat", ".mat"})

Receivers = Mapping[Collection[str], Callable[[list[Path]], object]]


class FileDrops(QObject):
    """Accepts files that are dropped on a widget.

    Args:
        widget: the files are dropped on it.
        receivers: functions that receive paths, by the suffixes of their files.
        own: accept drags that begin in this program.
    """

    def __init__(self, widget: QWidget, receivers: Receivers, own: bool = True) -> None:
        super().__init__(widget)
        self._receivers, self._own = receivers, own
        widget.setAcceptDrops(True)
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() not in (QEvent.Type.DragEnter, QEvent.Type.Drop):
            return super().eventFilter(watched, event)
        drop = cast("QDropEvent", event)
        paths = [Path(url.toLocalFile()) for url in drop.mimeData().urls() if url.isLocalFile()]
        chosen = [
            (receive, files)
            for suffixes, receive in self._receivers.items()
            if (files := [path for path in paths if path.suffix.lower() in suffixes])
        ]
        if event.type() == QEvent.Type.Drop:
            for receive, files in chosen:
                receive(files)
        if event.type() == QEvent.Type.Drop or (chosen and (self._own or drop.source() is None)):
            drop.acceptProposedAction()
        return True
