"""View box that is zoomed with the wheel or a dragged box, and keeps the zoom while new data arrive."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt

from app.gui.plots.items import CurveItem, ScatterItem, linear_data

MARGIN = 0.04
MAX_DECADES = 6.0
"""Decades of a logarithmic axis at most."""


class ZoomBox(pg.ViewBox):  # type: ignore[misc]  # pyqtgraph has no types
    """Ranges that the program sets are kept as the whole range, and applied unless the user has zoomed.

    They are in the units of the axes; a logarithmic axis begins at the smallest value that is drawn.

    Wheel: closer or further away. Left button: a box to zoom into. Middle button: move.
    """

    def __init__(self) -> None:
        self.zoomed, self._by_user = False, False
        self.log = (False, False)
        """Whether x and y are logarithmic."""
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
            rect, xRange, yRange = None, self._place(0, x_range), self._place(1, y_range)
        super().setRange(rect, xRange, yRange, padding, **options)

    def autoRange(self, padding: Any = None, items: Any = None, item: Any = None) -> None:
        """Show everything that is drawn."""
        if not any(self.log):
            super().autoRange(padding, items, item)
        elif not self.zoomed:
            bounds = self.childrenBoundingRect(items=items)
            linear = ((bounds.left(), bounds.right()), (bounds.top(), bounds.bottom()))
            # Ranges of a logarithmic axis are already coordinates of the view, logarithms of the values.
            x, y = (self._extent(axis) if self.log[axis] else linear[axis] for axis in (0, 1))
            self._as_user(lambda: self.setRange(xRange=x, yRange=y, padding=padding), zooms=False)

    def set_log(self, x: bool, y: bool) -> None:
        """Make the axes logarithmic or linear; the whole range is shown again."""
        self.log = (x, y)
        self.show_whole()

    def _place(self, axis: int, limits: Any) -> Any:
        """Return a range in the coordinates of an axis."""
        if limits is None or not self.log[axis]:
            return limits
        low, high = self._extent(axis)
        if limits[1] > 0:
            high = float(np.log10(limits[1]))
        low = float(np.log10(limits[0])) if limits[0] > 0 else low - (MARGIN * (high - low) if axis else 0.0)
        return (max(low, high - MAX_DECADES), high) if low < high else (high - 1.0, high)

    def _extent(self, axis: int) -> tuple[float, float]:
        """Return the logarithms of the smallest and largest value above zero that is drawn."""
        ends = []
        for item in self.addedItems:
            if item.isVisible() and isinstance(item, CurveItem | ScatterItem | pg.PlotDataItem):
                values = linear_data(item)[axis]
                if values is not None and len(above := values[values > 0]):
                    ends += [float(np.log10(above.min())), float(np.log10(above.max()))]
        low, high = min(ends, default=0.0), max(ends, default=1.0)
        return (low, high) if low < high else (high - 0.5, high + 0.5)

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
        self._as_user(lambda: super(ZoomBox, self).linkedViewChanged(view, axis), zooms=False)

    def _as_user(self, change: Callable[[], object], zooms: bool = True) -> None:
        by_user, self._by_user = self._by_user, True
        try:
            change()
        finally:
            self._by_user = by_user
        self.zoomed = self.zoomed or zooms
