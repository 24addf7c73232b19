"""Bars of an uncertainty budget: the shares of ruler, gain, noise and other sources in each parameter's uncertainty."""

from collections.abc import Sequence

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QPaintEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.gui.face import CENTRE, draw_box, draw_text, painting, tokens
from app.gui.widgets import configure
from app.identification import BudgetBar, largest_sources

SOURCE_COLORS = ("#9ad0f5", "#f3c77b", "#8fd6bd", "#e7b3d0", "#f0e68c", "#f2a285", "#c9c9e8")
"""The source with the largest shares first; light in both themes, so that black names in them are legible."""
REST_COLOR, NAME_COLOR = "#d9d9d9", "#16191d"
BAR_SHARE = 0.56
"""Of the width; names are left of the bars, sizes right of them."""


class BudgetPlot(QWidget):
    """A stacked bar for each parameter, with the names of the sources in it and the sizes beside it."""

    def __init__(self) -> None:
        super().__init__()
        configure(self, "identification.budget", accessibleName="uncertainty budget")
        self.bars: tuple[BudgetBar, ...] = ()
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_bars(self, bars: Sequence[BudgetBar]) -> None:
        """Show a budget; nothing without bars."""
        self.bars = tuple(bars)
        self.setVisible(bool(bars))
        lines = [f"{bar.name}: {bar.size_text}; {_format_shares(bar)}" for bar in bars]
        self.setToolTip("\n".join(lines))
        self.setAccessibleDescription("\n".join(lines))
        self.updateGeometry()
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(600, self._row_height * len(self.bars) + 2)

    def minimumSizeHint(self) -> QSize:
        return QSize(300, self.sizeHint().height())

    @property
    def _row_height(self) -> int:
        return self.fontMetrics().height() + 10

    def paintEvent(self, _event: QPaintEvent) -> None:
        names, metrics = [bar.name for bar in self.bars], self.fontMetrics()
        left = max((metrics.horizontalAdvance(name) for name in names), default=0) + 10
        beside = max((metrics.horizontalAdvance(bar.size_text) for bar in self.bars), default=0) + 16
        width = max(BAR_SHARE * self.width(), self.width() - left - beside)
        width = min(width, self.width() - left - 20)
        colors = dict(zip(largest_sources(self.bars), SOURCE_COLORS, strict=False))
        ink, right = tokens().text, Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignRight
        with painting(self) as painter:
            for at, bar in enumerate(self.bars):
                top, height = at * self._row_height + 2.0, self._row_height - 4.0
                draw_text(painter, QRectF(0, top, left - 8, height), bar.name, ink, align=right)
                area = QRectF(left + width + 8, top, self.width() - left - width - 8, height)
                draw_text(painter, area, bar.size_text, ink)
                x = float(left)
                for source, share in bar.shares:
                    piece = QRectF(x, top, share * width, height)
                    draw_box(painter, piece, 0, colors.get(source, REST_COLOR), tokens().surface)
                    text = f"{source} {100 * share:.0f} %"
                    if metrics.horizontalAdvance(text) + 6 < piece.width():
                        draw_text(painter, piece, text, NAME_COLOR, align=CENTRE)
                    x += share * width


def _format_shares(bar: BudgetBar) -> str:
    return ", ".join(f"{source} {100 * share:.0f} %" for source, share in bar.shares)
