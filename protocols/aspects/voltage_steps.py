"""Aspects of the protocol `voltage-steps`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from model import Array, DriveHistory, Mask, SeriesAxis, identification
from protocols import measurements
from protocols.base import (
    DISPLACEMENT_RANGE_M,
    REPEAT_ALIASES,
    Aspects,
    Figure,
    ImportColumn,
    ImportedTable,
    ImportForm,
    ModelState,
)

if TYPE_CHECKING:
    from model.identification import Observation
    from protocols.aspects.run_points import RunPoints

EARLIER_CREEP_AGES_S = (1.0, 10.0, 100.0)
"""Age of the earlier drive or load whose creep continues, before the begin of a run: any time from seconds to minutes."""

DEFAULT_READ_S = 1.0
"""Assumed time from reaching a level to its reading, for a table that does not state it."""

RAMP_LINES = 4
"""Lines of each ramp: its volts on the specimen bend at rest, and hysteresis follows them in parabolas."""

LEVEL_COLUMNS = ("level", "drive", "specimen_voltage")
MAX_BEYOND_V = 0.05
"""Largest excess of an imported level over the amplifier's input range."""


class VoltageStepsAspects(Aspects):
    """Voltage steps beside its measurement."""

    import_form = ImportForm(
        columns=(
            ImportColumn("level", "V", "volts at the amplifier's input", ("voltage", "input", "inputvoltage", "v", "u", "spannung"), (0.0, 5.0)),
            ImportColumn("specimen_voltage", "V", "volts on the specimen, behind the amplifier", ("highvoltage", "hv", "outputvoltage"), (-500.0, 1500.0)),
            ImportColumn("deflection", "m", "displacement against rest", ("displacement", "w", "durchbiegung"), DISPLACEMENT_RANGE_M),
            ImportColumn("repeat", "1", "which repeat", REPEAT_ALIASES),
            ImportColumn("direction", "1", "levels rising (1) or falling (-1)"),
            ImportColumn("read_time", "s", "time from reaching the level to its reading", ("time", "t")),
        ),
        required=(LEVEL_COLUMNS, ("deflection",)),
        input_uncertainties={"level": "V", "specimen_voltage": "V"},
    )  # fmt: skip

    def complete_table(self, table: ImportedTable) -> None:
        values, map_ = table.values, table.amplifier
        if "level" not in values and "drive" in values:
            values["level"] = values["drive"]
        if "level" not in values:
            values["level"] = map_.input_v(values.pop("specimen_voltage"))
            if "specimen_voltage_errors" in values:
                values["level_errors"] = values.pop("specimen_voltage_errors") / map_.slope_at(values["level"])
            table.warnings.append(
                f"volts on the specimen are turned into volts at the input by {map_.slope_below:g} and {map_.slope_above:g} V/V around {map_.rest_v:g} V"
            )
        level = values["level"]
        if (beyond := (level < map_.low_v - MAX_BEYOND_V) | (level > map_.high_v + MAX_BEYOND_V)).any():
            row = int(beyond.argmax())
            quantity = next(name for name in LEVEL_COLUMNS if name in table.headings)
            raise table.refusal(
                f": {level[row]:.4g} V leaves the amplifier's input range of {map_.low_v:g} to {map_.high_v:g} V; "
                f'volts on the specimen are named so: --column "specimen_voltage={table.headings[quantity]}"',
                row,
                quantity,
            )
        if "reached" in values and not values.get("direction", np.zeros(1)).any():
            values.setdefault("drive", level)
            values.setdefault("ramp_time", np.zeros(level.size))
            values.setdefault("read_time", np.full(level.size, DEFAULT_READ_S))
        table.warnings.append(f"deflections are taken as against rest, {map_.rest_v:g} V at the amplifier's input")

    short_name = "steps"

    def model_curve(self, state: ModelState, x: Array) -> Array:
        """Return the deflection under volts at the amplifier's input, against rest."""
        from model.response import voltage_gain  # slow to import

        gain = voltage_gain(state.specimen.acting_tactor)
        return np.asarray(gain * state.amplifier.specimen_v(x) * state.crept(identification.STEP_TIME_S))

    def figures(self, points: RunPoints) -> Iterator[Figure]:
        """Yield the deflection under a held voltage, against rest: levels reached from below and from above."""
        amplifier, rising = points.run.setup.amplifier_map, _rising(points)
        x = SeriesAxis("level", "V", "voltage at the amplifier's input")
        measured = replace(points.series(x, SeriesAxis("deflection", "m")), x=_input_v(points))
        ways = () if rising is None else (("rising", rising), ("falling", ~rising))
        series = tuple(replace(measured.at(rows), label=label) for label, rows in ways if rows.any())
        caption = (
            f"Deflection against rest at {amplifier.rest_v:g} V (0 V on the specimen). The kink is the amplifier's: "
            f"{amplifier.slope_below:g} V/V below rest, {amplifier.slope_above:g} V/V above."
        )
        grid, markers = np.linspace(amplifier.low_v, amplifier.high_v, 51), {"rising": "^", "falling": "v"}
        title = "Fig. 6: deflection under a voltage"
        yield Figure(series or (measured,), title, caption, self.model_curve, grid, markers=markers)

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        columns = points.columns
        good = points.good & (columns["deflection_errors"] > 0)
        time = columns["read_time"]
        input_v = _input_v(points)
        common = points.common_arguments("displacement", "volts")
        name = f"{points.label}, level of {{}} V"
        common["shared_errors"] += points.input_errors("level", "level", good, name, input_v)
        history = history_of_levels(points)
        if history is not None:
            common["shared_errors"] += _rest_errors(points.label, columns["zero"][points.good])
        elif np.isfinite(columns["drive_step"]).any():  # against rest before each level
            held_s = np.where(np.isfinite(time), time, DEFAULT_READ_S)
            history = DriveHistory.of_levels(input_v, points.run.setup.amplifier_map.rest_v, held_s, staircase=False)
        yield identification.VoltageStepsObservation(
            points.label,
            input_v,
            columns["deflection"],
            columns["deflection_errors"],
            rising=_rising(points),
            time_s=time if np.isfinite(time).all() else None,
            history=history,
            good=good,
            **common,
        )


