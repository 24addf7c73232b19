"""Drift of the bench or of the specimen: comparison of a golden specimen's changes with other changes at the same time.

A golden specimen is measured repeatedly. A change of its values is attributed to the bench if other specimens on the same
displacement sensor changed alike, or if the golden specimen did not change on other sensors; in the opposite cases to the
specimen. Means before and after are compared by their standard errors (two-sample test, NIST/SEMATECH e-Handbook 7.3.1), with the
three standard errors of a Shewhart chart.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from app.fleet.catalogue_values import Fleet, FleetSelection, FleetValue, arrays
from app.fleet.control_chart import BASELINE, ControlChart, TooFewValuesError, control_chart
from model import LENGTH_UNITS, format_with_uncertainty

NOTHING_ELSE = (
    "nothing else was measured before and after; measure another specimen here, or this one on another sensor"
)
SIGNIFICANT = 3.0
"""Standard errors above which a change is not attributed to chance."""


class DriftCause(StrEnum):
    """Cause of a drift."""

    NOTHING = "in control"
    BENCH = "bench"
    SPECIMEN = "specimen"
    NO_LASTING_CHANGE = "no lasting change"
    """A rule is broken, but the mean since then equals the baseline's: chance, or a single bad run."""
    UNDECIDED = "not decided"

    @property
    def is_drift(self) -> bool:
        """Whether something changed to stay."""
        return self not in (DriftCause.NOTHING, DriftCause.NO_LASTING_CHANGE)


@dataclass(frozen=True, slots=True)
class Change:
    """Relative change of values between two spans of time, with its standard error."""

    subject: str
    relative: float
    error: float

    @property
    def figure(self) -> str:
        """The change in per cent with its standard error."""
        return format_with_uncertainty(100 * self.relative, 100 * self.error, "%", signed=True)

    @property
    def text(self) -> str:
        return f"{self.subject} {self.figure}"

    def differs(self, other: float = 0.0, error: float = 0.0) -> bool:
        """Whether it differs from another change by more than three standard errors."""
        return abs(self.relative - other) > SIGNIFICANT * math.hypot(self.error, error)


@dataclass(frozen=True)
class GoldenChart:
    """Control chart of a golden specimen on one sensor, and the cause of its signals.

    Attributes:
        values: of the chart, oldest first.
        cause: cause of the first signal.
        change: of the chart; None without a lasting one.
        compared: changes at the same time of other specimens on the sensor, and of the golden one on other sensors.
    """

    sensor: str
    values: tuple[FleetValue, ...]
    chart: ControlChart
    cause: DriftCause
    change: Change | None = None
    compared: tuple[Change, ...] = ()

    @property
    def evidence(self) -> tuple[str, ...]:
        """The changes that determine the cause, as text; what to measure where there is nothing to compare with."""
        if self.change is None:
            return ()
        return (self.change.text, *([each.text for each in self.compared] or [NOTHING_ELSE]))

    @property
    def first_signal(self) -> int | None:
        """Index of the first value that breaks a rule; None if it is in control.

        Of a lasting change: the first of the signals about its onset, no two of them more than two values apart.
        """
        indices = {signal.index for signal in self.chart.signals}
        first = min((at for at in indices if at >= self.chart.onset), default=None)
        if first is None or not self.chart.onset:
            return min(indices, default=None)
        while earlier := indices & {first - 1, first - 2}:
            first = min(earlier)
        return first


def golden_charts(selection: FleetSelection, golden: str, baseline: int = BASELINE) -> tuple[GoldenChart, ...]:
    """Return a control chart of the golden specimen for each displacement sensor that measured it often enough.

    Raises:
        TooFewValuesError: none measured it often enough.
    """
    streams: dict[str, list[FleetValue]] = {}
    for value in selection.values:
        if value.specimen == golden:
            streams.setdefault(value.sensor, []).append(value)
    charts, problem = [], TooFewValuesError(f"there is no value of {golden}; name the golden specimen with --golden")
    for sensor, values in sorted(streams.items()):
        try:
            charts.append((sensor, values, control_chart(arrays(values)[0], baseline)))
        except TooFewValuesError as error:
            problem = TooFewValuesError(f"{golden} on {sensor}: {error}")
    if not charts:
        raise problem
    return tuple(_judge(selection.values, golden, sensor, tuple(values), chart) for sensor, values, chart in charts)


