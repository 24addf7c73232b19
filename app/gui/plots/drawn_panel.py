"""One panel of a plot as items of pyqtgraph: its layers over their grid, its regions, rules and spots with their labels."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QBrush, QColor, QPainterPath, QPen, QPolygonF, QTransform
from PySide6.QtWidgets import (
    QGraphicsEllipseItem,
    QGraphicsItem,
    QGraphicsLineItem,
    QGraphicsPathItem,
    QGraphicsPolygonItem,
    QGraphicsRectItem,
)

from app.gui.face import px, text_font
from app.gui.plots.axes import TITLE_PX, PlotAxis
from app.gui.plots.labels import LABEL_SEPARATOR, Label, Placer, along, beside, fitting_text, nearest_to
from app.gui.plots.picture import MODEL_WIDTH, ON_AXIS, RING, Layer, Panel, Picture, Region, Rule, Spot, color_of
from app.gui.plots.zoom import ZoomBox
from model import Array, Mask

RIM_PX, RING_PX = 1.5, 8
SMALLEST = 1e-12
"""Ends of bands and bars that are not above zero lie here on a logarithmic axis, far below every range."""

SYMBOLS = pg.graphicsItems.ScatterPlotItem.Symbols
SYMBOLS[ON_AXIS] = QTransform.fromScale(0.5, 0.5).map(SYMBOLS["t"]).translated(0.0, -0.25)  # the upper half of the size

MAX_OBSTACLES, OBSTACLE_GAP_PX = 4000, 8
BAND_ALPHA = 56
FRAME_PX = 1


def place(values: Any, log: bool) -> Array:
    """Return values as coordinates of an axis; NaN where a logarithmic one has none."""
    numbers = np.asarray(values, dtype=float)
    return np.log10(np.where(numbers > 0, numbers, np.nan)) if log else numbers


def place_end(values: Any, log: bool) -> Array:
    """Return the ends of bands or bars as coordinates; an end not above zero lies below every range."""
    numbers = np.asarray(values, dtype=float)
    return place(np.where(np.isfinite(numbers), np.maximum(numbers, SMALLEST), np.nan), True) if log else numbers


def crossed_circle() -> QPainterPath:
    """Return the symbol of a point that is not usable."""
    path = QPainterPath()
    path.addEllipse(QRectF(-0.5, -0.5, 1, 1))
    for side in (-1, 1):
        path.moveTo(-0.3, -0.3 * side)
        path.lineTo(0.3, 0.3 * side)
    return path


class DrawnLayer:
    """The items of one layer; they stay while the layer changes."""

    def __init__(self, plot: Any) -> None:
        self._plot = plot
        self.line: Any = None
        self.scatter: Any = None
        self._bars: Any = None
        self._band: QGraphicsPathItem | None = None

    @property
    def items(self) -> list[Any]:
        return [each for each in (self._band, self.line, self._bars, self.scatter) if each is not None]

    def remove(self) -> None:
        for item in self.items:
            self._plot.removeItem(item)

    def _made(self, item: Any, z: float) -> Any:
        item.setZValue(z)
        self._plot.addItem(item, ignoreBounds=True)
        return item

    def show(self, layer: Layer, log: tuple[bool, bool], above: float) -> None:
        """Draw a layer on linear or logarithmic axes; `above` is its place among the others."""
        color = color_of(layer.tone)
        x, y = place(layer.x, log[0]), place(layer.y, log[1])
        if layer.series.band is not None or self._band is not None:
            self._band = self._band or self._made(QGraphicsPathItem(), -20)
            self._show_band(layer, log, color)
        if layer.line is not None:
            if self.line is None:
                self.line = self._made(pg.PlotCurveItem(antialias=True), above)
            drawn = (
                (x, y) if layer.drawn is None else tuple(place(v, on) for v, on in zip(layer.drawn, log, strict=True))
            )
            self.line.setPen(pg.mkPen(color, width=layer.width, style=layer.line))
            self.line.setData(*drawn, connect="finite")
        there = np.isfinite(x) & np.isfinite(y)  # Qt crashes when it paints a point that is not finite
        if layer.series.errors is not None:
            if self._bars is None:
                self._bars = self._made(pg.ErrorBarItem(beam=0.0), above + 1)
            self._show_bars(layer, log, x, there & np.isfinite(layer.series.errors), color)
        if layer.symbol:
            if self.scatter is None:
                self.scatter = self._made(pg.ScatterPlotItem(antialias=True), above + 2)
            self._show_points(layer, x, y, there, color)

    def _show_band(self, layer: Layer, log: tuple[bool, bool], color: QColor) -> None:
        assert self._band is not None
        path, fill = QPainterPath(), QColor(color)
        fill.setAlpha(BAND_ALPHA)
        self._band.setPen(QPen(Qt.PenStyle.NoPen))
        self._band.setBrush(QBrush(color_of("band") if layer.tone == "model" else fill))
        if layer.series.band is not None:
            x, low, high = place(layer.x, log[0]), *(place_end(end, log[1]) for end in layer.series.band)
            there = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
            for part in np.split(np.arange(x.size), np.flatnonzero(np.diff(there)) + 1):
                if part.size > 1 and there[part[0]]:
                    around = np.concatenate((low[part], high[part][::-1]))
                    path.addPath(pg.arrayToQPath(np.concatenate((x[part], x[part][::-1])), around))
        self._band.setPath(path)

    def _show_bars(self, layer: Layer, log: tuple[bool, bool], x: Array, there: Mask, color: QColor) -> None:
        assert layer.series.errors is not None
        low, middle, high = (
            place_end(layer.y[there] + side * layer.series.errors[there], log[1]) for side in (-1.0, 0.0, 1.0)
        )
        self._bars.setData(x=x[there], y=middle, top=high - middle, bottom=middle - low, pen=pg.mkPen(color))

    def _show_points(self, layer: Layer, x: Array, y: Array, there: Mask, color: QColor) -> None:
        ground, rim = color_of("surface"), px(10 * RIM_PX) / 10
        full = pg.mkPen(ground if not layer.hollow else color, width=rim), pg.mkBrush(ground if layer.hollow else color)
        empty = pg.mkPen(color, width=rim), pg.mkBrush(ground)
        options: dict[str, Any] = {"symbol": layer.symbol, "pen": full[0], "brush": full[1]}
        if layer.symbol == RING:
            options = {"symbol": "o", "pen": pg.mkPen(color, width=2), "brush": None}
        if not layer.usable.all():
            each = [full if good else empty for good in layer.usable[there]]
            symbols = [layer.symbol if good else crossed_circle() for good in layer.usable[there]]
            options = {"symbol": symbols, "pen": [p for p, _ in each], "brush": [b for _, b in each]}
        if layer.chosen is not None and np.any(layer.chosen):
            pen = pg.mkPen(color_of("accent"), width=px(4))
            given = options["pen"] if isinstance(options["pen"], list) else [options["pen"]] * int(there.sum())
            options["pen"] = [pen if c else p for c, p in zip(np.asarray(layer.chosen)[there], given, strict=True)]
        self.scatter.setData(x=x[there], y=y[there], size=px(layer.size), **options)


class DrawnPanel:
    """A plot item with own axes; the items that are no data lie in pixels over and under them."""

    def __init__(self, canvas: Any, row: int, zooms: bool) -> None:
        self.axes = {side: PlotAxis(side) for side in ("left", "bottom")}
        self.box = ZoomBox(zooms)
        self.plot = canvas.addPlot(row=row, col=0, viewBox=self.box, axisItems=dict(self.axes), enableMenu=False)
        self.plot.hideButtons()
        self.plot.setContentsMargins(0, 0, 0, 0)
        self.plot.titleLabel.setVisible(False)
        self.title = Label(self.plot)
        self.panel, self.picture = Panel(), Picture()
        self.log = (False, False)
        self.drawn: dict[str, DrawnLayer] = {}
        self.layers: list[Layer] = []
        """The visible layers."""
        self._index = 0
        self._grid = QGraphicsPathItem(self.box)
        self._grid.setZValue(-2)
        self._marks: list[QGraphicsItem] = []
        self.box.sigResized.connect(self.arrange)
        self.box.sigRangeChanged.connect(self.arrange)

    def show_theme(self) -> None:
        """Use the colours and the text size in use."""
        for axis in self.axes.values():
            axis.show_theme()
        self.plot.titleLabel.setMaximumHeight(px(TITLE_PX))
        self.plot.layout.setRowFixedHeight(0, px(TITLE_PX) if self.panel.title else 8)
        self._grid.setPen(QPen(color_of("line"), FRAME_PX))

    def show(self, picture: Picture, index: int, log: tuple[bool, bool], hidden: set[str]) -> None:
        """Draw the n-th panel of a picture, apart from the hidden groups."""
        panel = picture.panels[index]
        self.panel, self.picture, self.log = panel, picture, log
        for side, axis in self.axes.items():
            axis.is_log, axis.has_dates = log[side == "left"], picture.dates and side == "bottom"
            axis.picture = None
            axis.update()
        self.axes["left"].fixed, self.axes["left"].ends_above = panel.ticks, not panel.x_labels
        self.axes["bottom"].labelled = panel.x_labels
        self.show_theme()
        self.axes["bottom"].show_title(picture.x_title)
        self.axes["bottom"].resizeEvent()
        self.title.show_text(panel.title)
        self.layers = [one for one in picture.layers if one.panel == index and one.group not in hidden]
        shown = {}
        for at, layer in enumerate(self.layers):
            key = f"{layer.name}:{layer.line is None}:{layer.symbol}:{layer.series.errors is None}"
            known = self.drawn.pop(key, None)  # a second layer of the same name has items of its own
            drawn = shown[key] = known or DrawnLayer(self.plot)
            drawn.show(layer, log, 3.0 * at)
        for gone in self.drawn.values():
            gone.remove()
        self.drawn, self._index = shown, index

    def drawn_layer(self, name: str) -> DrawnLayer:
        """Return the items of a visible layer.

        Raises:
            KeyError: there is none.
        """
        return next((each for key, each in self.drawn.items() if key.startswith(f"{name}:")), None) or self.drawn[name]

    def extent(self) -> tuple[float, float]:
        """Return lowest and highest drawn value; error bars and bands of usable points widen the range threefold at most.

        Points that are not usable set no range unless there are no others.
        """
        ends, bars, unusable = [np.empty(0)], [np.empty(0)], [np.empty(0)]
        for layer in self.layers:
            ends.append(layer.y[layer.usable])
            unusable.append(layer.y[~layer.usable])
            if layer.series.errors is not None:
                bars += [(layer.y + side * layer.series.errors)[layer.usable] for side in (-1.0, 1.0)]
            bars += [np.asarray(end) for end in layer.series.band or ()]
        ends.append(np.array([each.y for each in self.picture.spots if each.panel == self._index]))
        every, wide = (values[np.isfinite(values)] for values in map(np.concatenate, (ends, bars)))
        if not every.size:
            every = np.concatenate(unusable)
            every = every[np.isfinite(every)]
        if not every.size:
            return np.nan, np.nan
        low, high = float(every.min()), float(every.max())
        wide = np.append(wide, (low, high))
        if np.ptp(wide) <= 3 * (high - low):
            low, high = float(wide.min()), float(wide.max())
        return low, high

    # -- what lies in pixels -----------------------------------------------------------------------------------------

    def to_pixels(self, x: Any, y: Any) -> Array:
        """Return places on linear or logarithmic axes, given in the units of the axes, in pixels of the box, (N, 2)."""
        (left, right), (bottom, top) = self.box.viewRange()
        width, height = self.box.width(), self.box.height()
        across = (place(x, self.log[0]) - left) / (right - left) * width
        up = height - (place(y, self.log[1]) - bottom) / (top - bottom) * height
        return np.column_stack(np.broadcast_arrays(np.atleast_1d(across), np.atleast_1d(up)))

    def arrange(self, *_: object) -> None:
        """Place titles, grid, regions, rules, spots and labels; after a new size or range."""
        scene = self.plot.scene()
        box = self.box.geometry()
        if scene is None or box.width() < 2 or box.height() < 2:
            return
        self.title.setPos(0, max(box.top() - px(TITLE_PX), 0))
        for item in self._marks:
            scene.removeItem(item)
        self._marks = []
        self._draw_grid(box)
        placer = Placer(QRectF(0, 0, box.width(), box.height()), self._obstacles(self.layers))
        regions = [each for each in self.picture.regions if each.panel == self._index]
        for region in regions:
            self._draw_region(region, box)
        spots = [self._draw_spot(each, placer, box) for each in self.picture.spots if each.panel == self._index]
        for rule in self.picture.rules:
            if rule.panel == self._index:
                self._draw_rule(rule, placer, box)
        for label, at, first in spots:
            self._place(label, placer, beside(at, label.boundingRect(), placer.area, first))
        for layer in self.layers:
            if layer.label:
                self._label_layer(layer, placer)
        for region in regions:
            self._label_region(region, placer, box)
        self._say_empty(box)

    def _say_empty(self, box: QRectF) -> None:
        if self.picture.empty and not self.layers:
            label = self._add(Label(self.box))
            size = label.show_text(self.picture.empty, "text2")
            label.setPos(max((box.width() - size.width()) / 2, 0), (box.height() - size.height()) / 2)

    def _add(self, item: Any, z: float | None = None) -> Any:
        if z is not None:
            item.setZValue(z)
        self._marks.append(item)
        return item

    def _draw_grid(self, box: QRectF) -> None:
        path = QPainterPath()
        low, high = self.axes["left"].range
        for value, _ in self.axes["left"].places():
            y = round(box.height() * (1 - (value - low) / (high - low))) + 0.5
            path.moveTo(0, y)
            path.lineTo(box.width(), y)
        self._grid.setPath(path)

    def _obstacles(self, layers: Iterable[Layer]) -> Array:
        places = [np.empty((0, 2))]
        for layer in layers:
            x, y = (layer.x, layer.y) if layer.drawn is None else layer.drawn
            pixels = self.to_pixels(x, y)
            pixels = pixels[np.isfinite(pixels).all(axis=1)]
            if layer.line is not None and 1 < len(pixels) < MAX_OBSTACLES:  # the line between the points, too
                longest = float(np.hypot(*np.diff(pixels, axis=0).T).max())
                number = max(4, longest / px(OBSTACLE_GAP_PX)) * len(pixels)
                steps = np.linspace(0, len(pixels) - 1, min(max(int(number), 200), 2 * MAX_OBSTACLES))
                at = np.arange(len(pixels))
                pixels = np.column_stack([np.interp(steps, at, pixels[:, axis]) for axis in (0, 1)])
            places.append(pixels[: 2 * MAX_OBSTACLES])
        return np.concatenate(places)

    def _edges(self, region: Region, box: QRectF) -> QRectF:
        if region.along_y:
            ends = np.clip(self.to_pixels(1.0, [region.low, region.high])[:, 1], 0, box.height())
            return QRectF(0, ends.min(), box.width(), np.ptp(ends))
        ends = np.clip(np.nan_to_num(self.to_pixels([region.low, region.high], 1.0)[:, 0]), 0, box.width())
        return QRectF(ends.min(), 0, np.ptp(ends), box.height())

    def _draw_region(self, region: Region, box: QRectF) -> None:
        item = self._add(QGraphicsRectItem(self._edges(region, box), self.box), -3)
        item.setPen(QPen(Qt.PenStyle.NoPen))
        item.setBrush(QBrush(color_of(region.tone)))

    def _label_region(self, region: Region, placer: Placer, box: QRectF) -> None:
        edges = self._edges(region, box)
        text = fitting_text(region.label, edges.width() - 2 * px(6), text_font("key"))
        if text:
            label = self._add(Label(self.box))
            size = label.show_text(text, region.text_tone)
            heights = np.linspace(edges.bottom() - size.height() - px(28), edges.top() + px(6), 9)
            self._place(label, placer, [QPointF(edges.left() + px(6), y) for y in heights])

    def _draw_rule(self, rule: Rule, placer: Placer, box: QRectF) -> None:
        x, y = (1.0, rule.at) if rule.along_y else (rule.at, 1.0)
        pixels = self.to_pixels(x, y)[0]
        at = pixels[1] if rule.along_y else pixels[0]
        if not np.isfinite(at) or not 0 <= at <= (box.height() if rule.along_y else box.width()):
            return
        color = color_of(rule.tone)
        ends = QLineF(0, at, box.width(), at) if rule.along_y else QLineF(at, 0, at, box.height())
        self._add(QGraphicsLineItem(ends, self.box), -1).setPen(QPen(color, 1, rule.style))
        if rule.marked:
            corner = QPolygonF([QPointF(at - px(4), 0), QPointF(at + px(4), 0), QPointF(at, px(7))])
            triangle = self._add(QGraphicsPolygonItem(corner, self.box), 6)
            triangle.setBrush(QBrush(color))
            triangle.setPen(QPen(Qt.PenStyle.NoPen))
        if not rule.label:
            return
        label = self._add(Label(self.box, "caption" if rule.marked else "key"))
        size = label.show_text(rule.label, rule.tone)
        if rule.along_y:
            right, sides = box.width() - size.width() - px(2), (at - size.height() - 1, at + 1)
            wishes = [QPointF(x, y) for x in (px(8), right, right / 2) for y in sides]
        else:
            placer.avoid([(at, y) for y in np.arange(0.0, box.height(), px(OBSTACLE_GAP_PX))])
            sides = (at + px(8), at - size.width() - px(8))
            wishes = [QPointF(x, y) for y in (0, size.height(), box.height() / 2) for x in sides]
        self._place(label, placer, wishes)

    def _draw_spot(self, spot: Spot, placer: Placer, box: QRectF) -> tuple[Label, QPointF, str]:
        x, y = self.to_pixels(spot.x, spot.y)[0]
        reach, color = px(RING_PX), color_of(spot.tone)
        if spot.column:
            column = self._add(QGraphicsRectItem(QRectF(x - px(4), 0, px(8), box.height()), self.box), -2.5)
            column.setBrush(QBrush(color))
            column.setOpacity(0.5)
            column.setPen(QPen(Qt.PenStyle.NoPen))
        ring = self._add(QGraphicsEllipseItem(x - reach, y - reach, 2 * reach, 2 * reach, self.box), 6)
        ring.setPen(QPen(color_of("text"), 2))
        ring.setBrush(QBrush(color) if spot.column else QBrush(Qt.BrushStyle.NoBrush))
        ring.setVisible(bool(np.isfinite(y)))
        if np.isfinite(y):
            placer.take(QRectF(x - reach, y - reach, 2 * reach, 2 * reach))
        label = self._add(Label(self.box, "caption"))
        label.show_text(spot.label)
        at = QPointF(x, y) if np.isfinite(y) else QPointF(x, px(16))
        return label, at, "right" if spot.column else "left-above"

    def _label_layer(self, layer: Layer, placer: Placer) -> None:
        pixels = self.to_pixels(layer.x, layer.y)
        inside = np.isfinite(pixels).all(axis=1) & (pixels[:, 0] >= 0) & (pixels[:, 0] <= self.box.width())
        if not inside.any():
            return
        label = self._add(Label(self.box))
        size = label.show_text(layer.label, layer.tone if layer.width >= MODEL_WIDTH or layer.tone != "ink" else "text")
        if layer.label_at is not None:
            x, y = pixels[inside][min(int(layer.label_at * inside.sum()), int(inside.sum()) - 1)]
            label.setPos(x - size.width() / 2, y - size.height() / 2)
            return
        # Points are compared with points and lines with lines, because a model's line runs through its points.
        alike = [e for e in self.layers if e is not layer and (e.symbol if layer.symbol else e.line is not None)]
        own, others = self._obstacles([layer]), self._obstacles(alike)
        short = layer.label.partition(LABEL_SEPARATOR)[0]
        for text in dict.fromkeys((layer.label, short)):
            size = label.show_text(text, label.tone)
            wishes = along(pixels[inside], size, from_left=bool(layer.symbol))
            if self._place(
                label, placer, nearest_to(own, others, wishes, size), covers=text == short and not layer.group
            ):
                return

    @staticmethod
    def _place(label: Label, placer: Placer, wishes: Iterable[QPointF], covers: bool = True) -> bool:
        """Show a label at the best place, and return whether there is one."""
        at = placer.place(label.boundingRect(), wishes, covers)
        label.setVisible(at is not None)
        if at is not None:
            label.setPos(at)
        return at is not None
