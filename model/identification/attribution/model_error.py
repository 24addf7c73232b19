"""Uncertainties that are no residuals: changes of parameters with each cause of a misfit, and with an unknown temperature."""

from dataclasses import replace

from model.identification.adequacy import Adequacy
from model.identification.fit_result import JointFit
from model.identification.usual_effects import assumed_temperature

NOT_ADEQUATE, NO_TEMPERATURE = "model not adequate", "temperature not stated (1 K)"
"""Sources of uncertainty."""


def with_model_error(fit: JointFit, adequacy: Adequacy, others: tuple[JointFit, ...] = ()) -> JointFit:
    """Return the fit with a covariance that covers the other fits of the same runs, if it is not adequate.

    Where the model is wrong in a way that is not known, the fits with each likely cause are the models that may be right. Their
    differences from the fit are added to its covariance: every total uncertainty is at least the largest of them.

    Args:
        fit: the fit.
        adequacy: its test with the causes that were compared.
        others: further fits, such as those before causes were added.
    """
    if adequacy.adequate is not False:
        return fit
    explained = () if adequacy.diagnosis is None else tuple(e.fit for e in adequacy.diagnosis.explanations)
    shifts = tuple((NOT_ADEQUATE, tuple(_shift(fit, other))) for other in (*explained, *others))
    return replace(fit, further_shifts=(*fit.further_shifts, *shifts))


def with_temperature_error(fit: JointFit) -> JointFit:
    """Return the fit with a covariance that has the change of its parameters by a temperature that runs do not state."""
    values = dict(zip(fit.names, fit.theta.tolist(), strict=True))
    shifts = [
        (NO_TEMPERATURE, tuple(share * values[n] if n == name else 0.0 for n in fit.names))
        for name, share in assumed_temperature(fit.observations).items()
        if name in fit.free_parameters and name not in fit.options.priors
    ]
    return replace(fit, further_shifts=(*fit.further_shifts, *shifts))


def _shift(fit: JointFit, other: JointFit) -> list[float]:
    """Return the change of each parameter of the fit, 0 for one that the other fit does not have."""
    found = dict(zip(other.names, other.theta.tolist(), strict=True))
    return [found.get(name, value) - value for name, value in zip(fit.names, fit.theta.tolist(), strict=True)]
