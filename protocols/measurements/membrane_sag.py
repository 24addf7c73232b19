"""Membrane sag under its own weight, for the modulus E_m (paper, Supplementary Information; Table I).

The sag, some millimetres, exceeds the range of a fine laser sensor. It is measured against a reference surface at a known
depth below the line of the clamps: sag = depth + displacement between the surface and the membrane.
"""

import contextlib
import math
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval, Unit

from model import (
    Array,
    Membrane,
    ParameterError,
    format_quantity,
    linear_young_modulus,
    weight_per_length,
    young_modulus_from_sag,
)
from protocols.base import (
    Ask,
    CheckResult,
    EstimatedQuantity,
    Outcome,
    PlanEntry,
    Prompt,
    Protocol,
    Quality,
    Record,
    Recording,
    Repeat,
    Series,
    Step,
)
from protocols.measurements.fields import LevelDuration, QualityFlags, RepeatNumber, SampleRate, point_quality
from protocols.measurements.fit_lines import mean_line
from protocols.measurements.result_checks import mean_with_error, repeatability_check, usable_points
from protocols.signals import combine_errors, estimate_level

SOURCE = "membrane sag, bending with the tension of the deflection itself"
LINEAR_SOURCE = "membrane sag, linear theory: for comparison only"

GEOMETRY_ERRORS = {
    "length_m": "length_error_m",
    "thickness_m": "thickness_error_m",
    "density_kg_per_m3": "density_error_kg_per_m3",
}
"""Uncertain inputs of the moduli and the fields of their standard errors."""

RUBBER_MODULI_PA = 1e4, 1e8
"""Moduli of rubbers, from the softest silicone to the hardest; another value means no rubber or no membrane."""

SAME_SURFACE_SIGMAS = 5.0
"""Distance to the reference surface, in standard errors, below which the membrane may be the surface itself."""

MAX_ATTEMPTS = 3
"""Attempts at a sag outside the sensor's range."""


@dataclass(frozen=True, slots=True)
class SagPoint:
    """One sag of the membrane. Its error is standard and statistical; geometry and reference are common to all."""

    repeat: RepeatNumber
    sag: Annotated[float, Unit("m"), "depth of the membrane's centre below the line of the clamps"]
    sag_errors: Annotated[float, Unit("m"), "standard uncertainty of the sag, without the reference depth"]
    reference: Annotated[float, Unit("m"), "sensor reading at the reference surface"]
    hanging: Annotated[float, Unit("m"), "sensor reading at the membrane's centre"]
    noise: Annotated[float, Unit("m"), "standard deviation of the residuals of line and mains in the membrane's trace"]
    quality: QualityFlags

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        return f"sag {self.repeat:.0f}: {format_quantity(self.sag, self.sag_errors, 'm', 'sag')}"


