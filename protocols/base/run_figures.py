"""Figures of a run for lists, fleets and control charts, and tables of results for the report."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self


class RunFigure(NamedTuple):
    """A figure of one run, SI.

    Attributes:
        statistical: standard uncertainty by the scatter of the points alone.
        total: standard uncertainty, with the uncertainty of the sensor's gain, which is common to all runs of a calibration.
        condition: condition of the figure, such as the drive; figures of different conditions are not compared.
        frequency_hz: frequency of a margin over the threshold of perception; 0 for other figures.
    """

    name: str
    value: float
    statistical: float
    total: float
    unit: str
    condition: str = ""
    frequency_hz: float = 0.0

    @classmethod
    def with_gain(
        cls, name: str, value: float, statistical: float, unit: str, gain: float, condition: str = ""
    ) -> Self:
        """Return a figure whose total uncertainty includes a relative uncertainty of the sensor's gain."""
        return cls(name, float(value), float(statistical), math.hypot(statistical, gain * value), unit, condition)


@dataclass(frozen=True, slots=True)
class ResultTable:
    """A table of the report; a figure as a cell is shown with its total uncertainty.

    Attributes:
        section: section of the report: `perception` or `results`.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | RunFigure, ...], ...]
    note: str = ""
    section: str = "results"
