"""Identification of one specimen from its run files, by the paper's chain or by the joint fit, as one kind of result."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from app.identification.observations import read_observations, shape_count_of_file
from model.estimate import EstimatedQuantity
from model.identification.adequacy import Adequacy, assess_adequacy
from model.identification.fit_options import FitOptions
from model.identification.fit_result import JointFit
from model.identification.joint_fit import joint_fit
from model.identification.observations import ObservationSet
from model.identification.paper_chain import CurveValidation, PaperChainOptions, identify_by_paper_chain
from model.identification.paper_chain_errors import linearized_errors
from model.identification.parameters import default_values
from model.parameter_spec import parameter_specs
from model.parameters import Membrane, Tactor
from protocols.runfile.reader import Run

Method = Literal["chain", "joint"]


@dataclass(frozen=True, slots=True)
class RunMisfit:
    """How well one run is explained."""

    label: str
    points: int
    chi_square: float
    probability: float
    outliers: int


@dataclass(frozen=True, slots=True)
class IdentificationResult:
    """What an identification found, whichever method found it."""

    specimen: str
    method: Method
    observations: ObservationSet
    estimates: tuple[EstimatedQuantity, ...]
    covariance: NDArray[np.float64]
    fixed: Mapping[str, float | None]
    """Every parameter of the model that was not identified, with the value it was given."""
    verdict: str
    misfits: tuple[RunMisfit, ...] = ()
    validation: tuple[CurveValidation, ...] = ()
    unidentified: tuple[str, ...] = ()
    """Combinations that these runs do not tell, in words."""
    notes: tuple[str, ...] = ()
    duration_s: float = 0.0
    joint_fit: JointFit | None = field(default=None, repr=False)
    adequacy: Adequacy | None = None
    """Of a joint fit: is the misfit noise, or is the model wrong."""
    shapes: int = FitOptions.n
    """Shape functions it was made with; what is drawn of it should have as many."""

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
) -> IdentificationResult:
    """Identify the specimen of these runs; `opened` may correct them; `n` shapes, by default as `observing.shape_count_of_file` says.

    Raises:
        ObservingError: the runs do not go together, or tell nothing.
        ChainError, IdentificationError, ParameterError: a sentence why it cannot be identified so.
    """
    paths = tuple(paths)
    specimen, campaign, left_out = read_observations(track(paths), open_run)
    options = replace(options or FitOptions(), n=n or max(map(shape_count_of_file, paths)))
    return identify_observations(specimen, campaign, method, options, left_out)


def identify_observations(
    specimen: str,
    observations: ObservationSet,
    method: Method,
    options: FitOptions,
    exclusions: Sequence[str] = (),
    progress: Callable[..., None] | None = None,
) -> IdentificationResult:
    """As `identify`, from observations that were read already; `left_out` are sentences that go into the notes.

    Of the setting the chain takes what it begins from, the amplifier and the number of shapes: its steps are its own.

    Raises:
        ChainError, IdentificationError, ParameterError: a sentence why it cannot be identified so.
    """
    if method == "chain":
        chosen = PaperChainOptions(
            tactor=options.tactor, membrane=options.membrane, amplifier=options.amplifier, n=options.n
        )
        found = identify_by_paper_chain(observations, chosen)
        estimates, covariance = linearized_errors(observations, chosen, found)
        return IdentificationResult(
            specimen,
            method,
            observations,
            estimates,
            covariance,
            _fixed_parameters(default_values(options.tactor, options.membrane, None), estimates),
            "the paper's chain: every step takes the results of those before it; errors are carried through all steps",
            validation=found.validation,
            notes=(*exclusions, *(step.summary for step in found.steps)),
            shapes=options.n,
        )
    fit = joint_fit(observations, options, progress)
    estimates = fit.estimates()
    return IdentificationResult(
        specimen,
        method,
        observations,
        estimates,
        fit.covariance_of(estimates),
        _fixed_parameters(options.base_values(), estimates),
        fit.verdict,
        misfits=tuple(
            RunMisfit(r.label, len(r.values), r.chi_square, r.p_value, len(r.outliers)) for r in fit.residuals
        ),
        unidentified=tuple(c.description for c in fit.unidentified_combinations),
        notes=(*exclusions, *([] if fit.converged else [fit.message])),
        duration_s=fit.duration_s,
        joint_fit=fit,
        adequacy=assess_adequacy(fit),
        shapes=options.n,
    )


def _fixed_parameters(
    base: Mapping[str, float | None], estimates: Sequence[EstimatedQuantity]
) -> dict[str, float | None]:
    found = {e.name for e in estimates}
    return {name: value for name, value in base.items() if name not in found}