def _input_v(points: RunPoints) -> Array:
    """Return the volts at the amplifier's input: as recorded, or as commanded if a table has no other."""
    drive = points.columns["drive"]
    return np.where(np.isfinite(drive), drive, points.columns["level"])


def _rising(points: RunPoints) -> Mask | None:
    """Return whether each level is reached from below; None if unknown for a level."""
    direction = np.nan_to_num(points.columns["direction"])
    return direction > 0 if (direction != 0).all() else None


def history_of_levels(points: RunPoints) -> DriveHistory | None:
    """Return the history of levels and rests; None if the points do not have them all, as in most imported tables.

    A ramp to rest begins when the recording ends, and ends when the source reported rest; the loop before the first level has its planned times.
    """
    columns, rest_v = points.columns, points.run.setup.amplifier_map.rest_v
    ramp, level = columns["ramp_time"], columns["drive"]
    if points.run.resumed_from is not None or not (np.isfinite(ramp) & np.isfinite(level)).all():
        return None
    protocol = points.read_protocol()
    assert isinstance(protocol, measurements.VoltageSteps)
    reached = columns.get("reached")
    if reached is None:  # a file of an earlier version
        recordings = points.recording_times(1)
        reached = None if recordings is None else recordings[:, 0, 1] - protocol.hold_s
    if reached is None or not np.isfinite(reached).all():
        return None
    begun = reached - ramp
    begin_s, end_s, to_v = _ramps(protocol, columns, begun, reached, rest_v)
    time_s = np.linspace(begin_s, end_s, RAMP_LINES + 1, axis=1)
    drive = np.linspace(np.append(rest_v, to_v[:-1]), to_v, RAMP_LINES + 1, axis=1)
    zero_s = (begun - measurements.ZERO_GUARD_S - protocol.window_s / 2)[:, None]
    return DriveHistory.of_points(time_s, drive, reached, reached + columns["read_time"], zero_s)


def _ramps(
    protocol: measurements.VoltageSteps, columns: dict[str, Array], begun: Array, reached: Array, rest_v: float
) -> Array:
    """Return begin (s), end (s) and final level (V) of every ramp in order, (3, R): of the loop before the first level, to each level, and to rest.

    Planned times replace the end of a recording and the arrival at rest where the points do not have them.
    """
    unknown = np.full(reached.size, np.nan)
    ended, rested = columns.get("ended", unknown), columns.get("rested", unknown)
    ended = np.where(np.isfinite(ended), ended, reached + protocol.hold_s)
    back = np.append(rested[1:], np.nan)
    back = np.where(np.isfinite(back), back, ended + reached - begun)
    levels = np.stack((columns["drive"], np.full(reached.size, rest_v)), axis=1)
    ramps = np.stack((np.stack((begun, ended), axis=1), np.stack((reached, back), axis=1), levels)).reshape(3, -1)
    if (columns.get("conditioned", np.zeros(1)) == 1).any():
        high_v, low_v = protocol.conditioning_levels_v(rest_v)
        lasts_s = np.array([high_v - rest_v, high_v - low_v, rest_v - low_v]) / measurements.RAMP_V_PER_S
        before_s = np.cumsum(np.append(0.0, lasts_s[:0:-1] + measurements.CONDITIONING_S))[::-1]
        at_rest_s = rested[0] if np.isfinite(rested[0]) else begun[0] - protocol.lead_s - protocol.rest_s
        end_s = at_rest_s - before_s
        loop = np.stack((end_s - lasts_s, end_s, np.array([high_v, low_v, rest_v])))
        ramps = np.concatenate((loop, ramps), axis=1)
    return np.asarray(ramps)


def _rest_errors(label: str, zero_m: Array) -> tuple[identification.SharedError, ...]:
    """Return the drifts at rest by creep from an unknown drive before the run: each at most the change of the zeros."""
    moved = float(np.ptp(zero_m)) if zero_m.size and np.isfinite(zero_m).all() else 0.0
    if moved == 0:
        return ()
    return tuple(
        identification.SharedError(f"{label}, creep of {age:g} s before it", "rest", moved, at=age)
        for age in EARLIER_CREEP_AGES_S
    )


ASPECTS = VoltageStepsAspects()
