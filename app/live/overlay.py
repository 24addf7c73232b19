"""The model's curve under the measured points, with its band: computed beside the window, never in its thread, and kept."""

import math
from collections.abc import Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.identification.active_model import PAPER_MODEL, ActiveModel, load_active_model
from model.amplifier_map import AmplifierMap
from protocols.base.protocol import Protocol

if TYPE_CHECKING:
    from model.specimen import Specimen
    from model.studies.uncertainty import EstimateSet

Array = NDArray[np.float64]

LOWEST_HZ = 5.0
"""Below this the response is quasi-static, and the curve needs ever more harmonics."""

SPLIT_HZ = (15.0, 60.0)
"""Where the frequencies are divided: a seventh of the time, and within 2e-5 of the whole."""

MAX_CACHED_CURVES = 64
FREQUENCIES = 400
COVERAGE = 0.95


@dataclass(frozen=True, slots=True)
class CurveRequest:
    """Which curve is wanted: up to what frequency, for which peak amplitude at the amplifier's input, and of what.

    The specimen's active calibration is looked for in `folder`; without one the curve is that of the paper's values.
    """

    max_hz: float
    amplitude_v: float
    folder: Path | None = None
    specimen: str = ""
    elongations_m: tuple[float, ...] = ()
    """Of the membrane: the curves that are wanted besides the free tactor's."""


@dataclass(frozen=True, slots=True)
class CurveBand:
    """Where the curve lies with a probability of `COVERAGE`, given the errors of the calibration; all (F,), m."""

    peak_to_peak: tuple[Array, Array]
    fundamental: tuple[Array, Array]


def curve_request_for(protocol: Protocol, folder: Path | None = None, specimen: str = "") -> CurveRequest:
    """The curve that belongs to a protocol's points on a specimen."""
    frequencies = getattr(protocol, "frequencies_hz", (getattr(protocol, "stop_hz", 250.0),))
    top_hz = 25.0 * math.ceil(1.04 * max(frequencies) / 25.0)
    elongations = tuple(sorted(set(getattr(protocol, "elongations_m", ()))))
    return CurveRequest(top_hz, getattr(protocol, "peak_to_peak_v", 5.0) / 2, folder, specimen, elongations)


@dataclass(frozen=True, slots=True)
class OverlayCurve:
    """The model over frequency, (F,), SI: `peak_to_peak` is max - min, `fundamental` a peak amplitude, `phase` its own."""

    request: CurveRequest
    frequency_hz: Array
    peak_to_peak: Array
    fundamental: Array
    phase: Array
    active_model: ActiveModel = PAPER_MODEL
    """Whose curve it is."""
    band: CurveBand | None = None
    """None where nothing is known of the errors: the paper's values have none."""
    elongation_m: float | None = None
    """Of the membrane under the tactor; None is the free tactor."""
    on_membrane: tuple["OverlayCurve", ...] = ()
    """The same on the membrane, at the elongations that were asked for; one that the model cannot answer is left out."""

    def at_elongation(self, elongation_m: float | None) -> "OverlayCurve | None":
        """The curve at an elongation; None or NaN is the free tactor's. None where there is none."""
        if elongation_m is None or math.isnan(elongation_m):
            return self
        return next((curve for curve in self.on_membrane if _same_elongation(curve.elongation_m, elongation_m)), None)


