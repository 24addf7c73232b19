"""Load point: deflection under one weight (zero, loaded, zero), operator prompts, and compliance fit."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Unit

from drivers import REST_TOLERANCE_V, Hold
from model import format_quantity
from protocols.base import EstimatedQuantity, Prompt, Quality, Recording
from protocols.measurements.fields import QualityFlags, RepeatNumber, point_quality
from protocols.signals import LevelEstimate, WeightStepDetector, weighted_fit

SOURCE = "static loading, weighted lines through zero"

EXPLAINED_SIGMAS = 3.0
"""Largest difference between the change of a zero and the creep's remainder, in standard errors, that is explained by it."""

PLACING_S = 0.2
"""Time from the middle of a hand's movement to the quiet samples after it, and its standard uncertainty: a heavy weight on a specimen that
creeps is quiet later."""

SIDE_LABELS = {1.0: "MFC up", -1.0: "aluminium up"}

ValueWithError = tuple[float, float]
"""A value and its standard error."""


def compliance_estimates(points: Sequence[Any]) -> tuple[EstimatedQuantity, ...]:
    """Return all quantities identified from the usable points; quantities without enough points are left out."""
    by_side = {side: [p for p in points if p.side == side] for side in SIDE_LABELS}
    lines = {side: line for side, group in by_side.items() if (line := compliance(group)) is not None}
    estimates = [
        EstimatedQuantity.listed(f"compliance, {SIDE_LABELS[side]}", *line, SOURCE) for side, line in lines.items()
    ]
    if len(lines) == len(SIDE_LABELS):
        (one, one_error), (other, other_error) = lines.values()
        error = math.hypot(one_error, other_error)
        mean = (one + other) / 2
        estimates += [
            EstimatedQuantity.listed("compliance, mean of both sides", mean, error / 2, SOURCE),
            EstimatedQuantity.listed("side_difference", (one - other) / mean, error / abs(mean), SOURCE),
        ]
    for side, group in by_side.items():
        if (bend := nonlinearity(group)) is not None:
            source = f"static loading, against a line, at {max(p.load for p in group):.3g} N"
            estimates.append(EstimatedQuantity.listed(f"nonlinearity, {SIDE_LABELS[side]}", *bend, source))
    return tuple(estimates)


def compliance(points: Sequence[Any]) -> ValueWithError | None:
    """Slope of the weighted line through zero, m/N; None for fewer than two points or no load.

    Each point is weighted with its own error, including the error of the load. Significant scatter of the points widens the standard
    error.
    """
    if len(points) < 2:
        return None
    load, moved = (np.array([getattr(p, name) for p in points]) for name in ("load", "deflection"))
    slope = float(load @ moved / (load @ load))
    for _ in range(2):  # the load's error times the slope
        (slope,), covariance = weighted_fit((load,), moved, 1 / np.sqrt(_variance(points, slope)))
    return float(slope), math.sqrt(covariance[0, 0])


def nonlinearity(points: Sequence[Any]) -> ValueWithError | None:
    """Return the relative difference of the compliance at the largest load from the compliance without load: d = c F (1 + n F / F_max).

    None for fewer than three different loads.
    """
    if len({round(p.load, 9) for p in points}) < 3:
        return None
    first = compliance(points)
    if first is None or not first[0]:
        return None
    load, moved = (np.array([getattr(p, name) for p in points]) for name in ("load", "deflection"))
    most = float(load.max())
    root = 1 / np.sqrt(_variance(points, first[0]))
    (c, bent), covariance = weighted_fit((load, load**2 / most), moved, root)
    turn = np.array([-bent / c**2, 1 / c])
    return float(bent / c), math.sqrt(float(turn @ covariance @ turn))


def _variance(points: Sequence[Any], slope: float) -> Any:
    return np.array([p.deflection_errors**2 + (slope * p.load_errors) ** 2 for p in points])


