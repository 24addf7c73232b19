"""What `tactor-bench import` does."""

import argparse
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from app.answer import Answer, Column, Table, deliver
from app.config import ConfigError, load_bench
from app.config_tables import AmplifierTable
from app.exits import UsageError
from app.import_columns import ImportingError, Matched, match, recognised
from app.import_kinds import RAW, Kind, kinds
from app.import_series import take_series
from app.import_values import Asked
from app.importing import Taken, store, take
from app.progress import Tell, bar, files, part, parts
from app.sheet import Sheet, SheetError
from app.sheet_file import read_sheet
from app.units import UnitError, read_value, to_number
from app.validation import faults
from protocols.registry import PROTOCOLS
from protocols.storing import StoreError

READ, TAKEN = 0.6, 0.95
"""How far an import is when the files are read, and when points are made of them."""


def import_tables(options: argparse.Namespace) -> int:
    """`tactor-bench import FILE...`."""
    words = options.files[0].name if len(options.files) == 1 else f"{len(options.files)} files"
    with bar(words, options.json) as tell:
        taken, written = bring(options, _amplifier(options.bench), tell)
    return deliver(_answer(taken, written), options)


def bring(options: argparse.Namespace, amplifier: AmplifierTable, tell: Tell) -> tuple[list[Taken], list[Path]]:
    """What was taken from the files, and the run files that were written.

    Args:
        options: of the command; its `bench` is not looked at.
        amplifier: through which all of it was driven.
        tell: hears how far it is; what it raises ends the import before anything is written.

    Raises:
        UsageError: a sentence that says which file is wrong, where, and what would do.
    """
    every = kinds()
    if options.kind and options.kind not in every:
        raise UsageError(f"--as {options.kind}: there is no such measurement; there are: {', '.join(every)}")
    columns = _pairs("--column", options.column)
    try:
        told = files(part(tell, 0.0, READ), options.files)
        sheets = [read_sheet(path, tell_one) for path, tell_one in zip(options.files, told, strict=True)]
        wanted = [every[options.kind] if options.kind else recognised_as(sheet, every, columns) for sheet in sheets]
        taken = _taken(sheets, wanted, options, amplifier, part(tell, READ, TAKEN))
        written = [] if options.dry_run else [store(each, asked, options.out) for each, asked in taken]
    except (SheetError, ImportingError, StoreError) as error:
        raise UsageError(str(error)) from None
    return [each for each, _ in taken], written


def recognised_as(sheet: Sheet, every: dict[str, Kind], columns: dict[str, str]) -> Kind:
    """The kind of a table: what an export says of itself, else what its columns say."""
    told = str(sheet.about.get("protocol", ""))
    return every[told] if told in every else recognised(sheet, columns)


def _taken(
    sheets: Sequence[Sheet],
    wanted: Sequence[Kind],
    options: argparse.Namespace,
    amplifier: AmplifierTable,
    tell: Tell,
) -> list[tuple[Taken, Asked]]:
    made, columns, series = [], _pairs("--column", options.column), list[tuple[Sheet, Matched]]()
    raw = sum(len(sheet.places) for sheet, kind in zip(sheets, wanted, strict=True) if kind.name == RAW)
    sizes = [0 if kind.name == RAW else len(sheet.places) for sheet, kind in zip(sheets, wanted, strict=True)]
    *told, told_raw = parts(tell, [*sizes, raw])
    for sheet, kind, tell_one in zip(sheets, wanted, told, strict=True):
        asked = _asked(sheet, kind, options, amplifier)
        matched = match(sheet, kind, columns)
        if kind.name == RAW:
            series.append((sheet, matched))
        else:
            made.append((take(sheet, matched, asked, tell_one), asked))
    if series:
        asked = _asked(series[0][0], wanted[0], options, amplifier)
        made.append((take_series(series, asked, told_raw), asked))
    return made


