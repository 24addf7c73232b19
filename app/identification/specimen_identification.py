"""Parameter identification of a specimen from run files, by joint fit or by the paper's chain."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from app.common import kept_result, pluralize
from app.identification.observations import read_observations, shape_count_of_file
from app.identification.sheet_file import SheetError, load_sheet, read_sheet
from app.identification.specimen_sheet import SpecimenSheet
from model import Array, EstimatedQuantity, Membrane, ParameterError, Tactor, parameter_specs
from model.identification import (
    ASSUMED_PARAMETERS,
    NONIDEALITIES,
    USUAL_EFFECTS,
    Adequacy,
    ChainDifference,
    CurveValidation,
    DecayPoleObservation,
    ExtensionStep,
    FitOptions,
    FrequencyResponseObservation,
    IdentificationError,
    JointFit,
    ObservationSet,
    PaperChainError,
    PaperChainOptions,
    RunResiduals,
    UncertaintyBudget,
    assess_adequacy,
    chain_differences,
    default_values,
    extend_stepwise,
    identify_by_paper_chain,
    joint_fit,
    linearized_errors,
    prior_moments,
    uncertainty_budget,
    with_model_error,
    with_mountings,
    with_temperature_error,
)
from protocols.runfile import Run

Method = Literal["joint", "chain"]
SheetChoice = Path | Literal["none"] | None
"""A specimen sheet; None: the sheet beside the runs, "none": exact dimensions and masses."""

ASSUMED_SHARE = 0.85
"""Share of a parameter's prior standard deviation above which the runs do not determine the parameter."""

NONIDEAL = frozenset(("asymmetry", *NONIDEALITIES))
"""Parameters of the fit that the beam model does not have."""

CHAIN_SHEET_NOTE = "the chain takes dimensions and masses as exact: their uncertainties are in none of its errors; the joint fit's have them"


@dataclass(frozen=True, slots=True)
class IdentificationResult:
    """Result of an identification by either method."""

    specimen: str
    method: Method
    observations: ObservationSet
    estimates: tuple[EstimatedQuantity, ...]
    covariance: Array
    fixed: Mapping[str, float | None]
    """Parameters of the model that were held, with their values."""
    verdict: str
    misfits: tuple[RunResiduals, ...] = ()
    validation: tuple[CurveValidation, ...] = ()
    unidentified: tuple[str, ...] = ()
    """Combinations of parameters that these runs do not determine, as text."""
    notes: tuple[str, ...] = ()
    duration_s: float = 0.0
    joint_fit: JointFit | None = field(default=None, repr=False)
    adequacy: Adequacy | None = None
    """Of a joint fit: whether the misfit is noise or a model error."""
    shapes: int = FitOptions.n
    """Number of shape functions of the fit; its curves should use the same number."""
    budget: UncertaintyBudget | None = None
    """Of a joint fit: the sources of the uncertainties of its estimates."""
    sheet: SpecimenSheet | None = None
    """Source of dimensions and masses; None if the options define them."""
    steps: tuple[ExtensionStep, ...] = ()
    """Causes that were added to a first fit whose model was not adequate, in turn."""
    first_fit: JointFit | None = field(default=None, repr=False)
    """The joint fit without added causes."""
    joint_differences: tuple[ChainDifference, ...] = ()
    """Differences between the paper's chain and the joint fit."""

    @property
    def priors(self) -> Mapping[str, tuple[float, float]]:
        """Prior value and standard uncertainty of the parameters with a prior, such as lengths."""
        return {} if self.joint_fit is None else dict(self.joint_fit.options.priors)

    @property
    def assumed(self) -> tuple[EstimatedQuantity, ...]:
        """The estimates that are no measurement: sheet and runs determine them no better than the spread among tactors."""
        fit = self.joint_fit
        if fit is None:
            return ()
        usual = {**USUAL_EFFECTS, **ASSUMED_PARAMETERS}.keys() & self.priors.keys()
        expected = {name: prior_moments(name, self.priors[name])[1] for name in usual}
        return tuple(
            e for e in self.estimates if e.name in usual and e.standard_error > ASSUMED_SHARE * expected[e.name]
        )

    @property
    def resting(self) -> Mapping[str, float]:
        """Share of assumed parameters in the squared total uncertainty of each identified parameter, if above a half."""
        budget, assumed = self.budget, {e.name for e in self.assumed}
        if budget is None:
            return {}
        rows = [i for i, source in enumerate(budget.sources) if source in assumed]
        shares = dict(zip(budget.names, budget.shares[rows].sum(axis=0).tolist(), strict=True))
        return {e.name: shares[e.name] for e in self.identified if shares[e.name] > 0.5}

    @property
    def nonidealities(self) -> tuple[EstimatedQuantity, ...]:
        """The estimates of effects outside the beam model with a prior size, such as creep."""
        return tuple(e for e in self.estimates if e.name in NONIDEAL and e.name in self.priors)

    @property
    def dimensions(self) -> Mapping[str, tuple[float, float]]:
        """Prior values that are no nonideality: lengths, masses, moduli."""
        return {n: prior for n, prior in self.priors.items() if n not in NONIDEAL and n not in ASSUMED_PARAMETERS}

    @property
    def identified(self) -> tuple[EstimatedQuantity, ...]:
        """The estimates without the parameters that have a prior or are assumed."""
        own = {*self.priors} - {*ASSUMED_PARAMETERS} | {e.name for e in self.assumed}
        return tuple(e for e in self.estimates if e.name not in own)

    @property
    def budget_rows(self) -> Mapping[str, int]:
        """Row of each identified parameter in the budget; empty for the chain."""
        names = () if self.budget is None else self.budget.names
        return {e.name: names.index(e.name) for e in self.identified if e.name in names}

    @property
    def statistical_errors(self) -> Mapping[str, float]:
        """Standard uncertainty of each estimate by the scatter of the points alone; empty for the chain."""
        budget = self.budget
        return {} if budget is None else dict(zip(budget.names, budget.statistical.tolist(), strict=True))

    @property
    def tactor(self) -> Tactor:
        """The tactor as identified."""
        return Tactor(**self._values(Tactor))

    @property
    def membrane(self) -> Membrane:
        """The membrane as identified."""
        return Membrane(**self._values(Membrane))

    def _values(self, kind: type) -> dict[str, Any]:
        every = {**self.fixed, **{e.name: e.value for e in self.estimates}}
        return {q.name: every[q.name] for q in parameter_specs(kind)}


