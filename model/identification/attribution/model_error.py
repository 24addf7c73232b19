"""Uncertainties outside the residuals: shifts of the parameters by each possible cause of a misfit, and by an unknown temperature."""

from dataclasses import replace

from model.identification.adequacy import Adequacy
from model.identification.fit_result import JointFit
from model.identification.priors import assumed_temperature

NOT_ADEQUATE, NO_TEMPERATURE = "model not adequate", "temperature not stated (1 K)"
"""Sources of uncertainty."""


def with_model_error(fit: JointFit, adequacy: Adequacy, others: tuple[JointFit, ...] = ()) -> JointFit:
    """Return the fit with a covariance that covers the other fits of the same runs, if it is not adequate.

    If the model is wrong in an unknown way, the fits with each likely cause are possible models. Their differences from the fit
    are added to its covariance: every total uncertainty is at least the largest of them.

    Args:
        fit: the fit.
        adequacy: test of the fit with the compared causes.
        others: further fits, such as earlier ones without added causes.
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
    """Return the change of each parameter of the fit, 0 for a parameter that the other fit lacks."""
    values = dict(zip(other.names, other.theta.tolist(), strict=True))
    return [values.get(name, value) - value for name, value in zip(fit.names, fit.theta.tolist(), strict=True)]
