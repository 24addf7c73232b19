"""Expected settings: replies of an armed instrument, as a table.

Each driver lists its whole configured state in such a table. `initialize_at_rest` and `is_at_rest` read the same table, so that
changes at the front panel or by another program between two runs are detected.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from drivers.errors import InstrumentError

LEVEL_TOLERANCE_V = 1e-3


@dataclass(frozen=True, slots=True)
class ExpectedSetting:
    """One of `keywords`, or a number from `low` to `high`.

    Args:
        name: its header in the driver's queries, e.g. `BURS:PHAS`.
        keywords: valid replies in capitals; empty for a number.
        low: smallest number.
        high: largest number.
        optional: whether models may lack this setting; a missing one counts as expected.
    """

    name: str
    keywords: tuple[str, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    optional: bool = False

    def matches(self, answer: str) -> bool:
        """Whether a reply is as expected; an invalid number does not match."""
        if self.keywords:
            return answer.strip().upper() in self.keywords
        try:
            return self.low <= float(answer) <= self.high
        except ValueError:
            return False

    @property
    def expected(self) -> str:
        """The expected reply, for messages."""
        if self.keywords:
            return self.keywords[0]
        if math.isinf(self.low) or math.isinf(self.high):
            return f"at most {self.high:g}" if math.isinf(self.low) else f"at least {self.low:g}"
        middle, around = (self.low + self.high) / 2, (self.high - self.low) / 2
        return f"{middle:g}" if around <= 0.01 else f"{self.low:g} to {self.high:g}"


def expect_keyword(name: str, *keywords: str, optional: bool = False) -> ExpectedSetting:
    """Expect one of these keywords."""
    return ExpectedSetting(name, keywords, optional=optional)


@dataclass(frozen=True, slots=True)
class NeutralSetting:
    """A persistent setting of other users that changes the output: polarity, gating, combining.

    Args:
        header: in commands and queries, e.g. `OUTP:POL`.
        value: value without effect on the output, as in a command.
        replies: replies for this value, in capitals.
        optional: whether models may lack it.
    """

    header: str
    value: str
    replies: tuple[str, ...]
    optional: bool = False

    @property
    def expected(self) -> ExpectedSetting:
        """The neutral value as an expected setting."""
        return expect_keyword(self.header, *self.replies, optional=self.optional)


def expect_value(name: str, value: float, tolerance: float) -> ExpectedSetting:
    """Expect this number."""
    return ExpectedSetting(name, low=value - tolerance, high=value + tolerance)


def expect_range(name: str, low: float, high: float) -> ExpectedSetting:
    """Expect a number in this range."""
    return ExpectedSetting(name, low=low, high=high)


def mismatches(
    settings: Iterable[ExpectedSetting], query: Callable[[str], str], query_optional: Callable[[str], str | None]
) -> Iterator[tuple[ExpectedSetting, str]]:
    """Query the settings in turn; yield each unexpected one with its reply."""
    for setting in settings:
        answer = query_optional(setting.name) if setting.optional else query(setting.name)
        if answer is not None and not setting.matches(answer):
            yield setting, answer


def check_readback(instrument: str, readback: float, setpoint: float, tolerance: float, quantity: str) -> None:
    """Raise InstrumentError if a setting reads back differently."""
    if not abs(readback - setpoint) <= tolerance:
        raise InstrumentError(
            f"{instrument}: {quantity} was set to {setpoint:.6g} and reads back {readback:.6g} (limit {tolerance:.2g}); "
            "nothing more was sent. See its actual setting on the instrument's front panel"
        )
