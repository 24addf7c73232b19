"""What a campaign consists of: measurements in an order, what each needs before it, and the paper's own as the default."""

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from protocols.steps import Prompt


@dataclass(frozen=True, slots=True)
class Item:
    """One measurement of a campaign.

    Attributes:
        name: what the campaign calls it.
        protocol: which protocol it is a run of.
        settings: parameters that differ from the protocol's defaults; runs with others are not runs of it.
        needs: names of the items that must be done before.
        prepare: what must be set up before it, and that the protocol itself does not ask for.
        skipped: why it is left out; empty where it is not.
        since: earlier runs (ISO, UTC) do not count.
        rejected: names of run files that do not count.
    """

    name: str
    protocol: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    prepare: tuple[Prompt, ...] = ()
    skipped: str = ""
    since: str = ""
    rejected: tuple[str, ...] = ()

    def as_record(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""
        return {**asdict(self), "settings": dict(self.settings)}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "Item":
        """The item that `as_record` described. Raises TypeError or KeyError where it is none."""
        lists = {name: tuple(record[name]) for name in ("needs", "rejected")}
        prepare = tuple(Prompt(**{**asked, "choices": tuple(asked["choices"])}) for asked in record["prepare"])
        return cls(**{**record, **lists, "prepare": prepare})


MFC_UP = Prompt("turn-side", "Take all weights off and turn the specimen MFC up.", {"side": 1.0}, hands_on=True)
FREE = Prompt("remove-membrane", "Take the membrane off: the tactor vibrates freely.", hands_on=True)
PAPER_MASS = Prompt(
    "fix-mass", "Fix the mass of 7.73 g in the cylinder (the paper's).", {"mass_kg": 7.73e-3}, hands_on=True
)

PAPER: tuple[Item, ...] = (
    Item("wiring", "wiring-check"),
    Item("loading", "static-loading", needs=("wiring",), prepare=(FREE,)),
    Item("resonance", "mass-resonance", needs=("wiring",), prepare=(FREE, MFC_UP)),
    Item("steps", "voltage-steps", needs=("loading", "resonance"), prepare=(FREE, MFC_UP)),
    Item("dwell", "sine-dwell", needs=("steps",), prepare=(FREE, MFC_UP, PAPER_MASS)),
    Item("sag", "membrane-sag", needs=("wiring",)),
    Item("membrane", "membrane-series", needs=("dwell", "sag"), prepare=(MFC_UP, PAPER_MASS)),
)
"""The paper's campaign: k2 (loading, resonance) before mu (steps) before c0 (dwell) before c_s (membrane, with E_m of sag)."""


CARRIED: Mapping[str, str] = {"decay_s": "decay time"}
"""Parameters that take their value from an accepted estimate of what the item rests on, unless its settings say another."""


def known(items: Collection[Item], protocols: Collection[str]) -> tuple[Item, ...]:
    """Those items whose protocol is known; what needed one that is not needs what that one needed."""
    lost = {item.name: item.needs for item in items if item.protocol not in protocols}

    def needs(names: Collection[str]) -> tuple[str, ...]:
        found: dict[str, None] = {}
        for name in names:
            found.update(dict.fromkeys(needs(lost[name]) if name in lost else (name,)))
        return tuple(found)

    return tuple(
        Item(**{**{f: getattr(item, f) for f in Item.__dataclass_fields__}, "needs": needs(item.needs)})
        for item in items
        if item.name not in lost
    )
