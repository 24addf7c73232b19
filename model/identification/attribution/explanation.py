"""Explanation of a misfit: the fit with one cause, and the ranking of all."""

from dataclasses import dataclass

from scipy.special import chdtrc

from model.identification.attribution.causes import Cause
from model.identification.fit_result import JointFit

TOLD_APART = 3.0
"""Difference of logarithms of odds, 20 to 1, up to which two causes are named together."""
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
    sizes: tuple[tuple[float, float], ...]
    """Of its parameters, each with its standard error; none for a point or an exchange."""
    chi_square: float
    degrees_of_freedom: int
    log_odds: float
    """Logarithm of the odds of this cause against chance."""
    shifts: tuple[ParameterShift, ...]
    """Parameters of the fit that it moves, the most moved first."""
    fit: JointFit
    cause_words: str = ""
    """What it means, with its size."""
    words: str = ""
    """The explanation with the changes of the fit."""
    check: str = ""
    """What would show whether it is the cause."""

    @property
    def size(self) -> float:
        """Of its first parameter; NaN without any."""
        return self.sizes[0][0] if self.sizes else float("nan")

    @property
    def standard_error(self) -> float:
        """Of the size."""
        return self.sizes[0][1] if self.sizes else float("nan")

    @property
    def p_value(self) -> float:
        """Of a chi-square at least as large with this cause."""
        return float(chdtrc(self.degrees_of_freedom, self.chi_square)) if self.degrees_of_freedom > 0 else 1.0


@dataclass(frozen=True)
class Diagnosis:
    """Explanations of a misfit, the likeliest first; none where no cause is more likely than chance."""

    explanations: tuple[Explanation, ...]
    tried: int
    """Causes that were compared."""

    @property
    def likeliest(self) -> tuple[Explanation, ...]:
        """The first explanation and those that the runs do not tell from it, three at most."""
        if not self.explanations:
            return ()
        least = self.explanations[0].log_odds - TOLD_APART
        return tuple(e for e in self.explanations[:MAX_TOGETHER] if e.log_odds >= least)
