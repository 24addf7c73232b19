"""Mountings of a specimen: mass glued, plate clamped, membrane put on, laser moved, as dated events."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from protocols.base.events import Event
from protocols.base.steps import Prompt

MOUNTED_PARTS = {
    "mass": "mass glued",
    "plate": "plate clamped",
    "membrane": "membrane put on",
    "laser": "laser moved",
}
"""Parts that can be mounted anew, with their titles."""

MOUNTING_ACTIONS = {"fix-mass": "mass", "place-tactor": "laser", "stretch-membrane": "membrane"}
"""Parts by the action of the prompt that mounts them."""

MOUNTED = "mounted"
"""Number of a prompt for the specimen's own mass, which is glued; other masses are added to it, and taken off again."""

UNCHANGED = "unchanged"
"""Answer to a prompt for a part that is mounted already."""


@dataclass(frozen=True, slots=True)
class SpecimenMounted(Event, kind="Mounted"):
    """A part of the set-up was mounted anew; until the next mounting of the part all runs are of this one.

    Attributes:
        part: one of `MOUNTED_PARTS`.
        time: ISO 8601, UTC; with the part it identifies the mounting.
        who: name of the operator; empty if unknown.
        values: numbers of the prompt, SI, such as the mass.
    """

    part: str
    time: str
    who: str = ""
    values: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def now(cls, part: str, who: str, values: Mapping[str, float] | None = None) -> "SpecimenMounted":
        """Return a mounting at the present time."""
        return cls(part, datetime.now(UTC).isoformat(timespec="milliseconds"), who, dict(values or {}))

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "SpecimenMounted":
        """Return the mounting of a JSON object.

        Raises:
            LookupError, TypeError, ValueError: it is none.
        """
        if record["part"] not in MOUNTED_PARTS:
            raise ValueError(f"there is no part '{record['part']}'; the parts are {', '.join(MOUNTED_PARTS)}")
        datetime.fromisoformat(str(record["time"]))
        values = {str(name): float(value) for name, value in dict(record.get("values", {})).items()}
        return cls(str(record["part"]), str(record["time"]), str(record.get("who", "")), values)

    @classmethod
    def by_prompt(cls, prompt: Prompt, answer: str, who: str) -> "SpecimenMounted | None":
        """Return the mounting by an answered prompt; None for another prompt, and for a part that was mounted already."""
        part = MOUNTING_ACTIONS.get(prompt.action)
        if part is None or answer != prompt.choices[0] or (part == "mass" and not prompt.values.get(MOUNTED)):
            return None
        return cls.now(part, who, prompt.values)


def last_mountings(mountings: Iterable[SpecimenMounted]) -> tuple[SpecimenMounted, ...]:
    """Return the last mounting of each part, of mountings in the order of time."""
    return tuple({each.part: each for each in mountings}.values())