def _judge(
    every: Sequence[FleetValue], golden: str, sensor: str, values: tuple[FleetValue, ...], chart: ControlChart
) -> GoldenChart:
    if chart.in_control:
        return GoldenChart(sensor, values, chart, DriftCause.NOTHING)
    first = chart.onset
    if not first:
        return GoldenChart(sensor, values, chart, DriftCause.NO_LASTING_CHANGE)
    until, since = values[first - 1].time_s, values[first].time_s
    change = Change(f"{golden} on {sensor}", *chart.change(first))
    sigma = chart.sigma / abs(chart.centre)
    other_specimens = _change_of_others(
        [v for v in every if v.sensor == sensor and v.specimen != golden], until, since, sigma
    )
    other_sensors = (
        _change(
            [v for v in every if (v.specimen, v.sensor) == (golden, name)], until, since, sigma, f"{golden} on {name}"
        )
        for name in sorted({v.sensor for v in every if v.specimen == golden} - {sensor})
    )
    votes, compared = set[DriftCause](), list[Change]()
    if other_specimens is not None:
        compared.append(other_specimens)
        votes |= _vote(change, other_specimens, alike=DriftCause.BENCH, apart=DriftCause.SPECIMEN)
    for other in filter(None, other_sensors):
        compared.append(other)
        votes |= _vote(change, other, alike=DriftCause.SPECIMEN, apart=DriftCause.BENCH)
    cause = votes.pop() if len(votes) == 1 else DriftCause.UNDECIDED
    return GoldenChart(sensor, values, chart, cause, change, tuple(compared))


def _vote(change: Change, other: Change, alike: DriftCause, apart: DriftCause) -> set[DriftCause]:
    """Return the implication of another change for the cause: an equal change, or no change; empty without implication."""
    same = not other.differs(change.relative, change.error)
    if same == other.differs():  # the same and significant, or another and none
        return {alike} if same else {apart}
    return set()


def _change(values: Sequence[FleetValue], until: float, since: float, sigma: float, subject: str) -> Change | None:
    """Return the relative change of values up to one time and from another on; None without values on both sides."""
    early = np.array([v.value for v in values if v.time_s <= until])
    late = np.array([v.value for v in values if v.time_s >= since])
    if not (early.size and late.size and early.mean()):
        return None
    error = sigma * math.sqrt(1 / early.size + 1 / late.size)
    return Change(subject, float(late.mean() / early.mean()) - 1, error)


def _change_of_others(values: Sequence[FleetValue], until: float, since: float, sigma: float) -> Change | None:
    """Return the mean change of all other specimens that were measured before and after, weighted by their errors."""
    changes = [
        change
        for name in sorted({v.specimen for v in values})
        if (change := _change([v for v in values if v.specimen == name], until, since, sigma, name)) is not None
    ]
    if not changes:
        return None
    weights = np.array([change.error**-2 for change in changes])
    mean = float(np.average([change.relative for change in changes], weights=weights))
    subject = changes[0].subject if len(changes) == 1 else f"{len(changes)} other specimens there"
    return Change(subject, mean, float(weights.sum() ** -0.5))


@dataclass(frozen=True, slots=True)
class SensorDrift:
    """Drift of a displacement sensor, as the golden specimen shows it; values from `since` on, ISO 8601, are doubtful."""

    since: str
    text: str


def sensor_drifts(fleet: Fleet, golden: str, baseline: int = BASELINE) -> Mapping[str, SensorDrift]:
    """Return the drifts that charts of the golden specimen attribute to the bench, by sensor; of each sensor the earliest.

    Only quantities that are proportional to the sensor's gain are charted.
    """
    drifts: dict[str, SensorDrift] = {}
    for name in fleet.names if golden else ():
        selection = fleet.of(name)
        if selection.unit not in LENGTH_UNITS:
            continue
        try:
            charts = golden_charts(selection, golden, baseline)
        except TooFewValuesError:
            continue
        for each in charts:
            if each.cause is DriftCause.BENCH and each.first_signal is not None:
                since = each.values[each.first_signal].start_time
                changed = "" if each.change is None else f": {each.change.text}"
                drift = SensorDrift(since, f"drifting since {since[:10]} by {selection.label} of {golden}{changed}")
                if each.sensor not in drifts or since < drifts[each.sensor].since:
                    drifts[each.sensor] = drift
    return drifts
