"""Overlay of the model's curve with its error band under measured points, computed in a background thread and cached."""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.identification import PAPER_MODEL, ActiveModel, load_active_model, same_elongation
from app.live.curve_cache import CurveCache
from app.live.latest_only import LatestOnlyWorker
from model import AmplifierMap, Array, Band, ParameterError, Role, Series, replace_variables
from protocols import aspects_of
from protocols.base import ModelState, Protocol

if TYPE_CHECKING:
    from app.archive import LoadedRun
    from model import Specimen
    from model.studies import EstimateSet

LOWEST_HZ = 5.0
"""Lowest frequency of a curve. Below it the response is quasi-static, but needs ever more harmonics."""

SPLIT_HZ = (15.0, 60.0)
"""Frequencies that split the computation, which then takes a seventh of the time and agrees within 2e-5."""

MAX_CACHED_CURVES = 64
FREQUENCIES = 400
COVERAGE = 0.95


@dataclass(frozen=True, slots=True)
class CurveRequest:
    """A requested curve: highest frequency, peak amplitude at the amplifier's input, and specimen.

    The specimen's active calibration is read from `folder`; without one the curve uses the paper's values.
    """

    max_hz: float
    amplitude_v: float
    folder: Path | None = None
    specimen: str = ""
    elongations_m: tuple[float, ...] = ()
    """Elongations of the membrane for which curves are computed besides the free tactor's."""
    protocol: str = ""
    """Name of the protocol whose axes have a model curve of their own."""


def curve_request_for(protocol: Protocol, folder: Path | None = None, specimen: str = "") -> CurveRequest:
    """Return the request of the curve for a protocol's points on a specimen."""
    frequencies = getattr(protocol, "frequencies_hz", (getattr(protocol, "stop_hz", 250.0),))
    top_hz = 25.0 * math.ceil(1.04 * max(frequencies, default=250.0) / 25.0)
    elongations = tuple(sorted(set(getattr(protocol, "elongations_m", ()))))
    amplitude_v = getattr(protocol, "peak_to_peak_v", 5.0) / 2
    return CurveRequest(top_hz, amplitude_v, folder, specimen, elongations, protocol.name)


def curve_request_of(run: "LoadedRun") -> CurveRequest:
    """Return the request of the curve for the points of a recorded run."""
    amplitude_v, specimen = float(run.record.parameters.get("peak_to_peak_v", 5.0)) / 2, run.record.specimen
    elongations = {float(getattr(point, "elongation", math.nan)) for point in run.points}
    elongations_m = tuple(sorted(each for each in elongations if not math.isnan(each)))
    return CurveRequest(1.05 * run.max_hz, amplitude_v, run.path.parent, specimen, elongations_m, run.record.protocol)


