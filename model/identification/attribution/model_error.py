"""Model error of a fit that is not adequate: how far the parameters move with each of the causes that may explain the misfit."""

from dataclasses import replace

from model.identification.adequacy import Adequacy
from model.identification.fit_result import JointFit


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
    shifts = [_shift(fit, other) for other in (*explained, *others)]
    return replace(fit, model_shifts=tuple(map(tuple, shifts))) if shifts else fit


def _shift(fit: JointFit, other: JointFit) -> list[float]:
    """Return the change of each parameter of the fit, 0 for one that the other fit does not have."""
    values = dict(zip(other.names, other.theta.tolist(), strict=True))
    return [values.get(name, value) - value for name, value in zip(fit.names, fit.theta.tolist(), strict=True)]
