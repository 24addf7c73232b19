"""What the points of the present run tell of the specimen so far, and how its error shrinks with every point."""

import math
from collections.abc import Sequence

from PySide6.QtCore import QPointF, QSize
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QGridLayout, QLabel, QWidget

from app.common.formatting import counted, uncertain
from app.explore.sliders import SLIDERS
from app.gui.widgets.form import mark
from app.gui.widgets.theme import Theme
from app.live.estimates import Told

ROWS = 3
TOO_FEW = "Not enough yet to tell the parameters apart; points at other frequencies will."


class Shrinking(QWidget):
    """A relative error after each point, on a logarithmic scale."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.errors: Sequence[float] = ()
        self._ink = "#000000"
        self.setMinimumWidth(44)

    def sizeHint(self) -> QSize:
        return QSize(60, self.fontMetrics().height() + 4)

    def show_errors(self, errors: Sequence[float], ink: str) -> None:
        """The history of one estimate."""
        self.errors, self._ink = errors, ink
        told = f"{len(errors)} fits, from {100 * errors[0]:.2g} % to {100 * errors[-1]:.2g} %" if errors else ""
        self.setToolTip(f"Standard error in parts of the value: {told}" if told else "")
        self.update()

    def paintEvent(self, _event: QPaintEvent) -> None:
        if not self.errors:
            return
        width, height = self.width(), self.height()
        logs = [math.log10(max(e, 1e-9)) for e in self.errors]
        low, high = min(*logs, max(logs) - 1.0), max(logs)
        places = [
            QPointF(2 + (width - 6) * i / max(len(logs) - 1, 1), 3 + (height - 6) * (high - v) / (high - low))
            for i, v in enumerate(logs)
        ]
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(QPen(QColor(self._ink), 1.5))
        painter.drawPolyline(QPolygonF(places))
        painter.setBrush(QColor(self._ink))
        painter.drawEllipse(places[-1], 2, 2)
        painter.end()


class EstimatesPanel(QWidget):
    """Hidden until a run has points to tell from."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme, self._told = theme, Told()
        self._busy = False
        self.caption, self.note = QLabel(), QLabel()
        mark(self.caption, "caption")
        mark(self.note, "note")
        self.note.setWordWrap(True)
        self.rows = [(QLabel(), QLabel(), Shrinking()) for _ in range(ROWS)]
        for name, value, _ in self.rows:
            mark(name, "note")
            mark(value, "small")
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(8)
        grid.setVerticalSpacing(1)
        grid.setColumnStretch(2, 1)
        grid.addWidget(self.caption, 0, 0, 1, 3)
        for at, row in enumerate(self.rows, 1):
            for column, widget in enumerate(row):
                grid.addWidget(widget, at, column)
        grid.addWidget(self.note, ROWS + 1, 0, 1, 3)
        self.hide()

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        told, self._told = self._told, Told()
        self.show_told(told)

    def show_told(self, told: Told) -> None:
        """Show what is known by now."""
        if told is self._told:
            return
        self._told = told
        count = counted(told.points, "usable point")
        self.caption.setText(f"What {count} tell{'s' if told.points == 1 else ''}")
        estimates = told.estimates[:ROWS]
        for at, (name, value, shrinking) in enumerate(self.rows):
            there = at < len(estimates)
            for widget in (name, value, shrinking):
                widget.setVisible(there)
            if there:
                e = estimates[at]
                slider = SLIDERS[e.name.partition("(")[0]]
                name.setText(slider.label + e.name.removeprefix(slider.name))
                value.setText(uncertain(slider.factor * e.value, slider.factor * e.standard_error, slider.unit))
                shrinking.show_errors((told.errors or {}).get(e.name, ()), self._theme.model)
        rests = f"Everything else as in {told.believed.words}; the sensor's gain is taken as exact."
        self.note.setText(rests if estimates else TOO_FEW if told.words.startswith("not identifiable") else told.words)
        self.note.setToolTip(told.words)
        self._show()

    def allow(self, busy: bool) -> None:
        """Only while points arrive: what the run ended with stands above the response."""
        self._busy = busy
        self._show()

    def _show(self) -> None:
        self.setVisible(self._busy and bool(self._told.points))