class Overlay:
    """Answers questions for specimens on one amplifier, in a thread of its own; the newest question wins."""

    def __init__(self, amplifier: AmplifierMap | None = None) -> None:
        self._amplifier = amplifier or AmplifierMap()
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="overlay")
        self._cache: dict[tuple[object, ...], OverlayCurve] = {}
        self._active_model = PAPER_MODEL
        self._requested: CurveRequest | None = None
        self._future: Future[OverlayCurve] | None = None
        self._curve: OverlayCurve | None = None

    @property
    def amplifier(self) -> AmplifierMap:
        """Through which the tactor is driven."""
        return self._amplifier

    def submit(self, request: CurveRequest) -> None:
        """Want a curve; returns at once. `ready` gives it when it is there."""
        if request == self._requested:
            return
        self._requested, self._curve = request, None
        if self._future is not None:
            self._future.cancel()
        self._future = self._pool.submit(self.compute, request)

    def refresh(self) -> None:
        """See whether the specimen has another calibration by now; returns at once."""
        if self._future is None and self._requested is not None and self._requested.folder is not None:
            self._future = self._pool.submit(self.compute, self._requested)

    def result(self) -> OverlayCurve | None:
        """The curve last asked for, None while it is being computed.

        Raises:
            ParameterError: the model cannot answer this question.
        """
        if self._future is not None and self._future.done():
            future, self._future = self._future, None
            self._curve = future.result()
        return self._curve

    def compute(self, request: CurveRequest) -> OverlayCurve:
        """Compute a curve here and now; one that was computed before is given again."""
        self._active_model = of = load_active_model(request.folder, request.specimen, self._active_model)
        name = (request.max_hz, request.amplitude_v, request.elongations_m, of.stamp, of.description, of.problem)
        if name not in self._cache:
            if len(self._cache) >= MAX_CACHED_CURVES:
                self._cache.pop(next(iter(self._cache)))
            self._cache[name] = self._compute_all(request, of)
        return self._cache[name]

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _compute_all(self, request: CurveRequest, active_model: ActiveModel) -> OverlayCurve:
        from model.parameter_spec import ParameterError
        from model.specimen import Specimen

        free = self._compute_curve(request, active_model, Specimen(active_model.tactor))
        on = []
        for elongation_m in request.elongations_m:
            alone = next(
                (c_s for at, c_s in active_model.damping_by_elongation if _same_elongation(at, elongation_m)), None
            )
            try:
                pressed = Specimen(
                    active_model.tactor, active_model.membrane, elongation_m / active_model.membrane.L_m, c_s=alone
                )
                on.append(replace(self._compute_curve(request, active_model, pressed), elongation_m=elongation_m))
            except ParameterError:  # as a damping below zero: of this elongation there is no curve
                continue
        return replace(free, on_membrane=tuple(on))

    def _compute_curve(self, request: CurveRequest, active_model: ActiveModel, specimen: "Specimen") -> OverlayCurve:
        from model.response.frequency_response import (  # scipy.linalg takes a quarter of a second, and nobody waits here
            amplifier_response,
        )

        frequency = np.linspace(LOWEST_HZ, max(request.max_hz, 2 * LOWEST_HZ), FREQUENCIES)
        amplitude_v, amplifier = request.amplitude_v, self._amplifier
        # The harmonics that matter reach up to the same frequency: low ones need many, so they go by themselves.
        driven = [
            amplifier_response(specimen.tactor, part, amplitude_v, amplifier.rest_v, amplifier, skin=specimen.skin)
            for part in np.split(frequency, np.searchsorted(frequency, SPLIT_HZ))
            if part.size
        ]
        peak_to_peak = np.concatenate([part.peak_to_peak for part in driven])
        motion = np.concatenate([part.fundamental for part in driven])
        fundamental, phase = np.abs(motion), np.angle(motion)
        estimates = active_model.estimates if specimen.membrane is None else active_model.membrane_estimates
        band = None
        if estimates is not None:
            reach = self._band_half_width(request, estimates, specimen, frequency)
            band = CurveBand(*((y - r, y + r) for y, r in zip((peak_to_peak, fundamental), reach, strict=True)))
        return OverlayCurve(request, frequency, peak_to_peak, fundamental, phase, active_model, band)

    def _band_half_width(
        self, request: CurveRequest, estimates: "EstimateSet", specimen: "Specimen", frequency: Array
    ) -> tuple[Array, Array]:
        """Half the band of either series; its derivatives are those of the quick curve, 0.01 % from the thorough one."""
        from model.response.fast_response import response_curve
        from model.studies.uncertainty import linear_band

        def both(values: tuple[float, ...]) -> Array:
            given = dict(zip(estimates.names, values, strict=True))
            got = response_curve(_with_parameters(specimen, given), frequency, request.amplitude_v, self._amplifier)
            return np.concatenate((got.peak_to_peak, np.abs(got.fundamental)))

        band = linear_band(
            lambda values: np.array([both(row) for row in zip(*values.values(), strict=True)]), estimates, COVERAGE
        )
        reach = band.upper - band.centre
        return reach[: frequency.size], reach[frequency.size :]


def elongations_of(points: Iterable[Any]) -> tuple[float, ...]:
    """The elongations of the membrane at which points were measured, rising; none for those of the free tactor."""
    found = {float(getattr(point, "elongation", math.nan)) for point in points}
    return tuple(sorted(elongation for elongation in found if not math.isnan(elongation)))


def _same_elongation(one_m: float | None, other_m: float) -> bool:
    return one_m is not None and math.isclose(one_m, other_m, rel_tol=1e-5, abs_tol=1e-8)


def _with_parameters(specimen: "Specimen", given: Mapping[str, float]) -> "Specimen":
    """Another tactor, and another membrane where there is one."""
    tactor, membrane = specimen.tactor, specimen.membrane
    names = {field.name for field in fields(tactor)}
    tactor = replace(tactor, **{name: value for name, value in given.items() if name in names})
    if membrane is not None:
        membrane = replace(membrane, **{name: value for name, value in given.items() if name not in names})
    return replace(specimen, tactor=tactor, membrane=membrane)
