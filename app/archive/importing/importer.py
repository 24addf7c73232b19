"""Imports tables and time series (CSV, MATLAB, TDMS, Universal File) as run files."""

import ast
import csv
import hashlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from app.archive.importing import tdms
from app.archive.importing.columns import TIME_SERIES, ColumnMapping, TableKind, detect_kind, match_columns, table_kinds
from app.archive.importing.csv_table import read_text_table
from app.archive.importing.import_table import ImportTable
from app.archive.importing.imported_run import ImportedPoints, build_points, write_imported_run
from app.archive.importing.si_columns import ImportOptions
from app.archive.importing.time_series import build_series_runs
from app.archive.importing.universal_file import is_universal_file, read_universal_file
from app.common import NO_PROGRESS, Progress, UnitError, UsageError, read_value, record_audit, usage_errors
from app.config import AmplifierTable, validation_messages
from app.session import load_protocol_class, unknown_parameter
from drivers import open_regular
from model import current_parameter
from protocols import PROTOCOLS
from protocols.base import UNNAMED, TableImportError
from protocols.runfile import HDF5_SIGNATURE, StorageError, notes_path

READ_SHARE, BUILT_SHARE = 0.6, 0.95
"""How far an import is when the files are read, and when points are made of them."""
MAX_FILE_BYTES = 400_000_000
POINTS_SUFFIX, ABOUT_SUFFIX, SERIES_MARK = "_points.csv", "_about.csv", "_series-"
"""Ends of the names of tables that an export writes side by side, and the mark in the names of tables of series."""


def import_files(
    options: ImportOptions, amplifier: AmplifierTable, progress: Progress = NO_PROGRESS
) -> tuple[list[ImportedPoints], list[Path]]:
    """Return the imported runs, and the written run files.

    Args:
        options: what the user specifies about the files.
        amplifier: the amplifier that drove every specimen.
        progress: an exception that it raises ends the import before anything is written.

    Raises:
        UsageError: a file is invalid; the message names file, place and remedy.
    """
    if options.kind and options.kind.endswith(".py"):
        options = replace(options, kind=load_protocol_class(options.kind).name)
    by_name = table_kinds()
    if options.kind and options.kind not in by_name:
        raise UsageError(f"--as {options.kind}: there is no such measurement; there are: {', '.join(by_name)}")
    with usage_errors(TableImportError, StorageError):
        parts = progress.part(0.0, READ_SHARE).split_by_files(options.files)
        sheets = [read_table(path, file_progress) for path, file_progress in zip(options.files, parts, strict=True)]
        kinds = [by_name[options.kind] if options.kind else _kind_of(sheet, options) for sheet in sheets]
        taken = _import_tables(sheets, kinds, options, amplifier, progress.part(READ_SHARE, BUILT_SHARE))
        written = (
            []
            if options.dry_run
            else [write_imported_run(each, table_options, options.folder) for each, table_options in taken]
        )
    if written:
        record_audit("import", *written, *map(notes_path, written), sources=[str(path) for path in options.files])
    return [each for each, _ in taken], written


def _kind_of(table: ImportTable, options: ImportOptions) -> TableKind:
    """Return the kind of a table by the metadata of an export, or else by its columns.

    Raises:
        TableImportError: it is none, several, or a table of series.
    """
    if kind := table_kinds().get(str(table.metadata.get("protocol"))):
        return kind
    stem, exported, _ = table.path.name.rpartition(SERIES_MARK)
    if exported and [column.name for column in table.columns[:2]] == ["entry", "label"]:
        raise TableImportError(
            f"{table.path} has the series of an exported run, one below the other, and a run needs its points: import {stem}{POINTS_SUFFIX}; "
            "or name the measurement that the columns of this table are of with --as"
        )
    return detect_kind(table, options.columns)


def read_table(path: Path, progress: Progress = NO_PROGRESS) -> ImportTable:
    """Read the table of a file.

    Raises:
        TableImportError: the file does not exist, or has no table.
    """
    try:
        if path.is_file() and path.stat().st_size > MAX_FILE_BYTES:
            raise TableImportError(f"{path} has more than {MAX_FILE_BYTES / 1e6:.0f} MB; cut it into smaller files")
        with open_regular(path) as file:
            data = file.read()
    except FileNotFoundError:
        raise TableImportError(f"there is no file {path}") from None
    except OSError as error:
        raise TableImportError(f"{path} cannot be read: {error.strerror or error}") from None
    if not data or data.isspace():
        raise TableImportError(
            f"{path} is empty; give a table with a header line, for example 'frequency [Hz],peak_to_peak [um]'"
        )
    with ThreadPoolExecutor(1) as pool:  # hashing takes a third of the time of reading, and no interpreter
        digest = pool.submit(hashlib.sha256, data)
        table = replace(_read_content(path, data, progress), sha256=digest.result().hexdigest())
    return table if table.metadata else replace(table, metadata=_exported_metadata(path))


