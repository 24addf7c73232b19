"""Fitted model of a specimen: identified parameters, and model curves with 95 % bands."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from app.identification import IdentificationResult, SpecimenSheet, identify_observations
from app.report.runs import ReportRun
from model import (
    COVERAGE_FACTOR_95,
    NONIDEAL_NAMES,
    AmplifierMap,
    Array,
    EstimatedQuantity,
    Membrane,
    ParameterError,
    Skin,
    Specimen,
    Tactor,
    parameter_specs,
    replace_variables,
    skin,
    variable_specs,
)
from model.identification import (
    FitOptions,
    FrequencyResponseObservation,
    JointFit,
    ObservationSet,
    elongation_parameter,
    joint_fit,
    parameter_spec,
    parse_elongation,
)
from model.response import driven_amplitudes, lag_factor
from model.studies import EstimateSet, UncertaintyBand, linear_band
from protocols.base import ModelFunction, ModelState

Effects = Mapping[str, float]
"""Effects that the beam model leaves out, by name."""
CurveFunction = Callable[[Tactor, Membrane, Effects], Array]

NO_EFFECTS: Effects = {
    "creep": 0.0,
    "hysteresis": 0.0,
    "mass_fraction": 1.0,
    "mass_offset": 0.0,
    "clamp_flexibility": 0.0,
}
"""Nonidealities of the curves, with their values in an ideal specimen."""

LOW_HZ, HIGH_HZ = 5.0, 250.0
"""Frequency range of the perception threshold (paper, Sec. I)."""
LOW_GRID_HZ = np.linspace(LOW_HZ, 37.5, 14)
HIGH_GRID_HZ = np.linspace(40.0, HIGH_HZ, 85)
GRID_HZ = np.concatenate((LOW_GRID_HZ, HIGH_GRID_HZ))
BAND_HZ = np.concatenate((LOW_GRID_HZ[::4], HIGH_GRID_HZ[::3]))
"""Where the width of a band is computed; relative to the curve it changes slowly."""
FREE_RESPONSE_PARAMETERS = frozenset(("mu", "m_add", "c0"))
"""Parameters that determine the response of the free tactor."""

TACTOR_NAMES, MEMBRANE_NAMES = ({q.name for q in parameter_specs(kind)} for kind in (Tactor, Membrane))


@dataclass(frozen=True, slots=True)
class SpecimenModel:
    """Model of one specimen with its identification."""

    tactor: Tactor
    membrane: Membrane
    amplifier: AmplifierMap
    identification: IdentificationResult | None
    n: int = FitOptions.n
    """Number of shape functions."""
    problem: str = ""
    """Why nothing was identified."""
    cached_bands: dict[tuple[float | None, float, bool], UncertaintyBand | None] = field(
        default_factory=dict, compare=False, repr=False
    )
    """Bands over `GRID_HZ` by elongation (None: free), amplitude and kind."""
    damping_by_elongation: Mapping[float, tuple[float, float]] | None = None
    """Elongation (m) -> c_s and its standard error, from a fit with separate damping for every elongation."""
    sheet: SpecimenSheet = field(default_factory=SpecimenSheet)
    """Dimensions and masses."""
    effects: Effects = field(default_factory=lambda: NO_EFFECTS)

    @property
    def specimen(self) -> Specimen:
        """The specimen on its membrane, without pre-stretch, with the effects outside the beam model."""
        nonideal = {name: self.effects[name] for name in NONIDEAL_NAMES}
        return replace_variables(Specimen(self.tactor, self.membrane), nonideal)

    @property
    def description(self) -> str:
        """Source of the model's parameters as text."""
        if self.identification is None:
            return "model with the paper's Table I"
        return "fitted model, partly identified" if self.identification.unidentified else "model as identified"

    @property
    def joint_fit(self) -> JointFit | None:
        """The joint fit of the identification, if there is one."""
        return None if self.identification is None else self.identification.joint_fit

    @property
    def estimates(self) -> tuple[EstimatedQuantity, ...]:
        """The identified parameters."""
        return () if self.identification is None else tuple(self.identification.estimates)

    @property
    def identified(self) -> tuple[EstimatedQuantity, ...]:
        """Estimates that the runs determine: neither values known beforehand nor assumed ones."""
        return () if self.identification is None else self.identification.identified

    @property
    def identified_names(self) -> frozenset[str]:
        """Names of the identified parameters."""
        return frozenset(e.name for e in self.estimates)

    @property
    def identifies_free_response(self) -> bool:
        """Whether all parameters of the free response were identified."""
        return (
            self.identified_names >= FREE_RESPONSE_PARAMETERS
            and self.identification is not None
            and not self.identification.unidentified
        )

    def identifies_response_at(self, elongation_m: float) -> bool:
        """Return whether all parameters of the response at this elongation were identified."""
        on_skin = "c_s_0" in self.identified_names and ("c_s_delta" in self.identified_names or elongation_m == 0)
        return self.identifies_free_response and (
            on_skin or elongation_parameter("c_s", elongation_m) in self.identified_names
        )

    @property
    def full_amplitude_v(self) -> float:
        """The largest amplitude of a sine around rest."""
        map_ = self.amplifier
        return min(map_.rest_v - map_.low_v, map_.high_v - map_.rest_v)

    def curve_with_band(self, curve: CurveFunction) -> UncertaintyBand | None:
        """Return a model curve with its 95 % band; None if the model cannot be evaluated.

        The band follows from the covariance of the identified parameters. A band of zero width means that no identified
        parameter affects the curve.
        """
        try:
            estimates = self._estimates()
            if estimates is None:
                centre = curve(self.tactor, self.membrane, self.effects)
                return UncertaintyBand(centre, np.zeros_like(centre), centre, centre)

            def rows(varied: Mapping[str, Array]) -> Array:
                names = tuple(varied)
                return np.array([curve(*self._with_values(names, row)) for row in zip(*varied.values(), strict=True)])

            return linear_band(rows, estimates)
        except ParameterError:
            return None

    def figure_curve(self, curve: ModelFunction, x: Array) -> CurveFunction:
        """Return a protocol's model curve over x as a function of the parameters; NaN where it has none."""

        def values(tactor: Tactor, _: Membrane, effects: Effects) -> Array:
            specimen = replace_variables(Specimen(tactor), {name: effects[name] for name in NONIDEAL_NAMES})
            state = ModelState(specimen, self.amplifier, self.n, effects["mass_fraction"], effects["mass_offset"])
            y = curve(state, x)
            return np.full(x.size, np.nan) if y is None else y

        return values

    def response(
        self, amplitude_v: float, elongation_m: float | None, peak_to_peak: bool = True
    ) -> UncertaintyBand | None:
        """Return the response amplitude over `GRID_HZ` with its band."""
        key = (elongation_m, amplitude_v, peak_to_peak)
        if key not in self.cached_bands:
            centre = self.curve_values(self.amplitude_curve(GRID_HZ, amplitude_v, elongation_m, peak_to_peak))
            coarse = self.curve_with_band(self.amplitude_curve(BAND_HZ, amplitude_v, elongation_m, peak_to_peak))
            self.cached_bands[key] = None if centre is None or coarse is None else _refined_band(centre, coarse)
        return self.cached_bands[key]

    def curve_values(self, curve: CurveFunction) -> Array | None:
        """Return a model curve; None if the model cannot be evaluated."""
        try:
            return curve(self.tactor, self.membrane, self.effects)
        except ParameterError:
            return None

    def amplitude_curve(
        self, frequency_hz: Array, amplitude_v: float, elongation_m: float | None = None, peak_to_peak: bool = True
    ) -> CurveFunction:
        """Return a function for max - min (or 2 x fundamental) of the centre (m) under a sine around rest; (F,)."""

        @cache  # many parameters of a band change neither
        def amplitudes(acting: Tactor, on: Skin | None) -> tuple[Array, Array]:
            return driven_amplitudes(acting, frequency_hz, amplitude_v, self.amplifier, on, self.n)

        def curve(tactor: Tactor, membrane: Membrane, effects: Effects) -> Array:
            on = None if elongation_m is None else self._skin(tactor, membrane, elongation_m)
            whole, fundamental = amplitudes(acting_tactor(tactor, effects), on)
            lag = lag_factor(
                effects["hysteresis"], effects["creep"], frequency_hz, amplitude_v, amplifier=self.amplifier
            )
            return np.abs(lag) * (whole if peak_to_peak else 2 * fundamental)

        return curve

    def _skin(self, tactor: Tactor, membrane: Membrane, elongation_m: float) -> Skin:
        """Return the skin: by the line fitted to all elongations, or by the damping identified for this one."""
        on = skin(membrane, elongation_m / membrane.L_m, tactor=tactor)
        name = elongation_parameter("c_s", elongation_m)
        return Skin(on.k_s, next((e.value for e in self.estimates if e.name == name), on.c_s))

    def _estimates(self) -> EstimateSet | None:
        if self.identification is None:
            return None
        keep = [i for i, e in enumerate(self.estimates) if e.name in variable_specs() or e.name in NO_EFFECTS]
        if not keep:
            return None
        chosen = [self.estimates[i] for i in keep]
        return EstimateSet(
            tuple(e.name for e in chosen),
            tuple(e.value for e in chosen),
            self.identification.covariance[np.ix_(keep, keep)],
            {**variable_specs(), **{name: parameter_spec(name) for name in NO_EFFECTS}},
        )

    def _with_values(self, names: Sequence[str], values: Sequence[float]) -> tuple[Tactor, Membrane, Effects]:
        given = dict(zip(names, map(float, values), strict=True))
        return (
            replace(self.tactor, **{n: v for n, v in given.items() if n in TACTOR_NAMES}),
            replace(self.membrane, **{n: v for n, v in given.items() if n in MEMBRANE_NAMES}),
            {**self.effects, **{n: v for n, v in given.items() if n in NO_EFFECTS}},
        )


