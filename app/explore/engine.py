"""Response engine of the Explore page: model curves, felt bands and beam motion, in the order of their importance."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from app.explore.state import ExploreSetting, KeptCurve
from app.live import CurveCache
from model import Array
from model.response import PeriodicResponse

if TYPE_CHECKING:
    from model.response import PerceptionThreshold

FREQUENCIES = 300
LOWEST_HZ = 1.0
PHASES = 48
POSITIONS = 49
MAX_CACHED_CURVES = 200
LABORATORY_SITE = "laboratory"
"""In place of a body site: the threshold of the laboratory file."""


@dataclass(frozen=True, slots=True)
class ExploreRequest:
    """A requested state of the page."""

    setting: ExploreSetting
    kept_curves: tuple[KeptCurve, ...]
    max_hz: float
    cursor_hz: float
    site: str = "abdomen"
    """Body site of the perception threshold, one of `model.response.SITES`, or `LABORATORY_SITE`."""
    own_threshold: "PerceptionThreshold | None" = None
    """Threshold of the laboratory, for the site `LABORATORY_SITE`."""


@dataclass(frozen=True, slots=True)
class BeamMotion:
    """Motion of the half beam: `deflection` (phases, X) in m at `x` (X,) in m."""

    x: Array
    deflection: Array
    L1: float
    L2: float


@dataclass(frozen=True, slots=True)
class ExploreResult:
    """The results so far."""

    curve: PeriodicResponse
    felt_bands: tuple[tuple[float, float], ...]
    """Where max - min is above the perception threshold of the skin, Hz."""
    threshold_m: Array
    """That threshold at the frequencies of the curve, (F,)."""
    threshold_label: str
    natural_hz: tuple[float, ...]
    """Natural frequency of the setting, then of each kept curve's."""
    kept_curves: tuple[PeriodicResponse, ...] | None = None
    motion: BeamMotion | None = None


class ResponseEngine:
    """Computes results; curves are cached, so that kept ones cost nothing."""

    def __init__(self) -> None:
        self._cache: CurveCache[PeriodicResponse] = CurveCache(MAX_CACHED_CURVES)

    def compute(self, request: ExploreRequest) -> Iterator[ExploreResult]:
        """Yield the curve, then also the kept ones, then also the motion.

        Raises:
            ParameterError, LinAlgError: the model cannot be computed.
        """
        from model.response import SITES, natural_frequencies, usable_bands

        curve, own = self._curve(request.setting, request.max_hz), request.own_threshold
        own = own if request.site == LABORATORY_SITE else None
        threshold = own or SITES.get(request.site, SITES["abdomen"])
        felt_bands = usable_bands(curve.frequency_hz, curve.peak_to_peak, threshold)
        specimens = [each.specimen for each in (request.setting, *(kept.setting for kept in request.kept_curves))]
        natural_hz = tuple(float(natural_frequencies(each.tactor, each.skin)[0]) for each in specimens)
        threshold_m = threshold.amplitude_at(curve.frequency_hz)
        result = ExploreResult(curve, felt_bands, threshold_m, threshold.line_label, natural_hz)
        yield result
        kept_curves = tuple(self._curve(kept.setting, request.max_hz) for kept in request.kept_curves)
        result = replace(result, kept_curves=kept_curves)
        yield result
        yield replace(result, motion=_beam_motion(request))

    def _curve(self, setting: ExploreSetting, max_hz: float) -> PeriodicResponse:
        key = (frozenset(setting.values.items()), setting.on_skin, setting.peak_to_peak_v, max_hz)
        return self._cache.get(key, lambda: _compute_curve(setting, max_hz))


def _compute_curve(setting: ExploreSetting, max_hz: float) -> PeriodicResponse:
    from model.response import response_curve

    f = np.linspace(LOWEST_HZ, max_hz, FREQUENCIES)
    return response_curve(setting.specimen, f, setting.peak_to_peak_v / 2)


def _beam_motion(request: ExploreRequest) -> BeamMotion:
    from model.response import operating_deflection_shape

    specimen = request.setting.specimen
    t = specimen.tactor
    x = np.linspace(0, t.L, POSITIONS)
    w = operating_deflection_shape(specimen, request.cursor_hz, x, PHASES, request.setting.peak_to_peak_v / 2)
    return BeamMotion(x, w, t.L1, t.L2)
