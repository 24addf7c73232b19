"""Live estimates of the present run with the history of their errors."""

import math
from collections.abc import Sequence

from PySide6.QtCore import QPointF, QSize
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QLabel, QWidget

from app.common import pluralize
from app.explore import SLIDERS
from app.gui.face import follow_tokens, tokens
from app.gui.widgets import ElidedLabel, configure, grid
from app.live import EstimateUpdate
from model import format_with_uncertainty

MAX_ROWS = 3
MIN_HISTORY_WIDTH = 16
"""A window of 800 points has little more beside the values."""
TOO_FEW = "Not enough points yet to separate the parameters; points at other frequencies will."


class ErrorHistoryPlot(QWidget):
    """Relative error after each point, on a logarithmic scale."""

    def __init__(self) -> None:
        super().__init__()
        self.errors: Sequence[float] = ()
        self._color = "#000000"
        self.setMinimumWidth(MIN_HISTORY_WIDTH)

    def sizeHint(self) -> QSize:
        return QSize(60, self.fontMetrics().height() + 4)

    def show_errors(self, errors: Sequence[float], color: str) -> None:
        """Show the error history of one estimate."""
        self.errors, self._color = errors, color
        history = f"{len(errors)} fits, from {100 * errors[0]:.2g} % to {100 * errors[-1]:.2g} %" if errors else ""
        self.setToolTip(f"Standard error in parts of the value: {history}" if history else "")
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
        painter.setPen(QPen(QColor(self._color), 1.5))
        painter.drawPolyline(QPolygonF(places))
        painter.setBrush(QColor(self._color))
        painter.drawEllipse(places[-1], 2, 2)
        painter.end()


class EstimatesPanel(QWidget):
    """Estimates of the present run, hidden until it has points."""

    def __init__(self) -> None:
        super().__init__()
        self._update, self._busy = EstimateUpdate(), False
        self.caption = configure(QLabel(), "estimates.caption", kind="caption")
        self.note = configure(QLabel(), "estimates.note", kind="note", wordWrap=True)
        self.rows = [
            (configure(ElidedLabel(), kind="note"), configure(QLabel(), kind="small"), ErrorHistoryPlot())
            for _ in range(MAX_ROWS)
        ]
        grid(
            (self.caption, 0, 0, 1, 3),
            *((widget, at, column) for at, row in enumerate(self.rows, 1) for column, widget in enumerate(row)),
            (self.note, MAX_ROWS + 1, 0, 1, 3),
            parent=self,
            spacing=(8, 1),
            stretch={2: 1},
        )
        follow_tokens(self, lambda _: self._show_estimates())
        self.hide()

    def show_update(self, update: EstimateUpdate) -> None:
        """Show the present estimates."""
        if update is not self._update:
            self._update = update
            self._show_estimates()

    def _show_estimates(self) -> None:
        update = self._update
        count = pluralize(update.points, "usable point")
        self.caption.setText(f"From {count}")
        estimates = update.estimates[:MAX_ROWS]
        for at, row in enumerate(self.rows):
            for widget in row:
                widget.setVisible(at < len(estimates))
        for e, (name, value, history) in zip(estimates, self.rows, strict=False):
            slider = SLIDERS[e.name.partition("(")[0]]
            name.setText(slider.label + e.name.removeprefix(slider.name))
            name.setToolTip(name.text())
            value.setText(
                format_with_uncertainty(slider.factor * e.value, slider.factor * e.standard_error, slider.unit)
            )
            history.show_errors((update.error_history or {}).get(e.name, ()), tokens().model)
        rests = f"± by noise, hysteresis and creep: everything else is as in {update.active_model.description}, and counts as exact, as does the sensor's gain."
        self.note.setText(
            rests if estimates else TOO_FEW if update.message.startswith("not identifiable") else update.message
        )
        self.note.setToolTip(update.message)
        self._show()

    def set_busy(self, busy: bool) -> None:
        """Show the panel only during a run: final estimates are above the response."""
        self._busy = busy
        self._show()

    def _show(self) -> None:
        self.setVisible(self._busy and bool(self._update.points))
