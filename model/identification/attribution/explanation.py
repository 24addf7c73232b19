"""Explanation of a misfit: the fit with one cause, and the ranking of all."""

from dataclasses import dataclass

from scipy.special import chdtrc

from model.identification.attribution.causes import Cause
from model.identification.fit_result import JointFit

INDISTINGUISHABLE = 3.0
"""Causes whose logarithms of odds differ by less are reported as indistinguishable: odds of 20 to 1."""
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
    sizes: tuple[tuple[float, float], ...]
    """Size and standard error of each of its parameters; empty for a point or an exchange."""
    chi_square: float
    degrees_of_freedom: int
    log_odds: float
    """Logarithm of the odds of this cause against chance."""
    shifts: tuple[ParameterShift, ...]
    """Changes of the fit's parameters, the largest first."""
    fit: JointFit
    excess_penalty: float = 0.0
    """Part of the fit's chi-square that the prior of its size adds beyond `LARGE_SCALE`; it is not counted."""
    cause_text: str = ""
    """Meaning of the cause, with its size."""
    text: str = ""
    """The explanation with the changes of the fit."""
    check: str = ""
    """Measurement that decides whether it is the cause."""

    @property
    def size(self) -> float:
        """Size of its first parameter; NaN without any."""
        return self.sizes[0][0] if self.sizes else float("nan")

    @property
    def standard_error(self) -> float:
        """Standard error of the size."""
        return self.sizes[0][1] if self.sizes else float("nan")

    @property
    def p_value(self) -> float:
        """Probability of a chi-square at least as large with this cause."""
        return float(chdtrc(self.degrees_of_freedom, self.chi_square)) if self.degrees_of_freedom > 0 else 1.0


@dataclass(frozen=True)
class Diagnosis:
    """Explanations of a misfit, the likeliest first; empty if no cause is more likely than chance."""

    explanations: tuple[Explanation, ...]
    tried: int
    """Number of compared causes."""

    @property
    def likeliest(self) -> tuple[Explanation, ...]:
        """The first explanation and the ones that the runs do not distinguish from it, three at most."""
        if not self.explanations:
            return ()
        least = self.explanations[0].log_odds - INDISTINGUISHABLE
        return tuple(e for e in self.explanations[:MAX_TOGETHER] if e.log_odds >= least)
