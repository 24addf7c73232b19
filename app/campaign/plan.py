"""Campaign plan: ordered items with their dependencies, the paper's campaign, and the campaign file.

The campaign file is JSON, in the folder of the runs, named after the specimen, and replaced atomically.
"""

import contextlib
import json
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from app.common import UndoHistory
from model import current_parameter
from protocols import PAPER_CAMPAIGN, PROTOCOLS
from protocols.base import Prompt, read_json_file, visible_values, write_atomic
from protocols.runfile import folded_name, safe_name

SUFFIX = ".campaign.json"
VERSION = 2
"""Of a file with series; one without them is of version 1, which earlier programs read."""


class CampaignError(Exception):
    """A campaign cannot be opened, changed or saved; the message gives campaign, reason and remedy."""


def campaign_path(folder: Path, specimen: str) -> Path:
    """Return the path of a specimen's campaign file in the folder of its runs; an earlier version's file if it belongs to the specimen."""
    path, earlier = (folder / f"{name(specimen)}{SUFFIX}" for name in (safe_name, folded_name))
    if earlier != path and not path.exists() and earlier.exists():
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError, CampaignError):
            if read_record(earlier)["specimen"] == specimen:
                return earlier
    return path


def list_campaigns(folder: Path) -> list[Path]:
    """Return the campaign files of a folder, the last changed first."""
    try:
        files = [(path.stat().st_mtime_ns, path) for path in folder.glob(f"*{SUFFIX}")]
    except OSError:
        return []
    return [path for _, path in sorted(files, reverse=True)]