class MembraneSag(Protocol):
    """The membrane's own weight bends and stretches it; its sag gives the modulus of the rubber."""

    name: ClassVar[str] = "membrane-sag"
    title: ClassVar[str] = "Membrane sag"
    point_type: ClassVar[type] = SagPoint
    axes: ClassVar[tuple[str, str]] = ("repeat", "sag")
    restore: ClassVar[Prompt | None] = Prompt(
        "place-tactor",
        "The membrane is under the sensor. Take it away and put the tactor back under the sensor.",
        hands_on=True,
    )
    high_voltage: ClassVar[bool] = False

    repeats: Annotated[int, Unit("1"), Interval(ge=1, le=100), "number of times the membrane is clamped anew"] = 5
    reference_m: Annotated[
        float, Unit("m"), Interval(ge=0, le=0.1), "depth of the reference surface below the line of the clamps"
    ] = 3.5e-3
    reference_error_m: Annotated[
        float, Unit("m"), Interval(ge=0, le=0.01), "standard uncertainty of the reference depth"
    ] = 20e-6
    length_m: Annotated[float, Unit("m"), Interval(gt=0, le=2), "free length between the clamps"] = 0.17
    length_error_m: Annotated[float, Unit("m"), Interval(ge=0, le=0.1), "standard uncertainty of the length"] = 0.3e-3
    thickness_m: Annotated[float, Unit("m"), Interval(gt=0, le=0.02), "thickness of the membrane"] = 1.4e-3
    thickness_error_m: Annotated[float, Unit("m"), Interval(ge=0, le=0.01), "standard uncertainty of the thickness"] = (
        10e-6
    )
    width_m: Annotated[
        float, Unit("m"), Interval(gt=0, le=1), "width of the membrane; without effect on the modulus"
    ] = 0.066
    density_kg_per_m3: Annotated[
        float, Unit("kg/m^3"), Interval(gt=0, le=20_000), "density of the rubber, from weighing the strip"
    ] = 1000.0
    density_error_kg_per_m3: Annotated[
        float, Unit("kg/m^3"), Interval(ge=0, le=5_000), "standard uncertainty of the density"
    ] = 10.0
    elongation_m: Annotated[
        float, Unit("m"), Interval(ge=0, le=0.5), "elongation of the membrane between the clamps; 0 is best"
    ] = 0.0
    elongation_error_m: Annotated[
        float, Unit("m"), Interval(ge=0, le=0.05), "standard uncertainty of the elongation, clamping included"
    ] = 10e-6
    settle_s: Annotated[
        float, Unit("s"), Interval(ge=0, le=600), "wait after the operator's confirmation, before the recording"
    ] = 5.0
    record_s: LevelDuration = 1.0
    sample_rate_hz: SampleRate = 2000.0

    @property
    def membrane(self) -> Membrane:
        """The membrane's geometry; its E_m is not used."""
        return Membrane(L_m=self.length_m, b_m=self.width_m, h_m=self.thickness_m)

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        each_s = 2 * self.record_s + self.settle_s
        return tuple(
            PlanEntry(f"sag {repeat}", (), each_s, (float(repeat),), prompts=2) for repeat in range(1, self.repeats + 1)
        )

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, Repeat | None]:
        for attempt in range(1, MAX_ATTEMPTS + 1):
            yield Ask(self._reference_prompt())
            surface: Recording = yield Record(self.record_s)
            yield Ask(self._hang_prompt())
            hanging: Recording = yield Record(self.settle_s + self.record_s)
            outside = (surface.quality | hanging.quality) & (Quality.OUT_OF_RANGE | Quality.CLIPPED)
            if not outside or attempt == MAX_ATTEMPTS or (yield Ask(self._out_of_range_prompt())) == "keep":
                break
        return None

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> SagPoint:
        if len(recordings) < 2:
            raise ValueError("a sag needs two recordings: the reference, and the membrane")
        parts = recordings[-2:]
        surface, hanging = (
            estimate_level(
                part.displacement_m[-round(self.record_s * part.rate_hz) :],
                part.rate_hz,
                interference=part.interference,
            )
            for part in parts
        )
        return SagPoint(
            repeat=float(key[0]),
            sag=self.reference_m + hanging.value - surface.value,
            sag_errors=combine_errors(surface, hanging)[0],
            reference=surface.value,
            hanging=hanging.value,
            noise=hanging.noise,
            quality=point_quality(parts, simulated, {}),
        )

    @classmethod
    def fit_lines(cls, points: Sequence[Any]) -> tuple[Series, ...]:
        return mean_line(points, *cls.axes, "mean sag")

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        usable = [p for p in points if Quality(p.quality).usable]
        if not usable:
            return ()
        mean_m, error_m = self.mean_sag(np.array([p.sag for p in usable]), np.array([p.sag_errors for p in usable]))
        if not mean_m > 0:
            return ()
        estimates = [EstimatedQuantity.listed("sag", mean_m, error_m, "membrane sag")]
        with contextlib.suppress(ParameterError):  # if no modulus explains this sag, the sag alone is reported
            names = ("E_m", SOURCE), ("linear_young_modulus", LINEAR_SOURCE)
            moduli = zip(names, *self._young_moduli(mean_m, error_m), strict=True)
            estimates += [EstimatedQuantity.listed(name, e, error, source) for (name, source), e, error in moduli]
        return tuple(estimates)

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = usable_points(points)
        values = {estimate.name: estimate.value for estimate in self.estimates(points)}
        checks = list(
            repeatability_check(
                "sag", [[p.sag for p in good]], "clamp the membrane the same way each time, without stretch"
            )
        )
        if outside := sum(bool(Quality(int(p.quality)) & Quality.OUT_OF_RANGE) for p in points):
            remedy = "make sure that the membrane is clamped under the sensor, and choose reference_m near its sag"
            outcome = Outcome.DOUBTFUL if good else Outcome.NO_RESULT
            checks.append(
                CheckResult("sags out of the sensor's range", float(outside), "1", None, 0.0, remedy, outcome)
            )
        apart = [abs(p.hanging - p.reference) / p.sag_errors for p in good if p.sag_errors > 0]
        if apart:
            remedy = (
                "take the reference surface away before the membrane is read, or choose another depth (reference_m)"
            )
            name = "membrane against the reference / its standard error, least"
            checks.append(CheckResult(name, min(apart), "1", SAME_SURFACE_SIGMAS, None, remedy))
        if modulus := values.get("E_m"):
            remedy = "make sure that the membrane is under the sensor, and check reference_m, length_m and thickness_m"
            checks.append(CheckResult("Young modulus", modulus, "Pa", *RUBBER_MODULI_PA, remedy))
        return tuple(checks)

    def promised_estimates(self, points: Sequence[Any]) -> tuple[str, ...]:
        return "sag", "E_m"

    def mean_sag(self, sags_m: Array, errors_m: Array) -> tuple[float, float]:
        """Mean of the sags, (N,), and its standard error, with the error of the reference's depth (m)."""
        mean_m, error_m = mean_with_error(list(zip(sags_m.tolist(), errors_m.tolist(), strict=True)))
        return mean_m, math.hypot(error_m, self.reference_error_m)

    def combined_sag_error_m(self, sag_m: float, sag_error_m: float) -> float:
        """Return the effect of the errors of the sag and of the membrane's geometry on its modulus, as one error of the sag (m).

        Raises:
            ParameterError: no modulus explains this sag.
        """
        _, (error, _) = self._young_moduli(sag_m, sag_error_m)
        low, high = (
            young_modulus_from_sag(self.membrane, sag_m * k, self.load_n_per_m, self.elongation_m / self.length_m)
            for k in (0.999, 1.001)
        )
        return error * 2e-3 * sag_m / abs(high - low)

    def _young_moduli(self, sag_m: float, sag_error_m: float) -> tuple[list[float], list[float]]:
        """Return E_m and the modulus of linear theory, and their standard errors: effects of the uncertain inputs in quadrature."""

        def moduli(changed: "MembraneSag", w: float = sag_m) -> Array:
            of_load = changed.membrane, w, changed.load_n_per_m
            stretch = changed.elongation_m / changed.length_m
            return np.array([young_modulus_from_sag(*of_load, stretch), linear_young_modulus(*of_load)])

        def changed(name: str, by: float) -> Array:
            return moduli(self.model_copy(update={name: getattr(self, name) + by}))

        best = moduli(self)
        errors = {name: getattr(self, error) for name, error in GEOMETRY_ERRORS.items()}
        steps = [(changed(name, error) - changed(name, -error)) / 2 for name, error in errors.items()]
        steps.append((moduli(self, sag_m + sag_error_m) - moduli(self, sag_m - sag_error_m)) / 2)
        # A stretch is not negative: near 0 only the upper side exists.
        steps.append(changed("elongation_m", self.elongation_error_m) - best)
        return best.tolist(), np.linalg.norm(steps, axis=0).tolist()

    @property
    def load_n_per_m(self) -> float:
        """Weight of the membrane per length."""
        return weight_per_length(self.membrane, self.density_kg_per_m3)

    def _reference_prompt(self) -> Prompt:
        depth = f"{1e3 * self.reference_m:.3f} mm below the line of the clamps"
        return Prompt("place-reference", f"Put the reference surface under the sensor, {depth}.", self._prompt_values)

    def _hang_prompt(self) -> Prompt:
        stretch = f" at {1e3 * self.elongation_m:g} mm elongation" if self.elongation_m else " without stretch"
        text = (
            f"Take the reference away; clamp the membrane{stretch}, its centre under the sensor, and let it hang free."
        )
        return Prompt("hang-membrane", text, self._prompt_values)

    @property
    def _prompt_values(self) -> dict[str, float]:
        return {"reference_m": self.reference_m, "elongation_m": self.elongation_m}

    def _out_of_range_prompt(self) -> Prompt:
        text = (
            "The sensor was out of its range: no membrane is under it, or it hangs too far from the reference. Choose another depth "
            "(reference_m) or move the sensor. Repeat, or keep it as it is?"
        )
        return Prompt("out-of-range", text, choices=("repeat", "keep"))
