"""What the person who puts the weights on is asked, and how the laser tells that it was done."""

from typing import Any

from protocols.compliance import SIDES
from protocols.signals.landing import LandingDetector
from protocols.steps import Prompt
from protocols.values import Recording
from protocols.weights import grams

DONE, PREVIOUS, REPEAT, KEEP = "done", "previous again", "repeat", "keep"

ATTEMPTS = 3
"""So often a weight that does not fit is asked for again before it is taken for what the specimen does."""


class Landed:
    """Watches the laser for a weight that lands or leaves (protocols.steps.Detector); knows the level it starts from."""

    def __init__(self, before: Recording, least_m: float, last_s: float) -> None:
        self._detector = LandingDetector(before.rate_hz, least_m)
        self._detector.feed(before.displacement_m[-round(last_s * before.rate_hz) :])

    def feed(self, drive_v: Any, displacement_m: Any) -> bool:
        """Whether what came now, (n,) each, shows it."""
        return self._detector.feed(displacement_m) is not None


def turn_side(side: float, offset_kg: float) -> Prompt:
    """Lay the tactor on its other side, electrodes shorted."""
    offset = f" and put the {grams(offset_kg)} offset weight on its centre" if offset_kg else ""
    return Prompt(
        "turn-side",
        f"High voltage is off. Short the electrodes, lay the tactor with the {SIDES[side].replace(' up', ' side')} up{offset}.",
        {"side": side, "offset_kg": offset_kg, "shorted": 1.0},
        hands_on=True,
    )


def place(side: float, mass_kg: float, can_go_back: bool) -> Prompt:
    """Put a weight on; or say that the one before was wrong."""
    return Prompt(
        "place-weight",
        f"Place the {grams(mass_kg)} weight on the centre; the laser sees it land.",
        {"mass_kg": mass_kg, "side": side},
        (DONE, PREVIOUS) if can_go_back else (DONE,),
        hands_on=True,
    )


def lift(side: float, mass_kg: float) -> Prompt:
    """Take a weight off; or say that it was wrong."""
    words = f"Take the {grams(mass_kg)} weight off."
    return Prompt("remove-weight", words, {"mass_kg": mass_kg, "side": side}, (DONE, REPEAT), hands_on=True)


def doubt(action: str, words: str, attempt: int) -> Prompt:
    """Again, at first; what comes out the same so often is what the specimen does."""
    if attempt < ATTEMPTS:
        return Prompt(action, f"{words} Repeat it, or keep it as it is?", choices=(REPEAT, KEEP))
    return Prompt(action, f"{words} That was attempt {attempt}. Keep it, or repeat it?", choices=(KEEP, REPEAT))
