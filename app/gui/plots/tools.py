"""Plot tools: zoom, cursor read-out, marker, context menu, and files of picture and data; the same on every plot."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QObject, QPoint, QPointF, Qt
from PySide6.QtWidgets import QLabel

from app.common import pluralize
from app.gui.face import Tokens
from app.gui.plots.copy import PlotCopyButtons
from app.gui.plots.items import ScatterItem
from app.gui.plots.zoom import ZoomBox
from app.gui.widgets import ACTIONS, Menu, Mode, add_actions, choose_files, configure
from model import Array

CLOSER, FURTHER = 0.7, 1 / 0.7
MARGIN = 6
LOG_TEXTS = ("Logarithmic x axis", "Logarithmic y axis")


class LogAxes(Protocol):
    """Plot with axes that can be logarithmic."""

    LOG_AXES: tuple[bool, bool]

    @property
    def log_axes(self) -> tuple[bool, bool]: ...

    def set_log_axes(self, x: bool, y: bool) -> None: ...


class PlotTools(QObject):
    """Tools of one canvas.

    Args:
        canvas: a pyqtgraph view.
        plots: its plots, the first of which has the marker.
        copying: copies picture and numbers.
        fill_menu: function that adds entries to the context menu.
        log_axes: plot with optional logarithmic axes; None without one.
    """

    def __init__(
        self,
        canvas: Any,
        plots: Sequence[Any],
        copying: PlotCopyButtons,
        fill_menu: Callable[[Menu], None],
        log_axes: LogAxes | None = None,
    ) -> None:
        super().__init__(canvas)
        self._canvas, self._plots, self._copying, self._fill_menu = canvas, list(plots), copying, fill_menu
        self.label = configure(QLabel("", canvas), "plot.read-out", kind="read-out")
        self.label.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.label.hide()
        self._marker: pg.InfiniteLine | None = None
        self._marked: tuple[Array, Array, int] | None = None
        """x and y of the marked series in view coordinates, and the index of the marked point."""
        self._marker_color = "#808080"
        self.cursors: list[pg.InfiniteLine] = []
        """One vertical line through all plots of the canvas, at the pointer; created when first used."""
        self.units: Sequence[str] = ()
        """Units of the plots of a canvas with several, whose axes have no names."""
        self._log = log_axes
        canvas.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        canvas.customContextMenuRequested.connect(lambda at: self.make_menu().popup(canvas.mapToGlobal(at)))
        canvas.scene().sigMouseMoved.connect(self._on_mouse_moved)
        canvas.installEventFilter(self)
        canvas.viewport().installEventFilter(self)
        add_actions(
            canvas,
            {
                "plot.whole": self.show_whole,
                "plot.closer": lambda: self.zoom(CLOSER),
                "plot.further": lambda: self.zoom(FURTHER),
                "plot.peak": self.mark_peak,
                "plot.marker-left": lambda: self.move_marker(-1),
                "plot.marker-right": lambda: self.move_marker(1),
                "plot.save-picture": partial(
                    self._choose_file, "picture", "Pictures (*.png)", "plot.png", self._write_picture
                ),
                "plot.save-data": partial(self._choose_file, "data", "Tables (*.tsv)", "plot.tsv", self._write_data),
            },
        )
        if log_axes is not None:
            add_actions(canvas, {"plot.log-x": lambda: self.toggle_log(0), "plot.log-y": lambda: self.toggle_log(1)})

    def toggle_log(self, axis: int) -> None:
        """Make the x axis (0) or the y axis (1) logarithmic, or linear again."""
        if self._log is None or not self._log.LOG_AXES[axis]:
            return
        x, y = self._log.log_axes
        self._log.set_log_axes(x is not (axis == 0), y is not (axis == 1))
        self._remove_marker()
        hidden = sum(item.hidden_count for item in self._plots[0].items if isinstance(item, ScatterItem))
        if hidden:
            self._show_text(f"{pluralize(hidden, 'point')} at zero or below: not on a logarithmic axis")

    def apply_theme(self, theme: Tokens) -> None:
        """Apply a theme."""
        self._marker_color = theme.accent
        if self._marker is not None:
            self._marker.setPen(pg.mkPen(theme.accent, width=1, style=Qt.PenStyle.DashLine))

    # -- zoom --------------------------------------------------------------------------------------------------------

    @property
    def boxes(self) -> list[ZoomBox]:
        """The plots' view boxes that zoom."""
        return [box for box in (plot.getViewBox() for plot in self._plots) if isinstance(box, ZoomBox)]

    def show_whole(self) -> None:
        """Show everything, and remove the marker."""
        for box in self.boxes:
            box.show_whole()
        self._remove_marker()

    def zoom(self, factor: float) -> None:
        """Scale the visible range."""
        for box in self.boxes:
            box.zoom(factor)

    # -- read-out and marker -----------------------------------------------------------------------------------------

    def mark_peak(self) -> None:
        """Put the marker on the highest visible point."""
        (left, right), (bottom, top) = self._plots[0].getViewBox().viewRange()
        best: tuple[float, Array, Array, int] | None = None
        for x, y in self._visible_series():
            there = np.flatnonzero((x >= left) & (x <= right) & (y >= bottom) & (y <= top))
            if there.size and (best is None or y[there].max() > best[0]):
                at = int(there[y[there].argmax()])
                best = (float(y[at]), x, y, at)
        if best is not None:
            self._mark(*best[1:])

    def move_marker(self, steps: int) -> None:
        """Move the marker along its curve."""
        if self._marked is not None:
            x, y, at = self._marked
            self._mark(x, y, min(max(at + steps, 0), x.size - 1))

    def _mark(self, x: Array, y: Array, at: int) -> None:
        self._marked = (x, y, at)
        plot = self._plots[0]
        if self._marker is None:
            pen = pg.mkPen(self._marker_color, width=1, style=Qt.PenStyle.DashLine)
            self._marker = pg.InfiniteLine(float(x[at]), angle=90, pen=pen)
            plot.addItem(self._marker, ignoreBounds=True)
        self._marker.setValue(float(x[at]))
        self._show_text(f"marker: {self.describe(plot, float(x[at]), float(y[at]))}")

    def _remove_marker(self) -> None:
        if self._marker is not None:
            self._plots[0].removeItem(self._marker)
        self._marker = self._marked = None
        self._show_text("")

    def _visible_series(self) -> list[tuple[Array, Array]]:
        """Return the finite points of every visible curve and scatter of the first plot, in view coordinates, rising in x."""
        series = []
        for item in self._plots[0].items:
            if not isinstance(item, pg.PlotCurveItem | pg.ScatterPlotItem | pg.PlotDataItem) or not item.isVisible():
                continue
            x, y = item.getData()
            if x is None or not len(x):
                continue
            x, y = np.asarray(x, float) + item.pos().x(), np.asarray(y, float)
            there = np.isfinite(x) & np.isfinite(y)
            order = np.argsort(x[there], kind="stable")
            if there.any():
                series.append((x[there][order], y[there][order]))
        return series

    @staticmethod
    def describe(plot: Any, x: float, y: float) -> str:
        """Return a place as text in the units of the axes."""
        texts = []
        for side, value in (("bottom", x), ("left", y)):
            axis = plot.getAxis(side)
            shown = (10.0**value if axis.logMode else value) * axis.scale
            _, _, unit = str(axis.labelText).rpartition("(")
            texts.append(f"{shown:.5g} {unit.removesuffix(')') if unit.endswith(')') else ''}".strip())
        return ",  ".join(texts)

    def _on_mouse_moved(self, at: QPointF) -> None:
        if self._marked is not None:
            return
        for plot in self._plots:
            box = plot.getViewBox()
            if box.sceneBoundingRect().contains(at):
                place = box.mapSceneToView(at)
                self._show_cursor(place.x())
                shared = self._values_at(place.x()) if self.units else ""
                self._show_text(shared or self.describe(plot, place.x(), place.y()))
                return
        self._show_cursor(None)
        self._show_text("")

    def _show_cursor(self, x: float | None) -> None:
        """Draw the cursor through all plots of a canvas with several; None: hide it."""
        if len(self._plots) > 1 and x is not None and not self.cursors:
            for plot in self._plots:
                line = pg.InfiniteLine(
                    x, angle=90, pen=pg.mkPen(self._marker_color, width=1, style=Qt.PenStyle.DotLine)
                )
                plot.addItem(line, ignoreBounds=True)
                self.cursors.append(line)
        for line in self.cursors:
            line.setVisible(x is not None)
            if x is not None:
                line.setValue(x)

    def _values_at(self, x: float) -> str:
        """Return the place of the cursor and the value of the nearest sample in every plot."""
        axis = self._plots[-1].getAxis("bottom")
        texts = [f"{x * axis.scale:.5g} {'ms' if axis.scale == 1000.0 else 's'}"]
        for plot, unit in zip(self._plots, self.units, strict=True):
            for item in plot.items:
                if isinstance(item, pg.PlotCurveItem) and item.isVisible():
                    places, values = item.getData()
                    if places is not None and len(places):
                        texts.append(f"{values[int(np.abs(places + item.pos().x() - x).argmin())]:.5g} {unit}")
                        break
        return ",  ".join(texts) if len(texts) > 1 else ""

    def _show_text(self, text: str) -> None:
        self.label.setText(text)
        self.label.setVisible(bool(text))
        if text:
            self.label.adjustSize()
            self.label.move(QPoint(MARGIN, self._canvas.height() - self.label.height() - 2))
            self.label.raise_()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Leave and self._marked is None:
            self._show_cursor(None)
            self._show_text("")
        elif event.type() == QEvent.Type.MouseButtonDblClick and self.boxes:
            self.show_whole()
        return super().eventFilter(watched, event)

    # -- menu and files ----------------------------------------------------------------------------------------------

    def make_menu(self) -> Menu:
        """Return the context menu."""
        menu = Menu(self._canvas)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        zooming = ("plot.whole", "plot.closer", "plot.further") if self.boxes else ()
        menu.add_named(self._canvas, (*zooming, "plot.peak"))
        self._fill_menu(menu)
        self._add_log_axes(menu)
        menu.addSeparator()
        menu.add_named(
            self._canvas, [f"plot.{what}-{kind}" for what in ("copy", "save") for kind in ("picture", "data")]
        )
        return menu

    def _add_log_axes(self, menu: Menu) -> None:
        if self._log is None:
            return
        menu.addSeparator()
        for axis, name in enumerate(("plot.log-x", "plot.log-y")):
            action = menu.addAction(f"{LOG_TEXTS[axis]}\t{ACTIONS[name].shortcut}", partial(self.toggle_log, axis))
            action.setCheckable(True)
            action.setChecked(self._log.log_axes[axis])
            action.setEnabled(self._log.LOG_AXES[axis])

    def _choose_file(self, content: str, kinds: str, name: str, write: Callable[[list[Path]], None]) -> None:
        choose_files(self._canvas, f"Save the {content} of this plot", write, kinds, name, Mode.AnyFile)

    def _write_picture(self, paths: list[Path]) -> None:
        path = paths[0] if paths[0].suffix else paths[0].with_suffix(".png")
        self._report(self._copying.picture().save(str(path)), path)

    def _write_data(self, paths: list[Path]) -> None:
        path, written = paths[0] if paths[0].suffix else paths[0].with_suffix(".tsv"), False
        with suppress(OSError):
            written = path.write_text(self._copying.table(), encoding="utf-8") > 0
        self._report(written, path)

    def _report(self, written: bool, path: Path) -> None:
        self._show_text(f"{path} is written" if written else f"{path} cannot be written; choose another folder")
