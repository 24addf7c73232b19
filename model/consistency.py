"""Factor on standard errors that the scatter contradicts: one rule for means, lines and fits."""

from math import sqrt

MISFIT_LEVEL = 0.01
"""Probability of a chi-square below which errors are enlarged: of correct errors through three points the rms is 1.04 times too large."""


def misfit_factor(chi_square: float, freedom: float, tests: int = 1) -> float:
    """Return the Birge ratio, the root of chi-square over its degrees of freedom, if it is significant, else 1.

    A ratio above 1 by chance is no reason: the rms error of a line through three points would be stated 1.22 times too large. As a test
    the ratio is used by R. N. Kacker et al., Metrologia 45 (2008) 257.

    Args:
        chi_square: sum of the squared residuals over their stated errors.
        freedom: its degrees of freedom; of 0 there is no scatter.
        tests: number of chi-squares that are tested together.
    """
    from scipy.special import chdtrc

    if freedom <= 0 or chdtrc(freedom, chi_square) * tests >= MISFIT_LEVEL:
        return 1.0
    return max(1.0, sqrt(chi_square / freedom))
