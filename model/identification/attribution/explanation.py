"""Explanation of a misfit: the fit with one cause, and the ranking of all."""

from dataclasses import dataclass

from scipy.special import chdtrc

from model.identification.attribution.causes import Cause
from model.identification.fit_result import JointFit

SAME_CHI_SQUARE = 6.0
"""Causes whose chi-squares differ by less are reported as indistinguishable: odds of 20 to 1."""

IMPLAUSIBLE = 25.0
"""Penalty, five standard deviations, beyond which a cause is not named beside another."""
MAX_TOGETHER = 3
"""Causes that are named together."""


@dataclass(frozen=True)
class ParameterShift:
    """One parameter of the fit, without and with the cause."""

    name: str
    before: float
    after: float
    standard_error: float
    """With the cause."""


@dataclass(frozen=True)
class Explanation:
    """The fit with one cause."""

    cause: Cause
    size: float
    """Of its parameter; NaN for a point."""
    standard_error: float
    chi_square: float
    """Without the penalty."""
    penalty: float
    """Square of the size over what is plausible; 0 where any size is."""
    degrees_of_freedom: int
    log_probability: float
    """Logarithm of the probability of the improvement by chance, all causes of its kind counted."""
    shifts: tuple[ParameterShift, ...]
    """Parameters of the fit that it moves, the most moved first."""
    fit: JointFit
    cause_text: str = ""
    """Meaning of the cause, with its size."""
    text: str = ""
    """The explanation with the changes of the fit."""

    @property
    def p_value(self) -> float:
        """Of a chi-square at least as large with this cause."""
        return float(chdtrc(self.degrees_of_freedom, self.chi_square)) if self.degrees_of_freedom > 0 else 1.0


@dataclass(frozen=True)
class Diagnosis:
    """Explanations of a misfit, the likeliest first; none where no cause is significant."""

    explanations: tuple[Explanation, ...]
    tried: int
    """Causes that were compared."""

    @property
    def likeliest(self) -> tuple[Explanation, ...]:
        """The first explanation and those that the runs do not tell from it, three at most."""
        if not self.explanations:
            return ()
        first, *others = self.explanations
        limit = first.chi_square + SAME_CHI_SQUARE
        same = [e for e in others if e.chi_square < limit and e.penalty < IMPLAUSIBLE]
        return (first, *same[: MAX_TOGETHER - 1])
