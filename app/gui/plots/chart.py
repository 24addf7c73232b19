"""The plot of the window: draws a `Picture` with chips for its layers, tools, and files of picture and data."""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF, QRect, QSize, Qt, Signal
from PySide6.QtGui import QColor, QIcon, QPainter, QPen, QResizeEvent
from PySide6.QtWidgets import QPushButton, QWidget

from app.gui.face import PaintedIcon, Tokens, follow_tokens, px, text_scale
from app.gui.plots.axes import RIGHT_PX, stable_range
from app.gui.plots.drawn_panel import DrawnPanel, place
from app.gui.plots.picture import Layer, Picture, color_of
from app.gui.plots.series import series_as_text
from app.gui.plots.tools import PlotTools
from app.gui.widgets import ElidedLabel, Menu, column, configure, make_label, make_pane, row, set_style_kind, show_text
from model import Series

CHIP_ICON = QSize(18, 14)
LAYERS_TEXT = "Layers {} of {}"
MAX_DECADES = 6.0
"""Decades of a logarithmic axis at most."""


class Chart(QWidget):
    """Panels above each other on one horizontal axis; `show_picture` draws all of them.

    Args:
        name: accessible name for a screen reader.
        headed: whether it has a head with title, chips and buttons.
        zooms: whether it can be zoomed.
    """

    point_picked = Signal(str, int)
    """Name of a layer and index of the point that was clicked."""
    cursor_moved = Signal(float)
    """Place of the cursor in the unit of the horizontal axis."""
    log_changed = Signal(bool)
    """Whether the vertical axis is logarithmic."""
    has_title = True
    """Whether the title of the picture stands in the head."""
    few_tools = False
    """Whether the menu alone has the tools."""
    _scale: float | None = None
    """Text scale at which the plot was last drawn; None before the first time."""

    def __init__(self, name: str, *, headed: bool = True, zooms: bool = True) -> None:
        super().__init__()
        self.canvas = pg.GraphicsLayoutWidget()
        self.canvas.setAccessibleName(f"plot: {name}")
        self.canvas.ci.setSpacing(0)
        self.canvas.setMinimumSize(80, 40)
        self.canvas.viewport().setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)  # nothing is painted below it
        self.picture, self._zooms = Picture(), zooms
        self.panels: list[DrawnPanel] = []
        self.hidden: set[str] = set()
        """Groups of layers that are not shown."""
        self.log_axes = (False, False)
        """Whether x and y are logarithmic."""
        self.chips: dict[str, QPushButton] = {}
        self._ranges: list[tuple[float, float] | None] = []
        self.title_label = make_label(kind="heading", wrap=False)
        self.note_label = configure(ElidedLabel(), kind="note")
        self._chip_row = row(spacing=8)
        self.layers_button = configure(QPushButton(), "plot.layers", kind="choice", accessibleName="layers of the plot")
        self.layers_button.clicked.connect(self._choose_layers)
        self.tools = PlotTools(self)
        self.head_layout = row(
            self.title_label, self._chip_row, self.layers_button, (self.note_label, 1), *self.tools.buttons, spacing=8
        )
        self.head = make_pane(self.head_layout)
        if not headed:  # showing it before it has a parent would open a window
            self.head.hide()
        self.head.setMinimumWidth(80)  # its chips become one button where they have no space
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        configure(self, kind="bar")
        self.canvas_row = row((self.canvas, 1))
        column(self.head, (self.canvas_row, 1), parent=self, margins=(12, 6 if headed else 0, 4, 4), spacing=2)
        follow_tokens(self, self.apply_theme)
        self._scale = text_scale()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.StyleChange and self._scale not in (None, text_scale()):
            self._scale = text_scale()
            self.show_picture(self.picture, force=True)

    # -- contents ----------------------------------------------------------------------------------------------------

    def apply_theme(self, theme: Tokens) -> None:
        self.canvas.setBackground(theme.surface)
        self.show_picture(self.picture, force=True)

    def show_picture(self, picture: Picture, force: bool = False) -> None:
        new_axes = picture.x_title != self.picture.x_title or len(picture.panels) != len(self.panels)
        new_chips = force or [*picture.groups] != [*self.picture.groups]
        self.picture = picture
        if len(picture.panels) != len(self.panels):
            self._make_panels(picture)
        if new_axes:
            self._ranges = [None] * len(self.panels)
            self.panels[0].box.zoomed = False
            self.tools.clear_cursors()
        if new_chips:
            self._make_chips()
        show_text(self.title_label, picture.title if self.has_title else "")
        self.note_label.hint = not picture.alarming
        self.note_label.setText(picture.note)
        for label in (self.title_label, self.note_label):
            label.setToolTip(picture.note)
        set_style_kind(self.note_label, "fault" if picture.alarming else "note")
        self._draw()

    def _make_panels(self, picture: Picture) -> None:
        self.canvas.clear()
        self.panels = [DrawnPanel(self.canvas, at, self._zooms and at == 0) for at in range(len(picture.panels))]
        for at, drawn in enumerate(self.panels):
            self.canvas.ci.layout.setRowStretchFactor(at, picture.panels[at].share)
            self.canvas.ci.layout.setRowPreferredHeight(at, 10 * picture.panels[at].share)
            for changed in (drawn.box.sigResized, drawn.box.sigRangeChanged):
                changed.connect(lambda *_: self.tools.update_read_out())
                changed.connect(lambda *_: self.align())  # other ticks have labels of another width
            if at:
                drawn.plot.setXLink(self.panels[0].plot)

    def _draw(self) -> None:
        if not self.panels:
            return
        for at, drawn in enumerate(self.panels):
            drawn.show(self.picture, at, (self.log_axes[0], self.log_axes[1] and not at), self.hidden)
        x = self._x_range()
        for at, drawn in enumerate(self.panels):
            self._ranges[at] = self._y_range(at, drawn)
            drawn.box.set_whole(x, self._ranges[at] or (-1.0, 1.0))
        self.align()
        for drawn in self.panels:
            drawn.arrange()
        self.tools.update_read_out()

    def align(self) -> None:
        """Give all left axes the width of the widest."""
        self.canvas.ci.setContentsMargins(0, 0, px(RIGHT_PX), 0)
        width = max((each.axes["left"].needed_width() for each in self.panels), default=0)
        for each in self.panels:
            if each.axes["left"].width() != width:
                each.axes["left"].setWidth(width)

    def _x_range(self) -> tuple[float, float]:
        every = [each.x for each in self.picture.layers if each.group not in self.hidden]
        x = place(np.concatenate(every), self.log_axes[0]) if every else np.empty(0)
        x = x[np.isfinite(x)]
        low, high = (float(x.min()), float(x.max())) if x.size else (0.0, 1.0)
        margin = 0.03 * ((high - low) or abs(high) or 1.0)
        if self.picture.x is None:
            return low - margin, high + margin
        if not self.log_axes[0]:
            return self.picture.x
        high = float(np.log10(max(self.picture.x[1], 1e-9)))
        return max(low, high - MAX_DECADES) if low < high else high - 1.0, high

    def _y_range(self, at: int, drawn: DrawnPanel) -> tuple[float, float]:
        panel = drawn.panel
        low, high = drawn.extent()
        ends = [each for each in (panel.low, panel.high) if each is not None]
        if drawn.log[1]:
            above = [each.y[(each.y > 0) & each.usable] for each in drawn.layers]
            least = min((float(each.min()) for each in above if each.size), default=0.1)
            top = float(np.log10(np.nanmax([high * 1.1, 1.0, *(e for e in ends if e > 0)])))
            bottom = float(np.log10(least))
            bottom -= 0.04 * (top - bottom)
            return (max(bottom, top - MAX_DECADES), top) if bottom < top else (top - 1.0, top)
        low, high = (
            min([low, *ends]) if np.isfinite(low) else np.nan,
            max([high, *ends]) if np.isfinite(high) else np.nan,
        )
        if not np.isfinite(low):
            return (panel.low or 0.0, panel.high or 1.0) if panel.high != panel.low else (0.0, 1.0)
        low, high = stable_range(low, high, self._ranges[at])
        if panel.low is not None and low < panel.low <= drawn.extent()[0]:
            low = panel.low
        return low, high

    def layer(self, name: str) -> Layer | None:
        """Return a layer of the picture by its name."""
        return next((each for each in self.picture.layers if each.name == name), None)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit_head()

    # -- chips -------------------------------------------------------------------------------------------------------

    def _make_chips(self) -> None:
        for button in self.chips.values():
            self._chip_row.removeWidget(button)
            button.hide()  # now: it is deleted when the event loop turns
            button.deleteLater()
        self.chips = {}
        for group, layer in self.picture.groups.items():
            button = configure(QPushButton(group), kind="chip", checkable=True, checked=group not in self.hidden)
            button.setIcon(layer_icon(layer))
            button.setIconSize(CHIP_ICON * text_scale())
            button.setToolTip(f"{group}: press to hide or show it")
            button.clicked.connect(lambda _=False, group=group: self.toggle_group(group))
            self._chip_row.addWidget(button)
            self.chips[group] = button
        self._fit_head()

    def toggle_group(self, group: str) -> None:
        """Hide the layers of a chip, or show them again."""
        self.hidden ^= {group}
        if group in self.chips:
            self.chips[group].setChecked(group not in self.hidden)
        self._draw()
        self._fit_head()

    def _fit_head(self) -> None:
        """Show the chips where they have space, else one button for all layers; the menu has the tools that have none."""
        chips, tools = [*self.chips.values()], [] if self.few_tools else self.tools.buttons[:-1]
        self.layers_button.setText(LAYERS_TEXT.format(sum(g not in self.hidden for g in self.chips), len(self.chips)))
        every: list[QWidget] = [self.title_label, *self.head.findChildren(QPushButton)]
        fitted = {*chips, *self.tools.buttons[:-1], self.layers_button}
        room = self.width() - px(16) - self.note_label.minimumSizeHint().width()
        room -= _width_of(each for each in every if not each.isHidden() and each not in fitted)
        fits = _width_of([*chips, *tools]) <= room
        for each in chips:
            each.setVisible(fits)
        self.layers_button.setVisible(not fits and bool(chips))
        for each in self.tools.buttons[:-1]:
            each.setVisible(each in tools and (fits or _width_of([self.layers_button, *tools]) <= room))

    def _choose_layers(self) -> None:
        menu = Menu(self.layers_button)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        for group in self.chips:
            action = menu.addAction(group, partial(self.toggle_group, group))
            action.setCheckable(True)
            action.setChecked(group not in self.hidden)
        menu.popup(self.layers_button.mapToGlobal(self.layers_button.rect().bottomLeft()))

    # -- axes, zoom, table -------------------------------------------------------------------------------------------

    def set_log_axes(self, x: bool, y: bool) -> None:
        """Make the axes logarithmic or linear."""
        was, self.log_axes = self.log_axes, (x and self.picture.log[0], y and self.picture.log[1])
        self._ranges = [None] * len(self.panels)
        for drawn in self.panels:
            drawn.box.zoomed = False
        self._draw()
        if was[1] is not self.log_axes[1]:
            self.log_changed.emit(self.log_axes[1])

    def show_whole(self) -> None:
        """Show everything, and remove the cursors."""
        for drawn in self.panels:
            drawn.box.show_whole()
        self.tools.clear_cursors()

    def zoom(self, factor: float) -> None:
        """Scale the visible range."""
        for drawn in self.panels:
            drawn.box.zoom(factor)

    def series(self) -> Iterable[Series]:
        """Yield the visible series, with their panels where there are several."""
        for each in self.picture.layers:
            if each.copied and each.group not in self.hidden and each.x.size:
                title = self.picture.panels[each.panel].title if each.panel else ""
                yield replace(each.series, name=f"{each.name}{f': {title}' if title else ''}")
                for end, name in zip(each.series.band or (), ("lower", "upper"), strict=False):
                    yield Series(each.x, np.asarray(end), name=f"{each.name}, {name} end of the band")

    def table(self) -> str:
        """Return the visible data as a tab-separated table."""
        return series_as_text(self.series(), self.picture.x_title, self.picture.panels[0].title, self.picture.simulated)


