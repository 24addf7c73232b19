"""Campaign of the paper: the measurements of one specimen in their order, with needs and setup prompts."""

from typing import NamedTuple

from protocols.base import MOUNTED, UNCHANGED, Prompt

TURN_MFC_UP = Prompt("turn-side", "Take all weights off and turn the specimen MFC up.", {"side": 1.0}, hands_on=True)
REMOVE_MEMBRANE = Prompt("remove-membrane", "Take the membrane off: the tactor vibrates freely.", hands_on=True)
FIX_PAPER_MASS = Prompt(
    "fix-mass",
    "Fix a mass in the cylinder so that 7.73 g moves with the centre; in the paper this was a mass of 11 g.",
    {"mass_kg": 7.73e-3, "moving": 1.0, MOUNTED: 1.0},
    ("done", UNCHANGED),
    hands_on=True,
)


class PaperItem(NamedTuple):
    """One measurement: its name, the protocol, the names of its prerequisites, and prompts that the protocol does not show."""

    name: str
    protocol: str
    needs: tuple[str, ...] = ()
    prepare: tuple[Prompt, ...] = ()


PAPER_CAMPAIGN = (
    PaperItem("wiring", "wiring-check"),
    PaperItem("loading", "static-loading", ("wiring",), (REMOVE_MEMBRANE,)),
    PaperItem("resonance", "mass-resonance", ("wiring",), (REMOVE_MEMBRANE, TURN_MFC_UP)),
    PaperItem("steps", "voltage-steps", ("loading", "resonance"), (REMOVE_MEMBRANE, TURN_MFC_UP)),
    PaperItem("dwell", "sine-dwell", ("steps",), (REMOVE_MEMBRANE, TURN_MFC_UP, FIX_PAPER_MASS)),
    PaperItem("sag", "membrane-sag", ("wiring",)),
    PaperItem("membrane", "membrane-series", ("dwell", "sag"), (TURN_MFC_UP, FIX_PAPER_MASS)),
)
"""k2 (loading, resonance) before mu (steps) before c0 (dwell) before c_s (membrane, with E_m of sag)."""
