"""Latency: time until the displacement reaches the perception threshold, after a step and after the onset of a sine.

The steps are the fastest that the bench admits. The times of a step begin at the centroid of its edge in the recorded drive, so
that they equal times of an ideal step to first order; the remaining effect of the edge is in the uncertainty. The times of a sine
begin at its onset. The sensor's delay is removed. The amplifier is part of the actuator: times refer to its input.
"""

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from drivers import Drive, Sine, Steps
from model import Array, format_quantity
from model.response import THRESHOLD_M
from protocols.base import (
    CheckResult,
    EstimatedQuantity,
    PlanEntry,
    Protocol,
    Quality,
    Record,
    Recording,
    Series,
    SeriesAxis,
    Step,
    first_adapted,
)
from protocols.measurements.fields import DriveVpp, QualityFlags, RepeatNumber, point_quality
from protocols.measurements.result_checks import (
    CABLE_REMEDY,
    group_values,
    repeatability_check,
    signal_to_noise_check,
    usable_points,
)
from protocols.signals import (
    EDGE_FLOOR,
    Crossing,
    edge_average,
    find_edge,
    first_crossing,
    fit_frequency,
    fit_sine,
    last_crossing,
    smooth,
)

STEP, SINE = "step", "sine"

LEAST_DWELL_S = 0.02
"""Shortest dwell after which a step has settled before its return: the first mode settles within 17 ms."""

SLOWER = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)
"""Shares of the slope, tried in turn if the source's memory is too small for the fastest edge."""

SHOWN_S = 0.03
"""Duration of the stored curve of a response, from `CURVE_LEAD_S` before the onset."""
CURVE_LEAD_S = 1e-3

FINAL_SHARE = 0.2
"""Share of a dwell at its end whose mean is the final value of a step."""

HARMONICS = 8
"""Harmonics of the steady response to a sine; the amplifier's two slopes generate even ones."""

SETTLED_NOISE = 1.5
"""Uncertainty of a deviation from the fitted steady state, divided by the uncertainty of a sample."""

RISE_LOW, RISE_HIGH = 0.1, 0.9
EDGE_LIMIT = 1.3
"""Largest recorded duration of an edge over the commanded one: a staircase of 5 µs adds 2 %."""

LEAST_SIGMAS = 5.0
"""Smallest response in standard uncertainties of a sample."""

SOURCE = "latency"


@dataclass(frozen=True, slots=True)
class LatencyPoint:
    """One onset. Uncertainties are standard; the common errors of the sensor's gain and delay are excluded."""

    frequency: Annotated[float, Unit("Hz"), "frequency of the sine; 0: a step"]
    level: Annotated[float, Unit("V"), "level of the step, or highest level of the sine, at the amplifier's input"]
    repeat: RepeatNumber
    latency: Annotated[float, Unit("s"), "time from the onset until the displacement reaches the threshold"]
    latency_errors: Annotated[float, Unit("s"), "standard uncertainty of the latency, with the residuals at the edge"]
    driven_latency: Annotated[float, Unit("s"), "latency from the begin of the edge as driven"]
    threshold_speed: Annotated[float, Unit("m/s"), "speed of the displacement at the threshold"]
    rise: Annotated[float, Unit("s"), "step: 10 % to 90 % of the final value; sine: from its begin to 90 % of its peak"]
    rise_errors: Annotated[float, Unit("s"), "standard uncertainty of the rise"]
    overshoot: Annotated[float, Unit("1"), "largest excess over the final value, or over the steady peak, as a share"]
    overshoot_errors: Annotated[float, Unit("1"), "standard uncertainty of the overshoot"]
    settling: Annotated[
        float, Unit("s"), "time from the onset until the response stays within the band of its steady state"
    ]
    settling_errors: Annotated[float, Unit("s"), "standard uncertainty of the settling time"]
    final: Annotated[float, Unit("m"), "mean at the end of the step, or steady peak of the sine, against rest"]
    final_errors: Annotated[float, Unit("m"), "standard uncertainty of the final value"]
    drive_step: Annotated[float, Unit("V"), "step of the recorded drive, or amplitude of the recorded sine"]
    edge_time: Annotated[float, Unit("s"), "duration of the drive's edge as recorded; 0 for a sine"]
    quality: QualityFlags

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        drive = f"sine of {self.frequency:g} Hz" if self.frequency else f"step to {self.level:g} V"
        felt = f"threshold after {format_quantity(self.latency, self.latency_errors, 's')}"
        if not math.isfinite(self.latency):
            felt = "below the threshold"
        return (
            f"{drive}, repeat {self.repeat:g}: {felt}, rise {format_quantity(self.rise, self.rise_errors, 's')}, overshoot "
            f"{100 * self.overshoot:.1f} %, settled after {1e3 * self.settling:.3g} ms"
        )


