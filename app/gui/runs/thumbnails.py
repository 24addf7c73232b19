"""Thumbnails of runs: read in the background for the rows that are visible, drawn from memory."""

from pathlib import Path

from PySide6.QtCore import QObject, QPointF, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QGuiApplication, QPen, QPixmap, QPolygonF

from app.archive import NO_SKETCH, RunSummary, Sketch, read_sketch
from app.gui.face import painting, px, tokens
from app.gui.widgets import BackgroundWorker

SIZE = QSize(88, 36)
MAX_LINE_POINTS = 2 * SIZE.width()
MAX_DOTS = 30
"""More points are a line without dots."""
MAX_WANTED = 60
"""Rows that wait to be read; the last asked for come first."""
SETTLE_MS = 40
"""Delay between the first request and the reading: a list that is scrolled asks for rows that it leaves at once."""


class Thumbnails(QObject):
    """Gives the picture of a run at once if it was read, else an empty one, and reads it.

    Args:
        parent: owner.
    """

    changed = Signal()
    """Emitted when further runs have been read."""

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._sketches: dict[tuple[Path, int], Sketch] = {}
        self._pixmaps: dict[tuple[Path, int, int, bool], QPixmap] = {}
        self._wanted: dict[tuple[Path, int], None] = {}
        self._timer = QTimer(self, singleShot=True, interval=SETTLE_MS)
        self._timer.timeout.connect(self._read)
        self._worker = BackgroundWorker("thumbnails", self, self._timer.stop)

    def pixmap(self, folder: Path, run: RunSummary) -> QPixmap:
        """Return the thumbnail of a run."""
        key = folder / run.path, run.modified_ns
        sketch = self._sketches.get(key)
        if sketch is None and run.readable:
            self._wanted.pop(key, None)
            self._wanted[key] = None
            if not self._timer.isActive():
                self._timer.start()
        if sketch is None:
            return self._drawn((Path(), 0), NO_SKETCH)
        return self._drawn(key, sketch)

    def _read(self) -> None:
        if self._worker.pending:
            self._timer.start()
            return
        wanted, self._wanted = [*self._wanted][-MAX_WANTED:], {}
        self._worker.submit(lambda: {key: _read_sketch(key[0]) for key in reversed(wanted)}, self._on_read)

    def _on_read(self, sketches: dict[tuple[Path, int], Sketch]) -> None:
        self._sketches |= sketches
        self.changed.emit()

    def _drawn(self, key: tuple[Path, int], sketch: Sketch) -> QPixmap:
        at = (*key, px(SIZE.width()), tokens().dark)
        if at not in self._pixmaps:
            self._pixmaps[at] = _draw(sketch)
        return self._pixmaps[at]


def _read_sketch(path: Path) -> Sketch:
    """Return the points of a run in a unit square; empty if the file cannot be read, which the list reports."""
    try:
        return read_sketch(path, MAX_LINE_POINTS)
    except Exception:  # noqa: BLE001 - a run without a thumbnail is listed all the same
        return NO_SKETCH


def _draw(sketch: Sketch) -> QPixmap:
    ratio, width, height = QGuiApplication.primaryScreen().devicePixelRatio(), px(SIZE.width()), px(SIZE.height())
    pixmap = QPixmap(round(width * ratio), round(height * ratio))
    pixmap.setDevicePixelRatio(ratio)
    pixmap.fill(Qt.GlobalColor.transparent)
    if sketch is NO_SKETCH:
        return pixmap
    colors = tokens()
    places = [QPointF(4 + (width - 8) * x, height - 6 - (height - 12) * y) for x, y in zip(*sketch, strict=True)]
    with painting(pixmap) as painter:
        painter.setPen(QPen(QColor(colors.line), 1))
        painter.drawLine(0, height - 3, width, height - 3)
        painter.setPen(QPen(QColor(colors.model), 1.25))
        painter.drawPolyline(QPolygonF(places))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(colors.ink))
        for place in places if len(places) <= MAX_DOTS else ():
            painter.drawEllipse(place, 1.5, 1.5)
    return pixmap
