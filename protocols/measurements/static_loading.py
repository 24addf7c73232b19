"""Static loading: weights on both sides of the shorted tactor, no high voltage (paper, Sec. IV-1).

Each entry is one weight: zero, weight on, zero again. The laser detects placing and removing, so that the operator has both hands
free; the operator is asked immediately about an implausible deflection.
"""

import math
from collections.abc import Generator, Iterable, Sequence
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

import numpy as np
from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from drivers import REST_TOLERANCE_V, BenchError
from model import GRAVITY, format_quantity
from protocols.base import (
    Ask,
    CheckResult,
    EstimatedQuantity,
    PlanEntry,
    Protocol,
    Quality,
    Record,
    Recording,
    Repeat,
    Role,
    Series,
    Step,
    WaitForDetection,
)
from protocols.measurements.fields import LevelDuration, SampleRate
from protocols.measurements.fit_lines import line_indices
from protocols.measurements.load_point import (
    KEEP,
    MAX_ATTEMPTS,
    PREVIOUS,
    REPEAT,
    SIDE_LABELS,
    LoadPoint,
    WeightStepWatcher,
    compliance,
    compliance_estimates,
    load_point,
    place_weight_prompt,
    remove_weight_prompt,
    repeat_or_keep_prompt,
    turn_side_prompt,
)
from protocols.measurements.result_checks import (
    WEIGHT_DEVIATION_LIMIT,
    group_values,
    labelled_weight_checks,
    repeatability_check,
    signal_to_noise_check,
    usable_points,
)
from protocols.signals import LevelEstimate, estimate_level

WeightClass = Literal["F1", "F2", "M1", "M2", "M3", "own"]
"""`own`: the uncertainties are given, e.g. by a calibration certificate."""

NOMINAL_KG = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
MAX_ERROR_MG = {
    "F1": (0.10, 0.12, 0.16, 0.20, 0.25, 0.3, 0.5, 1.0, 2.5, 5.0, 10.0),
    "F2": (0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.6, 3.0, 8.0, 16.0, 30.0),
    "M1": (1.0, 1.2, 1.6, 2.0, 2.5, 3.0, 5.0, 10.0, 25.0, 50.0, 100.0),
    "M2": (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 16.0, 30.0, 80.0, 160.0, 300.0),
    "M3": (10.0, 12.0, 16.0, 20.0, 25.0, 30.0, 50.0, 100.0, 250.0, 500.0, 1000.0),
}
"""Maximum permissible error of a weight by class and nominal mass (OIML R 111-1, Table 1)."""

assert set(get_args(WeightClass)) == {*MAX_ERROR_MG, "own"}


def uncertainty_kg(mass_kg: float, weight_class: str) -> float:
    """Standard uncertainty of a weight of a class: its largest error as a rectangle; between nominal masses, a power law."""
    largest = np.interp(math.log(mass_kg), np.log(NOMINAL_KG), np.log(MAX_ERROR_MG[weight_class]))
    return 1e-6 * math.exp(float(largest)) / math.sqrt(3)


PAPER_WEIGHTS_KG = (0.02, 0.05, 0.1, 0.2, 0.5)

MIN_STEP_SHARE = 0.2
"""Share of the expected deflection of the smallest weight; a smaller deflection is no weight."""

OPERATOR_ACTION_S = 3.0
"""Approximate time to put a weight on or take it off."""


