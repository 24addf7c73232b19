"""View box that is zoomed with the wheel or a dragged box, and keeps the zoom while new data arrive."""

from collections.abc import Callable
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import Qt


class ZoomBox(pg.ViewBox):  # type: ignore[misc]  # pyqtgraph has no types
    """Ranges that the program sets are kept as the whole range, and applied unless the user has zoomed.

    Wheel: closer or further away. Left button: a box to zoom into. Middle button: move.
    """

    def __init__(self) -> None:
        self.zoomed, self._by_user = False, False
        self._whole: dict[str, tuple[Any, Any]] = {}
        """Range and padding of each axis as the program set them last."""
        super().__init__(enableMenu=False)
        self.setMouseMode(pg.ViewBox.RectMode)

    def setRange(
        self, rect: Any = None, xRange: Any = None, yRange: Any = None, padding: Any = None, **options: Any
    ) -> None:
        """Set the visible range; while the user has zoomed, the program's is kept for later."""
        if not self._by_user:
            x_range, y_range = xRange, yRange
            if rect is not None:
                x_range, y_range = (rect.left(), rect.right()), (rect.top(), rect.bottom())
            for name, given in (("xRange", x_range), ("yRange", y_range)):
                if given is not None:
                    self._whole[name] = (given, padding)
            if self.zoomed:
                return
        super().setRange(rect, xRange, yRange, padding, **options)

    def show_whole(self) -> None:
        """Show everything again."""
        self.zoomed = False
        for name, (limits, padding) in dict(self._whole).items():
            self.setRange(**{name: limits}, padding=padding)

    def zoom(self, factor: float) -> None:
        """Scale the visible range around its middle; a factor below 1 shows less."""
        if any(self.state["mouseEnabled"]):
            self._as_user(lambda: self.scaleBy((factor, factor)))

    def wheelEvent(self, ev: Any, axis: Any = None) -> None:
        if any(self.state["mouseEnabled"]):
            self._as_user(lambda: super(ZoomBox, self).wheelEvent(ev, axis))
        else:
            ev.ignore()

    def mouseDragEvent(self, ev: Any, axis: Any = None) -> None:
        moves = ev.button() is Qt.MouseButton.MiddleButton
        if not any(self.state["mouseEnabled"]) or not (moves or ev.button() is Qt.MouseButton.LeftButton):
            ev.ignore()
            return
        self.state["mouseMode"] = pg.ViewBox.PanMode if moves else pg.ViewBox.RectMode
        self._as_user(lambda: super(ZoomBox, self).mouseDragEvent(ev, axis), zooms=moves or ev.isFinish())

    def linkedViewChanged(self, view: Any, axis: Any) -> None:
        """Follow a linked view, zoomed or not."""
        by_user, self._by_user = self._by_user, True
        super().linkedViewChanged(view, axis)
        self._by_user = by_user

    def _as_user(self, change: Callable[[], object], zooms: bool = True) -> None:
        self._by_user = True
        try:
            change()
        finally:
            self._by_user = False
        self.zoomed = self.zoomed or zooms
