"""Points of a run with the errors of its instruments, from which a protocol's aspects make observations for the fit.

The gain error of a sensor is shared by all its values; its name has the serial number, so that only runs with the same sensor
share it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np

from model import Array, Mask, ParameterError, Series, SeriesAxis
from model.identification import ErrorTarget, SharedError
from protocols.base import Protocol
from protocols.runfile import Run

MAX_INPUT_ERRORS = 100
"""Largest number of errors of single inputs, such as masses or levels, of one run in a fit."""
ONE_TEMPERATURE_K = 1.0
"""Differences of temperature within a run that count as one temperature."""


@dataclass(frozen=True, slots=True)
class RunPoints:
    """Points of an open run.

    Attributes:
        run: the run, for further data such as curves and events.
        columns: columns of its points, (F,) each.
        good: mask of points that a fit may use, (F,); flagged points are kept but not used.
        read_protocol: function that returns the protocol with the run's parameters; raises RunReadError for rejected parameters.
        part: end of the label, of a part of the points.
    """

    run: Run
    columns: dict[str, Array]
    good: Mask
    read_protocol: Callable[[], Protocol]
    part: str = ""

    @property
    def label(self) -> str:
        """Label of the run's observations."""
        return self.run.path.stem + self.part

    @property
    def temperature_c(self) -> float | None:
        """Mean temperature of the usable points, degrees Celsius; of the run, if they have none; None if unknown."""
        measured = self._measured_c
        return self.run.setup.conditions.temperature_c if measured.size == 0 else float(measured.mean())

    @property
    def _measured_c(self) -> Array:
        stored = self.columns.get("air_temperature", np.empty(0))
        return stored[self.good & np.isfinite(stored)] if stored.size else stored

    def by_temperature(self) -> Iterator["RunPoints"]:
        """Yield the points in groups of nearly one temperature, each with all rows and a mask of its own; most runs are one group.

        A point without a temperature belongs to the group nearest to the mean.
        """
        measured = self._measured_c
        if measured.size == 0 or np.ptp(measured) <= ONE_TEMPERATURE_K:
            yield self
            return
        stored = self.columns["air_temperature"]
        group = np.round(np.where(np.isfinite(stored), stored, measured.mean()) / ONE_TEMPERATURE_K)
        for number in np.unique(group[self.good]):
            mine = replace(self, good=self.good & (group == number))
            yield replace(mine, part=f" at {mine.temperature_c:.1f} °C")

    @property
    def start_s(self) -> float:
        """When the run was started, s: the order of runs."""
        return datetime.fromisoformat(self.run.setup.start_time).timestamp() if self.run.setup.start_time else 0.0

    def take(self, rows: Mask) -> "RunPoints":
        """Return some of the points."""
        return replace(
            self, columns={name: column[rows] for name, column in self.columns.items()}, good=self.good[rows]
        )

    def series(
        self,
        x: SeriesAxis | str,
        y: SeriesAxis | str,
        label: str = "",
        rows: Mask | None = None,
        values: Array | None = None,
    ) -> Series:
        """Return columns of the points over each other with the standard errors of y, for a figure.

        Args:
            x: column, as an axis with a description or by name.
            y: column, in the same form.
            label: label of the series.
            rows: mask of its points; None: all.
            values: values of y, (F,), if different from the column's.
        """
        units = self.run.units()
        x_axis, y_axis = (SeriesAxis(axis, units[axis]) if isinstance(axis, str) else axis for axis in (x, y))
        y_values = self.columns[y_axis.name] if values is None else values
        errors = self.columns.get(f"{y_axis.name}_errors")
        errors = np.full(y_values.size, np.nan) if errors is None else errors
        whole = Series(
            self.columns[x_axis.name],
            y_values,
            errors,
            usable=self.good & ~(errors <= 0),
            x_axis=x_axis,
            y_axis=y_axis,
            label=label,
        )
        return whole if rows is None else whole.at(rows)

    def common_arguments(self, *acting: ErrorTarget) -> dict[str, Any]:
        """Return the errors of sensor and amplifier that act on these targets, whether the run is simulated, its temperature and mountings."""
        sensor, amplifier = self.run.setup.sensor, self.run.setup.configuration.get("amplifier", {})
        label = f"{sensor.name} {sensor.serial}".strip()
        slopes = f"slopes of {amplifier.get('name', 'the amplifier')} {amplifier.get('serial', '')}".strip()
        stated: tuple[tuple[str, ErrorTarget, float], ...] = (
            (f"gain of {label}", "displacement", sensor.gain_relative_uncertainty),
            (f"delay of {label}", "delay", sensor.delay_uncertainty_s),
            (slopes, "volts", float(amplifier.get("slope_relative_uncertainty", 0.0))),
        )
        errors = tuple(SharedError(name, on, size) for name, on, size in stated if size > 0 and on in acting)
        return {
            "shared_errors": errors,
            "simulated": self.run.setup.simulated,
            "temperature_c": self.temperature_c,
            "mountings": {each.part: each.time for each in self.run.mountings},
        }

    def input_errors(
        self, column: str, target: ErrorTarget, good: Mask, name: str, values: Array | None = None
    ) -> tuple[SharedError, ...]:
        """Return an error for each different value of an input whose uncertainty a table states, such as each mass.

        Args:
            column: column of the input; its errors are in `<column>_errors`.
            target: affected quantity.
            good: usable points.
            name: name of the error, with {} for the value.
            values: input of the model, if different from the column.
        """
        stated = self.columns.get(f"{column}_errors")
        if stated is None:
            return ()
        at = self.columns[column] if values is None else values
        counts = good & np.isfinite(at) & np.isfinite(stated) & (stated > 0)
        errors = []
        for value in np.unique(at[counts]).tolist():
            error = float(np.sqrt(np.mean(stated[counts & (at == value)] ** 2)))
            relative = error / abs(value) if target == "load" else error
            errors.append(SharedError(name.format(f"{value:.9g}"), target, float(f"{relative:.6g}"), at=value))
        if len(errors) > MAX_INPUT_ERRORS:
            raise ParameterError(
                f"{column} has {len(errors)} different values with a separate uncertainty, the limit is {MAX_INPUT_ERRORS}: "
                "add it to the uncertainty of the measured values, and omit this column"
            )
        return tuple(errors)

    def recording_times(self, count: int) -> Array | None:
        """Return begin and end of the last `count` recordings of each point, s, (F, count, 2); None if a point has fewer."""
        run, entries = self.run, self.columns["entry"]
        if run.setup.imported or not entries.size or run.resumed_from is not None:
            return None
        trace, places = run.trace, dict[int, list[tuple[int, int]]]()
        for first, stop, entry in trace.recording_rows():
            places.setdefault(entry, []).append((first, stop))
        rows = [places.get(int(entry), [])[-count:] for entry in entries]
        if any(len(each) < count for each in rows):
            return None
        edges = sorted({edge for each in rows for pair in each for edge in pair})
        step_s = 1 / trace.rate_hz
        lasts = [max(edge - 1, 0) for edge in edges]
        ends = {
            edge: last + step_s if edge else 0.0 for edge, last in zip(edges, trace.times_of_rows(lasts), strict=True)
        }
        firsts = sorted({first for each in rows for first, _ in each})
        begins = dict(zip(firsts, trace.times_of_rows(firsts), strict=True))
        return np.array([[(begins[first], ends[stop]) for first, stop in each] for each in rows])