class StaticLoading(Protocol):
    """Deflection of the centre under weights, on both sides; the paper's five weights, ten times each, by default."""

    name: ClassVar[str] = "static-loading"
    title: ClassVar[str] = "Static loading"
    point_type: ClassVar[type] = LoadPoint
    axes: ClassVar[tuple[str, str]] = ("load", "deflection")
    high_voltage: ClassVar[bool] = False
    uses_weights: ClassVar[bool] = True

    weights_kg: Annotated[
        tuple[Annotated[float, Interval(ge=0.001, le=2)], ...], Unit("kg"), Len(1, 20), "masses of the weights"
    ] = PAPER_WEIGHTS_KG
    weight_class: Annotated[WeightClass, "OIML class of the weights; own: errors by weight_errors_kg"] = "M1"
    weight_errors_kg: Annotated[
        tuple[Annotated[float, Interval(ge=0, le=0.1)], ...],
        Unit("kg"),
        Len(1, 20),
        "standard uncertainty of each weight from its certificate; counts with weight_class own",
    ] = (1.4e-6, 1.7e-6, 2.9e-6, 5.8e-6, 14e-6)
    offset_kg: Annotated[
        float, Unit("kg"), Interval(ge=0, le=0.1), "permanent weight against slack in the mount; 0: none"
    ] = 0.01
    repeats: Annotated[int, Unit("1"), Interval(ge=1, le=100), "measurements of each weight per side"] = 10
    sides: Annotated[Literal["both", "MFC up", "aluminium up"], "side that carries the weights"] = "both"
    seed: Annotated[int, Unit("1"), Interval(ge=0, le=2**31), "seed of the random order of the weights"] = 1
    gravity_m_per_s2: Annotated[float, Unit("m/s^2"), Interval(ge=9.76, le=9.84), "local gravity"] = GRAVITY
    expected_m_per_n: Annotated[
        float, Unit("m/N"), Interval(gt=0), "expected compliance; the operator is asked about an implausible point"
    ] = 1.379e-4
    plausible_factor: Annotated[
        float, Unit("1"), Interval(gt=1, le=100), "a deflection larger or smaller by this factor is implausible"
    ] = 1.5
    zero_limit_m: Annotated[
        float,
        Unit("m"),
        Interval(gt=0),
        "largest change of the zero over one weight; the operator is asked about a larger one",
    ] = 3e-6
    zero_limit_share: Annotated[
        float,
        Unit("1"),
        Interval(ge=0, le=0.5),
        "largest change of the zero as a share of the deflection; the larger limit counts",
    ] = 0.01  # Creep after 1 s under a load and 1 s without it returns within 0.7 % where it is 1.5 % a decade.
    settle_s: Annotated[
        float, Unit("s"), Interval(ge=0, le=600), "wait after a manual action, before the recording"
    ] = 1.0
    record_s: LevelDuration = 0.5
    sample_rate_hz: SampleRate = 2000.0

    @model_validator(mode="after")
    def _check_weights(self) -> Self:
        if self.weight_class == "own" and len(self.weight_errors_kg) != len(self.weights_kg):
            raise ValueError(
                f"weight_errors_kg holds {len(self.weight_errors_kg)} uncertainties for {len(self.weights_kg)} weights; "
                "give one for each, or the class of the weights"
            )
        if len(set(self.weights_kg)) < len(self.weights_kg):
            raise ValueError("weights_kg names a weight twice; 'repeats' sets how often each is measured")
        return self

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        each_s = 3 * (self.settle_s + self.record_s) + 2 * OPERATOR_ACTION_S
        return tuple(
            PlanEntry(
                f"{SIDE_LABELS[side]}, {format_quantity(mass_kg, 0.0, 'kg')}, repeat {repeat}",
                (),
                each_s,
                (side, mass_kg, float(repeat)),
                turn_side_prompt(side, self.offset_kg),
                prompts=2,
            )
            for side in SIDE_LABELS
            if self.sides in ("both", SIDE_LABELS[side])
            for repeat in range(1, self.repeats + 1)
            for mass_kg in self._weight_order(side, repeat)
        )

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, Repeat | None]:
        side, mass_kg, attempt = float(entry.key[0]), float(entry.key[1]), 0
        can_go_back = self._has_previous_entry(entry, rest_v)
        while True:
            attempt += 1
            # Vibration of the previous manual action, or of the key press, has decayed at its end.
            zero: Recording = yield Record(self.settle_s + self.record_s)
            _check_rest(zero, rest_v)
            placed = yield WaitForDetection(
                place_weight_prompt(side, mass_kg, can_go_back),
                WeightStepWatcher(zero, self._min_step_m, self.record_s),
            )
            if placed.answer == PREVIOUS:
                return Repeat.PREVIOUS
            loaded: Recording = yield Record(self.settle_s + self.record_s)
            _check_rest(loaded, rest_v)
            again = False
            if wrong := self._plausibility_message(mass_kg, zero, loaded):
                if attempt >= MAX_ATTEMPTS and self._moved_backwards(mass_kg, zero, loaded):
                    raise BenchError(f"{wrong} So it was {attempt} times: correct gain_m_per_v in the bench file")
                again = (yield Ask(repeat_or_keep_prompt("implausible-step", wrong, attempt))) == REPEAT
            lifted = yield WaitForDetection(
                remove_weight_prompt(side, mass_kg), WeightStepWatcher(loaded, self._min_step_m, self.record_s)
            )
            after: Recording = yield Record(self.settle_s + self.record_s)
            if not again and lifted.answer != REPEAT:
                before_m = self._measure_level(zero).value
                moved_m = self._measure_level(after).value - before_m
                limit_m = self._zero_limit_m(self._measure_level(loaded).value - before_m)
                if abs(moved_m) <= limit_m:
                    return None
                if (
                    yield Ask(
                        repeat_or_keep_prompt("zero-moved", _zero_shift_message(mass_kg, moved_m, limit_m), attempt)
                    )
                ) == KEEP:
                    return None

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> LoadPoint:
        side, mass_kg, repeat = (float(value) for value in key)
        load_n = mass_kg * self.gravity_m_per_s2, self._mass_error_kg(mass_kg) * self.gravity_m_per_s2
        return load_point(
            (side, mass_kg, repeat),
            recordings,
            self._measure_level,
            load_n,
            self.record_s,
            self._zero_limit_m,
            simulated,
        )

    @classmethod
    def fit_lines(cls, points: Sequence[Any]) -> tuple[Series, ...]:
        """Return the compliance of each side: a line through zero."""
        lines = []
        for side, name in SIDE_LABELS.items():
            used = tuple(i for i in line_indices(points, *cls.axes) if points[i].side == side)
            if (line := compliance([points[i] for i in used])) is not None:
                ends = np.array([0.0, max(points[i].load for i in used)])
                label = f"compliance, {name}"
                lines.append(Series(ends, line[0] * ends, role=Role.FIT, label=label, fitted_rows=used))
        return tuple(lines)

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        return compliance_estimates([point for point in points if Quality(point.quality).usable])

    def warnings(self, points: Sequence[Any]) -> tuple[str, ...]:
        return tuple(
            f"{check.name}: more than {100 * WEIGHT_DEVIATION_LIMIT:.0f} % off; {check.remedy}"
            for check in self._weight_checks(points)
            if not check.passed
        )

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = usable_points(points)
        remedy = "place the weight on the centre each time, and check the clamp and the offset weight"
        return (
            *signal_to_noise_check("deflection, smallest", [(p.deflection, p.deflection_errors) for p in good]),
            *repeatability_check(
                "deflection under one weight", group_values(good, lambda p: (p.side, p.mass), "deflection"), remedy
            ),
            *self._weight_checks(points),
        )

    def promised_estimates(self, points: Sequence[Any]) -> tuple[str, ...]:
        if len(self.weights_kg) * self.repeats < 2:
            return ()
        return tuple(f"compliance, {side}" for side in SIDE_LABELS.values() if self.sides in ("both", side))

    def _weight_checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        groups: dict[float, dict[float, list[tuple[float, float]]]] = {}
        for p in usable_points(points):
            one = p.deflection / p.load, p.deflection_errors / p.load
            groups.setdefault(p.mass, {}).setdefault(p.side, []).append(one)
        return labelled_weight_checks(groups)

    def _weight_order(self, side: float, repeat: int) -> tuple[float, ...]:
        order = np.random.default_rng([self.seed, int(side > 0), repeat]).permutation(len(self.weights_kg))
        return tuple(self.weights_kg[i] for i in order)

    def _has_previous_entry(self, entry: PlanEntry, rest_v: float) -> bool:
        """Return whether there is a previous entry on the same side."""
        first = next(planned for planned in self.plan(rest_v) if planned.key[0] == entry.key[0])
        return first.key != entry.key

    @property
    def _min_step_m(self) -> float:
        return MIN_STEP_SHARE * min(self.weights_kg) * self.gravity_m_per_s2 * self.expected_m_per_n

    def _mass_error_kg(self, mass_kg: float) -> float:
        if self.weight_class == "own":
            return self.weight_errors_kg[self.weights_kg.index(mass_kg)]
        return uncertainty_kg(mass_kg, self.weight_class)

    def _measure_level(self, recording: Recording) -> LevelEstimate:
        """The level of the last `record_s` of a recording."""
        samples = recording.displacement_m[-round(self.record_s * recording.rate_hz) :]
        return estimate_level(samples, recording.rate_hz, interference=recording.interference)

    def _plausibility_message(self, mass_kg: float, zero: Recording, loaded: Recording) -> str:
        """Return the reason why the deflection does not match this weight; empty if it does."""
        weight = f"the {format_quantity(mass_kg, 0.0, 'kg')} weight"
        if (zero.quality | loaded.quality) & (Quality.OUT_OF_RANGE | Quality.CLIPPED):
            return f"The sensor is out of its range under {weight}: move it so that both ends are inside."
        moved_m = self._measure_level(loaded).value - self._measure_level(zero).value
        expected_m = mass_kg * self.gravity_m_per_s2 * self.expected_m_per_n
        low_m, high_m = expected_m / self.plausible_factor, expected_m * self.plausible_factor
        if low_m <= moved_m <= high_m:
            return ""
        deviation = f"{1e6 * moved_m:+.1f} µm under {weight}, {1e6 * low_m:.0f} to {1e6 * high_m:.0f} µm are expected"
        if self._moved_backwards(mass_kg, zero, loaded):
            return f"{deviation}: the wrong way. Either something else moved, or the sensor's gain has the wrong sign."
        if moved_m < low_m:
            return f"{deviation}: too little. Is it {weight}, and does it lie free on the centre?"
        return f"{deviation}: too much. Is it {weight} alone, and was the sensor left untouched?"

    def _moved_backwards(self, mass_kg: float, zero: Recording, loaded: Recording) -> bool:
        """Whether the centre moved by this weight's deflection in the opposite direction."""
        expected_m = mass_kg * self.gravity_m_per_s2 * self.expected_m_per_n
        return self._measure_level(loaded).value - self._measure_level(zero).value < -expected_m / self.plausible_factor

    def _zero_limit_m(self, deflection_m: float) -> float:
        """Return the largest change of the zero over a weight with a deflection of `deflection_m`."""
        return max(self.zero_limit_m, self.zero_limit_share * abs(deflection_m))


def _zero_shift_message(mass_kg: float, moved_m: float, limit_m: float) -> str:
    return (
        f"The zero moved by {1e6 * moved_m:+.1f} µm over the {format_quantity(mass_kg, 0.0, 'kg')} weight (limit "
        f"{1e6 * limit_m:.1f} µm): was the sensor touched, or did the clamp give?"
    )


def _check_rest(recording: Recording, rest_v: float) -> None:
    seen_v = float(recording.drive_v.mean())
    if abs(seen_v - rest_v) > REST_TOLERANCE_V:
        raise BenchError(
            f"hands are on the specimen, and the card sees {seen_v:.3f} V at the amplifier's input where {rest_v:g} V is "
            f"rest (limit {REST_TOLERANCE_V:g} V); make sure that high voltage is off, and check the generator's cable"
        )
