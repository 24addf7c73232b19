"""The specimen as its runs tell it: what was identified, and any curve of the model with the band of its errors."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from app.identification.identify import Identified, identify_campaign
from app.report.runs import Taken
from model.amplifier_map import AmplifierMap
from model.identification.fit_options import Setting
from model.identification.joint_fit import joint_fit
from model.identification.observations import Campaign, FrequencyResponse
from model.identification.parameters import at, elongation_of, quantity
from model.parameter_spec import ParameterError, quantities
from model.parameters import Membrane, Tactor
from model.response.frequency_response import amplifier_response
from model.skin import Skin, skin
from model.specimen import variables
from model.studies.uncertainty import Band, Estimates, linear_band

Array = NDArray[np.float64]
Curve = Callable[[Tactor, Membrane], Array]

LOW_HZ, HIGH_HZ = 5.0, 250.0
"""Where the threshold of the skin is known (paper, Sec. I)."""
SLOW_HZ = np.linspace(LOW_HZ, 37.5, 14)
FAST_HZ = np.linspace(40.0, HIGH_HZ, 85)
GRID_HZ = np.concatenate((SLOW_HZ, FAST_HZ))
NORMAL = 1.959964
"""Standard errors to either side that hold 95 % of a normal error."""

FREE = frozenset(("mu", "m_add", "c0"))
"""What the response of the free tactor tells."""

TACTOR, MEMBRANE = ({q.name for q in quantities(kind)} for kind in (Tactor, Membrane))


@dataclass(frozen=True, slots=True)
class Specimen:
    """What is known of one specimen."""

    tactor: Tactor
    membrane: Membrane
    amplifier: AmplifierMap
    found: Identified | None
    n: int = Setting.n
    """Shape functions."""
    why_not: str = ""
    """Why nothing was identified."""
    bands: dict[tuple[float, float, bool], Band | None] = field(default_factory=dict, compare=False, repr=False)
    """What was computed once: by elongation (-1 free), amplitude and kind, over `GRID_HZ`."""
    each: Mapping[float, tuple[float, float]] | None = None
    """Elongation (m) -> c_s and its standard error, from a fit with one for every elongation."""

    @property
    def words(self) -> str:
        """Whose numbers the model has."""
        if self.found is None:
            return "model with the paper's Table I"
        return "model as fitted, not all of it identified" if self.found.unidentified else "model as identified"

    @property
    def told(self) -> frozenset[str]:
        """Names of what was identified."""
        return frozenset(e.name for e in self.found.estimates) if self.found is not None else frozenset()

    @property
    def tells_free(self) -> bool:
        """Whether the response of the free tactor is this specimen's own, not partly the paper's."""
        return self.told >= FREE and self.found is not None and not self.found.unidentified

    def tells_on(self, elongation_m: float) -> bool:
        """Whether the response at this elongation is."""
        on_skin = "c_s_0" in self.told and ("c_s_delta" in self.told or elongation_m == 0)
        return self.tells_free and (on_skin or at("c_s", elongation_m) in self.told)

    @property
    def full_v(self) -> float:
        """The largest amplitude of a sine around rest."""
        map_ = self.amplifier
        return min(map_.rest_v - map_.low_v, map_.high_v - map_.rest_v)

    def band(self, curve: Curve) -> Band | None:
        """A curve of the model with its 95 % band; None where the model cannot be evaluated there.

        The errors are those of what was identified, with their correlations. A band of no width means that nothing that was
        identified moves the curve.
        """
        try:
            estimates = self._estimates()
            if estimates is None:
                centre = curve(self.tactor, self.membrane)
                return Band(centre, np.zeros_like(centre), centre, centre)

            def rows(varied: Mapping[str, Array]) -> Array:
                names = tuple(varied)
                return np.array([curve(*self._with(names, row)) for row in zip(*varied.values(), strict=True)])

            return linear_band(rows, estimates)
        except ParameterError:
            return None

    def response(self, amplitude_v: float, elongation_m: float | None, whole: bool = True) -> Band | None:
        """`moved` over `GRID_HZ` with its band."""
        key = (-1.0 if elongation_m is None else elongation_m, amplitude_v, whole)
        if key not in self.bands:
            self.bands[key] = self.band(self.moved(GRID_HZ, amplitude_v, elongation_m, whole))
        return self.bands[key]

    def value(self, curve: Curve) -> Array | None:
        """A curve of the model; None where the model cannot be evaluated there."""
        try:
            return curve(self.tactor, self.membrane)
        except ParameterError:
            return None

    def moved(self, f: Array, amplitude_v: float, elongation_m: float | None = None, whole: bool = True) -> Curve:
        """Max - min of the centre (m) under a sine around rest, free or on the membrane; (F,). Not `whole`: 2 x fundamental."""

        def curve(tactor: Tactor, membrane: Membrane) -> Array:
            on = None if elongation_m is None else self._skin(tactor, membrane, elongation_m)
            # The harmonics that matter reach up to the same frequency: low frequencies need many, so they go by themselves.
            parts = [part for part in (f[f < FAST_HZ[0]], f[f >= FAST_HZ[0]]) if part.size]
            rest_v = self.amplifier.rest_v
            driven = [
                amplifier_response(tactor, part, amplitude_v, rest_v, self.amplifier, skin=on, n=self.n)
                for part in parts
            ]
            return np.concatenate([d.peak_to_peak if whole else 2 * np.abs(d.fundamental) for d in driven])

        return curve

    def _skin(self, tactor: Tactor, membrane: Membrane, elongation_m: float) -> Skin:
        """By the line of all elongations; where one alone was identified, that."""
        on = skin(membrane, elongation_m / membrane.L_m, tactor=tactor)
        name = at("c_s", elongation_m)
        if self.found is None or name not in self.told:
            return on
        return Skin(on.k_s, next(e.value for e in self.found.estimates if e.name == name))

    def _estimates(self) -> Estimates | None:
        if self.found is None:
            return None
        keep = [i for i, e in enumerate(self.found.estimates) if e.name in variables()]
        if not keep:
            return None
        chosen = [self.found.estimates[i] for i in keep]
        return Estimates(
            tuple(e.name for e in chosen), tuple(e.value for e in chosen), self.found.covariance[np.ix_(keep, keep)]
        )

    def _with(self, names: Sequence[str], values: Sequence[float]) -> tuple[Tactor, Membrane]:
        given = dict(zip(names, map(float, values), strict=True))
        return (
            replace(self.tactor, **{n: v for n, v in given.items() if n in TACTOR}),
            replace(self.membrane, **{n: v for n, v in given.items() if n in MEMBRANE}),
        )


def specimen_of(
    name: str, runs: Sequence[Taken], progress: Callable[[int, float], None] | None = None
) -> tuple[Specimen, Campaign | None]:
    """Identify what the runs tell, all at once; where that cannot be done, the paper's Table I and the reason."""
    counting = [run for run in runs if run.observations and not run.left_out]
    amplifier = counting[-1].amplifier if counting else AmplifierMap()
    n = max((run.shapes for run in counting), default=Setting.n)
    table = Specimen(Tactor(), Membrane(), amplifier, None, n)
    if not counting:
        return replace(table, why_not="no run tells anything about the model"), None
    try:
        campaign = Campaign(tuple(each for run in counting for each in run.observations))
    except ParameterError as error:
        return replace(table, why_not=str(error)), None
    try:
        found = identify_campaign(name, campaign, "joint", Setting(amplifier=amplifier, n=n), progress=progress)
        tactor, membrane = _fitted(found)
    except ValueError as error:  # of the fit: a sentence what it lacks
        return replace(table, why_not=str(error)), campaign
    return Specimen(tactor, membrane, amplifier, found, n, each=_each(campaign, amplifier, n)), campaign