def _exported_metadata(path: Path) -> dict[str, Any]:
    """Return the run's metadata from the table beside an exported table of points; empty for any other table."""
    about = path.with_name(path.name.removesuffix(POINTS_SUFFIX) + ABOUT_SUFFIX)
    if not path.name.endswith(POINTS_SUFFIX) or not about.is_file():
        return {}
    with about.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.reader(file) if len(row) == 2]
    metadata: dict[str, Any] = {}
    for name, text in rows:
        try:
            metadata[name] = ast.literal_eval(text)
        except (ValueError, SyntaxError):
            metadata[name] = text
    return metadata


def _read_content(path: Path, data: bytes, progress: Progress) -> ImportTable:
    """Read the table in a file's bytes, without its hash.

    Raises:
        TableImportError: there is none.
    """
    if data.startswith(b"MATLAB 7.3 MAT-file"):
        from app.archive.importing.mat_table import read_mat73_table

        return read_mat73_table(path)
    if data.startswith(tdms.SIGNATURE):
        return tdms.read_tdms(path)
    if is_universal_file(data):
        return read_universal_file(path, data)
    if data.startswith(HDF5_SIGNATURE):
        raise TableImportError(
            f"{path} is an HDF5 file: a run is used as it is; of anything else save the table as CSV or MAT"
        )
    if data.startswith(b"PK\x03\x04"):
        raise TableImportError(f"{path} is a workbook or an archive; save its sheet as CSV")
    if data.startswith(b"MATLAB 5.0 MAT-file") or path.suffix.lower() == ".mat":
        # scipy.io is slow to import, and CSV does not need it.
        from app.archive.importing.mat_table import read_mat_table

        return read_mat_table(path)
    return read_text_table(path, data, progress)


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


def _import_tables(
    sheets: Sequence[ImportTable],
    kinds: Sequence[TableKind],
    options: ImportOptions,
    amplifier: AmplifierTable,
    progress: Progress,
) -> list[tuple[ImportedPoints, ImportOptions]]:
    made, series = [], list[tuple[ImportTable, ColumnMapping]]()
    rows = [len(sheet.row_numbers) for sheet in sheets]
    sizes = [0 if kind.name == TIME_SERIES else count for count, kind in zip(rows, kinds, strict=True)]
    *parts, raw_progress = progress.split([*sizes, sum(rows) - sum(sizes)])
    for sheet, kind, file_progress in zip(sheets, kinds, parts, strict=True):
        table_options = _import_options(sheet, kind, options, amplifier, kinds)
        matched = match_columns(sheet, kind, options.columns, options.units)
        if kind.name == TIME_SERIES:
            series.append((sheet, matched))
        else:
            made.append((build_points(sheet, matched, table_options, file_progress), table_options))
    if series:
        table_options = _import_options(series[0][0], table_kinds()[TIME_SERIES], options, amplifier, kinds)
        made += [(run, table_options) for run in build_series_runs(series, table_options, raw_progress)]
    return made


def _import_options(
    table: ImportTable, kind: TableKind, options: ImportOptions, amplifier: AmplifierTable, kinds: Sequence[TableKind]
) -> ImportOptions:
    """Complete the options with the metadata of an exported file."""
    about = table.metadata
    if options.elongation_m is not None and kind.name != TIME_SERIES and kind.column("elongation") is None:
        raise UsageError(f"--membrane-elongation is for a response on a membrane; {table.path} is a {kind.name}")
    settings = _settings(kind, options.settings, kinds)
    names = PROTOCOLS[kind.protocol].model_fields
    prefix = "parameter_"
    stored = {current_parameter(n.removeprefix(prefix), names): about[n] for n in about if n.startswith(prefix)}
    settings |= {name: stored[name] for name in names if name in stored and name not in settings}
    start = about.get("start_time")
    return replace(
        options,
        specimen=str(about.get("specimen", UNNAMED)) if options.specimen == UNNAMED else options.specimen,
        settings=settings,
        amplifier=amplifier,
        simulated=options.simulated or bool(int(about.get("simulated", 0))),
        measured=options.measured or (read_time(str(start)) if start else None),
    )


def _settings(kind: TableKind, texts: Mapping[str, str], kinds: Sequence[TableKind]) -> dict[str, Any]:
    """Return the settings of a kind; settings of other tables of the import are left to these."""
    protocol = PROTOCOLS[kind.protocol]
    others = {name for each in kinds for name in PROTOCOLS[each.protocol].model_fields}
    given: dict[str, Any] = {}
    for name, text in texts.items():
        if name not in protocol.model_fields:
            if name in others:
                continue
            raise UsageError(
                f"{unknown_parameter(protocol, name)}; omit --set {name} for this table, or import it together with "
                "tables that have it"
            )
        try:
            given[name] = read_value(protocol, name, text)
        except UnitError as error:
            raise UsageError(f"--set {name}={text}: {error}") from None
    try:
        checked = protocol(**given)
    except ValidationError as error:
        raise UsageError(f"this was not a {protocol.name}:\n" + "\n".join(validation_messages(error))) from None
    return {name: checked.model_dump(mode="json")[name] for name in given}
