"""Free decay: ringing after a small step; resonance and damping at small amplitude.

Faster than a sweep. The drive is constant during the free decay, so neither the amplifier's two slopes nor a clock
error enters the result.
"""

import math
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Interval, Unit
from pydantic import model_validator

from drivers import Drive, Steps
from model import Array, format_with_uncertainty, misfit_factor
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
from protocols.measurements.fields import (
    DampingRatio,
    DampingRatioError,
    NaturalFrequency,
    NaturalFrequencyError,
    QualityFlags,
    SampleRate,
    modal_columns,
    modal_estimates,
    point_quality,
)
from protocols.measurements.fit_lines import mean_line
from protocols.measurements.result_checks import repeatability_check, signal_to_noise_check, usable_points
from protocols.signals import DecayFit

SOURCE = "free decay after a step"

SKIPPED_AFTER_EDGE_S = 2e-3
"""Time after the edge that is left out, until the drive is constant and the second mode, at 2.3 kHz, has decayed."""


@dataclass(frozen=True, slots=True)
class DecayPoint:
    """Free decay of the tactor after one edge. Uncertainties are standard and statistical."""

    edge: Annotated[float, Unit("1"), "number of the edge, from 1; odd edges leave rest, even edges return to it"]
    natural_frequency: NaturalFrequency
    natural_frequency_errors: NaturalFrequencyError
    damping: DampingRatio
    damping_errors: DampingRatioError
    amplitude: Annotated[float, Unit("m"), "amplitude of the ringing at the begin of the fit"]
    noise: Annotated[float, Unit("m"), "standard deviation of the fit's residuals"]
    quality: QualityFlags

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        return (
            f"edge {self.edge:g}: rings at {format_with_uncertainty(self.natural_frequency, self.natural_frequency_errors)} Hz, damping ratio "
            f"{format_with_uncertainty(self.damping, self.damping_errors)}, from {1e6 * self.amplitude:.1f} µm"
        )


