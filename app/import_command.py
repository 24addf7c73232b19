"""The command `tactor-bench import`."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from app.answer import Answer, Column, Table, deliver
from app.config import ConfigError, load_bench
from app.config_tables import AmplifierTable
from app.exits import UsageError
from app.importer import ImportOptions, import_files, read_time
from app.importing import Taken
from app.progress import bar
from app.units import UnitError, to_number


def import_tables(options: argparse.Namespace) -> int:
    """`tactor-bench import FILE...`."""
    words = options.files[0].name if len(options.files) == 1 else f"{len(options.files)} files"
    with bar(words, options.json) as tell:
        taken, written = import_files(_options(options), _amplifier(options.bench), tell)
    return deliver(_answer(taken, written), options)


def _options(options: argparse.Namespace) -> ImportOptions:
    elongation = _number("--membrane-elongation", options.membrane_elongation, "m")
    if elongation is not None and not 0 <= elongation <= 0.05:
        raise UsageError(f"--membrane-elongation {options.membrane_elongation}: it must lie between 0 and 50 mm")
    return ImportOptions(
        files=tuple(options.files),
        folder=options.out,
        kind=options.kind,
        specimen=options.specimen,
        columns=_pairs("--column", options.column),
        units=_pairs("--unit", options.unit),
        uncertainties=_pairs("--uncertainty", options.uncertainty),
        settings=_pairs("--set", options.settings),
        elongation_m=elongation,
        sensor=options.sensor,
        gain_error=_number("--gain-error", options.gain_error, "1") or 0.0,
        delay_s=_number("--sensor-delay", options.sensor_delay, "s") or 0.0,
        simulated=options.simulated,
        measured=read_time(options.measured) if options.measured else None,
        dry_run=options.dry_run,
    )


def _pairs(option: str, texts: Sequence[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (equals and name.strip() and value.strip()):
            raise UsageError(f"{option} {text}: write NAME=VALUE; '--help' shows an example")
        found[name.strip()] = value.strip()
    return found


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