@dataclass(frozen=True, slots=True)
class LoadPoint:
    """One weight on one side. Errors are standard and statistical; the sensor's gain is common to all."""

    side: Annotated[float, Unit("1"), "1 with the MFC up, -1 with the aluminium up"]
    mass: Annotated[float, Unit("kg"), "mass of the weight, besides the offset"]
    repeat: RepeatNumber
    load: Annotated[float, Unit("N"), "force of mass and gravity"]
    load_errors: Annotated[float, Unit("N"), "standard uncertainty of the load; one error shared by all repeats"]
    deflection: Annotated[
        float, Unit("m"), "displacement under the weight against the mean of the zeros before and after"
    ]
    deflection_errors: Annotated[
        float,
        Unit("m"),
        "standard uncertainty of the deflection, with a change of the zero that creep does not explain",
    ]
    zero_before: Annotated[float, Unit("m"), "sensor reading before the weight is put on"]
    zero_after: Annotated[float, Unit("m"), "sensor reading after the weight is taken off"]
    drift: Annotated[float, Unit("m"), "zero after - zero before"]
    creep: Annotated[float, Unit("m/s"), "slope of the displacement under the weight during the recording"]
    noise: Annotated[float, Unit("m"), "standard deviation of the residuals of line and mains under the weight"]
    zero_before_time: Annotated[
        float, Unit("s"), "time of the zero before the weight, since the first sample of the run"
    ]
    placed: Annotated[float, Unit("s"), "time at which the weight was put on"]
    read: Annotated[float, Unit("s"), "time of the reading under the weight"]
    lifted: Annotated[float, Unit("s"), "time at which the weight was taken off"]
    zero_after_time: Annotated[float, Unit("s"), "time of the zero after the weight"]
    quality: QualityFlags

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        moved = f"deflection {format_quantity(self.deflection, self.deflection_errors, 'm', signed=True)}"
        return (
            f"{SIDE_LABELS.get(self.side, 'either side')}, {format_quantity(self.mass, 0.0, 'kg')} ({self.repeat:.0f}): {moved} under {self.load:.4f} N, "
            f"zero moved {1e6 * self.drift:+.2f} µm"
        )


def load_point(
    key: Sequence[float],
    recordings: Sequence[Recording],
    measure_level: Callable[[Recording], LevelEstimate],
    load_n: tuple[float, float],
    record_s: float,
    zero_limit_m: Callable[[float], float],
    simulated: bool,
) -> LoadPoint:
    """Return the point of one weight; the last three recordings count.

    Args:
        key: side (1: MFC up, -1: aluminium up), mass in kg, number of the repeat.
        recordings: recordings of the weight.
        measure_level: function that returns the level of a recording.
        load_n: the weight's force and its standard uncertainty.
        record_s: length of the part of a recording that is read, at its end, and of the quiet samples by which a weight is detected.
        zero_limit_m: function that returns the largest change of the zero over a deflection in m; a larger one makes the point
            unsettled.
        simulated: whether the bench was simulated.

    Raises:
        ValueError: there are fewer than three recordings.
    """
    side, mass_kg, repeat = key
    if len(recordings) < 3:
        raise ValueError("a weight needs three recordings: zero, weight on, zero again")
    parts = recordings[-3:]
    before, under, after = (measure_level(part) for part in parts)
    drift = after.value - before.value
    deflection = under.value - (before.value + after.value) / 2
    zero_error, times = math.hypot(before.standard_error, after.standard_error) / 2, _times(parts, record_s)
    moved = _unexplained_shift(before, under, after, times, record_s)
    # The time at which the zero moved is unknown: a rectangular distribution from one to the other.
    error = math.hypot(under.standard_error, zero_error, moved / math.sqrt(12))
    detected = {
        Quality.DRIVE_OFF: any(
            isinstance(part.drive, Hold) and abs(float(part.drive_v.mean()) - part.drive.level_v) > REST_TOLERANCE_V
            for part in parts
        ),
        Quality.UNSETTLED: abs(drift) > zero_limit_m(deflection),
        Quality.NO_RESPONSE: abs(deflection) <= 5 * error,
    }
    load, load_error = load_n
    return LoadPoint(
        side=side,
        mass=mass_kg,
        repeat=repeat,
        load=load,
        load_errors=load_error,
        deflection=deflection,
        deflection_errors=error,
        zero_before=before.value,
        zero_after=after.value,
        drift=drift,
        creep=under.drift_per_s,
        noise=under.noise,
        **times,
        quality=point_quality(parts, simulated, detected),
    )