def _refined_band(centre: Array, coarse: UncertaintyBand) -> UncertaintyBand:
    """Return the band around a curve over `GRID_HZ`, as wide relative to it as the band over `BAND_HZ`."""
    error = centre * np.interp(GRID_HZ, BAND_HZ, coarse.standard_error / coarse.centre)
    return UncertaintyBand(centre, error, centre - COVERAGE_FACTOR_95 * error, centre + COVERAGE_FACTOR_95 * error)


def acting_tactor(tactor: Tactor, effects: Effects) -> Tactor:
    """Return the tactor with its bare plate lengthened by the equivalent of the clamp's rotation."""
    return Specimen(tactor, clamp_flexibility=effects["clamp_flexibility"]).acting_tactor


def fit_specimen(
    name: str,
    runs: Sequence[ReportRun],
    progress: Callable[[int, float], None] | None = None,
    sheet: SpecimenSheet | None = None,
) -> tuple[SpecimenModel, ObservationSet | None]:
    """Fit all runs jointly; if that is not possible, return the paper's Table I and the reason.

    Dimensions and masses come from the `sheet`, by default Table I with the uncertainties of ruler and caliper.
    """
    sheet = sheet or SpecimenSheet(name)
    counting = [run for run in runs if run.identifiable]
    amplifier = counting[-1].record.amplifier_map if counting else AmplifierMap()
    n = max((run.shape_count for run in counting), default=FitOptions.n)
    paper_model = SpecimenModel(sheet.tactor, sheet.membrane, amplifier, None, n, sheet=sheet)
    if not counting:
        return replace(paper_model, problem="no run constrains the model"), None
    observations = None
    try:
        observations = ObservationSet(tuple(each for run in counting for each in run.observations))
        options = FitOptions(amplifier=amplifier, n=n)
        identification = identify_observations(name, observations, "joint", options, progress=progress, sheet=sheet)
        tactor, membrane, effects = _fitted_parameters(identification)
    except ValueError as error:  # the message names the missing data of the fit
        return replace(paper_model, problem=str(error)), observations
    return SpecimenModel(tactor, membrane, amplifier, identification, n, sheet=sheet, effects=effects), observations


