"""A run in a comparison: its curves with the settings under which each was measured."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from string import ascii_uppercase
from typing import NamedTuple, Self

import numpy as np

from app.archive import RunSummary, points_series, read_run_summary
from model import LENGTH_UNITS, Array, GainErrors, Series, SeriesAxis
from protocols.base import usable_mask
from protocols.runfile import ENTRY_COLUMN, RESPONSE_COLUMNS, Run, RunReadError, translate_read_errors

MAX_RUNS = 20
LETTERS = ascii_uppercase[:MAX_RUNS]
"""Letters of compared runs in their order."""

SPLIT_COLUMNS = ("side", "direction", "level", "mass", "load", "elongation")
"""Columns of points whose values are a curve each; repeats of one setting are averaged."""


class ComparisonError(Exception):
    """Runs cannot be compared as asked; the message gives reason and remedy."""


class RunCurve(NamedTuple):
    """A curve and the settings under which it was measured, SI: `time` (s since 1970), `amplitude` (V), `mass`, `elongation`."""

    series: Series
    settings: Mapping[str, float]

    @property
    def quantity(self) -> str:
        """The axes as text: `peak to peak over frequency`."""
        return f"{self.series.y_axis.name} over {self.series.x_axis.name}".replace("_", " ")


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRun:
    """A run with its curves; the first one is the plot of its protocol.

    Attributes:
        letter: its name in the comparison.
        path: the file.
        summary: its row in lists.
        curves: points and series over their axes.
        simulated: whether it was measured on the simulated bench.
    """

    letter: str
    path: Path
    summary: RunSummary
    curves: tuple[RunCurve, ...]

    @classmethod
    def read(cls, path: Path, letter: str = LETTERS[0]) -> Self:
        """Read a run.

        Raises:
            RunReadError: it is missing, damaged, or of a newer version.
        """
        with Run(path) as run, translate_read_errors(path):
            curves = tuple(_curves(run))
        summary = read_run_summary(path, path.name)
        if summary is None or not summary.readable:
            raise RunReadError(f"{path.name} cannot be read; copy it again")
        return cls(letter, path, summary, curves)

    @property
    def simulated(self) -> bool:
        return bool(self.summary.simulated)

    @property
    def title(self) -> str:
        """Specimen and begin: `T7 22 Nov 17:59:03`."""
        begun = self.summary.started_at
        return f"{self.summary.specimen or self.path.stem} {f'{begun:%d %b %H:%M:%S}' if begun else ''}".strip()

    def gains_against(self, reference: "ComparedRun", unit: str) -> GainErrors:
        """Return the errors of the sensors' gains of this run and its reference for values of a unit."""
        if unit not in LENGTH_UNITS:
            return GainErrors()
        own, other = (run.summary.record.sensor for run in (self, reference))
        same = (own.name, own.serial, own.calibrated, own.gain_m_per_v) == (
            other.name, other.serial, other.calibrated, other.gain_m_per_v,
        )  # fmt: skip
        return GainErrors(own.gain_relative_uncertainty, other.gain_relative_uncertainty, float(same))


def _curves(run: Run) -> Iterator[RunCurve]:
    """Yield the plot of the protocol first, then the others."""
    points, units, (x, y) = run.points(), run.units(), run.record.axes
    series = [RunCurve(one, _settings(run, points, one.entry)) for one in run.series()]
    is_default = [bool(run.record.default_plot) and each.series.name == run.record.default_plot for each in series]
    yield from (each for each, first in zip(series, is_default, strict=True) if first)
    if {x, y} <= points.keys() and points[x].size and points[y].ndim == 1:
        whole = Series(
            points[x], points[y], points.get(f"{y}_errors"), usable=usable_mask(points["quality"]), name="points",
            x_axis=SeriesAxis(x, units[x], x.replace("_", " ")), y_axis=SeriesAxis(y, units[y], y.replace("_", " ")),
        )  # fmt: skip
        yield from _split(run, whole, points)
        if points.keys() >= RESPONSE_COLUMNS and (per_volt := points_series(run)).is_complex:
            yield RunCurve(per_volt, _settings(run, points))
    yield from (each for each, first in zip(series, is_default, strict=True) if not first)


def _split(run: Run, whole: Series, points: Mapping[str, Array]) -> Iterator[RunCurve]:
    """Yield a curve for each combination of settings, with the settings that vary as its label."""
    varying = [
        name
        for name in SPLIT_COLUMNS
        if name in points and name != whole.x_axis.name and len(np.unique(points[name])) > 1
    ]
    keys = (
        list(zip(*(np.round(points[name].astype(float), 9).tolist() for name in varying), strict=True))
        or [()] * whole.x.size
    )
    keys = [tuple("none" if value != value else f"{value:.4g}" for value in key) for key in keys]
    for key in dict.fromkeys(keys):
        rows = np.array([each == key for each in keys])
        label = ", ".join(f"{name} {value}" for name, value in zip(varying, key, strict=True))
        part = {name: column[rows] for name, column in points.items()}
        one = replace(whole.at(rows), label=label)
        yield RunCurve(one.at(np.argsort(one.x, kind="stable")), _settings(run, part))


def _settings(run: Run, points: Mapping[str, Array], entry: int | None = None) -> dict[str, float]:
    """Return the settings of these points, or of the points of one entry."""
    rows = slice(None) if entry is None or ENTRY_COLUMN not in points else points[ENTRY_COLUMN] == entry
    amplitude = run.record.parameters.get("peak_to_peak_v")
    found = {"time": datetime.fromisoformat(run.record.start_time).timestamp()} if run.record.start_time else {}
    if isinstance(amplitude, int | float):
        found["amplitude"] = float(amplitude)
    for name, column, factor in (
        ("amplitude", "drive_amplitude", 2.0),
        ("mass", "mass", 1.0),
        ("elongation", "elongation", 1.0),
    ):
        values = np.asarray(points[column][rows], float) if column in points else np.empty(0)
        if (values := values[np.isfinite(values)]).size:
            found[name] = factor * float(np.median(values))
    return found