def _fitted(found: Identified) -> tuple[Tactor, Membrane]:
    """Where the fit ended, also for what these runs do not tell by itself: only together it is what explains the points."""
    if found.fit is None:
        return found.tactor, found.membrane
    values = found.fit.values
    pick = [{q.name: float(values[q.name] or 0.0) for q in quantities(kind)} for kind in (Tactor, Membrane)]
    return Tactor(**pick[0]), Membrane(**pick[1])


def _each(campaign: Campaign, amplifier: AmplifierMap, n: int) -> Mapping[float, tuple[float, float]] | None:
    """The damping by the skin at every elongation by itself: the points of the paper's Fig. 8."""
    if len({r.elongation_m for r in campaign.of(FrequencyResponse) if r.elongation_m is not None}) < 2:
        return None
    try:
        fit = joint_fit(campaign, Setting(each=True, amplifier=amplifier, n=n))
    except ValueError:
        return None
    found = {}
    for estimate in fit.estimates():
        elongation = elongation_of(estimate.name)
        if elongation is not None and estimate.name.startswith("c_s"):
            found[elongation] = (estimate.value, estimate.standard_error)
    return found or None


def meaning(name: str) -> str:
    """What a parameter is, in words; empty where nobody knows."""
    try:
        return quantity(name).words
    except ParameterError:
        return ""
