"""Latency: time until the displacement reaches the perception threshold, after a step and after the onset of a sine.

The steps are the fastest that the bench admits. The times of a step begin at the centroid of its edge in the recorded drive, so
that they equal times of an ideal step to first order; the remaining effect of the edge is in the uncertainty. The times of a sine
begin at its onset. The sensor's delay is removed. The amplifier is part of the actuator: times refer to its input.
"""

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple, Self

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
    mean_with_error,
    repeatability_check,
    signal_to_noise_check,
    usable_points,
)
from protocols.signals import (
    LEAST_EDGE_SHARE,
    Edge,
    find_edge,
    first_crossings,
    fit_frequency,
    fit_lines,
    fit_sine,
    last_crossings,
    line_samples,
    remove_edge,
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

LEAD_S = 0.02
"""Time before the onset in which a response is evaluated."""

LONGEST_SINE_S = 0.6
"""Time after the onset of a sine in which it is evaluated; the second half is its steady state."""

REALISATIONS, SEED = 24, 0
"""Number of responses with noise added: their scatter has a standard uncertainty of 15 %; the seed makes points repeat exactly."""

EDGE_RESOLUTION = 0.0075
"""Smallest uncertainty of a time as a share of the edge's duration: ringing faster than the edge is not resolved."""

RISE_LOW, RISE_HIGH = 0.1, 0.9
EDGE_LIMIT = 1.3
"""Largest recorded duration of an edge over the commanded one: a staircase of 5 µs adds 2 %."""

MAXIMA_BIAS = 1.7
"""Bias of the largest of many equal maxima over its shift by as much noise again: it grows with the noise to the power 4/3."""

RINGING_S = 1e-3
"""Width of the polynomial that smooths the deviation from the steady state: only the first mode rings that long."""

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
    overshoot: Annotated[
        float,
        Unit("1"),
        "largest excess over the final value, or over the steady peak, as a share; noise can make it negative",
    ]
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
            f"{100 * max(self.overshoot, 0.0):.1f} %, settled after {1e3 * self.settling:.3g} ms"
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
        value, error = onset.times(self.threshold_m, self.tolerance)
        unsettled = onset.final_drift > self.tolerance * value.final
        return LatencyPoint(
            frequency=float(key[1]) if kind == SINE else 0.0,
            level=recording.drive.high_v if kind == SINE else float(key[1]),
            repeat=repeat,
            latency=value.latency,
            latency_errors=error.latency,
            driven_latency=value.latency + onset.since_begin_s,
            threshold_speed=value.speed,
            rise=value.rise,
            rise_errors=error.rise,
            overshoot=value.overshoot,
            overshoot_errors=error.overshoot,
            settling=value.settling,
            settling_errors=error.settling,
            final=value.final,
            final_errors=error.final,
            drive_step=onset.drive_v,
            edge_time=onset.edge_s,
            quality=point_quality((recording,), simulated, {Quality.UNSETTLED: unsettled}),
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
                onset.responses[0, shown],
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
            if (mean := _mean_of_repeats(group, column)) is not None:
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


class _Times(NamedTuple):
    """Properties of one response, or of several, (M,): times in s, the speed at the threshold in m/s, the final value in m."""

    latency: Any
    speed: Any
    rise: Any
    overshoot: Any
    settling: Any
    final: Any


@dataclass(frozen=True, slots=True)
class _Onset:
    """Smoothed responses from an onset: the measured one, and the same with noise added as it is at rest.

    Attributes:
        time_s: time since the onset, sensor's delay removed, (N,).
        responses: displacement against rest, (1 + M, N); the first is the measured one.
        steady: columns of the steady state, (N, K): a constant after a step, harmonics of a sine.
        steady_from: index from which the steady state is fitted.
        final_drift: change of a step's response within the time of its final value, whose mean is final only if it has settled.
        edge: edge of the drive; None for a sine.
    """

    time_s: Array
    responses: Array
    steady: Array
    steady_from: int
    rate_hz: float
    drive_v: float
    final_drift: float = 0.0
    edge: Edge | None = None

    @property
    def edge_s(self) -> float:
        """Duration of the drive's edge; 0 for a sine."""
        return self.edge.duration_s if self.edge else 0.0

    @property
    def since_begin_s(self) -> float:
        """Time from the begin of the drive's edge to the onset."""
        return self.edge.centroid_s - self.edge.begin_s if self.edge else 0.0

    def times(self, threshold_m: float, tolerance: float) -> tuple[_Times, _Times]:
        """Return the properties for an ideal onset, and their standard uncertainties.

        The scatter over the responses with added noise is the uncertainty, and their mean shift, by which noise makes a first crossing
        early, a last one late and a maximum large, is removed. A step adds the change by a coarser removal of its edge.
        """
        responses, left = self.responses, 0.0
        if self.edge is not None:
            responses = remove_edge(responses, self.edge, self.rate_hz)
        found = np.array(self._properties(responses, threshold_m, tolerance))
        if self.edge is not None:
            smoother = remove_edge(self.responses[:1], self.edge, self.rate_hz, 2 * LEAST_EDGE_SHARE)
            left = np.abs(found[:, 0] - np.array(self._properties(smoother, threshold_m, tolerance))[:, 0])
        value = found[:, 0]
        shifted = found[:, 1:] - value[:, None]
        missing = np.isnan(shifted).any(1)
        bias = np.where(missing, 0.0, shifted.mean(1))
        if self.edge is None:
            bias[_Times._fields.index("overshoot")] *= MAXIMA_BIAS
        scatter = np.where(missing, np.inf, shifted.std(1, ddof=1))
        error = np.hypot(scatter, np.where(np.isnan(left), np.inf, left))
        error = np.where(np.isnan(value), np.nan, np.hypot(error, EDGE_RESOLUTION * self.edge_s * _IS_TIME))
        return _Times(*map(float, value - bias)), _Times(*map(float, error))

    def _properties(self, responses: Array, threshold_m: float, tolerance: float) -> _Times:
        """Return the properties of responses, (M, N); each (M,)."""
        late = slice(self.steady_from, None)
        steady = np.linalg.lstsq(self.steady[late], responses[:, late].T, rcond=None)[0].T @ self.steady.T
        final = np.abs(steady).max(1)
        after = self.time_s > 0
        is_sine = self.edge is None
        moved = np.where(after, np.abs(responses), 0.0) if is_sine else np.sign(steady[:, :1]) * responses
        felt = first_crossings(self.time_s, moved, threshold_m)
        high = first_crossings(self.time_s, moved, RISE_HIGH * final)
        low = 0.0 if is_sine else first_crossings(self.time_s, moved, RISE_LOW * final)
        deviation = np.where(after, np.abs(smooth(responses - steady, self.rate_hz, RINGING_S)), 0.0)
        at = np.clip(np.searchsorted(self.time_s, felt), 1, self.time_s.size - 1)
        rows = np.arange(len(responses))
        speed = np.where(np.isnan(felt), np.nan, (moved[rows, at] - moved[rows, at - 1]) * self.rate_hz)
        return _Times(
            felt,
            speed,
            high - low,
            moved.max(1) / final - 1,
            last_crossings(self.time_s, deviation, tolerance * final),
            final,
        )


_TIMES = "latency", "rise", "settling"
_IS_TIME = np.array([name in _TIMES for name in _Times._fields], float)


def _with_noise(recording: Recording, onset_s: float, begin: int, until_s: float) -> tuple[Array, Array]:
    """Return the times since an onset, (N,), and the smoothed displacement against rest, alone and with noise added, (1 + M, N).

    Args:
        recording: under a step or a sine that begins in it.
        onset_s: time of the onset in the recording.
        begin: index of the first sample that is not at rest.
        until_s: end, after the onset.

    Lines of the interference are fitted at rest before the onset, and removed. The added noise is that at rest: white noise, and
    what remains of each line, with a random phase.
    """
    rate, since = recording.rate_hz, max(begin // 4, 0)
    rest = slice(since, max(begin - 5, 8))
    lines = [
        line for line in recording.interference if line.significant and line.frequency_hz > 2 * rate / (begin - since)
    ]
    moved, frequencies = (
        recording.displacement_m - recording.displacement_m[rest].mean(),
        np.array([line.frequency_hz for line in lines]),
    )
    if lines:
        components = fit_lines(moved[rest], rate, frequencies).components
        moved[since:] -= line_samples(components, frequencies, moved.size - since, rate)
    noise = float(np.std(np.diff(moved[rest]))) / math.sqrt(2)
    time = np.arange(moved.size) / rate - onset_s - recording.sensor_delay_s
    kept = (time > -LEAD_S) & (time < until_s)
    time, moved = time[kept], moved[kept]
    random = np.random.default_rng(SEED)
    added = noise * random.standard_normal((REALISATIONS, time.size))
    fitted = noise * math.sqrt(2 / (begin - since))
    added += fitted * random.standard_normal((REALISATIONS, 1))
    for line in lines:
        apart_s = until_s / 2 + (begin - since) / (2 * rate)
        left = math.hypot(fitted, 2 * math.pi * line.frequency_error_hz * apart_s * line.amplitude_m)
        phases = np.exp(2j * np.pi * random.uniform(size=(REALISATIONS, 1)))
        added += left * (phases * np.exp(2j * np.pi * line.frequency_hz * time)).imag
    return time, smooth(np.vstack([moved, moved + added]), rate)


def _check_follows(drive: str, onset: _Onset) -> _Onset:
    measured, *noisy = onset.responses[:, onset.steady_from :]
    if math.sqrt(np.mean(measured**2)) <= LEAST_SIGMAS * float(np.std(noisy - measured)):
        raise ValueError(
            f"the displacement does not follow the {drive}: check that high voltage is on and the laser meets the tactor"
        )
    return onset


def _step_onset(recording: Recording) -> _Onset:
    drive, rate = recording.drive, recording.rate_hz
    if not isinstance(drive, Steps):
        raise ValueError("the recording is not one under a step")
    edge = find_edge(recording.drive_v, rate, drive.rise_s, drive.dwell_s)
    begin = int(edge.begin_s * rate)
    time, responses = _with_noise(recording, edge.centroid_s, begin, drive.dwell_s - drive.rise_s)
    steady_from = int(np.searchsorted(time, (1 - FINAL_SHARE) * time[-1]))
    first, second = (half.mean() for half in np.array_split(responses[0, steady_from:], 2))
    onset = _Onset(
        time, responses, np.ones((time.size, 1)), steady_from, rate, edge.step_v, abs(float(second - first)), edge
    )
    return _check_follows("step", onset)


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
    until_s = min(drive.duration_s - 2e-3, LONGEST_SINE_S)
    time, responses = _with_noise(recording, begin_s, int(begin_s * rate), until_s)
    turns = np.exp(2j * np.pi * frequency * np.outer(time, np.arange(1, HARMONICS + 1)))
    steady = np.hstack([np.ones((time.size, 1)), turns.real, turns.imag])
    steady_from = int(np.searchsorted(time, 0.5 * until_s))
    onset = _Onset(time, responses, steady, steady_from, rate, abs(driven.fundamental))
    return _check_follows("sine", onset)


def _mean_of_repeats(group: Sequence[Any], column: str) -> tuple[float, float] | None:
    """Return the mean of the finite values and its uncertainty; the edge's resolution is common to the repeats."""
    values = [getattr(p, column) for p in group]
    spread = float(np.nanstd(values, ddof=1)) if np.isfinite(values).sum() > 1 else 0.0
    pairs = [(value, getattr(p, f"{column}_errors", spread)) for value, p in zip(values, group, strict=True)]
    finite = [(value, error) for value, error in pairs if math.isfinite(value) and math.isfinite(error)]
    if not finite:
        return None
    mean, error = mean_with_error(finite)
    common = EDGE_RESOLUTION * float(np.median([p.edge_time for p in group])) if column in _TIMES else 0.0
    return mean, math.hypot(error, common)