ResponseCurves = Mapping[str, Series]
"""`peak_to_peak` and the complex `fundamental` of one specimen over frequency, m over Hz; their bands have a coverage of `COVERAGE`."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelCurves:
    """Curves of the model for a request.

    Attributes:
        active_model: model parameters of the curves.
        free: curves of the free tactor; without bands if the parameters have no errors.
        on_membrane: computable curves by elongation of the membrane.
        over_axes: function that returns the second axis of the request's protocol over the first, SI; None without a model.
    """

    request: CurveRequest
    active_model: ActiveModel
    free: ResponseCurves
    on_membrane: Mapping[float, ResponseCurves]
    over_axes: Callable[[Array], Array | None]

    def at_elongation(self, elongation_m: float | None) -> ResponseCurves | None:
        """Return the curves at an elongation, None or NaN for the free tactor; None if there are none."""
        if elongation_m is None or math.isnan(elongation_m):
            return self.free
        return next((curves for at, curves in self.on_membrane.items() if same_elongation(at, elongation_m)), None)


class Overlay:
    """Computes the newest requested curve for specimens on one amplifier, in its own thread.

    Args:
        amplifier: drives the tactor.
        cache: of another overlay on the same amplifier, if curves are to be shared.
    """

    def __init__(self, amplifier: AmplifierMap | None = None, cache: CurveCache[ModelCurves] | None = None) -> None:
        self.amplifier = amplifier or AmplifierMap()
        self.cache = CurveCache[ModelCurves](MAX_CACHED_CURVES) if cache is None else cache
        self._worker = LatestOnlyWorker(lambda request: iter((self.compute(request),)), self._store, "overlay")
        self._active_model = PAPER_MODEL
        self._requested: CurveRequest | None = None
        self._result: tuple[CurveRequest | None, ModelCurves | Exception | None] = None, None

    def submit(self, request: CurveRequest) -> None:
        """Request a curve; returns at once. `result` returns it when it is ready."""
        if request != self._requested:
            self._requested = request
            self._worker.submit(request)

    def refresh(self) -> None:
        """Look for another calibration of the specimen; returns at once."""
        request = self._requested
        if request is not None and request.folder is not None and self._result[0] is request:
            self._worker.submit(request)

    def result(self) -> ModelCurves | None:
        """Return the curve requested last; None while it is being computed, or if it is outside the model's range."""
        request, curve = self._result
        if isinstance(curve, ParameterError) or request is not self._requested:
            return None
        if isinstance(curve, Exception):  # an error of this program
            self._result = request, None
            raise curve
        return curve

    def compute(self, request: CurveRequest) -> ModelCurves:
        """Compute a curve in the calling thread, or return it from the cache."""
        self._active_model = of = load_active_model(request.folder, request.specimen, self._active_model)
        name = (
            request.max_hz,
            request.amplitude_v,
            request.elongations_m,
            request.protocol,
            of.stamp,
            of.description,
            of.problem,
        )
        return self.cache.get(name, lambda: self._compute_all(request, of))

    def close(self) -> None:
        """Stop the thread."""
        self._worker.close()

    def _store(self, request: CurveRequest, result: ModelCurves | Exception) -> None:
        self._result = request, result

    def _compute_all(self, request: CurveRequest, active_model: ActiveModel) -> ModelCurves:
        on_membrane = {}
        for elongation_m in request.elongations_m:
            with suppress(ParameterError):  # for example a damping below zero: no curve at this elongation
                pressed = active_model.specimen(elongation_m)
                label = f"{1e3 * elongation_m:g} mm"
                on_membrane[elongation_m] = self._compute_curves(request, active_model, pressed, label)
        state = ModelState(active_model.specimen(), self.amplifier)
        over_axes = partial(aspects_of(request.protocol).model_curve, state)  # loaded here, in the background
        free = self._compute_curves(request, active_model, state.specimen, "free")
        return ModelCurves(request, active_model, free, on_membrane, over_axes)

    def _compute_curves(
        self, request: CurveRequest, active_model: ActiveModel, specimen: "Specimen", label: str
    ) -> ResponseCurves:
        from model.response import amplifier_response, with_lag  # lazily: scipy.linalg loads in 0.25 s

        frequency = np.linspace(LOWEST_HZ, max(request.max_hz, 2 * LOWEST_HZ), FREQUENCIES)
        amplitude_v, amplifier = request.amplitude_v, self.amplifier
        # The relevant harmonics reach up to the same frequency: low ones need many, so they are computed separately.
        driven = [
            with_lag(
                amplifier_response(
                    specimen.acting_tactor, part, amplitude_v, amplifier.rest_v, amplifier, skin=specimen.skin
                ),
                specimen,
                amplitude_v,
                amplifier.rest_v,
                amplifier,
            )
            for part in np.split(frequency, np.searchsorted(frequency, SPLIT_HZ))
            if part.size
        ]
        peak_to_peak = np.concatenate([part.peak_to_peak for part in driven])
        motion = np.concatenate([part.fundamental for part in driven])
        estimates = active_model.estimates_for(specimen)
        curves = {
            name: Series(frequency, y, name=name, label=label, role=Role.MODEL)
            for name, y in (("peak_to_peak", peak_to_peak), ("fundamental", motion))
        }
        if estimates is None:
            return curves
        reach = self._band_half_width(request, estimates, specimen, frequency)
        return {
            name: replace(curve, band=Band(curve.plotted - half, curve.plotted + half))
            for (name, curve), half in zip(curves.items(), reach, strict=True)
        }

    def _band_half_width(
        self, request: CurveRequest, estimates: "EstimateSet", specimen: "Specimen", frequency: Array
    ) -> tuple[Array, Array]:
        """Return half the band of either series; its derivatives are computed with the fast curve, within 0.01 % of the full one."""
        from model.response import response_curve
        from model.studies import linear_band

        def both(values: tuple[float, ...]) -> Array:
            given = dict(zip(estimates.names, values, strict=True))
            got = response_curve(replace_variables(specimen, given), frequency, request.amplitude_v, self.amplifier)
            return np.concatenate((got.peak_to_peak, np.abs(got.fundamental)))

        band = linear_band(
            lambda values: np.array([both(row) for row in zip(*values.values(), strict=True)]), estimates, COVERAGE
        )
        reach = band.upper - band.centre
        return reach[: frequency.size], reach[frequency.size :]
