"""One assumption of a driver that safety or a result depends on, with its evidence and the checks that measure it at the output."""

import re
from dataclasses import dataclass
from enum import StrEnum


class OutputCheck(StrEnum):
    """Measurements of a commissioning at the output of a source. The texts are stored in records and never change."""

    REST = "level between bursts"
    AFTER = "level after a burst"
    OFFSET = "scale of the offset"
    POLARITY = "polarity"
    SCALE = "amplitude of a sine"
    UNEVEN = "amplitude of an uneven waveform"
    SHAPE = "form of a waveform"
    SETTINGS = "output while settings change"
    AMPLITUDE = "output at a change of amplitude"
    START = "start of a drive"
    STOP = "output at Stop"
    WIRE = "output after the wire is cut"
    CROSSTALK = "crosstalk of the card's inputs"
    SETTLING = "settling of the card's inputs"
    SKEW = "skew of the card's inputs"
    START_ROUTE = "start of a drive on a scan"
    LONG_LEVEL = "long level"
    INTERLOCK = "high voltage without the heartbeat"


class ArmingCheck(StrEnum):
    """Check of an assumption at every arming, before high voltage."""

    CARD = "card"
    """The card measures rest, and both bursts of the self-test, within its limits."""
    REPLY = "reply"
    """The instrument replies with the value, or rejects the command, and the source is refused."""


@dataclass(frozen=True, slots=True)
class Quote:
    """A line of a public document.

    Args:
        document: title and revision; for a public repository its commit.
        place: page, or path and line.
        text: the line, as it stands there.
    """

    document: str
    place: str
    text: str


@dataclass(frozen=True, slots=True)
class Assumption:
    """One property of an instrument that a driver relies on.

    Args:
        driver: name of the driver in a bench file.
        models: affected models.
        quantity: property of the instrument.
        value: assumed value.
        evidence: guide and page, public driver with commit, or a measurement, that is not quoted; a restriction of the quotes.
        checks: measurements of it at the output; empty if the output does not show it.
        pattern: regular expression for the models, if `models` is a description.
        quotes: lines that state it.
        claims: words that the quotes must contain; empty: the headers and numbers of `value`.
        at_arming: check at every arming; None if there is none.
    """

    driver: str
    models: str
    quantity: str
    value: str
    evidence: str = ""
    checks: tuple[OutputCheck, ...] = ()
    pattern: str = ""
    quotes: tuple[Quote, ...] = ()
    claims: tuple[str, ...] = ()
    at_arming: ArmingCheck | None = None

    @property
    def is_unproven(self) -> bool:
        """Whether neither a quoted line states it for all its models nor every arming checks it."""
        return self.at_arming is None and (not self.quotes or "unproven" in self.evidence)

    def is_about(self, model: str) -> bool:
        """Whether it applies to a model: `DG1000Z` includes DG1032Z."""
        if self.pattern:
            return re.match(self.pattern, model) is not None
        is_named = _is_supply if self.driver == "dc-supply" else _is_generator
        return any(is_named(model.upper(), name) for name in self.models.split(", "))


def _is_generator(model: str, name: str) -> bool:
    """Return whether a generator belongs to a series of the table: `DG1000Z` includes DG1032Z, `AFG3000` excludes AFG31052."""
    digits = name.rstrip("ABCXZ")
    begin = digits.rstrip("0")
    if begin == digits:
        return model.startswith(begin)
    return re.match(re.escape(begin) + r"\d" * (len(digits) - len(begin)) + r"(?!\d)", model) is not None


def _is_supply(model: str, name: str) -> bool:
    """Return whether a supply belongs to a series of the table: `E36300` includes E36312A, `E3640A-E3649A` all models between."""
    if name == "all":
        return True
    first, _, last = name.partition("-")
    if last:
        return len(model) == len(first) and first <= model <= last
    digits = first.rstrip("0")
    return re.match(re.escape(digits) + r"\d" * (len(first) - len(digits)), model) is not None