def _width_of(widgets: Iterable[QWidget]) -> int:
    return sum(each.sizeHint().width() + px(8) for each in widgets)


class _LayerIcon(PaintedIcon):
    def __init__(self, layer: Layer) -> None:
        super().__init__()
        self._layer = layer

    def paint(self, painter: QPainter, rect: QRect, _mode: QIcon.Mode, _state: QIcon.State) -> None:
        layer, color = self._layer, color_of(self._layer.tone)
        end = CHIP_ICON.width() - 4  # a line does not touch the text beside it
        middle = QPointF(end / 2, CHIP_ICON.height() / 2)
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.translate(rect.topLeft())
        painter.scale(rect.width() / CHIP_ICON.width(), rect.height() / CHIP_ICON.height())
        if layer.line is not None:
            painter.setPen(QPen(color, layer.width, layer.line))
            painter.drawLine(QPointF(0, middle.y()), QPointF(end, middle.y()))
        if layer.symbol:
            painter.translate(middle)
            painter.scale(8, 8)
            painter.setPen(QPen(color, 0.19))
            painter.setBrush(QColor(color_of("surface")) if layer.hollow else color)
            painter.drawPath(pg.graphicsItems.ScatterPlotItem.Symbols[layer.symbol])
        painter.restore()

    def clone(self) -> "_LayerIcon":
        return _LayerIcon(self._layer)


def layer_icon(layer: Layer) -> QIcon:
    """Return line and symbol of a layer as an icon of any size."""
    return QIcon(_LayerIcon(layer))
