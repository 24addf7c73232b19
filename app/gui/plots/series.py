"""Series of plots as text for the clipboard, and the two amplitudes over frequency."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from PySide6.QtCore import Qt

from model import ERRORS, Array, Series


@dataclass(frozen=True, slots=True)
class AmplitudeSeries:
    """One of the two amplitudes: its name, symbol and line style, and the attribute that times `factor` gives it in µm."""

    label: str
    symbol: str
    line: Qt.PenStyle
    column: str
    factor: float

    def values_of(self, source: Any) -> Array:
        """Return the amplitudes of a curve or run, (N,), µm."""
        values = getattr(source, self.column)
        values = values.plotted if isinstance(values, Series) else np.asarray(values)
        return self.factor * (np.abs(values) if np.iscomplexobj(values) else values)

    def errors_of(self, source: Any) -> Array | None:
        """Return their standard errors, µm; None for a curve of the model."""
        values = getattr(source, self.column)
        errors = values.errors if isinstance(values, Series) else getattr(source, self.column + ERRORS, None)
        return None if errors is None else self.factor * np.asarray(errors)


SERIES = (
    AmplitudeSeries("max − min", "o", Qt.PenStyle.SolidLine, "peak_to_peak", 1e6),
    AmplitudeSeries("2 × fundamental", "s", Qt.PenStyle.DashLine, "fundamental", 2e6),
)


def series_as_text(series: Iterable[Series], x_label: str, y_label: str, simulated: bool) -> str:
    """Return a tab-separated table, as spreadsheets paste it; simulated data begin with a line SIMULATED."""
    lines = ["SIMULATED"] if simulated else []
    lines.append(f"series\t{x_label}\t{y_label}\tstandard error")
    for one in series:
        errors = one.total_errors if one.errors is None else one.errors
        errors = np.full(one.x.size, np.nan) if errors is None else errors
        lines += [
            f"{one.title}\t{x:.10g}\t{y:.10g}\t{'' if np.isnan(error) else f'{error:.6g}'}"
            for x, y, error in zip(one.x, one.y, errors, strict=True)
            if np.isfinite(x) and np.isfinite(y)
        ]
    return "\n".join(lines) + "\n"
