"""Membrane series: sine dwells at several elongations of the skin membrane (paper, Sec. IV-4).

The free tactor is measured before and after; the change between the two is drift. A membrane can only stiffen the tactor, and
more so with more stretch; a response that contradicts this gives a warning.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, Self

from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from protocols.base import CheckResult, EstimatedQuantity, PlanEntry, Prompt, Recording, ReferenceModel
from protocols.measurements.result_checks import usable_points
from protocols.measurements.sine_dwell import SineDwell, SinePoint, amplitude_text, sine_point

FREE = "free"
"""Value of a key without a membrane, in place of an elongation."""

SIGNIFICANCE_SIGMAS = 5.0
DRIFT_LIMIT = 0.02
"""Relative change of the free tactor from before to after above which it is reported."""


@dataclass(frozen=True, slots=True)
class MembranePoint(SinePoint):
    """One frequency at one elongation; the free tactor has none (NaN)."""

    elongation: Annotated[float, Unit("m"), "elongation of the membrane; NaN for the free tactor"]
    part: Annotated[float, Unit("1"), "number of the pass over the frequencies, from 0"]

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        where = "free" if math.isnan(self.elongation) else f"{1e3 * self.elongation:.2f} mm"
        return f"{where}, {amplitude_text(self)}"


class MembraneSeries(SineDwell):
    """The sine dwell at several elongations of a membrane, between two dwells of the free tactor."""

    name: ClassVar[str] = "membrane-series"
    title: ClassVar[str] = "Membrane series"
    point_type: ClassVar[type] = MembranePoint

    elongations_m: Annotated[
        tuple[Annotated[float, Interval(ge=0, le=0.05)], ...], Unit("m"), Len(1, 50), "elongations, in order"
    ] = (0.0, 1.27e-3, 2.54e-3, 3.81e-3, 5.08e-3, 6.35e-3)
    reference: Annotated[
        int, Unit("1"), Interval(ge=0, le=1), "1: measure the free tactor before and after; 0: do not"
    ] = 1
    m_per_turn: Annotated[
        float, Unit("m"), Interval(ge=0, le=0.01), "travel of one turn of the micrometer; 0: prompts give no turns"
    ] = 0.0

    @model_validator(mode="after")
    def _reject_refinement(self) -> Self:
        if self.refine_to_hz:
            raise ValueError("refine_to_hz must be 0 here: all elongations are measured at the same frequencies")
        return self

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        elongations = (None, *self.elongations_m, None) if self.reference else self.elongations_m
        return tuple(
            PlanEntry(
                f"{elongation_label(elongation)}, {f:g} Hz",
                (self._drive(f, rest_v),),
                self._expected_s(f),
                (part, FREE if elongation is None else elongation, float(f)),
                self._setup_prompt(elongation),
            )
            for part, elongation in enumerate(elongations)
            for f in self.dwell_frequencies_hz
        )

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> MembranePoint:
        dwelt = sine_point(recordings, simulated)
        elongation = math.nan if key[1] == FREE else float(key[1])
        return MembranePoint(
            **{field.name: getattr(dwelt, field.name) for field in fields(dwelt)},
            elongation=elongation,
            part=float(key[0]),
        )

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        """Return the largest response at each elongation, and the change of the free tactor from before to after."""
        free, stretched = _free_and_stretched(points)
        estimates = [
            EstimatedQuantity.listed(
                f"largest_twice_fundamental, {elongation_label(elongation)}",
                2 * top.fundamental,
                2 * top.fundamental_errors,
                f"highest of the pass, at {top.frequency:g} Hz",
            )
            for elongation, top in ((e, max(p, key=_compliance)) for e, p in stretched)
        ]
        if len(free) == 2:
            change, error = _relative_change(free[0], free[1])
            source = "free tactor after against before, mean over frequencies"
            estimates.append(EstimatedQuantity.listed("free_response_drift", change, error, source))
        return tuple(estimates)

    def warnings(self, points: Sequence[Any]) -> tuple[str, ...]:
        """Return the checks of order and drift from complete passes."""
        warnings = []
        parts = [p.part for p in points]
        free, stretched = _free_and_stretched(p for p in points if parts.count(p.part) == len(self.frequencies_hz))
        by_elongation = sorted(stretched, key=lambda pair: pair[0])
        for i, (elongation, group) in enumerate(by_elongation):
            looser, where = (by_elongation[i - 1][1], elongation_label(by_elongation[i - 1][0])) if i else (None, "")
            if looser is None and free:
                looser, where = free[0], "the free tactor"
            if looser is None:
                continue
            change, error = _relative_change(looser, group, lowest_octave=True)
            if change > SIGNIFICANCE_SIGMAS * error and change > DRIFT_LIMIT / 2:
                warnings.append(
                    f"At {elongation_label(elongation)} the tactor moves {100 * change:.1f} % further at low frequencies than at {where}: a "
                    "membrane that is stretched more can only be stiffer. Was it stretched the wrong way, or did it slip?"
                )
        if len(free) == 2:
            change, error = _relative_change(free[0], free[1])
            if abs(change) > max(SIGNIFICANCE_SIGMAS * error, DRIFT_LIMIT):
                warnings.append(
                    f"The free tactor moves {100 * change:+.1f} % after the series against before: something drifted or was "
                    "touched; the points between are uncertain by as much"
                )
        return tuple(warnings)

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        return (*super().checks(points), *self._order_checks(points))

    def _resonance_check(self, good: Sequence[Any]) -> tuple[CheckResult, ...]:
        return ()  # mean over several elongations

    def reference_checks(self, points: Sequence[Any], reference: ReferenceModel) -> tuple[CheckResult, ...]:
        return self._membrane_absent([p for p in usable_points(points) if math.isnan(p.elongation)], reference)

    def _order_checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        """Return the checks that the free tactor responds most, and equally before and after."""
        free, stretched = _free_and_stretched(points)
        if not free or not stretched:
            return ()
        checks = []
        against = [(elongation, *_relative_change(free[0], group)) for elongation, group in stretched]
        finite = [(elongation, change, error) for elongation, change, error in against if math.isfinite(error)]
        if finite:
            elongation, change, error = max(finite, key=lambda each: each[1])
            limit = -max(SIGNIFICANCE_SIGMAS * error, DRIFT_LIMIT)
            name, detail = (
                "response with membrane against the free tactor, largest change",
                elongation_label(elongation),
            )
            remedy = "make sure that the membrane is off for the free tactor and on for every elongation"
            checks.append(CheckResult(name, change, "1", None, limit, remedy, detail=f"at {detail}"))
        if len(free) == 2:
            change, error = _relative_change(free[0], free[1])
            if math.isfinite(error):
                limit = max(SIGNIFICANCE_SIGMAS * error, DRIFT_LIMIT)
                remedy = "repeat the series: something drifted, was touched, or the membrane was left on"
                checks.append(CheckResult("free tactor after against before", change, "1", -limit, limit, remedy))
        return tuple(checks)

    def _setup_prompt(self, elongation: float | None) -> Prompt:
        if elongation is None:
            return Prompt("remove-membrane", "Take the membrane off the tactor.", {}, hands_on=True)
        turns = f", {elongation / self.m_per_turn:.2f} turns of the micrometer from slack" if self.m_per_turn else ""
        text = f"Put the membrane on and stretch it by {1e3 * elongation:.2f} mm{turns}."
        return Prompt("stretch-membrane", text, {"elongation_m": elongation}, hands_on=True)


def elongation_label(elongation: float | None) -> str:
    """`free`, `2.54 mm`."""
    return FREE if elongation is None else f"{1e3 * elongation:g} mm"


def _free_and_stretched(points: Iterable[Any]) -> tuple[list[list[Any]], list[tuple[float, list[Any]]]]:
    """Return the usable points by pass, in order: passes of the free tactor, and passes under a membrane with their elongation."""
    passes: dict[int, list[Any]] = {}
    for point in usable_points(list(points)):
        passes.setdefault(int(point.part), []).append(point)
    in_order = [(some[0].elongation, some) for _, some in sorted(passes.items())]
    return [p for e, p in in_order if math.isnan(e)], [(e, p) for e, p in in_order if not math.isnan(e)]


def _compliance(point: Any) -> float:
    return float(point.fundamental / point.drive_amplitude)


def _relative_change(
    reference: Sequence[Any], points: Sequence[Any], lowest_octave: bool = False
) -> tuple[float, float]:
    """Return the mean relative change of the response at common frequencies, and its error; `below`: in the lowest octave only.

    There a tactor responds by its stiffness alone; near its resonance less damping or mass could look like less stiffness.
    """
    top_hz = 2 * min(point.frequency for point in reference) if lowest_octave else math.inf
    pairs = [
        (b, a)
        for b in reference
        for a in points
        if abs(b.frequency - a.frequency) < 1e-3 * b.frequency and b.frequency <= top_hz
    ]
    if not pairs:
        return 0.0, math.inf
    changes = [_compliance(a) / _compliance(b) - 1 for b, a in pairs]
    errors = [math.hypot(a.relative_uncertainty, b.relative_uncertainty) for b, a in pairs]
    return sum(changes) / len(pairs), math.sqrt(sum(e**2 for e in errors)) / len(pairs)
