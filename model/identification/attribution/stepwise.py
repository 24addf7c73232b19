"""Stepwise extension of a fit by the nonidealities that the adequacy tests propose, until the model is adequate."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from model import ParameterError
from model.identification.adequacy import Adequacy, assess_adequacy
from model.identification.attribution.explanation import Explanation
from model.identification.fit_options import IdentificationError
from model.identification.fit_result import JointFit
from model.identification.joint_least_squares import joint_fit

MAX_STEPS = 8
"""Largest number of added nonidealities."""


@dataclass(frozen=True)
class ExtensionStep:
    """A fit with one proposed parameter more than the fit before it."""

    explanation: Explanation
    """The accepted proposal."""
    fit: JointFit
    adequacy: Adequacy
    """Adequacy of the extended fit."""

    @property
    def name(self) -> str:
        """The added parameter."""
        return self.explanation.cause.name


def proposed_parameter(adequacy: Adequacy) -> Explanation | None:
    """Return the likeliest cause that a step may add; None if the likeliest causes need a decision of the operator."""
    if adequacy.adequate is not False or adequacy.diagnosis is None:
        return None
    likeliest = adequacy.diagnosis.likeliest
    return likeliest[0] if likeliest and all(e.cause.proposable for e in likeliest) else None


def extend_stepwise(
    fit: JointFit, adequacy: Adequacy, cancelled: Callable[[], bool] | None = None
) -> Iterator[ExtensionStep]:
    """Yield fits with one proposed parameter more each, until one is adequate or no parameter is proposed.

    Raises:
        FitCancelled: `cancelled` returned true.
    """
    for _ in range(MAX_STEPS):
        proposal = proposed_parameter(adequacy)
        if proposal is None:
            return
        found = proposal.fit
        start = dict(zip(found.names, found.theta.tolist(), strict=True))
        try:
            fit = joint_fit(fit.observations, replace(found.options, start=start), cancelled=cancelled, max_starts=1)
        except (ParameterError, IdentificationError):
            return
        adequacy = assess_adequacy(fit, cancelled=cancelled)
        yield ExtensionStep(proposal, fit, adequacy)
