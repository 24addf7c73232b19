"""Imports tables and time series, CSV or MAT, as run files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from app.archive.importing.columns import RAW, ImportingError, Kind, Matched, kinds, match, recognised
from app.archive.importing.points import Taken, store, take
from app.archive.importing.reader import read_sheet
from app.archive.importing.table import Sheet, SheetError
from app.archive.importing.time_series import take_series
from app.archive.importing.values import Asked
from app.common.errors import UsageError
from app.common.progress import Tell, files, part, parts, untold
from app.common.units import UnitError, read_value
from app.config.tables import AmplifierTable
from app.config.validation import faults
from protocols.registry import PROTOCOLS
from protocols.runfile.errors import StoreError

READ, TAKEN = 0.6, 0.95
"""How far an import is when the files are read, and when points are made of them."""


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """What the user says about the files to import; all of it may be left to the files themselves.

    Attributes:
        kind: name of the kind of measurement, None to recognise each table by its columns.
        specimen: `unnamed` to take the name from an exported file.
        columns: quantity -> head of its column.
        units: quantity, name or head of a column -> its unit.
        uncertainties: quantity -> `2 um` or `1 %`, standard, for every value.
        settings: parameter of the protocol -> its value as text, with or without a unit.
        elongation_m: of the membrane, None where it is free or the table says it.
        sensor: name and serial number of the displacement sensor.
        gain_error: relative standard uncertainty of the sensor's gain, 0 if unknown.
        delay_s: delay of the sensor's output, for time series.
        simulated: whether the values come from a simulation.
        measured: time of the measurement, None if unknown.
        dry_run: read the files and write nothing.
    """

    files: tuple[Path, ...]
    folder: Path
    kind: str | None = None
    specimen: str = "unnamed"
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    uncertainties: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, str] = field(default_factory=dict)
    elongation_m: float | None = None
    sensor: str = ""
    gain_error: float = 0.0
    delay_s: float = 0.0
    simulated: bool = False
    measured: datetime | None = None
    dry_run: bool = False


def import_files(
    options: ImportOptions, amplifier: AmplifierTable, tell: Tell = untold
) -> tuple[list[Taken], list[Path]]:
    """Return what was read from the files, and the run files that were written.

    Args:
        options: what the user says about the files.
        amplifier: the amplifier that drove every specimen.
        tell: progress callback; an exception that it raises ends the import before anything is written.

    Raises:
        UsageError: names the file that is wrong, where, and the remedy.
    """
    every = kinds()
    if options.kind and options.kind not in every:
        raise UsageError(f"--as {options.kind}: there is no such measurement; there are: {', '.join(every)}")
    try:
        told = files(part(tell, 0.0, READ), options.files)
        sheets = [read_sheet(path, tell_one) for path, tell_one in zip(options.files, told, strict=True)]
        wanted = [every[options.kind] if options.kind else _kind_of(sheet, every, options.columns) for sheet in sheets]
        taken = _taken(sheets, wanted, options, amplifier, part(tell, READ, TAKEN))
        written = [] if options.dry_run else [store(each, asked, options.folder) for each, asked in taken]
    except (SheetError, ImportingError, StoreError) as error:
        raise UsageError(str(error)) from None
    return [each for each, _ in taken], written


def read_time(text: str) -> datetime:
    """Return the time of a measurement from ISO 8601 text.

    Raises:
        UsageError: it is not a time, or one in the future.
    """
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise UsageError(f"--measured {text}: write a day, 2019-05-04, or a time, 2019-05-04T15:30") from None
    when = when.astimezone(UTC)
    if when > datetime.now(UTC):
        raise UsageError(f"--measured {text}: that day is still to come")
    return when


def _kind_of(sheet: Sheet, every: Mapping[str, Kind], columns: Mapping[str, str]) -> Kind:
    """Return the kind that an exported table names, else the one that its columns suggest."""
    told = str(sheet.about.get("protocol", ""))
    return every[told] if told in every else recognised(sheet, columns)


def _taken(
    sheets: Sequence[Sheet],
    wanted: Sequence[Kind],
    options: ImportOptions,
    amplifier: AmplifierTable,
    tell: Tell,
) -> list[tuple[Taken, Asked]]:
    made, series = [], list[tuple[Sheet, Matched]]()
    raw = sum(len(sheet.places) for sheet, kind in zip(sheets, wanted, strict=True) if kind.name == RAW)
    sizes = [0 if kind.name == RAW else len(sheet.places) for sheet, kind in zip(sheets, wanted, strict=True)]
    *told, told_raw = parts(tell, [*sizes, raw])
    for sheet, kind, tell_one in zip(sheets, wanted, told, strict=True):
        asked = _asked(sheet, kind, options, amplifier)
        matched = match(sheet, kind, options.columns)
        if kind.name == RAW:
            series.append((sheet, matched))
        else:
            made.append((take(sheet, matched, asked, tell_one), asked))
    if series:
        asked = _asked(series[0][0], wanted[0], options, amplifier)
        made.append((take_series(series, asked, told_raw), asked))
    return made


def _asked(sheet: Sheet, kind: Kind, options: ImportOptions, amplifier: AmplifierTable) -> Asked:
    """Complete the options by what an exported file says of itself."""
    about = sheet.about
    if options.elongation_m is not None and kind.protocol != "sine-dwell":
        raise UsageError(f"--membrane-elongation is for a sine dwell on a membrane; {sheet.path} is a {kind.name}")
    settings = _settings(kind, options.settings)
    for name in PROTOCOLS[kind.protocol].model_fields:
        if f"parameter_{name}" in about and name not in settings:
            settings[name] = about[f"parameter_{name}"]
    start = about.get("start_time")
    return Asked(
        specimen=str(about.get("specimen", "unnamed")) if options.specimen == "unnamed" else options.specimen,
        unit=options.units,
        uncertainty=options.uncertainties,
        settings=settings,
        elongation_m=options.elongation_m,
        sensor=options.sensor,
        gain_error=options.gain_error,
        delay_s=options.delay_s,
        amplifier=amplifier,
        simulated=options.simulated or bool(int(about.get("simulated", 0))),
        begun=options.measured or (read_time(str(start)) if start else None),
    )


def _settings(kind: Kind, texts: Mapping[str, str]) -> dict[str, Any]:
    protocol = PROTOCOLS[kind.protocol]
    given: dict[str, Any] = {}
    for name, text in texts.items():
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
