"""Identification of one specimen from its run files, by the paper's chain or by the joint fit, as one kind of result."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from app.identification.observations import campaign_of, shapes_of
from model.identification.adequacy import Adequacy, adequacy
from model.identification.calibration import Estimate
from model.identification.fit_options import Setting
from model.identification.fit_result import JointFit
from model.identification.joint_fit import joint_fit
from model.identification.observations import Campaign
from model.identification.paper_chain import ChainMethod, Validation, chain
from model.identification.paper_chain_errors import chain_errors
from model.identification.parameters import defaults
from model.parameter_spec import quantities
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
class Identified:
    """What an identification found, whichever method found it."""

    specimen: str
    method: Method
    campaign: Campaign
    estimates: tuple[Estimate, ...]
    covariance: NDArray[np.float64]
    fixed: Mapping[str, float | None]
    """Every parameter of the model that was not identified, with the value it was given."""
    verdict: str
    misfits: tuple[RunMisfit, ...] = ()
    validation: tuple[Validation, ...] = ()
    unidentified: tuple[str, ...] = ()
    """Combinations that these runs do not tell, in words."""
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    fit: JointFit | None = field(default=None, repr=False)
    adequacy: Adequacy | None = None
    """Of a joint fit: is the misfit noise, or is the model wrong."""
    shapes: int = Setting.n
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
        return {q.name: every[q.name] for q in quantities(kind)}


def identify(
    paths: Sequence[Path],
    method: Method = "joint",
    setting: Setting | None = None,
    n: int | None = None,
    opened: Callable[[Path], Run] = Run,
    told: Callable[[Sequence[Path]], Iterable[Path]] = iter,
) -> Identified:
    """Identify the specimen of these runs; `opened` may correct them; `n` shapes, by default as `observing.shapes_of` says.

    Raises:
        ObservingError: the runs do not go together, or tell nothing.
        ChainError, IdentificationError, ParameterError: a sentence why it cannot be identified so.
    """
    paths = tuple(paths)
    specimen, campaign, left_out = campaign_of(told(paths), opened)
    setting = replace(setting or Setting(), n=n or max(map(shapes_of, paths)))
    return identify_campaign(specimen, campaign, method, setting, left_out)


def identify_campaign(
    specimen: str,
    campaign: Campaign,
    method: Method,
    setting: Setting,
    left_out: Sequence[str] = (),
    progress: Callable[..., None] | None = None,
) -> Identified:
    """As `identify`, from observations that were read already; `left_out` are sentences that go into the notes.

    Of the setting the chain takes what it begins from, the amplifier and the number of shapes: its steps are its own.

    Raises:
        ChainError, IdentificationError, ParameterError: a sentence why it cannot be identified so.
    """
    if method == "chain":
        chosen = ChainMethod(tactor=setting.tactor, membrane=setting.membrane, amplifier=setting.amplifier, n=setting.n)
        found = chain(campaign, chosen)
        estimates, covariance = chain_errors(campaign, chosen, found)
        words = (
            "the paper's chain: every step takes the results of those before it; errors are carried through all steps"
        )
        return _result(
            specimen, method, campaign, estimates, covariance, defaults(setting.tactor, setting.membrane, None), words,
            shapes=setting.n, validation=found.validation, notes=(*left_out, *(step.words for step in found.steps)),
        )  # fmt: skip
    fit = joint_fit(campaign, setting, progress)
    estimates = fit.estimates()
    misfits = tuple(
        RunMisfit(r.label, len(r.values), r.chi_square, r.probability, len(r.outliers)) for r in fit.residuals
    )
    return _result(
        specimen, method, campaign, estimates, fit.covariance_of(estimates), setting.base(), fit.verdict,
        misfits=misfits, unidentified=tuple(c.words for c in fit.unidentified), seconds=fit.seconds, fit=fit,
        adequacy=adequacy(fit), shapes=setting.n,
        notes=(*left_out, *([] if fit.converged else [fit.message])),
    )  # fmt: skip


def _result(
    specimen: str,
    method: Method,
    campaign: Campaign,
    estimates: tuple[Estimate, ...],
    covariance: NDArray[np.float64],
    base: Mapping[str, float | None],
    verdict: str,
    **more: Any,
) -> Identified:
    found = {e.name for e in estimates}
    fixed = {name: value for name, value in base.items() if name not in found}
    return Identified(specimen, method, campaign, estimates, covariance, fixed, verdict, **more)