def _onset_name(frequency_hz: float, level_v: float) -> str:
    """Return the suffix of an estimate's name; files list estimates by name, steps first."""
    return f"from the onset of {frequency_hz:g} Hz" if frequency_hz else f"after a step to {level_v:g} V"


class OnsetLatency(Protocol):
    """Time to the perception threshold, rise, overshoot and settling, after the fastest steps and after onsets of a sine."""

    name: ClassVar[str] = "latency"
    title: ClassVar[str] = "Latency"
    point_type: ClassVar[type] = LatencyPoint
    axes: ClassVar[tuple[str, str]] = ("frequency", "latency")
    default_plot: ClassVar[str] = "onset"
    substitutes: ClassVar[tuple[str, ...]] = ("voltage-steps",)

    levels_v: Annotated[
        tuple[Annotated[float, Interval(ge=0, le=5)], ...],
        Unit("V"),
        Len(0, 20),
        "levels of the steps; each step begins at rest",
    ] = (5.0,)
    slew_v_per_s: Annotated[
        float,
        Unit("V/s"),
        Interval(ge=100, le=1e6),
        "slope of each edge at the amplifier's input; the default is 10 % below the usual limit, because a source plays samples",
    ] = 9_000.0
    dwell_s: Annotated[float, Unit("s"), Interval(ge=LEAST_DWELL_S, le=1), "recording before and after each edge"] = 0.1
    frequencies_hz: Annotated[
        tuple[Annotated[float, Interval(ge=10, le=500)], ...], Unit("Hz"), Len(0, 50), "frequencies of the sine onsets"
    ] = (100.0, 150.0, 200.0, 250.0)
    peak_to_peak_v: DriveVpp = 5.0
    sine_s: Annotated[float, Unit("s"), Interval(ge=0.05, le=5), "duration of each sine"] = 0.2
    repeats: Annotated[int, Unit("1"), Interval(ge=1, le=100), "measurements of each onset"] = 5
    threshold_m: Annotated[float, Unit("m"), Interval(gt=0, le=1e-2), "displacement threshold of perception"] = (
        THRESHOLD_M
    )
    tolerance: Annotated[
        float, Unit("1"), Interval(gt=0, lt=0.5), "band of the settling time, as a share of the final value"
    ] = 0.02
    sample_rate_hz: Annotated[float, Unit("Hz"), Interval(ge=50_000, le=250_000), "scans per second"] = 100_000.0

    @model_validator(mode="after")
    def _check_parameters(self) -> Self:
        if not self.levels_v and not self.frequencies_hz:
            raise ValueError("levels_v and frequencies_hz are both empty: name a level to step to, or a frequency")
        return self

    def adapted(self, rest_v: float, reason_unsupported: Callable[[Drive], str]) -> Self:
        """Shorten the dwells if the source's memory is small, then slow down the edges."""
        dwells = [self.dwell_s * share for share in (0.7, 0.5, 0.35) if self.dwell_s * share >= LEAST_DWELL_S]
        dwell = {"dwell_s": min(self.dwell_s, LEAST_DWELL_S)}
        changes: list[dict[str, float]] = [{"dwell_s": round(s, 4)} for s in dwells]
        changes += [dwell, *({**dwell, "slew_v_per_s": round(share * self.slew_v_per_s, 3)} for share in SLOWER)]
        return first_adapted(changes, self, rest_v, reason_unsupported)

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        return tuple(
            PlanEntry(f"{name}, repeat {repeat}", (drive,), 2 * (drive.duration_s + 0.3), (kind, value, float(repeat)))
            for kind, value, name, drive in self._onsets(rest_v)
            for repeat in range(1, self.repeats + 1)
        )

    def _onsets(self, rest_v: float) -> Iterator[tuple[str, float, str, Drive]]:
        for level in self.levels_v:
            rise_s = max(abs(level - rest_v), 0.01) / self.slew_v_per_s
            yield STEP, level, f"step to {level:g} V", Steps((rest_v, level, rest_v), self.dwell_s, rise_s)
        for f in self.frequencies_hz:
            cycles = math.ceil(self.sine_s * f)
            yield SINE, f, f"sine of {f:g} Hz", Sine(f, self.peak_to_peak_v / 2, rest_v, cycles)

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        # Driven twice: a specimen with hysteresis responds differently to the first onset after another drive.
        yield Record(entry.drives[0].duration_s, entry.drives[0])
        yield Record(entry.drives[0].duration_s, entry.drives[0])

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> LatencyPoint:
        recording, kind, repeat = recordings[-1], str(key[0]), float(key[2])
        onset = _step_onset(recording) if kind == STEP else _sine_onset(recording)
        felt = onset.first(self.threshold_m)
        low, high = (onset.first(share * onset.final) for share in (RISE_LOW, RISE_HIGH))
        begin_s = 0.0 if kind == SINE else low.time_s
        band = self.tolerance * onset.final
        settled = last_crossing(onset.time_s, np.abs(onset.deviation), band, SETTLED_NOISE * onset.noise)
        peak = float(onset.moved.max()) / onset.final - 1
        return LatencyPoint(
            frequency=float(key[1]) if kind == SINE else 0.0,
            level=recording.drive.high_v if kind == SINE else float(key[1]),
            repeat=repeat,
            latency=felt.time_s,
            latency_errors=felt.standard_error,
            driven_latency=felt.time_s + onset.since_begin_s,
            threshold_speed=felt.slope_per_s,
            rise=high.time_s - begin_s,
            rise_errors=math.hypot(high.standard_error, low.standard_error if kind == STEP else 0.0),
            overshoot=max(peak, 0.0),
            overshoot_errors=2 * math.hypot(onset.noise, onset.final_error) / onset.final,
            settling=settled.time_s,
            settling_errors=settled.standard_error,
            final=onset.final,
            final_errors=onset.final_error,
            drive_step=onset.drive_v,
            edge_time=onset.edge_s,
            quality=point_quality((recording,), simulated, {Quality.UNSETTLED: onset.final_drift > band}),
        )

    def series(self, key: tuple[float | str, ...], recordings: Sequence[Recording]) -> tuple[Series, ...]:
        kind, value, repeat = str(key[0]), float(key[1]), float(key[2])
        if repeat > 1:
            return ()
        onset = _step_onset(recordings[-1]) if kind == STEP else _sine_onset(recordings[-1])
        shown = (onset.time_s >= -CURVE_LEAD_S) & (onset.time_s <= SHOWN_S)
        return (
            Series(
                onset.time_s[shown],
                onset.signed[shown],
                x_axis=SeriesAxis("time", "s", "time since the onset, the sensor's delay removed"),
                y_axis=SeriesAxis("displacement", "m", "displacement against rest, smoothed"),
                name=self.default_plot,
                label=f"step to {value:g} V" if kind == STEP else f"sine of {value:g} Hz",
            ),
        )

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        groups: dict[tuple[float, float], list[Any]] = {}
        for point in usable_points(list(points)):
            groups.setdefault((point.frequency, point.level), []).append(point)
        return tuple(
            estimate for (f, level), group in groups.items() for estimate in self._estimates_of(f, level, group)
        )

    def _estimates_of(self, frequency_hz: float, level_v: float, group: Sequence[Any]) -> Iterator[EstimatedQuantity]:
        onset = _onset_name(frequency_hz, level_v)
        for column, name in (
            ("latency", self._felt_name),
            ("rise", "rise_time"),
            ("overshoot", "overshoot"),
            ("settling", "settling_time"),
            ("threshold_speed", f"threshold_speed, {1e6 * self.threshold_m:g} µm"),
        ):
            if (mean := _mean_with_error(group, column)) is not None:
                yield EstimatedQuantity.listed(f"{name}, {onset}", *mean, SOURCE)

    @property
    def _felt_name(self) -> str:
        return f"latency, {1e6 * self.threshold_m:g} µm"

    def promised_estimates(self, points: Sequence[Any]) -> tuple[str, ...]:
        felt = [p for p in usable_points(points) if math.isfinite(p.latency)]
        names = (_onset_name(p.frequency, p.level) for p in felt)
        return tuple(dict.fromkeys(f"{self._felt_name}, {name}" for name in names))

    def warnings(self, points: Sequence[Any]) -> tuple[str, ...]:
        weak = sorted({p.frequency for p in usable_points(points) if not math.isfinite(p.latency)})
        if not weak:
            return ()
        names = ", ".join(f"the sine of {f:g} Hz" if f else "a step" for f in weak)
        return (f"The displacement does not reach {1e6 * self.threshold_m:g} µm under {names}: no latency there",)

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = usable_points(points)
        checks = list(signal_to_noise_check("final value, smallest", [(p.final, p.final_errors) for p in good]))
        edges = [p.edge_time * self.slew_v_per_s / abs(p.drive_step) for p in good if p.edge_time > 0]
        if edges:
            name = "edge of the drive, recorded / commanded duration, longest"
            checks.append(CheckResult(name, max(edges), "1", None, EDGE_LIMIT, CABLE_REMEDY))
        felt = sum(math.isfinite(p.latency) for p in good)
        limit = "check that the amplifier is not at its current limit, and drive higher, or lower threshold_m"
        checks.append(CheckResult("onsets that reach the threshold", float(felt), "1", float(len(good)), None, limit))
        remedy = "let the specimen rest longer between onsets, and check the clamp"
        groups = group_values(good, lambda p: (p.frequency, p.level), "latency")
        return (*checks, *repeatability_check("latency", groups, remedy))


