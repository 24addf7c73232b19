"""Where everything of the Explore page stands: sliders at the left, the curves and the motion at the right."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QScrollArea, QSplitter, QVBoxLayout, QWidget

from app.gui.explore_bar import ExploreBar
from app.gui.explore_plot import ExplorePlot
from app.gui.remark import Remark
from app.gui.shape_plot import ShapePlot
from app.gui.sliders import SliderPanel


def columns(
    sliders: SliderPanel, remark: Remark, plot: ExplorePlot, shape: ShapePlot, bar: ExploreBar
) -> tuple[QWidget, QWidget]:
    """The left and the right side."""
    return _left(sliders, remark, bar), _right(plot, shape, bar)


def _left(sliders: SliderPanel, remark: Remark, bar: ExploreBar) -> QWidget:
    scroll = QScrollArea()
    scroll.setWidget(sliders)
    scroll.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    scroll.setWidgetResizable(True)
    scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    scroll.viewport().setAutoFillBackground(False)
    sliders.setAutoFillBackground(False)
    left, column = _column(6)
    column.setContentsMargins(0, 2, 4, 0)
    column.addLayout(bar.start())
    column.addWidget(scroll, 1)
    column.addWidget(remark)
    column.addLayout(bar.leave())
    left.setMinimumWidth(400)
    return left


def _right(plot: ExplorePlot, shape: ShapePlot, bar: ExploreBar) -> QWidget:
    right, column = _column(4)
    column.addLayout(bar.head())
    column.addLayout(bar.runs())
    rows = QSplitter(Qt.Orientation.Vertical)
    rows.addWidget(plot)
    below, beam = _column(2)
    beam.addLayout(bar.motion())
    beam.addWidget(shape, 1)
    rows.addWidget(below)
    rows.setSizes([400, 210])
    rows.setObjectName("explore/rows")
    rows.setChildrenCollapsible(False)
    column.addWidget(rows, 1)
    return right


def _column(spacing: int) -> tuple[QWidget, QVBoxLayout]:
    """An empty column that fills its place."""
    widget = QWidget()
    column = QVBoxLayout(widget)
    column.setContentsMargins(0, 0, 0, 0)
    column.setSpacing(spacing)
    return widget, column