@dataclass(frozen=True, slots=True)
class CampaignItem:
    """One measurement of a campaign.

    Attributes:
        name: name within the campaign.
        protocol: name of the protocol.
        settings: parameters that differ from the protocol's defaults; runs with other parameters do not belong to the item.
        needs: names of the prerequisite items.
        prepare: setup prompts that the protocol itself does not show.
        skipped: reason for skipping it; empty if it is not skipped.
        since: time of the request for a new run (ISO, UTC); earlier results count until there is one, earlier runs are not resumed.
        rejected: names of run files that do not count.
        accepted: names of run files whose results the operator has accepted; the last one counts.
        varied: varied parameter, with one run for each of `values`; empty: a single run.
        values: values of the varied parameter, in the unit of its field.
    """

    name: str
    protocol: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    prepare: tuple[Prompt, ...] = ()
    skipped: str = ""
    since: str = ""
    rejected: tuple[str, ...] = ()
    accepted: tuple[str, ...] = ()
    varied: str = ""
    values: tuple[float, ...] = ()

    @property
    def steps(self) -> tuple["CampaignItem", ...]:
        """Return the runs of a series as items of one value each; none of a single run."""
        return tuple(
            replace(self, settings={**self.settings, self.varied: value}, varied="", values=())
            for value in (self.values if self.varied else ())
        )

    def as_record(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        record = {**asdict(self), "settings": dict(self.settings)}
        return record if self.varied else {k: v for k, v in record.items() if k not in ("varied", "values")}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "CampaignItem":
        """Restore an item from `as_record`. Raises TypeError or KeyError for other records."""
        lists = {name: tuple(record[name]) for name in ("needs", "rejected", "accepted", "values") if name in record}
        prepare = tuple(Prompt(**{**prompt, "choices": tuple(prompt["choices"])}) for prompt in record["prepare"])
        settings, varied = record.get("settings", {}), record.get("varied", "")
        if settings or varied:  # files of earlier versions may have former names
            names = PROTOCOLS[record["protocol"]].model_fields if record["protocol"] in PROTOCOLS else ()
            present = {name: name if name in names else current_parameter(name, names) for name in (*settings, varied)}
            settings = {present[name]: value for name, value in settings.items()}
            varied = present[varied]
        return cls(**{**record, **lists, "prepare": prepare, "settings": settings, "varied": varied})


class _Basis(BaseModel):
    run: str
    estimates: dict[str, float]


class _CampaignRecord(BaseModel):
    """Types of a campaign file, checked when it is read."""

    specimen: str
    simulated: bool
    created: str
    items: list[CampaignItem]
    based_on: dict[str, dict[str, _Basis]]


def read_record(path: Path) -> dict[str, Any]:
    """Read the record of a campaign file.

    Raises:
        CampaignError: the file is not a campaign, or of a newer version.
        OSError, ValueError, KeyError, TypeError: the file cannot be read or parsed.
    """
    record = dict(visible_values(read_json_file(path)))
    if record["kind"] != "campaign" or record["version"] > VERSION:
        raise CampaignError(f"{path} is of a newer version of this program; install that")
    try:
        _CampaignRecord.model_validate_json(json.dumps(record), strict=True)
    except ValidationError as error:
        fault = error.errors()[0]
        raise ValueError(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}") from None
    before: set[str] = set()
    for item in record["items"]:
        if item["name"] in before:
            raise ValueError(f"there are two items '{item['name']}'")
        if missing := [need for need in item.get("needs", ()) if need not in before]:
            raise ValueError(f"{item['name']} needs '{missing[0]}', which is not an earlier item")
        if "prepare" not in item or any("choices" not in prompt for prompt in item["prepare"]):
            raise ValueError(f"{item['name']} has no list 'prepare' of prompts, each with its 'choices'")
        before.add(item["name"])
    return record


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Replace a campaign file.

    Raises:
        CampaignError: it cannot be written.
    """
    has_series = any(item.get("varied") for item in record["items"])
    whole = {"kind": "campaign", "version": VERSION if has_series else 1, **record}
    text = json.dumps(whole, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, text)
    except OSError as error:
        raise CampaignError(f"the campaign {path} cannot be written: {error.strerror}") from None


PAPER_ITEMS = tuple(
    CampaignItem(item.name, item.protocol, needs=item.needs, prepare=item.prepare) for item in PAPER_CAMPAIGN
)
"""The paper's campaign."""


CARRIED_PARAMETERS: Mapping[str, str] = {"decay_s": "decay_time"}
"""Parameters that default to an accepted estimate of a dependency, unless the item's settings give them."""


def drop_unknown_protocols(
    items: Collection[CampaignItem], known_protocols: Collection[str]
) -> tuple[CampaignItem, ...]:
    """Return the items with a known protocol; dependencies on dropped items pass to their dependencies."""
    lost = {item.name: item.needs for item in items if item.protocol not in known_protocols}

    def needs(names: Collection[str]) -> tuple[str, ...]:
        needs_of: dict[str, None] = {}
        for name in names:
            needs_of.update(dict.fromkeys(needs(lost[name]) if name in lost else (name,)))
        return tuple(needs_of)

    return tuple(replace(item, needs=needs(item.needs)) for item in items if item.name not in lost)


class CampaignPlan(UndoHistory[tuple[CampaignItem, ...]]):
    """Ordered items with undo history, in memory only."""

    @property
    def items(self) -> tuple[CampaignItem, ...]:
        return self.current

    def item(self, name: str) -> CampaignItem:
        """Return one item. Raises CampaignError for an unknown name."""
        for item in self.items:
            if item.name == name:
                return item
        raise CampaignError(f"the campaign has no '{name}'; it has: {', '.join(item.name for item in self.items)}")

    def dependencies(self, item: CampaignItem) -> set[str]:
        """Return the names of all direct and indirect dependencies of an item."""
        names: set[str] = set()
        for need in item.needs:
            names |= {need} | self.dependencies(self.item(need))
        return names

    def add(self, item: CampaignItem) -> None:
        """Add an item at the end.

        Raises:
            CampaignError: there is one of that name, or it needs an unknown one.
        """
        if any(item.name == each.name for each in self.items):
            raise CampaignError(f"the campaign has an item '{item.name}' already; choose another name")
        for need in item.needs:
            self.item(need)
        self.push((*self.items, item))

    def change(self, name: str, **values: Any) -> None:
        """Replace fields of an item."""
        changed = replace(self.item(name), **values)
        self.push(tuple(changed if item.name == name else item for item in self.items))

    def move(self, name: str, before: str = "") -> None:
        """Move an item before another one, or to the end.

        Raises:
            CampaignError: an item would precede its dependency.
        """
        moved, rest = self.item(name), [item for item in self.items if item.name != name]
        before = before and self.item(before).name
        place = next((i for i, item in enumerate(rest) if item.name == before), len(rest))
        items = (*rest[:place], moved, *rest[place:])
        for i, item in enumerate(items):
            if later := [need for need in item.needs if need in {other.name for other in items[i:]}]:
                where = f"before {before}" if before else "at the end"
                raise CampaignError(f"{name} cannot be moved {where}: {item.name} needs {later[0]} before it")
        self.push(items)