@dataclass(frozen=True, slots=True)
class _Onset:
    """A smoothed response from its onset.

    Attributes:
        time_s: time since the onset, sensor's delay removed, (N,).
        signed, moved: displacement against rest, and its component in the direction of the final value or its modulus, (N,).
        deviation: deviation from the steady state, (N,); 0 before the onset.
        noise: standard uncertainty of a smoothed sample.
        final_drift: change of a step's response within the time of its final value, whose mean is final only if it has settled.
        averaged: `moved` averaged over the edge once more; the change bounds the remaining effect of the edge. None for a sine.
        since_begin_s: time from the begin of the drive's edge to the onset.
    """

    time_s: Array
    signed: Array
    moved: Array
    deviation: Array
    noise: float
    final: float
    final_error: float
    drive_v: float
    commanded_v: float
    final_drift: float = 0.0
    edge_s: float = 0.0
    edge_spread_s: float = 0.0
    since_begin_s: float = 0.0
    averaged: Array | None = None

    def first(self, level: float) -> Crossing:
        """Return the first crossing of a level, with the remaining effect of the edge."""
        crossing = first_crossing(self.time_s, self.moved, level, self.noise)
        if self.averaged is None or not math.isfinite(crossing.time_s):
            return crossing
        again = first_crossing(self.time_s, self.averaged, level, self.noise)
        left = again.time_s - crossing.time_s if math.isfinite(again.time_s) else self.edge_spread_s
        error = math.hypot(crossing.standard_error, left, EDGE_FLOOR * self.edge_spread_s)
        return Crossing(crossing.time_s, error, crossing.slope_per_s)