def _unexplained_shift(
    before: LevelEstimate, under: LevelEstimate, after: LevelEstimate, times: Mapping[str, float], record_s: float
) -> float:
    """Return the change of the zero over a weight that its creep does not explain; 0 within `EXPLAINED_SIGMAS`.

    A specimen that creeps with the logarithm of time has not returned when the zero is read again. The slope under the weight
    tells the remainder, which is the same in every repeat: it is no error of the deflection.
    """
    lasted = times["read"] - times["placed"]
    since_placed, since_lifted = (times["zero_after_time"] - times[name] for name in ("placed", "lifted"))
    remainder_s = lasted * math.log(since_placed / since_lifted)
    slope_error = under.standard_error * math.sqrt(12) / record_s
    shift = after.value - before.value - under.drift_per_s * remainder_s
    error = math.hypot(before.standard_error, after.standard_error, slope_error * remainder_s)
    # Continuous at the limit: a jump would change the weights of points by chance.
    return math.sqrt(max(shift**2 - (EXPLAINED_SIGMAS * error) ** 2, 0.0))


def _times(parts: Sequence[Recording], record_s: float) -> dict[str, float]:
    """Return the times of a point; a weight is detected by quiet samples before its recording."""
    begins = [part.start_s for part in parts]
    ends = [part.start_s + part.displacement_m.size / part.rate_hz for part in parts]
    before, read, after = (end - record_s / 2 for end in ends)
    placed, lifted = (max(begins[i] - record_s - PLACING_S, ends[i - 1]) for i in (1, 2))
    return {"zero_before_time": before, "placed": placed, "read": read, "lifted": lifted, "zero_after_time": after}


DONE, PREVIOUS, REPEAT, KEEP = "done", "previous again", "repeat", "keep"

MAX_ATTEMPTS = 3
"""Repeats of an implausible weight before its deflection is accepted as the specimen's."""


CREEP_MARGIN = 1.5
"""Multiple of a specimen's creep in a baseline under the previous weight that counts as quiet."""


class WeightStepWatcher:
    """Detects in the laser signal that a weight is put on or taken off, from the previous level (protocols.base.steps.Detector)."""

    def __init__(self, baseline: Recording, min_step_m: float, baseline_s: float) -> None:
        before = baseline.displacement_m[-round(baseline_s * baseline.rate_hz) :]
        half = before.size // 2
        creep_m = 2 * abs(float(before[half:].mean() - before[:half].mean()))
        tolerance_m = min_step_m * min(max(0.05, CREEP_MARGIN * creep_m / min_step_m), 0.45)
        self._detector = WeightStepDetector(baseline.rate_hz, min_step_m, tolerance_m)
        self._detector.feed(before)

    def feed(self, drive_v: Any, displacement_m: Any) -> bool:
        """Return whether the new samples, (n,) each, show the event."""
        return self._detector.feed(displacement_m) is not None


def turn_side_prompt(side: float, offset_kg: float) -> Prompt:
    """Lay the tactor on its other side, electrodes shorted."""
    offset = f" and put the {format_quantity(offset_kg, 0.0, 'kg')} offset weight on its centre" if offset_kg else ""
    return Prompt(
        "turn-side",
        f"High voltage is off. Short the electrodes, lay the tactor with the {SIDE_LABELS[side].replace(' up', ' side')} up{offset}.",
        {"side": side, "offset_kg": offset_kg, "shorted": 1.0},
        hands_on=True,
    )


def place_weight_prompt(side: float, mass_kg: float, has_previous: bool) -> Prompt:
    """Return the prompt to put a weight on; or to report that the previous one was wrong."""
    return Prompt(
        "place-weight",
        f"Place the {format_quantity(mass_kg, 0.0, 'kg')} weight on the centre; the laser sees it land.",
        {"mass_kg": mass_kg, "side": side},
        (DONE, PREVIOUS) if has_previous else (DONE,),
        hands_on=True,
    )


def remove_weight_prompt(side: float, mass_kg: float) -> Prompt:
    """Return the prompt to take a weight off; or to report that it was wrong."""
    text = f"Take the {format_quantity(mass_kg, 0.0, 'kg')} weight off."
    return Prompt("remove-weight", text, {"mass_kg": mass_kg, "side": side}, (DONE, REPEAT), hands_on=True)


def repeat_or_keep_prompt(action: str, message: str, attempt: int) -> Prompt:
    """Return the repeat of an implausible weight; a deflection that recurs often is accepted as the specimen's."""
    if attempt < MAX_ATTEMPTS:
        return Prompt(action, f"{message} Repeat it, or keep it as it is?", choices=(REPEAT, KEEP))
    return Prompt(action, f"{message} That was attempt {attempt}. Keep it, or repeat it?", choices=(KEEP, REPEAT))