class FreeDecay(Protocol):
    """Small steps with the free decay after each: resonance and damping without a sweep."""

    name: ClassVar[str] = "free-decay"
    title: ClassVar[str] = "Free decay"
    point_type: ClassVar[type] = DecayPoint
    axes: ClassVar[tuple[str, str]] = ("edge", "natural_frequency")
    default_plot: ClassVar[str] = "free decay"

    step_v: Annotated[
        float, Unit("V"), Interval(gt=0, le=2.5), "height of the step above rest, at the amplifier's input"
    ] = 0.5
    rise_s: Annotated[
        float, Unit("s"), Interval(ge=1e-4, le=0.01), "duration of each edge; short against a period of the resonance"
    ] = 5e-4
    dwell_s: Annotated[
        float, Unit("s"), Interval(ge=0.02, le=5), "recording after each edge, until the ringing has decayed"
    ] = 0.15
    edges: Annotated[int, Unit("1"), Interval(ge=2, le=100), "number of edges, alternately up and down"] = 10
    low_hz: Annotated[float, Unit("Hz"), Interval(ge=1, le=5000), "lower end of the search band of the resonance"] = (
        60.0
    )
    high_hz: Annotated[float, Unit("Hz"), Interval(ge=2, le=5000), "upper end of the search band of the resonance"] = (
        600.0
    )
    sample_rate_hz: SampleRate = 20_000.0

    @model_validator(mode="after")
    def _check_parameters(self) -> Self:
        if not self.low_hz < self.high_hz <= 0.4 * self.sample_rate_hz:
            raise ValueError(f"low_hz and high_hz must rise and end below {0.4 * self.sample_rate_hz:g} Hz")
        if self.dwell_s < SKIPPED_AFTER_EDGE_S + 2 / self.low_hz:
            raise ValueError(f"dwell_s must hold two periods of low_hz, {SKIPPED_AFTER_EDGE_S + 2 / self.low_hz:.3g} s")
        return self

    def adapted(self, rest_v: float, reason_unsupported: Callable[[Drive], str]) -> Self:
        """Record each edge for a shorter time if the source's memory is small."""
        changes = [{"dwell_s": round(self.dwell_s * 0.9**k, 4)} for k in range(1, 20)]
        return first_adapted(changes, self, rest_v, reason_unsupported)

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        drive = Steps((rest_v, rest_v + self.step_v, rest_v), self.dwell_s, self.rise_s)
        return tuple(
            PlanEntry(f"edge {edge}", (drive,), drive.duration_s + 0.3, (edge,)) for edge in range(1, self.edges + 1)
        )

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        yield Record(entry.drives[0].duration_s, entry.drives[0])

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> DecayPoint:
        recording, edge = recordings[-1], int(float(key[0]))
        decay = self._fit(recording, edge)
        return DecayPoint(
            edge=float(edge),
            **modal_columns(decay),
            amplitude=decay.amplitude,
            noise=decay.noise,
            quality=point_quality((recording,), simulated, {}),
        )

    def series(self, key: tuple[float | str, ...], recordings: Sequence[Recording]) -> tuple[Series, ...]:
        recording, edge = recordings[-1], int(float(key[0]))
        time, moved = self._decay_after_edge(recording, edge)
        fitted = self._fit(recording, edge).displacement(np.arange(moved.size) / recording.rate_hz)
        return (
            Series(
                time,
                moved,
                fit=fitted,
                fit_description="one decaying oscillation, fitted",
                x_axis=SeriesAxis("time", "s", "time since the edge"),
                y_axis=SeriesAxis("displacement", "m", "displacement"),
                name=self.default_plot,
                label=f"after edge {float(key[0]):g}",
            ),
        )

    def _fit(self, recording: Recording, edge: int) -> DecayFit:
        from protocols.signals import fit_decay

        time, moved = self._decay_after_edge(recording, edge)
        band_hz = self.low_hz, self.high_hz
        released_s = float(time[:1].sum()) - recording.sensor_delay_s
        return fit_decay(moved, recording.rate_hz, band_hz, recording.interference, released_s)

    @classmethod
    def fit_lines(cls, points: Sequence[Any]) -> tuple[Series, ...]:
        return mean_line(points, *cls.axes, "mean natural frequency")

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        usable = [p for p in points if Quality(p.quality).usable]
        if len(usable) < 2:
            return ()
        modes: list[tuple[float, float]] = []
        for column in ("natural_frequency", "damping"):
            values = np.array([getattr(p, column) for p in usable])
            errors = np.array([getattr(p, f"{column}_errors") for p in usable])
            weight = 1 / errors**2
            mean = float((weight * values).sum() / weight.sum())
            factor = misfit_factor(*_scatter(values, errors, np.array([p.edge % 2 for p in usable])))
            modes.append((mean, factor * float(weight.sum() ** -0.5)))
        return modal_estimates(*modes[0], *modes[1], SOURCE)

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = usable_points(points)
        remedy = "check the clamp, and that nothing touches the tactor"
        return (
            *signal_to_noise_check("ringing, smallest", [(p.amplitude, p.noise) for p in good]),
            *repeatability_check("natural frequency", [[p.natural_frequency for p in good]], remedy),
        )

    def promised_estimates(self, points: Sequence[Any]) -> tuple[str, ...]:
        return "natural_frequency", "damping_ratio"

    def _decay_after_edge(self, recording: Recording, edge: int) -> tuple[Any, Any]:
        """Return time since an edge and displacement, from `SKIPPED_AFTER_EDGE_S` to shortly before the next edge; (N,) each."""
        rate, drive = recording.rate_hz, recording.drive_v
        rest, high = np.median(drive[: max(round(0.01 * rate), 4)]), float(drive.max())
        up = np.flatnonzero(drive > rest + 0.5 * (high - rest))
        if high - rest < 0.5 * self.step_v or not up.size:
            raise ValueError(
                f"the recorded drive shows no step of {self.step_v:g} V: check the cable from the generator to the card"
            )
        begin = int(up[0]) if edge % 2 else int(up[-1])
        first = begin + math.ceil((0.5 * self.rise_s + SKIPPED_AFTER_EDGE_S + recording.sensor_delay_s) * rate)
        last = min(begin + math.floor((self.dwell_s - self.rise_s) * rate), len(drive))
        samples = recording.displacement_m[first:last]
        return (first - begin + np.arange(len(samples))) / rate, samples


def _scatter(values: Array, errors: Array, direction: Array) -> tuple[float, int]:
    """Return chi-square and degrees of freedom of repeats of edges of one direction, (N,) each, or of all edges if none is repeated.

    A specimen with hysteresis rings differently at rest and at the level: this difference recurs, and is no scatter.
    """
    directions, counts = np.unique(direction, return_counts=True)
    if counts.min() < 2:
        directions, direction = np.zeros(1), np.zeros(values.size)
    means = np.array([values[direction == each].mean() for each in directions])
    left = (values - means[np.searchsorted(directions, direction)]) / errors
    return float(left @ left), values.size - directions.size