def _rest(recording: Recording, begin: int) -> tuple[float, float, float]:
    """Return displacement at rest before the onset, its standard uncertainty including hum, and the noise of a sample."""
    quiet = recording.displacement_m[max(begin // 4, 0) : max(begin - 5, 8)]
    hum = math.sqrt(sum(line.amplitude_m**2 / 2 for line in recording.interference if line.significant))
    noise = float(np.std(np.diff(quiet))) / math.sqrt(2)
    return float(quiet.mean()), math.hypot(noise / math.sqrt(quiet.size), hum), noise


def _check_follows(drive: str, final_m: float, error_m: float) -> None:
    if final_m <= LEAST_SIGMAS * error_m:
        raise ValueError(
            f"the displacement does not follow the {drive}: check that high voltage is on and the laser meets the tactor"
        )


def _step_onset(recording: Recording) -> _Onset:
    drive, rate = recording.drive, recording.rate_hz
    if not isinstance(drive, Steps):
        raise ValueError("the recording is not one under a step")
    edge = find_edge(recording.drive_v, rate, drive.rise_s, drive.dwell_s)
    begin = int(edge.begin_s * rate)
    rest_m, rest_error, noise = _rest(recording, begin)
    smoothed, left = smooth(recording.displacement_m - rest_m, rate)
    time = np.arange(smoothed.size) / rate - edge.centroid_s - recording.sensor_delay_s
    held = (time > -0.5 * drive.dwell_s) & (time < drive.dwell_s - drive.rise_s)
    time, smoothed = time[held], smoothed[held]
    end = smoothed[time > (1 - FINAL_SHARE) * time[-1]]
    sign = math.copysign(1.0, float(end.mean()))
    final = abs(float(end.mean()))
    sample_error = math.hypot(noise * left, rest_error)
    _check_follows("step", final, sample_error)
    moved = sign * smoothed
    return _Onset(
        time,
        smoothed,
        moved,
        np.where(time > 0, moved - final, 0.0),
        sample_error,
        final,
        math.hypot(rest_error, noise / math.sqrt(end.size)),
        edge.step_v,
        drive.levels_v[1] - drive.levels_v[0],
        abs(float(np.diff([half.mean() for half in np.array_split(end, 2)])[0])),
        edge.duration_s,
        edge.spread_s,
        edge.centroid_s - edge.begin_s,
        edge_average(moved, edge, rate),
    )


def _sine_onset(recording: Recording) -> _Onset:
    drive, rate = recording.drive, recording.rate_hz
    if not isinstance(drive, Sine):
        raise ValueError("the recording is not one under a sine")
    volts = recording.drive_v
    away = np.flatnonzero(np.abs(volts - drive.offset_v) > 0.2 * drive.amplitude_v)
    if not away.size:
        raise ValueError("the recorded drive shows no sine: check the cable from the generator to the card")
    first, last = int(away[0]), int(away[-1])
    frequency = fit_frequency(volts[first:last], rate, drive.frequency_hz)
    driven = fit_sine(volts[first:last], rate, frequency)
    # The sine rises through its offset at whole turns of its phase: the last one before it is seen away from the offset.
    phase = float(np.angle(driven.fundamental)) / (2 * math.pi)
    begin_s = first / rate - (phase % 1.0) / frequency
    rest_m, rest_error, noise = _rest(recording, int(begin_s * rate))
    smoothed, left = smooth(recording.displacement_m - rest_m, rate)
    time = np.arange(smoothed.size) / rate - begin_s - recording.sensor_delay_s
    kept = (time > -0.05) & (time < drive.duration_s - 2e-3)
    time, smoothed = time[kept], smoothed[kept]
    steady_from = int(np.searchsorted(time, 0.5 * drive.duration_s))
    steady = fit_sine(smoothed[steady_from:], rate, frequency, HARMONICS)
    orders = np.arange(1, len(steady.components) + 1)
    turns = np.exp(2j * np.pi * frequency * np.outer(time - time[steady_from], orders))
    waveform = (turns @ steady.components).imag + steady.offset
    final = float(np.abs(waveform).max())
    sample_error = math.hypot(noise * left, rest_error)
    _check_follows("sine", final, sample_error)
    return _Onset(
        time,
        smoothed,
        np.where(time > 0, np.abs(smoothed), 0.0),
        np.where(time > 0, smoothed - waveform, 0.0),
        sample_error,
        final,
        math.hypot(rest_error, steady.standard_error),
        abs(driven.fundamental),
        drive.amplitude_v,
    )


def _mean_with_error(group: Sequence[Any], column: str) -> tuple[float, float] | None:
    """Return the mean of the finite values and its uncertainty: their common uncertainty, and the scatter of the mean."""
    pairs = [(getattr(p, column), getattr(p, f"{column}_errors", 0.0)) for p in group]
    finite = np.array([(value, error) for value, error in pairs if math.isfinite(value) and math.isfinite(error)])
    if not finite.size:
        return None
    values, errors = finite.T
    scatter = float(values.std(ddof=1)) / math.sqrt(values.size) if values.size > 1 else 0.0
    return float(values.mean()), math.hypot(scatter, float(np.median(errors)))
