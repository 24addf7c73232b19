"""Coverage of confidence intervals by Student's t."""

from scipy.special import stdtrit


def coverage_factor(degrees_of_freedom: float, level: float = 0.95) -> float:
    """Return the number of standard errors on each side of a value that contains the truth with probability `level` (Student's t)."""
    return float(stdtrit(degrees_of_freedom, 0.5 + level / 2))
