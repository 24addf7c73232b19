"""Tools of a plot: two cursors with their read-out, zoom, context menu, and files of picture and data."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QEvent, QMarginsF, QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QGuiApplication, QPageSize, QPainter, QPdfWriter, QPen, QPixmap
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QGraphicsLineItem, QLabel, QPushButton, QWidget

from app.common import number_text
from app.gui.face import icon, px, set_length, text_font
from app.gui.plots.picture import Layer, color_of, unit_of
from app.gui.widgets import ACTIONS, Menu, Mode, add_actions, choose_file, configure, show_text, tooltip
from model import format_with_uncertainty

if TYPE_CHECKING:
    from app.gui.plots.chart import Chart
    from app.gui.plots.drawn_panel import DrawnPanel

CLOSER, FURTHER = 0.7, 1 / 0.7
SCREEN_DPI, POINTS_PER_INCH = 96, 72
NEAR_PX = 9
"""Distance of the pointer from a point that it touches."""

MAX_ROWS, MAX_DIFFERENCES = 5, 2
LOG_TEXTS = ("Logarithmic x axis", "Logarithmic y axis")
BUTTONS = (("zoom", "plot.whole"), ("cursor", "plot.peak"), ("copy", "plot.copy-picture"), ("more", ""))
"""Icon and action of each button in the head of a plot; the last one opens the menu."""


class PlotTools(QObject):
    """Tools of one plot: a click sets the cursor, a click with Shift the second one; a click on a point picks it."""

    places_changed = Signal(list)
    """Places of the cursors of a plot that `follows` the pointer, in the unit of its horizontal axis."""
    follows = False
    """Whether a cursor follows the pointer until one is set, and values are shown elsewhere, by `places_changed`."""

    def __init__(self, chart: Chart) -> None:
        super().__init__(chart)
        self._chart, canvas = chart, chart.canvas
        self.files = PlotFiles(chart, self.show_text)
        self.label = configure(QLabel("", canvas), "plot.read-out", kind="read-out", textFormat=Qt.TextFormat.PlainText)
        self.label.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.label.hide()
        self.cursors: list[float] = []
        """Places of the cursors on the horizontal axis, in its unit; at most two."""
        self.fill_menu: Callable[[Menu], None] = lambda _menu: None
        """Adds entries to the context menu."""
        self.values_at: Callable[[float], list[tuple[str, float, float, str]]] = self._values
        """Returns name, value, standard error and unit of each series at a value of x."""
        self._lines: list[QGraphicsLineItem] = []
        self._at: float | None = None
        self._pointed = ""
        commands: dict[str, Callable[[], object]] = {
            "plot.whole": chart.show_whole,
            "plot.closer": lambda: chart.zoom(CLOSER),
            "plot.further": lambda: chart.zoom(FURTHER),
            "plot.peak": self.mark_peak,
            "plot.marker-left": lambda: self.move_cursor(-1),
            "plot.marker-right": lambda: self.move_cursor(1),
            "plot.second": self.keep_cursor,
            "plot.log-x": lambda: self.toggle_log(0),
            "plot.log-y": lambda: self.toggle_log(1),
            "plot.copy-picture": lambda: QGuiApplication.clipboard().setPixmap(self.files.picture()),
            "plot.copy-data": lambda: QGuiApplication.clipboard().setText(chart.table()),
            "plot.save-picture": self.files.choose_picture,
            "plot.save-data": self.files.choose_data,
        }
        add_actions(canvas, commands)
        self.buttons = []
        for name, action in BUTTONS:
            button = configure(
                QPushButton(), f"plot.{name}", kind="tool", toolTip=tooltip(action) if action else "More"
            )
            button.setIcon(icon(name, "text2"))
            set_length(button, icon=16)
            button.setAccessibleName(ACTIONS[action].text if action else "more about this plot")
            button.clicked.connect(commands.get(action, partial(self._popup, button)))
            button.setFocusPolicy(Qt.FocusPolicy.TabFocus if not action else Qt.FocusPolicy.NoFocus)
            self.buttons.append(button)
        canvas.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        canvas.customContextMenuRequested.connect(lambda at: self.make_menu().popup(canvas.mapToGlobal(at)))
        canvas.scene().sigMouseMoved.connect(self._on_mouse_moved)
        canvas.scene().sigMouseClicked.connect(self._on_clicked)
        canvas.installEventFilter(self)
        canvas.viewport().installEventFilter(self)

    # -- cursors -----------------------------------------------------------------------------------------------------

    def set_cursor(self, x: float, second: bool = False) -> None:
        """Set the cursor, or the second one, to a place on the horizontal axis."""
        self.cursors = [*self.cursors[:1], x] if second and self.cursors else [x, *self.cursors[1:]]
        self.update_read_out()
        if not second:
            self._chart.cursor_moved.emit(x)

    @property
    def places(self) -> list[float]:
        """Places of the cursors, or of the pointer where the cursor follows it."""
        return self.cursors or ([self._at] if self.follows and self._at is not None else [])

    def keep_cursor(self) -> None:
        """Leave the second cursor where the cursor is, to read differences from there."""
        if self.cursors:
            self.cursors = [self.cursors[0]] * 2
            self.update_read_out()

    def clear_cursors(self) -> None:
        self.cursors, self._at, self._pointed = [], None, ""
        self.update_read_out()

    def mark_peak(self) -> None:
        """Set the cursor to the highest visible point of the first layer."""
        for layer in self._main_layers():
            (low, high), x = self._visible_x(), layer.x
            there = np.flatnonzero(np.isfinite(layer.y) & (x >= low) & (x <= high))
            if there.size:
                self.set_cursor(float(x[there[layer.y[there].argmax()]]))
                return

    def move_cursor(self, steps: int) -> None:
        """Move the cursor along the points of the first layer."""
        if not self.cursors:
            self.mark_peak()
            return
        for layer in self._main_layers():
            x = np.unique(layer.x[np.isfinite(layer.x) & np.isfinite(layer.y)])
            at = int(np.abs(x - self.cursors[0]).argmin()) + steps
            self.set_cursor(float(x[min(max(at, 0), x.size - 1)]))
            return

    def _main_layers(self) -> list[Layer]:
        """The layers that the cursor goes along: measured points first."""
        layers = [each for each in self._chart.panels[0].layers if each.copied and np.isfinite(each.y).any()]
        return sorted(layers, key=lambda each: not each.symbol)

    def _visible_x(self) -> tuple[float, float]:
        low, high = self._chart.panels[0].box.viewRange()[0]
        return (10.0**low, 10.0**high) if self._chart.log_axes[0] else (low, high)

    def _draw_lines(self) -> None:
        for line in self._lines:
            if line.scene() is not None:
                line.scene().removeItem(line)
        self._lines = []
        for number, x in enumerate(self.places):
            for panel in self._chart.panels:
                across = panel.to_pixels(x, 1.0)[0][0]
                if 0 <= across <= panel.box.width():
                    line = QGraphicsLineItem(across, 0, across, panel.box.height(), panel.box)
                    style = Qt.PenStyle.DashLine if number else Qt.PenStyle.SolidLine
                    line.setPen(QPen(color_of("accent_text"), 1.5, style))
                    line.setZValue(8)
                    self._lines.append(line)

    def update_read_out(self) -> None:
        """Draw the cursors, and show the values at them or under the pointer."""
        self._draw_lines()
        at = self.cursors[0] if self.cursors else self._at
        text = self._pointed
        if self.follows:
            self.places_changed.emit(self.places)
        elif not text and at is not None and self._chart.panels:
            text = "\n".join(self._rows(at))
            if len(self.cursors) > 1:
                text += "\n" + "\n".join(self._differences(*self.cursors))
        self.show_text(text)

    def _values(self, x: float) -> list[tuple[str, float, float, str]]:
        """Return name, value, standard error and unit of each visible layer at a place."""
        low, high = self._visible_x()
        reach = (high - low) * px(NEAR_PX) / max(self._chart.panels[0].box.width(), 1.0)
        found: list[tuple[str, float, float, str]] = []
        for panel in self._chart.panels:
            for layer in panel.layers:
                name = layer.label or layer.group or layer.name
                is_mark = not layer.copied and layer.line is None
                seen = is_mark or name in {each[0] for each in found}
                value = None if seen else layer.value_at(x, reach)
                if value is not None and np.isfinite(value[0]) and (panel is self._chart.panels[0] or layer.symbol):
                    found.append((name, *value, unit_of(panel.panel.title)))
        return found[:MAX_ROWS]

    def _x_text(self, x: float) -> str:
        scale = self._chart.panels[0].axes["bottom"].scale_by
        return f"{number_text(x * scale)} {unit_of(self._chart.picture.x_title)}".strip()

    def _rows(self, x: float) -> list[str]:
        rows = [self._x_text(x)]
        for name, value, error, of in self.values_at(x):
            known = np.isfinite(error) and error > 0
            text = format_with_uncertainty(value, error, of) if known else f"{number_text(value, 4)} {of}"
            rows.append(f"{name}: {text}".strip())
        return rows

    def _differences(self, first: float, second: float) -> list[str]:
        rows = [f"Δ {self._x_text(first - second)}"]
        before = {name: value for name, value, _, _ in self.values_at(second)}
        for name, value, _, of in self.values_at(first):
            if name in before:
                ratio = f", ratio {number_text(value / before[name], 4)}" if before[name] else ""
                rows.append(f"Δ {name}: {number_text(value - before[name], 3)} {of}{ratio}")
        return rows[: 1 + MAX_DIFFERENCES]

    def show_text(self, text: str) -> None:
        """Show a text at the top left of the plot; empty: none."""
        show_text(self.label, text)
        if text and self._chart.panels:
            self.label.adjustSize()
            corner = self._chart.canvas.mapFromScene(self._chart.panels[0].box.sceneBoundingRect().topLeft())
            self.label.move(corner.x() + px(8), corner.y() + px(8))
            self.label.raise_()

    # -- mouse -------------------------------------------------------------------------------------------------------

    def _panel_at(self, at: QPointF) -> tuple[DrawnPanel, QPointF] | None:
        for panel in self._chart.panels:
            if panel.box.sceneBoundingRect().contains(at):
                return panel, panel.box.mapFromScene(at)
        return None

    def _point_at(self, at: QPointF) -> tuple[Layer, int] | None:
        """Return the point under the pointer: its layer and index."""
        found = self._panel_at(at)
        best: tuple[float, Layer, int] | None = None
        if found is not None:
            panel, pixel = found
            for layer in panel.layers:
                if layer.symbol and layer.x.size:
                    away = np.hypot(*(panel.to_pixels(layer.x, layer.y) - (pixel.x(), pixel.y())).T)
                    away = np.where(np.isfinite(away), away, np.inf)
                    nearest = int(away.argmin())
                    if away[nearest] <= px(NEAR_PX) and (best is None or away[nearest] < best[0]):
                        best = float(away[nearest]), layer, nearest
        return None if best is None else best[1:]

    def _on_mouse_moved(self, at: QPointF) -> None:
        found, point = self._panel_at(at), self._point_at(at)
        self._pointed, self._at = "", None
        if point is not None and point[1] < len(point[0].texts):
            text = point[0].texts[point[1]]
            self._pointed = text() if callable(text) else text
        elif found is not None:
            self._at = self._x_at(*found)
        self.update_read_out()

    def _x_at(self, panel: DrawnPanel, pixel: QPointF) -> float:
        low, high = panel.box.viewRange()[0]
        x = low + pixel.x() / max(panel.box.width(), 1.0) * (high - low)
        return float(10.0**x if self._chart.log_axes[0] else x)

    def _on_clicked(self, event: object) -> None:
        at, button = event.scenePos(), event.button()  # type: ignore[attr-defined]  # pyqtgraph has no types
        if button is not Qt.MouseButton.LeftButton or event.double():  # type: ignore[attr-defined]
            return
        second = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)  # type: ignore[attr-defined]
        if (point := self._point_at(at)) is not None:
            self._chart.point_picked.emit(point[0].name, point[1])
            self.set_cursor(float(point[0].x[point[1]]), second)
        elif (found := self._panel_at(at)) is not None:
            self.set_cursor(self._x_at(*found), second)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Leave:
            self._pointed, self._at = "", None
            self.update_read_out()
        elif event.type() == QEvent.Type.MouseButtonDblClick:
            self._chart.show_whole()
        return super().eventFilter(watched, event)

    # -- menu and files ----------------------------------------------------------------------------------------------

    def toggle_log(self, axis: int) -> None:
        """Make the x axis (0) or the y axis (1) logarithmic, or linear again."""
        if self._chart.picture.log[axis]:
            x, y = self._chart.log_axes
            self._chart.set_log_axes(x is not (axis == 0), y is not (axis == 1))

    def make_menu(self) -> Menu:
        canvas = self._chart.canvas
        menu = Menu(canvas)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        menu.add_named(canvas, ("plot.whole", "plot.closer", "plot.further", "plot.peak", "plot.second"))
        self.fill_menu(menu)
        if any(self._chart.picture.log):
            menu.addSeparator()
            for axis, name in enumerate(("plot.log-x", "plot.log-y")):
                action = menu.addAction(f"{LOG_TEXTS[axis]}\t{ACTIONS[name].shortcut}", partial(self.toggle_log, axis))
                action.setCheckable(True)
                action.setChecked(self._chart.log_axes[axis])
                action.setEnabled(self._chart.picture.log[axis])
        menu.addSeparator()
        menu.add_named(canvas, [f"plot.{what}-{kind}" for what in ("copy", "save") for kind in ("picture", "data")])
        return menu

    def _popup(self, button: QWidget, _checked: bool = False) -> None:
        self.make_menu().popup(button.mapToGlobal(button.rect().bottomLeft()))


class PlotFiles:
    """Picture and table of a plot, as files or for the clipboard; `say` shows a text over the plot."""

    def __init__(self, chart: Chart, say: Callable[[str], object]) -> None:
        self._chart, self._say = chart, say

    def choose_picture(self) -> None:
        """Ask for a file and write the picture."""
        self._choose("picture", self.write_picture, "Pictures (*.png *.svg *.pdf)", "plot.png")

    def choose_data(self) -> None:
        """Ask for a file and write the table."""
        self._choose("data", self.write_data, "Tables (*.tsv)", "plot.tsv")

    def _choose(self, what: str, write: Callable[[Path], object], kinds: str, proposed: str) -> None:
        choose_file(self._chart.canvas, f"Save the {what} of this plot", write, kinds, proposed, Mode.AnyFile)

    def picture(self) -> QPixmap:
        """Return the plot as it is displayed; a plot of simulated data says SIMULATED."""
        shown: QPixmap = self._chart.canvas.viewport().grab()
        self._mark(QPainter(shown))
        return shown

    def _mark(self, painter: QPainter) -> None:
        """Draw the mark of simulated data into a picture, and end the painter."""
        if self._chart.picture.simulated:
            painter.setFont(text_font("caption"))
            width = painter.fontMetrics().horizontalAdvance("SIMULATED") + px(16)
            tag = QRectF(self._chart.canvas.viewport().width() - width - px(12), 0, width, px(20))
            painter.fillRect(tag, color_of("violet"))
            painter.setPen(Qt.GlobalColor.white)
            painter.drawText(tag, Qt.AlignmentFlag.AlignCenter, "SIMULATED")
        painter.end()

    def _draw_lines(self, device: QSvgGenerator | QPdfWriter) -> bool:
        """Draw the plot as lines and text, in its present size; return whether the file could be written."""
        painter = QPainter()
        if not painter.begin(device):
            return False
        canvas = self._chart.canvas
        area = QRectF(canvas.viewport().rect())
        painter.scale(device.logicalDpiX() / SCREEN_DPI, device.logicalDpiY() / SCREEN_DPI)
        painter.fillRect(area, color_of("surface"))
        cached = [
            (item, item.cacheMode())
            for item in canvas.scene().items()
            if item.cacheMode() is not item.CacheMode.NoCache
        ]
        for item, _ in cached:  # a cache is pixels
            item.setCacheMode(item.CacheMode.NoCache)
        canvas.render(painter, area, canvas.viewport().rect())
        for item, mode in cached:
            item.setCacheMode(mode)
        self._mark(painter)
        return True

    def write_picture(self, path: Path) -> None:
        path = path if path.suffix else path.with_suffix(".png")
        size = self._chart.canvas.viewport().size()
        match path.suffix.lower():
            case ".svg":
                drawing = QSvgGenerator()
                drawing.setFileName(str(path))
                drawing.setSize(size)
                drawing.setViewBox(QRectF(QPointF(), size))
                drawing.setResolution(SCREEN_DPI)
                self._report(self._draw_lines(drawing), path)
            case ".pdf":
                paper = QPdfWriter(str(path))
                paper.setPageSize(QPageSize(size * POINTS_PER_INCH / SCREEN_DPI, "plot"))
                paper.setPageMargins(QMarginsF())
                self._report(self._draw_lines(paper), path)
            case _:
                self._report(self.picture().save(str(path)), path)

    def write_data(self, path: Path) -> None:
        path, written = path if path.suffix else path.with_suffix(".tsv"), False
        with suppress(OSError):
            written = path.write_text(self._chart.table(), encoding="utf-8") > 0
        self._report(written, path)

    def _report(self, written: bool, path: Path) -> None:
        self._say(f"{path} is written" if written else f"{path} cannot be written; choose another folder")