def identify(
    paths: Sequence[Path],
    method: Method = "joint",
    options: FitOptions | None = None,
    n: int | None = None,
    open_run: Callable[[Path], Run] = Run,
    track: Callable[[Sequence[Path]], Iterable[Path]] = iter,
    sheet: SheetChoice = None,
    plain: bool = False,
    cancelled: Callable[[], bool] | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> IdentificationResult:
    """Identify the specimen of these runs; `open_run` may correct them; `n` shapes, default: `shape_count_of_file`.

    A joint fit has the usual nonidealities, free within their usual sizes. Where it is not adequate the causes that its tests
    propose are added in turn. A `plain` fit is one of the beam model alone.

    Raises:
        SheetError: the specimen sheet is invalid.
        ObservationError: the runs do not belong together, or have no usable points.
        PaperChainError, IdentificationError, ParameterError: identification is not possible; the message gives the reason.
        FitCancelled: `cancelled` returned true.
    """
    paths = tuple(paths)
    specimen, campaign, left_out = read_observations(paths, open_run, track)
    options = replace(options or FitOptions(), n=n or max(map(shape_count_of_file, paths)))
    priors = (
        None if sheet == "none" else load_sheet(paths[0].parent, specimen) if sheet is None else read_sheet(Path(sheet))
    )
    result = identify_observations(
        specimen, campaign, method, options, progress, sheet=priors, plain=plain, cancelled=cancelled
    )
    return replace(result, notes=(*left_out, *result.notes))


def identify_observations(
    specimen: str,
    observations: ObservationSet,
    method: Method,
    options: FitOptions,
    progress: Callable[..., None] | None = None,
    sheet: SpecimenSheet | None = None,
    plain: bool = False,
    cancelled: Callable[[], bool] | None = None,
) -> IdentificationResult:
    """Identify from observations already read; a result of the same observations, options and sheet is kept.

    With a `sheet`, its dimensions and masses are free within their uncertainties, and so are the usual nonidealities
    unless the fit is `plain`; without one, the options decide.

    Of the options the chain uses start values, amplifier and number of shapes only.

    Raises:
        SheetError: the sheet is of a simulated specimen, and a run is not.
        PaperChainError, IdentificationError, ParameterError: identification is not possible; the message gives the reason.
        FitCancelled: `cancelled` returned true.
    """
    inputs = specimen, observations, method, options, sheet, plain
    return kept_result("identification", inputs, lambda: _identified(*inputs, progress, cancelled))


def _identified(
    specimen: str,
    observations: ObservationSet,
    method: Method,
    options: FitOptions,
    sheet: SpecimenSheet | None,
    plain: bool,
    progress: Callable[..., None] | None,
    cancelled: Callable[[], bool] | None,
) -> IdentificationResult:
    """Return the result of `identify_observations`, computed."""
    given = options
    if sheet is not None:
        if sheet.simulated and (real := [run for run in observations.runs if not run.simulated]):
            raise SheetError(
                f"{sheet.path} describes a simulated specimen, but {pluralize(len(real), 'run')} of {specimen} "
                "were measured on a real bench; enter the values of the real specimen there, and remove the line simulated = true"
            )
        options = sheet.fit_options(options, observations, plain or method == "chain")
        if not plain and method == "joint":
            observations = with_mountings(observations, sheet.mountings)
    if method == "chain":
        joint: JointFit | None = None
        with suppress(IdentificationError, ParameterError):
            fitted = identify_observations(specimen, observations, "joint", given, progress, sheet, cancelled=cancelled)
            joint = fitted.joint_fit
        return _chain_result(specimen, observations, options, sheet, joint)
    first_fit = joint_fit(observations, options, progress, cancelled)
    return _joint_result(specimen, first_fit, sheet, sheet is not None and not plain, cancelled)


def _joint_result(
    specimen: str,
    first_fit: JointFit,
    sheet: SpecimenSheet | None,
    extended: bool,
    cancelled: Callable[[], bool] | None,
) -> IdentificationResult:
    """Return the result of a joint fit, `extended` by the causes of a misfit and by the uncertainty of an unstated temperature."""
    adequacy = assess_adequacy(first_fit, cancelled=cancelled)
    steps = tuple(extend_stepwise(first_fit, adequacy, cancelled)) if extended else ()
    fits = (first_fit, *(step.fit for step in steps))
    adequacy = steps[-1].adequacy if steps else adequacy
    fit = with_model_error(fits[-1], adequacy, fits[:-1])
    fit = with_temperature_error(fit) if extended else fit
    estimates = fit.estimates()
    return IdentificationResult(
        specimen,
        "joint",
        first_fit.observations,
        estimates,
        fit.covariance_of(estimates),
        _fixed_parameters(_base_values(fit), estimates),
        fit.verdict,
        misfits=fit.residuals,
        unidentified=tuple(c.description for c in fit.unidentified_combinations),
        notes=() if fit.converged else (fit.message,),
        duration_s=fit.duration_s,
        joint_fit=fit,
        adequacy=adequacy,
        shapes=fit.options.n,
        budget=uncertainty_budget(fit),
        sheet=sheet,
        steps=steps,
        first_fit=first_fit,
    )


def _chain_result(
    specimen: str,
    observations: ObservationSet,
    options: FitOptions,
    sheet: SpecimenSheet | None,
    joint: JointFit | None,
) -> IdentificationResult:
    """Return the result of the paper's chain, from the runs that it has a step for."""
    observations, left_out = _paper_observations(observations)
    chosen = PaperChainOptions(
        tactor=options.tactor, membrane=options.membrane, amplifier=options.amplifier, n=options.n
    )
    chain = identify_by_paper_chain(observations, chosen)
    estimates, covariance = linearized_errors(observations, chosen, chain)
    return IdentificationResult(
        specimen,
        "chain",
        observations,
        estimates,
        covariance,
        _fixed_parameters(default_values(options.tactor, options.membrane, None), estimates),
        "the paper's chain: every step takes the results of those before it; errors are carried through all steps",
        validation=chain.validation,
        notes=(*left_out, *([] if sheet is None else [CHAIN_SHEET_NOTE]), *(step.summary for step in chain.steps)),
        shapes=options.n,
        sheet=sheet,
        joint_differences=() if joint is None else chain_differences(chain.values, observations, chosen, joint),
    )


def compare_with_chain(identification: IdentificationResult) -> tuple[ChainDifference, ...]:
    """Return the differences between the paper's chain and a joint fit, with reasons; empty if the chain is not possible."""
    fit = identification.joint_fit
    if fit is None:
        return ()
    try:
        return _chain_result(
            identification.specimen, identification.observations, fit.options, identification.sheet, fit
        ).joint_differences
    except (PaperChainError, ParameterError):
        return ()


def _paper_observations(observations: ObservationSet) -> tuple[ObservationSet, list[str]]:
    """Return the runs that the paper's chain has a step for, and a message for each other one."""
    others = [
        run
        for run in observations.runs
        if isinstance(run, DecayPoleObservation) or (isinstance(run, FrequencyResponseObservation) and run.swept)
    ]
    kept = tuple(run for run in observations.runs if run not in others)
    if not kept:
        raise ParameterError(
            "the paper's chain has no step for a sweep or a free decay, and there is no other run: use the joint fit"
        )
    return ObservationSet(kept), [f"{run.label} is left out: the paper's chain has no step for it" for run in others]


def _base_values(fit: JointFit) -> dict[str, float | None]:
    """Return the values of the parameters without a fit; where the mass put in is given, m_add is its moving share."""
    base = fit.options.base_values()
    return base | {"m_add": fit.values["m_add"]} if fit.values["mass_put_in"] else base


def _fixed_parameters(
    base: Mapping[str, float | None], estimates: Sequence[EstimatedQuantity]
) -> dict[str, float | None]:
    identified = {e.name for e in estimates}
    return {name: value for name, value in base.items() if name not in identified}
