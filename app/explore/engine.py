"""What the Explore page asks of the model, answered piece by piece in the order in which a person looks. No Qt."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.explore.state import ExploreSetting, KeptCurve

Array = NDArray[np.float64]

FREQUENCIES = 300
LOWEST_HZ = 1.0
PHASES = 48
POSITIONS = 49
MAX_CACHED_CURVES = 200


@dataclass(frozen=True, slots=True)
class ExploreRequest:
    """One state of the page."""

    setting: ExploreSetting
    kept_curves: tuple[KeptCurve, ...]
    max_hz: float
    cursor_hz: float


@dataclass(frozen=True, slots=True)
class ExploreCurve:
    """One curve over frequency: amplitudes in m, phase in rad."""

    frequency_hz: Array
    peak_to_peak: Array
    twice_fundamental: Array
    phase: Array


@dataclass(frozen=True, slots=True)
class BeamMotion:
    """The half beam in motion: `deflection` (phases, X) in m at `x` (X,) in m."""

    x: Array
    deflection: Array
    L1: float
    L2: float


@dataclass(frozen=True, slots=True)
class ExploreResult:
    """What is known by now."""

    curve: ExploreCurve
    felt_bands: tuple[tuple[float, float], ...]
    """Where max - min is above the threshold of the skin, Hz."""
    kept_curves: tuple[ExploreCurve, ...] | None = None
    motion: BeamMotion | None = None


class ResponseEngine:
    """Computes pictures; curves once computed are kept in mind, so that kept ones cost nothing."""

    def __init__(self) -> None:
        self._cache: dict[tuple[str, float], ExploreCurve] = {}

    def compute(self, request: ExploreRequest) -> Iterator[ExploreResult]:
        """The curve first, then the kept ones, then the motion.

        Raises:
            ParameterError, LinAlgError: the model has no answer.
        """
        from model.response.perception import usable_bands

        line = self._curve(request.setting, request.max_hz)
        picture = ExploreResult(line, usable_bands(line.frequency_hz, line.peak_to_peak))
        yield picture
        picture = replace(
            picture, kept_curves=tuple(self._curve(kept.setting, request.max_hz) for kept in request.kept_curves)
        )
        yield picture
        yield replace(picture, motion=_beam_motion(request))

    def _curve(self, setting: ExploreSetting, max_hz: float) -> ExploreCurve:
        from model.response.fast_response import response_curve

        name = (repr((sorted(setting.values.items()), setting.on_skin, setting.peak_to_peak_v)), max_hz)
        if name not in self._cache:
            if len(self._cache) >= MAX_CACHED_CURVES:
                self._cache.pop(next(iter(self._cache)))
            f = np.linspace(LOWEST_HZ, max_hz, FREQUENCIES)
            got = response_curve(setting.specimen, f, setting.peak_to_peak_v / 2)
            phase = np.unwrap(np.angle(got.fundamental))
            self._cache[name] = ExploreCurve(f, got.peak_to_peak, 2 * np.abs(got.fundamental), phase)
        return self._cache[name]


def _beam_motion(request: ExploreRequest) -> BeamMotion:
    from model.response.fast_response import operating_deflection_shape

    specimen = request.setting.specimen
    t = specimen.tactor
    x = np.linspace(0, t.L, POSITIONS)
    w = operating_deflection_shape(specimen, request.cursor_hz, x, PHASES, request.setting.peak_to_peak_v / 2)
    return BeamMotion(x, w, t.L1, t.L2)
