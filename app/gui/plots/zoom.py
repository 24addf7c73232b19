"""View box that is zoomed with the wheel or a dragged box, and keeps the zoom while new data arrive."""

from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import Qt


class ZoomBox(pg.ViewBox):  # type: ignore[misc]  # pyqtgraph has no types
    """Wheel: closer or further away. Left button: a box to zoom into. Middle button: move."""

    def __init__(self, zooms: bool = True) -> None:
        self.zoomed = False
        self._whole: tuple[tuple[float, float], tuple[float, float]] | None = None
        super().__init__(enableMenu=False)
        self.setMouseEnabled(x=zooms, y=zooms)
        self.disableAutoRange()
        self.setDefaultPadding(0)
        self.sigRangeChangedManually.connect(self._on_zoomed)

    def set_whole(self, x: tuple[float, float], y: tuple[float, float]) -> None:
        """Set the whole range; while the user has zoomed, it is kept for later."""
        self._whole = (x, y)
        if not self.zoomed and self.viewRange() != [list(x), list(y)]:
            self.setRange(xRange=x, yRange=y, padding=0)

    def show_whole(self) -> None:
        """Show everything again."""
        self.zoomed = False
        if self._whole is not None:
            self.set_whole(*self._whole)

    def zoom(self, factor: float) -> None:
        """Scale the visible range around its middle; a factor below 1 shows less."""
        if any(self.state["mouseEnabled"]):
            self.scaleBy((factor, factor))
            self.zoomed = True

    def mouseDragEvent(self, ev: Any, axis: Any = None) -> None:
        moves = ev.button() is Qt.MouseButton.MiddleButton
        if not any(self.state["mouseEnabled"]) or not (moves or ev.button() is Qt.MouseButton.LeftButton):
            ev.ignore()
            return
        self.state["mouseMode"] = pg.ViewBox.PanMode if moves else pg.ViewBox.RectMode
        super().mouseDragEvent(ev, axis)

    def _on_zoomed(self) -> None:
        self.zoomed = True
