"""Which column of a table is which quantity, and in which unit.

Which tables can be imported: the quantities of each protocol, by which names they go, in which unit, and how large they are.

Nothing is guessed that changes a number: an `amplitude` may be max - min or half of it, so it is asked for.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from app.archive.importing.table import Cells, Sheet, split_head
from app.common.units import UnitError, to_number
from protocols.registry import PROTOCOLS
from protocols.runfile.schema import ENTRY, columns

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


ERROR = re.compile(
    r"^(?:u|std|sd|sigma|error|err|uncertainty|delta)(?:of)?_(.*)$|^(.*?)_?(?:errors?|err|uncertainty|sigma|std|sd|unsicherheit)$"
)


class ImportingError(Exception):
    """A table cannot be imported. The sentence says where, what is wrong, and what would do."""


@dataclass(frozen=True, slots=True)
class Matched:
    """Which column of a sheet is which quantity, and which are none."""

    kind: Kind
    of: Mapping[str, Cells]
    left: tuple[Cells, ...]


def match(sheet: Sheet, kind: Kind, told: Mapping[str, str]) -> Matched:
    """The columns of a sheet by the quantities of a kind; `told` says it by the columns' heads.

    Raises:
        ImportingError: a quantity is unknown, missing, or there twice; or a name may mean several.
    """
    of: dict[str, Cells] = {}
    for name, head in told.items():
        if kind.slot(name) is None:
            raise ImportingError(f"--column {name}={head}: {kind.name} has no '{name}'; it has: {_names(kind)}")
        of[name] = _named(sheet, head, f"--column {name}={head}")
    for cells in sheet.columns:
        if any(cells is known for known in of.values()):
            continue
        slot = _slot(kind, cells, told)
        if slot is None:
            continue
        if slot.name in of:
            if slot.name in told:
                continue
            raise ImportingError(
                f"{sheet.path}: '{of[slot.name].head}' and '{cells.head}' may both be the {slot.name.replace('_', ' ')}; "
                f'say which: --column "{slot.name}={cells.head}"'
            )
        of[slot.name] = cells
    left = tuple(cells for cells in sheet.columns if all(cells is not known for known in of.values()))
    _whole(sheet, kind, of, left)
    return Matched(kind, of, left)


def recognised(sheet: Sheet, told: Mapping[str, str]) -> Kind:
    """The kind whose columns these are; `told` says some of them.

    Raises:
        ImportingError: none, or several.
    """
    found: list[tuple[int, Kind]] = []
    for kind in kinds().values():
        named = [_slot(kind, cells, {}) for cells in sheet.columns]
        names = {slot.name for slot in named if slot is not None} | {name for name in told if kind.slot(name)}
        unclear = {name for cells in sheet.columns for name in kind.unclear.get(bare(cells.name), ())}
        if all(names & set(group) or unclear & set(group) for group in kind.needs):
            found.append((sum(slot is None for slot in named), kind))
    least = min((missed for missed, _ in found), default=0)
    best = [kind for missed, kind in found if missed == least]
    best = [kind for kind in best if kind.name in EXTRA] or best
    if len(best) == 1:
        return best[0]
    heads = ", ".join(f"'{cells.head}'" for cells in sheet.columns)
    if not best:
        forms = "; ".join(f"{name}: {' and '.join(' or '.join(g) for g in kinds()[name].needs)}" for name in EXTRA)
        raise ImportingError(
            f"{sheet.path} has the columns {heads}, which are of no measurement known here; say what they are: --as and --column. Needed are, for {forms}"
        )
    names_ = " or ".join(f"--as {kind.name}" for kind in best)
    raise ImportingError(
        f"{sheet.path} has the columns {heads}, which fit {len(best)} kinds of measurement; say which: {names_}"
    )


def factor(sheet: Sheet, slot: Slot, cells: Cells, units: Mapping[str, str]) -> float:
    """By what a column's numbers become SI; `units` as told, by head, name or quantity.

    Raises:
        ImportingError: no unit, an unknown one, or one of something else.
    """
    unit = next((units[key] for key in (cells.head, cells.name, slot.name) if key in units), cells.unit)
    where = f"{sheet.path}, column '{cells.head}'"
    if unit == slot.unit or (slot.unit == "1" and unit is None):
        return 1.0
    if unit is None:
        raise ImportingError(
            f"{where}: no unit; write it in the header, '{cells.name} [{slot.unit}]', or say it: --unit {slot.name}={slot.unit}"
        )
    try:
        return to_number(f"1 {unit}", slot.unit)
    except UnitError:
        raise ImportingError(
            f"{where}: '{unit}' is no unit of {slot.name.replace('_', ' ')}; {slot.unit} or a multiple of it is needed: --unit {slot.name}={slot.unit}"
        ) from None


def _slot(kind: Kind, cells: Cells, told: Iterable[str]) -> Slot | None:
    """The quantity that a head names; an error by its quantity, or by being the only value's."""
    if bare(cells.name) in kind.unclear:
        return None
    name = bare(cells.name)
    fitting = [slot for slot in kind.slots if name == bare(slot.name)]
    fitting += [slot for slot in kind.slots if name in slot.also]
    if len(fitting) > 1 and cells.unit is not None:  # a load in grams is a mass
        fitting = [slot for slot in fitting if _fits(cells.unit, slot.unit)] or fitting
    if fitting:
        return fitting[0]
    if found := ERROR.fullmatch(cells.name.casefold().replace(" ", "_").replace("±", "error_")):
        of, _ = split_head(found[1] or found[2] or "")
        if not bare(of):
            value = next((v for v in (*told, *kind.value) if v in kind.value), kind.value[0])
            return kind.slot(f"{value}_errors")
        base = _slot(kind, Cells(of, of, cells.unit, ()), told)
        return kind.slot(f"{base.name}_errors") if base is not None else None
    return None


def _fits(unit: str, wanted: str) -> bool:
    try:
        to_number(f"1 {unit}", wanted)
    except UnitError:
        return False
    return True


def _named(sheet: Sheet, head: str, option: str) -> Cells:
    for same in (lambda c: c.head == head, lambda c: c.name == head, lambda c: bare(c.name) == bare(head)):
        found = [cells for cells in sheet.columns if same(cells)]
        if len(found) == 1:
            return found[0]
    have = ", ".join(f"'{cells.head}'" for cells in sheet.columns)
    raise ImportingError(f"{option}: {sheet.path} has no such column; it has: {have}")


def _whole(sheet: Sheet, kind: Kind, of: Mapping[str, Cells], left: Sequence[Cells]) -> None:
    """Refuse a table that lacks something, or has it under a name that may mean several."""
    for cells in left:
        meant = kind.unclear.get(bare(cells.name), ())
        if meant and not any(name in of for name in meant):
            which = " or ".join(f'--column "{name}={cells.head}" ({kind.slot(name).meaning})' for name in meant)  # type: ignore[union-attr]
            raise ImportingError(
                f"{sheet.path}, column '{cells.head}': the name does not tell which it is; say {which}"
            )
    for group in kind.needs:
        if not any(name in of for name in group):
            have = ", ".join(f"'{cells.head}'" for cells in sheet.columns)
            wanted = " or ".join(group)
            raise ImportingError(
                f"{sheet.path} has no column {wanted}, which {kind.name} needs; it has: {have}. Say which it is: --column {group[0]}=NAME"
            )


def _names(kind: Kind) -> str:
    return ", ".join(slot.name for slot in kind.slots if not slot.name.endswith("_errors"))
