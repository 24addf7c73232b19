"""Export of a run for other programs, in SI units with units in every header.

File names of simulated runs contain SIMULATED.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Literal, get_args

from app.archive.exporting.matlab import mat73_writer, mat_writer
from app.archive.exporting.parts import PARTS, ExportedRun, ExportError, Part, part_tables
from app.archive.exporting.table_files import json_writer, write_csv, write_parquet, xlsx_writer
from app.archive.exporting.universal_file import uff_writer
from app.common import NO_PROGRESS, OperationCancelled, Progress, Table
from protocols.base import replacing, visible_text
from protocols.runfile import translate_read_errors

Format = Literal["csv", "json", "mat", "mat73", "parquet", "xlsx", "uff"]
FORMATS: tuple[Format, ...] = get_args(Format)
FORMAT_NAMES: dict[Format, str] = {
    "csv": "CSV tables",
    "json": "JSON",
    "mat": "MATLAB (version 5)",
    "mat73": "MATLAB 7.3",
    "parquet": "Parquet",
    "xlsx": "Excel workbook",
    "uff": "Universal File (series)",
}

FileWriter = Callable[[Path, Progress], None]
WRITERS: dict[Format, Callable[[ExportedRun, Sequence[Part]], FileWriter]] = {
    "json": json_writer, "mat": mat_writer, "mat73": mat73_writer, "xlsx": xlsx_writer, "uff": uff_writer,
}  # fmt: skip
"""Of the formats with one file for all parts."""

MAX_SCANS: dict[Format, int] = {"json": 20_000_000, "mat": 20_000_000, "mat73": 200_000_000, "xlsx": 1_000_000}
"""Limit of raw scans of formats that are held in memory whole, and of a worksheet's rows."""


def raw_left_out(run: ExportedRun, kind: Format) -> str:
    """Return why an export without a choice of parts leaves out the raw samples of a run; empty if it has them."""
    limit, scans = MAX_SCANS.get(kind), run.trace.sample_count
    return (
        ""
        if limit is None or scans <= limit
        else f"{run.path.name} has {scans} scans, and {kind} holds at most {limit}"
    )


def export_run(
    run: ExportedRun,
    folder: Path,
    kind: Format = "csv",
    parts: Sequence[Part] | None = None,
    progress: Progress = NO_PROGRESS,
) -> list[Path]:
    """Write `parts` of a run into `folder` and return the files written. Files of the same names are replaced.

    Without `parts`, every part that the format can hold; some formats cannot hold the raw samples of a long run.

    CSV and Parquet have one file for each part and each kind of series, all other formats one file. A Universal File contains the
    series for any selection of parts. `progress` receives the completed share, 0 to 1. If it is cancelled, the unfinished file is removed.

    Raises:
        RunReadError: the run is damaged.
        ExportError: a file cannot be written, the run is too long for the format, has no part, or a text or name, that the
            format can hold, or the library for the format is not installed.
    """
    too_long = raw_left_out(run, kind)
    if parts is None:
        parts = [part for part in PARTS if part != "raw" or not too_long]
    elif too_long and "raw" in parts:
        raise ExportError(f"{too_long}: take csv or parquet, or leave the raw data out")
    if run.path.name != run.path.name.encode(errors="replace").decode():
        raise ExportError(f"{visible_text(run.path.name)} has a name that is not UTF-8 text; rename it")
    written: list[Path] = []
    try:
        with translate_read_errors(run.path):  # errors of reading mean damage; errors of the format are raised outside
            files = list(_files(run, kind, parts))
        folder.mkdir(parents=True, exist_ok=True)
        for name, write in files:
            with replacing(folder / name) as working:
                write(working, progress)
            written.append(folder / name)
    except OperationCancelled:
        pass
    except ModuleNotFoundError as error:
        raise ExportError(
            f"{kind} needs the library {error.name}, which is not installed; install it with: pip install 'tactor-bench[formats]', "
            "or take another format"
        ) from None
    except OSError as error:
        raise ExportError(f"{folder} cannot be written to: {error.strerror or error}; choose another folder") from None
    except (ValueError, TypeError, OverflowError) as error:  # a text that cannot be encoded is a ValueError
        raise ExportError(
            f"{kind} cannot hold the contents of {run.path.name}: {error}; take another format"
        ) from error
    return written


def _files(run: ExportedRun, kind: Format, parts: Sequence[Part]) -> Iterator[tuple[str, FileWriter]]:
    """Yield the name of each file and the function that writes it, with everything read but the raw samples."""
    stem = run.path.stem + ("_SIMULATED" if run.record.simulated else "")
    if kind in ("csv", "parquet"):
        write = write_csv if kind == "csv" else write_parquet
        for part in parts:
            tables: Iterable[Table | None] = (None,) if part == "raw" else part_tables(run, part)
            for table in tables:
                yield f"{stem}_{part if table is None else table.name}.{kind}", partial(write, run, table)
        return
    writer = WRITERS[kind](run, parts)
    yield f"{stem}_v73.mat" if kind == "mat73" else f"{stem}.{kind}", writer
