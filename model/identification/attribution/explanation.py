"""Explanation of a misfit: the fit with one cause, and the ranking of all."""

from dataclasses import dataclass

from scipy.special import chdtrc

from model.identification.attribution.causes import Cause
from model.identification.fit_result import JointFit

SAME_CHI_SQUARE = 6.0
"""Causes whose chi-squares differ by less are reported as indistinguishable: odds of 20 to 1."""

IMPLAUSIBLE = 25.0
"""Penalty, five standard deviations, above which a cause is not named beside another."""
MAX_TOGETHER = 3
"""Largest number of causes named together."""


@dataclass(frozen=True)
class ParameterShift:
    """One parameter of the fit, without and with the cause."""

    name: str
    before: float
    after: float
    standard_error: float
    """Standard error with the cause."""


@dataclass(frozen=True)
class Explanation:
    """The fit with one cause."""

    cause: Cause
    size: float
    """Size of its parameter; NaN for a point."""
    standard_error: float
    chi_square: float
    """Chi-square without the penalty."""
    penalty: float
    """Square of the size over its plausible standard deviation; 0 if any size is plausible."""
    degrees_of_freedom: int
    log_probability: float
    """Logarithm of the probability of the improvement by chance, all causes of its kind counted."""
    shifts: tuple[ParameterShift, ...]
    """Changes of the fit's parameters, the largest first."""
    fit: JointFit
    cause_text: str = ""
    """Meaning of the cause, with its size."""
    text: str = ""
    """The explanation with the changes of the fit."""

    @property
    def p_value(self) -> float:
        """Probability of a chi-square at least as large with this cause."""
        return float(chdtrc(self.degrees_of_freedom, self.chi_square)) if self.degrees_of_freedom > 0 else 1.0


@dataclass(frozen=True)
class Diagnosis:
    """Explanations of a misfit, the likeliest first; empty if no cause is significant."""

    explanations: tuple[Explanation, ...]
    tried: int
    """Number of compared causes."""

    @property
    def likeliest(self) -> tuple[Explanation, ...]:
        """The first explanation and the ones that the runs do not distinguish from it, three at most."""
        if not self.explanations:
            return ()
        first, *others = self.explanations
        limit = first.chi_square + SAME_CHI_SQUARE
        same = [e for e in others if e.chi_square < limit and e.penalty < IMPLAUSIBLE]
        return (first, *same[: MAX_TOGETHER - 1])
