"""Unsuitable generators: models advised against by name, because nothing guarantees the level at which they idle.

They are recognised by their identity before any other message. 0 V at the amplifier's input is -500 V on the specimen.
"""

import re
from dataclasses import dataclass

from drivers.interfaces import Identity


@dataclass(frozen=True, slots=True)
class UnsuitableGenerator:
    """A series that must not drive the amplifier.

    Args:
        name: maker and series.
        maker: regular expression for the maker in the reply to `*IDN?`; empty if its form varies.
        model: regular expression for the model.
        reason: behaviour of its output, as part of a sentence.
        evidence: guide, public driver with commit, or empty if the reason is a missing source.
    """

    name: str
    maker: str
    model: str
    reason: str
    evidence: str = ""

    def is_about(self, identity: Identity) -> bool:
        """Whether an instrument belongs to the series."""
        maker, model = identity.maker.strip(), identity.model.strip()
        return all(re.match(p, t, re.IGNORECASE) for p, t in ((self.maker, maker), (self.model, model)))


NOT_DOCUMENTED = "no guide and no public driver available to us states the level of its output between two bursts"

UNSUITABLE_GENERATORS = (
    UnsuitableGenerator(
        "Agilent/HP 33120A",
        "HEWLETT|AGILENT|KEYSIGHT",
        "33120A",
        "its output cannot be switched off, comes on with 0 V at power-up and after a reset, and takes no offset above twice its "
        "amplitude, so that it cannot rest at 2.5 V with a small one",
        "33120A User's Guide (offset limits, power-on state); PyMeasure at 32503b8 (hp33120A: no output command)",
    ),
    UnsuitableGenerator(
        "Siglent SDG800 (SDG805, SDG810, SDG830) and Teledyne T3AFG5, T3AFG10",
        "",
        r"SDG8[013][05](?!X)|T3AFG(5|10)$",
        "it has a USB port only, on which a Siglent loses uploaded waveforms without an error, so that its output waits on another "
        "waveform than the sent one",
        "benchctrl at 0c6e51e (uploads over USB); SDG programming guide (WVDT: numbered memories on SDG800)",
    ),
    UnsuitableGenerator(
        "Tektronix AFG3251, AFG3252, AFG31151, AFG31152, AFG31251 and AFG31252",
        "TEKTRONIX",
        r"AFG3(25|1[12]5)[12](?!\d)",
        "its open output ends at 5 V, so that with the amplitude of 0 to 5 V, which it cannot change without a relay, its level cannot "
        "be moved",
        "tm_devices at db887dd (offset and amplitude: AFG3K, model 25; AFG31K, models 15 and 25)",
    ),
    UnsuitableGenerator("GW Instek AFG-2000, AFG-3000 and MFG-2000", "GW", r"[AM]FG-?[23]\d", NOT_DOCUMENTED),
    UnsuitableGenerator("OWON XDG, DGE and AG", "OWON|LILLIPUT", r"XDG|DGE|AG", NOT_DOCUMENTED),
    UnsuitableGenerator("Hantek HDG", "HANTEK", r"HDG", NOT_DOCUMENTED),
    UnsuitableGenerator("Feeltech FY", "FEELTECH|FEELELEC", r"FY", NOT_DOCUMENTED),
    UnsuitableGenerator("JUNTEK JDS", "JUNTEK|JOY-?IT", r"JDS|PSG", NOT_DOCUMENTED),
)


def reason_unsuitable(identity: Identity) -> str:
    """Return the reason against an instrument, as a sentence with the remedy; empty for a suitable one."""
    for series in UNSUITABLE_GENERATORS:
        if series.is_about(identity):
            return (
                f"it is advised against ({series.name}): {series.reason}. 0 V is -500 V on the specimen: take it off the amplifier's "
                "input, and use a generator of docs/generators.md or the card's analogue output. Nothing was set"
            )
    return ""
