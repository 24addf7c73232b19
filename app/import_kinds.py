"""Which tables can be imported: the quantities of each protocol, by which names they go, in which unit, and how large they are.

Nothing is guessed that changes a number: an `amplitude` may be max - min or half of it, so it is asked for.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from protocols.layout import ENTRY, columns
from protocols.registry import PROTOCOLS

RAW = "raw"
"""A time series, reduced here to a point of a sine dwell."""


@dataclass(frozen=True, slots=True)
class Slot:
    """A quantity that a table may have.

    Attributes:
        also: other names for it, lower case, letters and digits only.
        usual: between which sizes it lies on such a bench; outside somebody is told.
    """

    name: str
    unit: str
    meaning: str
    also: tuple[str, ...] = ()
    usual: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Kind:
    """A protocol's table: what it may have, what it must (one of each group), what is unclear by its name alone."""

    name: str
    protocol: str
    slots: tuple[Slot, ...]
    needs: tuple[tuple[str, ...], ...]
    unclear: Mapping[str, tuple[str, ...]]
    value: tuple[str, ...]
    """What was measured; a column `error` without more words belongs to the first of these that is there."""

    def slot(self, name: str) -> Slot | None:
        """The slot of a name."""
        return next((slot for slot in self.slots if slot.name == name), None)


MOVED = (1e-9, 1e-2)
EXTRA: dict[str, tuple[Slot, ...]] = {
    "sine-dwell": (
        Slot("frequency", "Hz", "frequency of the drive", ("f", "freq", "frequenz", "fhz"), (1.0, 2000.0)),
        Slot("peak_to_peak", "m", "max - min of the displacement: the paper's amplitude", ("pp", "p2p", "pkpk", "pktopk", "maxmin", "peaktopeakamplitude", "peakpeak"), MOVED),
        Slot("fundamental", "m", "peak amplitude of the fundamental", ("peakamplitude", "fundamentalamplitude", "sineamplitude"), MOVED),
        Slot("phase", "rad", "phase of the fundamental against the drive", ("phi", "phaseangle"), (-7.0, 7.0)),
        Slot("drive_amplitude", "V", "peak amplitude of the drive at the amplifier's input", ("drivepeak",), (0.01, 2.5)),
        Slot("drive_peak_to_peak", "V", "drive at the amplifier's input, max - min", ("drivepp", "vpp", "drivemaxmin"), (0.02, 5.0)),
        Slot("elongation", "m", "elongation of the membrane; empty for the free tactor", ("stretch", "membraneelongation"), (0.0, 0.05)),
    ),
    "static-loading": (
        Slot("load", "N", "force on the centre", ("force", "f", "kraft", "weight"), (1e-3, 20.0)),
        Slot("mass", "kg", "mass of the weight on the centre", ("m", "weightmass", "load"), (1e-4, 2.0)),
        Slot("deflection", "m", "displacement under the load against none", ("displacement", "w", "durchbiegung"), MOVED),
        Slot("side", "1", "which side was pushed", ("seite",)),
        Slot("repeat", "1", "which repeat", ("run", "trial", "wiederholung")),
    ),
    "voltage-steps": (
        Slot("level", "V", "volts at the amplifier's input", ("voltage", "input", "inputvoltage", "v", "u", "spannung"), (0.0, 5.0)),
        Slot("specimen_voltage", "V", "volts on the specimen, behind the amplifier", ("highvoltage", "hv", "outputvoltage"), (-500.0, 1500.0)),
        Slot("deflection", "m", "displacement against rest", ("displacement", "w", "durchbiegung"), MOVED),
        Slot("repeat", "1", "which repeat", ("run", "trial", "wiederholung")),
        Slot("direction", "1", "levels rising (1) or falling (-1)", ()),
        Slot("read_time", "s", "how long the level had stood", ("time", "t")),
    ),
    "mass-resonance": (
        Slot("mass", "kg", "added mass", ("m", "addedmass", "masse"), (1e-5, 0.1)),
        Slot("frequency", "Hz", "where the response is largest: the paper's resonance", ("f", "fres", "resonancefrequency", "peakfrequency", "freq", "frequenz"), (1.0, 2000.0)),
        Slot("resonance", "Hz", "undamped natural frequency", ("naturalfrequency", "undampedfrequency", "eigenfrequency"), (1.0, 2000.0)),
    ),
    RAW: (
        Slot("time", "s", "time of the sample", ("t", "zeit")),
        Slot("drive", "V", "volts at the amplifier's input", ("input", "voltage", "u", "v"), (-0.5, 5.5)),
        Slot("displacement", "m", "displacement of the centre", ("deflection", "w", "position", "x"), (-1e-2, 1e-2)),
    ),
}  # fmt: skip
NEEDS: dict[str, tuple[tuple[str, ...], ...]] = {
    "sine-dwell": (("frequency",), ("peak_to_peak", "fundamental")),
    "static-loading": (("load", "mass"), ("deflection",)),
    "voltage-steps": (("level", "drive", "specimen_voltage"), ("deflection",)),
    "mass-resonance": (("mass",), ("frequency", "resonance")),
    RAW: (("displacement",), ("time",)),
}
UNCLEAR: dict[str, dict[str, tuple[str, ...]]] = {
    "sine-dwell": {
        **dict.fromkeys(("amplitude", "displacement", "deflection", "a", "response"), ("peak_to_peak", "fundamental")),
        **dict.fromkeys(("drive", "voltage", "drivevoltage"), ("drive_peak_to_peak", "drive_amplitude")),
    },
}


def kinds() -> dict[str, Kind]:
    """Every kind of table, by name: those of the protocols, and raw time series."""
    made = {RAW: Kind(RAW, "sine-dwell", EXTRA[RAW], NEEDS[RAW], {}, ("displacement",))}
    for name, protocol in PROTOCOLS.items():
        own = {}
        for column, (unit, words, width) in columns(protocol.point_type).items():
            for each in [f"{column}_{i}" for i in range(1, width + 1)] or [column]:
                own[each] = Slot(each, unit, words)
        for slot in EXTRA.get(name, ()):
            known = own.get(slot.name, slot)
            own[slot.name] = Slot(slot.name, known.unit, slot.meaning, slot.also, slot.usual)
            errors = f"{slot.name}_errors"
            own.setdefault(errors, Slot(errors, slot.unit, f"standard uncertainty of {slot.name.replace('_', ' ')}"))
        own[ENTRY] = Slot(ENTRY, "1", "entry of the plan")
        needs = NEEDS.get(name, tuple((axis,) for axis in protocol.axes))
        made[name] = Kind(name, name, tuple(own.values()), needs, UNCLEAR.get(name, {}), needs[-1])
    return made


def bare(text: str) -> str:
    """A name as names are compared: lower case, letters and digits."""
    return re.sub(r"[^a-z0-9]", "", text.casefold())