def _asked(sheet: Sheet, kind: Kind, options: argparse.Namespace, amplifier: AmplifierTable) -> Asked:
    """What was said on the command line, and by the file itself where it is an export."""
    about = sheet.about
    elongation, gain, delay = (
        _number(option, getattr(options, name), unit)
        for option, name, unit in (
            ("--membrane-elongation", "membrane_elongation", "m"),
            ("--gain-error", "gain_error", "1"),
            ("--sensor-delay", "sensor_delay", "s"),
        )
    )
    if elongation is not None and kind.protocol != "sine-dwell":
        raise UsageError(f"--membrane-elongation is for a sine dwell on a membrane; {sheet.path} is a {kind.name}")
    if elongation is not None and not 0 <= elongation <= 0.05:
        raise UsageError(f"--membrane-elongation {options.membrane_elongation}: it must lie between 0 and 50 mm")
    settings = _settings(kind, options.settings)
    for name in PROTOCOLS[kind.protocol].model_fields:
        if f"parameter_{name}" in about and name not in settings:
            settings[name] = about[f"parameter_{name}"]
    return Asked(
        specimen=str(about.get("specimen", "unnamed")) if options.specimen == "unnamed" else options.specimen,
        unit=_pairs("--unit", options.unit),
        uncertainty=_pairs("--uncertainty", options.uncertainty),
        settings=settings,
        elongation_m=elongation,
        sensor=options.sensor,
        gain_error=gain or 0.0,
        delay_s=delay or 0.0,
        amplifier=amplifier,
        simulated=options.simulated or bool(int(about.get("simulated", 0))),
        begun=_when(options.measured or about.get("start_time")),
    )


def _pairs(option: str, texts: Sequence[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (equals and name.strip() and value.strip()):
            raise UsageError(f"{option} {text}: write NAME=VALUE; '--help' shows an example")
        found[name.strip()] = value.strip()
    return found


def _settings(kind: Kind, texts: Sequence[str]) -> dict[str, Any]:
    protocol = PROTOCOLS[kind.protocol]
    given: dict[str, Any] = {}
    for name, text in _pairs("--set", texts).items():
        if name not in protocol.model_fields:
            raise UsageError(f"{protocol.name} has no parameter '{name}'; it has: {', '.join(protocol.model_fields)}")
        try:
            given[name] = read_value(protocol, name, text)
        except UnitError as error:
            raise UsageError(f"--set {name}={text}: {error}") from None
    try:
        checked = protocol(**given)
    except ValidationError as error:
        raise UsageError(f"this was no {protocol.name}:\n" + "\n".join(faults(error))) from None
    return {name: checked.model_dump(mode="json")[name] for name in given}


def _number(option: str, text: str | None, unit: str) -> float | None:
    if text is None:
        return None
    try:
        share = unit == "1" and text.strip().endswith("%")
        number = to_number(text.strip().removesuffix("%"), "1") / 100 if share else to_number(text, unit)
    except UnitError as error:
        raise UsageError(f"{option} {text}: {error}") from None
    if not 0 <= number < float("inf"):
        raise UsageError(f"{option} {text}: it must not be negative")
    return number


def _amplifier(bench: str) -> AmplifierTable:
    try:
        return load_bench(bench).amplifier
    except ConfigError as error:
        raise UsageError(str(error)) from None


def _when(text: str | None) -> datetime | None:
    if not text:
        return None
    try:
        when = datetime.fromisoformat(str(text))
    except ValueError:
        raise UsageError(f"--measured {text}: write a day, 2019-05-04, or a time, 2019-05-04T15:30") from None
    when = when.astimezone(UTC)
    if when > datetime.now(UTC):
        raise UsageError(f"--measured {text}: that day is still to come")
    return when


def _answer(every: Sequence[Taken], written: Sequence[Path]) -> Answer:
    tables, notes = [], list[str]()
    for taken in every:
        names = ", ".join(name for name, _ in taken.files)
        sources = taken.sources
        tables.append(
            Table(
                f"columns of {names}",
                f"{taken.protocol.title} from {names}: {len(taken.points)} points"
                + (", SIMULATED" if taken.simulated else ""),
                (
                    Column("quantity", "", [s.name for s in sources]),
                    Column("column", "", [s.head for s in sources]),
                    Column("unit", "", [s.unit for s in sources]),
                    Column("meaning", "", [s.meaning for s in sources]),
                ),
                most=200,
            )
        )
        notes += [f"caution: {words}" for words in taken.cautions]
        if taken.left:
            notes.append(f"left out: {', '.join(repr(head) for head in taken.left)}")
    notes += [f"wrote {path}" for path in written] or ["nothing was written (--dry-run)"]
    more = {
        "written": [str(path) for path in written],
        "points": sum(len(taken.points) for taken in every),
        "cautions": [words for taken in every for words in taken.cautions],
        "left_out": [head for taken in every for head in taken.left],
    }
    return Answer("import", {}, tuple(tables), tuple(notes), more=more)