def _fitted_parameters(identification: IdentificationResult) -> tuple[Tactor, Membrane, Effects]:
    """Return the fit's end values of all parameters, unidentified ones included: only together they fit the points."""
    if identification.joint_fit is None:
        return identification.tactor, identification.membrane, NO_EFFECTS
    values = identification.joint_fit.values
    pick = [{q.name: float(values[q.name] or 0.0) for q in parameter_specs(kind)} for kind in (Tactor, Membrane)]
    effects = {name: float(values.get(name) or default) for name, default in NO_EFFECTS.items()}
    return Tactor(**pick[0]), Membrane(**pick[1]), effects


def with_damping_by_elongation(specimen: SpecimenModel) -> SpecimenModel:
    """Return the model with the skin damping fitted separately for every elongation: the points of the paper's Fig. 8.

    Unchanged where there are fewer than two elongations, or no joint fit.
    """
    if (joint := specimen.joint_fit) is None:
        return specimen
    elongations = {run.elongation_m for run in joint.observations.of_type(FrequencyResponseObservation)} - {None}
    if len(elongations) < 2:
        return specimen
    start = dict(zip(joint.names, map(float, joint.theta), strict=True))  # close to the end, which saves most steps
    try:
        fit = joint_fit(joint.observations, replace(joint.options, per_elongation=True, start=start), tolerance=1e-5)
    except ValueError:
        return specimen
    damping = {
        elongation: (estimate.value, estimate.standard_error)
        for estimate in fit.estimates()
        if estimate.name.startswith("c_s") and (elongation := parse_elongation(estimate.name)) is not None
    }
    return replace(specimen, damping_by_elongation=damping or None)
