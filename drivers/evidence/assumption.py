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


@dataclass(frozen=True, slots=True)
class Assumption:
    """One property of an instrument that a driver relies on.

    Args:
        driver: name of the driver in a bench file.
        models: affected models.
        quantity: property of the instrument.
        value: assumed value.
        evidence: guide and page, public driver with commit, or a measurement; empty if it is unproven.
        checks: measurements of it at the output; empty if the output does not show it.
        pattern: regular expression for the models, if `models` is a description.
    """

    driver: str
    models: str
    quantity: str
    value: str
    evidence: str = ""
    checks: tuple[OutputCheck, ...] = ()
    pattern: str = ""

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
