"""Shared commissioning records: figures of a box without serial number, addresses, people, paths and times of day.

A laboratory sends the file of `tactor-bench commission --share`; the files in docs/evidence/boxes raise assumptions to *proven on
N boxes* in the table of docs/generators.md, one file for each box.
"""

import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from app.common import UsageError
from app.session.commissioning_record import CARD_MAKER, MAX_BYTES
from drivers import open_regular
from drivers.evidence import Assumption, OutputCheck, assumptions_about, assumptions_about_card
from protocols.commissioning import CheckedOutput, OutputVerdict, checked_assumptions

FORMAT = "tactor-bench shared commissioning 1"

_NUMBER = (int, float, type(None))
_FIELDS: Mapping[str, Any] = {
    "format": str,
    "maker": str,
    "model": str,
    "firmware": str,
    "day": str,
    "program": str,
    "byte_order": str,
    "simulated": bool,
    "rate_hz": _NUMBER,
    "checks": [{"name": str, "value": _NUMBER, "unit": str, "low": _NUMBER, "high": _NUMBER}],
    "times": dict,
    "commands": [{"command": str, "count": int, "median_s": _NUMBER, "longest_s": _NUMBER}],
}
"""Types of the fields; nothing else is written, or accepted."""

_TEXT = re.compile(r"[\w '.,;+()/%²µ°*:?-]{0,60}")
_COMMAND = re.compile(r"[*:]?[A-Z0-9]+([: ][A-Z0-9]+)*\??")
_NAMED = re.compile(r"[a-z0-9_]{1,30}")


@dataclass(frozen=True, slots=True)
class SharedRecord:
    """An accepted record of a real box.

    Args:
        maker, model: of the box.
        checks: its measured figures and their limits.
    """

    maker: str
    model: str
    checks: tuple[CheckedOutput, ...]


def shared_record(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a commissioning record that names neither a box nor a person nor a place.

    A serial number that the instrument repeats in its model or firmware is removed from there. Details and errors are left out,
    because they may name addresses.
    """
    values = {**record, "format": FORMAT, "day": str(record["date"])[:10]}
    if serial := str(record["serial"]).strip():
        values |= {name: values[name].replace(serial, "").strip(" ,-") for name in ("maker", "model", "firmware")}
    values["commands"] = [each for each in record["commands"] if _COMMAND.fullmatch(each["command"])]
    return {name: _without_others(values[name], kind) for name, kind in _FIELDS.items()}


def _without_others(value: Any, kind: Any) -> Any:
    """Return a list of tables without the fields that are not shared, anything else as it is."""
    return [{name: each[name] for name in kind[0]} for each in value] if isinstance(kind, list) else value


def read_shared(path: Path) -> SharedRecord:
    """Return the shared record of a file.

    Raises:
        UsageError: it cannot be read, holds anything else than a shared record, or is of a simulated or unknown instrument.
    """
    try:
        with open_regular(path) as file:
            read = json.loads(file.read(MAX_BYTES))
        _check(read, _FIELDS, "the record")
        checks = tuple(_checked_output(each) for each in read["checks"])
    except OSError as error:
        raise UsageError(
            f"{path} cannot be read: {error.strerror or error}; name a file of commission --share"
        ) from error
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is no shared commissioning record: {error}; share the box's record anew") from error
    return SharedRecord(read["maker"], read["model"], checks)


def read_shared_records(folder: Path) -> list[SharedRecord]:
    """Return the records in a folder, in the order of their names. Raises UsageError for a bad one, or a box that is there twice."""
    records: dict[SharedRecord, Path] = {}
    for path in sorted(folder.glob("*.json")):
        record = read_shared(path)
        if record in records:
            raise UsageError(
                f"{path} has the figures of {records[record].name}: it is the same box; remove one of them"
            )
        records[record] = path
    return list(records)


def proven_boxes(records: Iterable[SharedRecord]) -> Counter[Assumption]:
    """Return the number of boxes on which each assumption was measured and passed."""
    boxes: Counter[Assumption] = Counter()
    for record in records:
        rows = assumptions_about_card(plays=True) if record.maker == CARD_MAKER else assumptions_about(record.model)
        checked = checked_assumptions(rows, record.checks)
        boxes.update(each.assumption for each in checked if each.verdict is OutputVerdict.PASS)
    return boxes


def _check(read: Any, fields: Mapping[str, Any], where: str) -> None:
    """Raise ValueError unless a table has exactly these fields, with values of their types and forms."""
    if not isinstance(read, dict):
        raise ValueError(f"{where} is no table")
    if unknown := sorted(read.keys() ^ fields.keys()):
        raise ValueError(f"{where} {'has a field' if unknown[0] in read else 'lacks'} '{unknown[0][:30]}'")
    for name, kind in fields.items():
        value, what = read[name], f"'{name}' of {where}"
        if isinstance(kind, list):
            if not isinstance(value, list):
                raise ValueError(f"{what} is no list")
            for each in value:
                _check(each, kind[0], what)
        elif not isinstance(value, kind) or (kind in (_NUMBER, int) and isinstance(value, bool)):
            raise ValueError(f"{what} has the wrong type")
        elif isinstance(value, str) and not (_COMMAND if name == "command" else _TEXT).fullmatch(value):
            raise ValueError(f"{what} is '{value[:30]}', which is no short text")
        elif isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"{what} is not finite")
    if fields is _FIELDS:
        _check_values(read)


def _check_values(read: Mapping[str, Any]) -> None:
    if read["format"] != FORMAT:
        raise ValueError(f"its format is '{read['format']}', not '{FORMAT}'")
    if len(read["day"]) != 10:
        raise ValueError(f"its day is '{read['day']}', not a date like 2026-11-28")
    date.fromisoformat(read["day"])
    if read["simulated"]:
        raise ValueError("it is of a simulated instrument, which proves nothing")
    if not all(_NAMED.fullmatch(name) and isinstance(value, _NUMBER) for name, value in read["times"].items()):
        raise ValueError("its times are no numbers by name")
    if read["maker"] != CARD_MAKER and not assumptions_about(read["model"]):
        raise ValueError(f"there is no table of assumptions about a '{read['model']}'")


def _checked_output(each: Mapping[str, Any]) -> CheckedOutput:
    value = math.nan if each["value"] is None else float(each["value"])
    return CheckedOutput(OutputCheck(each["name"]), value, each["unit"], each["low"], each["high"])
