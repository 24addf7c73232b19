"""What an armed box must answer when it is asked for one of its settings.

Each dialect lists the whole state that it is left in as a table of these. The end of its preparation and `at_rest` read
the same table, so that whatever a hand at the front panel or another program changed between two runs is noticed.
"""

import math
from dataclasses import dataclass

from drivers.deprecated import renamed


@renamed(words="keywords", holds="matches", wanted="expected")
@dataclass(frozen=True, slots=True)
class ExpectedSetting:
    """One of these words, or a number from `low` to `high`.

    Args:
        name: how the dialect asks for it, e.g. `BURS:PHAS`.
        keywords: in capitals; empty where it is a number.
    """

    name: str
    keywords: tuple[str, ...] = ()
    low: float = -math.inf
    high: float = math.inf

    def matches(self, answer: str) -> bool:
        """Whether this answer is the right one; what is no number where one is wanted is not."""
        if self.keywords:
            return answer.strip().upper() in self.keywords
        try:
            return self.low <= float(answer) <= self.high
        except ValueError:
            return False

    @property
    def expected(self) -> str:
        """The right answer in words."""
        if self.keywords:
            return self.keywords[0]
        if math.isinf(self.low) or math.isinf(self.high):
            return f"at most {self.high:g}" if math.isinf(self.low) else f"at least {self.low:g}"
        middle, around = (self.low + self.high) / 2, (self.high - self.low) / 2
        return f"{middle:g}" if around <= 0.01 else f"{self.low:g} to {self.high:g}"


def expect_keyword(name: str, *keywords: str) -> ExpectedSetting:
    """A setting that is one of these words."""
    return ExpectedSetting(name, keywords)


def expect_value(name: str, value: float, tolerance: float) -> ExpectedSetting:
    """A setting that is this number."""
    return ExpectedSetting(name, low=value - tolerance, high=value + tolerance)


def expect_range(name: str, low: float, high: float) -> ExpectedSetting:
    """A setting that is a number between these two."""
    return ExpectedSetting(name, low=low, high=high)
