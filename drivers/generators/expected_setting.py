"""What an armed box must answer when it is asked for one of its settings.

Each dialect lists the whole state that it is left in as a table of these. The end of its preparation and `at_rest` read
the same table, so that whatever a hand at the front panel or another program changed between two runs is noticed.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Setting:
    """One of these words, or a number from `low` to `high`.

    Args:
        name: how the dialect asks for it, e.g. `BURS:PHAS`.
        words: in capitals; empty where it is a number.
    """

    name: str
    words: tuple[str, ...] = ()
    low: float = -math.inf
    high: float = math.inf

    def holds(self, answer: str) -> bool:
        """Whether this answer is the right one; what is no number where one is wanted is not."""
        if self.words:
            return answer.strip().upper() in self.words
        try:
            return self.low <= float(answer) <= self.high
        except ValueError:
            return False

    @property
    def wanted(self) -> str:
        """The right answer in words."""
        if self.words:
            return self.words[0]
        if math.isinf(self.low) or math.isinf(self.high):
            return f"at most {self.high:g}" if math.isinf(self.low) else f"at least {self.low:g}"
        middle, around = (self.low + self.high) / 2, (self.high - self.low) / 2
        return f"{middle:g}" if around <= 0.01 else f"{self.low:g} to {self.high:g}"


def word(name: str, *words: str) -> Setting:
    """A setting that is one of these words."""
    return Setting(name, words)


def near(name: str, value: float, tolerance: float) -> Setting:
    """A setting that is this number."""
    return Setting(name, low=value - tolerance, high=value + tolerance)


def between(name: str, low: float, high: float) -> Setting:
    """A setting that is a number between these two."""
    return Setting(name, low=low, high=high)
