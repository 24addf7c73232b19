"""Export of a run for other programs, in SI units with units in every header.

File names of simulated runs contain SIMULATED.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Literal, get_args

from app.archive.exporting.parts import PARTS, ExportError, Part
from app.common import NO_PROGRESS, OperationCancelled, Progress, replacing
from protocols.runfile.reader import Run

Format = Literal["csv", "json", "mat", "mat73", "parquet", "xlsx", "uff"]
FORMATS: tuple[Format, ...] = get_args(Format)
FORMAT_NAMES: dict[Format, str] = {
    "csv": "CSV tables",
    "json": "JSON",
    "mat": "MATLAB (version 5)",
    "mat73": "MATLAB 7.3",
    "parquet": "Parquet",
    "xlsx": "Excel workbook",
    "uff": "Universal File (frequency response)",
}

PartWriter = Callable[[Run, Part, Path, Progress], None]
RunWriter = Callable[[Run, Sequence[Part], Path, Progress], None]

MAX_SCANS: dict[Format, int] = {"json": 20_000_000, "mat": 20_000_000, "mat73": 200_000_000, "xlsx": 1_000_000}
"""Limit of raw scans of formats that are held in memory whole, and of a worksheet's rows."""


def export_run(
    run: Run,
    folder: Path,
    kind: Format = "csv",
    parts: Sequence[Part] = PARTS,
    progress: Progress = NO_PROGRESS,
) -> list[Path]:
    """Write `parts` of a run into `folder` and return the files written. Files of the same names are replaced.

    CSV and Parquet make one file for each part, the others one file; a Universal File has the frequency responses
    whatever the parts. `progress` receives the completed share, 0 to 1. If it is cancelled, the unfinished file is removed.

    Raises:
        ExportError: a file cannot be written, the run is too long for the format or has nothing that the format holds,
            or the library for the format is not installed.
    """
    most = MAX_SCANS.get(kind)
    if most is not None and "raw" in parts and run.trace.sample_count > most:
        raise ExportError(
            f"{run.path.name} has {run.trace.sample_count} scans, and {kind} holds at most {most}: "
            "take csv or parquet, or leave the raw data out"
        )
    written: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, write in _files(run, kind, parts):
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
    return written


def _files(run: Run, kind: Format, parts: Sequence[Part]) -> Iterator[tuple[str, Callable[[Path, Progress], None]]]:
    """Yield the name of each file and the function that writes it."""
    stem = run.path.stem + ("_SIMULATED" if run.simulated else "")
    match kind:
        case "csv" | "parquet":
            write_part: PartWriter = _writer("text_files" if kind == "csv" else "parquet", f"write_{kind}")
            yield from ((f"{stem}_{part}.{kind}", partial(write_part, run, part)) for part in parts)
        case _:
            module = {
                "json": "text_files",
                "mat": "matlab",
                "mat73": "matlab",
                "xlsx": "workbook",
                "uff": "universal_file",
            }
            write_run: RunWriter = _writer(module[kind], f"write_{kind}")
            yield f"{stem}.{'mat' if kind == 'mat73' else kind}", partial(write_run, run, parts)


def _writer(module: str, name: str) -> Callable[..., None]:
    """Import a writer with the library of its format."""
    writer: Callable[..., None] = getattr(import_module(f"app.archive.exporting.{module}"), name)
    return writer
