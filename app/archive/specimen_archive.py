"""One archive file of a specimen and back: an `.eln` file, which is a zipped RO-Crate with the hash of every file.

Formats: "Specification for the ELN file format" of The ELN Consortium, and RO-Crate 1.1 (w3id.org/ro/crate/1.1). Each run is a
data set of its own, so that electronic lab notebooks import it as an experiment.
"""

import json
import shutil
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any

from app.archive.backup import COPY_CHUNK_BYTES, CopyResult, copy_stream
from app.archive.provenance import (
    SPECIMEN_ID,
    Provenance,
    certificate_files,
    people_of,
    photograph_files,
    provenance_of,
)
from app.archive.run_summary import RunState, RunSummary
from app.common import NO_PROGRESS, Progress
from app.config import CERTIFICATES
from drivers import open_regular
from drivers.watchdog import version
from model import format_time
from protocols.base import file_hash, replacing, visible_text
from protocols.runfile import notes_path, safe_name

SUFFIX = ".eln"
METADATA_NAME = "ro-crate-metadata.json"
SPECIMEN_FOLDER = "specimen"
"""Of the files that belong to no run: sheet, calibrations, campaign, audit trail, report."""

MAX_METADATA_BYTES = 50_000_000
"""Largest size of the metadata, which are read into memory; no specimen has more."""
MAX_PACKING_RATIO = 1100
"""Deflate packs at most 1032 to 1; a file that declares more is a trap."""
MEDIA_TYPES = {
    ".h5": "application/x-hdf5",
    ".json": "application/json",
    ".toml": "application/toml",
    ".pdf": "application/pdf",
    ".html": "text/html",
}
NO_LICENCE = "#no-licence"


class ArchiveError(Exception):
    """An archive cannot be written or read; the message gives file, reason and remedy."""


def write_archive(
    folder: Path,
    specimen: str,
    runs: Sequence[RunSummary],
    documents: Sequence[Path],
    archive: Path,
    licence: str = "",
    progress: Progress = NO_PROGRESS,
) -> Path:
    """Write the runs of a specimen with their notes, and further documents, into one archive file.

    Args:
        folder: folder of the runs.
        specimen: its name.
        runs: runs of the specimen; the paths are relative to the folder.
        documents: sheet, calibrations, campaign, report.
        archive: replaced if it exists.
        licence: address of a licence; empty for none.
        progress: an exception that it raises leaves an earlier archive as it was.

    Raises:
        ArchiveError: there are no runs, one is being written, two have the same name, or a file cannot be read or written.
        OperationCancelled: `progress` is cancelled.
    """
    _check_runs(folder, specimen, runs)
    members: dict[str, list[Path]] = {}
    for run in runs:
        path = folder / run.path
        members[path.stem] = [each for each in (path, notes_path(path)) if each.is_file()]
    if documents := (*documents, *photograph_files(folder, specimen)):
        members[SPECIMEN_FOLDER] = list(documents)
    if certificates := certificate_files(folder):
        members[CERTIFICATES] = certificates
    root = archive.name.removesuffix(SUFFIX)
    every = {f"{name}/{path.name}": path for name, part in members.items() for path in part}
    try:
        archive.parent.mkdir(parents=True, exist_ok=True)
        with (
            replacing(archive) as working,
            zipfile.ZipFile(working, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file,
        ):
            parts = progress.split_by_files(list(every.values()))
            files = {
                name: _add(file, f"{root}/{name}", path, part)
                for (name, path), part in zip(every.items(), parts, strict=True)
            }
            provenance = provenance_of(specimen, runs, folder)
            record = _crate(specimen, runs, members, files, licence, provenance)
            file.writestr(f"{root}/{METADATA_NAME}", json.dumps(record, indent=1, ensure_ascii=False))
    except OSError as error:
        raise ArchiveError(
            f"{archive} cannot be written: {error.strerror or error}; free space there, or choose another place with --out"
        ) from None
    return archive


def _check_runs(folder: Path, specimen: str, runs: Sequence[RunSummary]) -> None:
    if not runs:
        raise ArchiveError(
            f"there are no runs of {specimen} in {folder}; 'tactor-bench runs {folder}' lists the existing ones"
        )
    if running := [run.name for run in runs if run.state == RunState.RUNNING]:
        raise ArchiveError(f"{running[0]} is being written; wait until the run has ended")
    names = [run.name for run in runs]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ArchiveError(f"there are several files {twice[0]} below {folder}; move all but one of them away")


def restore_archive(archive: Path, folder: Path, progress: Progress = NO_PROGRESS) -> CopyResult:
    """Put the files of an archive into a folder, each after its hash was verified. No file is replaced.

    Raises:
        ArchiveError: it is not an archive of a specimen, is damaged, or the folder has another file of the same name.
        OperationCancelled: `progress` is cancelled; complete files are kept.
    """
    restored, present = list[str](), list[str]()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with open_regular(archive) as whole, zipfile.ZipFile(whole) as file:
            entries = list(_entries(archive, file))
            needed = sum(info.file_size for info, _, _ in entries)
            if needed > shutil.disk_usage(folder).free:
                raise ArchiveError(
                    f"{archive} needs {needed / 1e6:.0f} MB, which {folder} does not have; free space there"
                )
            for number, (info, name, sha256) in enumerate(entries):
                progress.raise_if_cancelled()
                progress.update(number / len(entries), name)
                target = folder / name
                target.parent.mkdir(exist_ok=True)
                if target.exists():
                    if file_hash(target) != sha256:
                        raise ArchiveError(
                            f"{folder} has another file {name} than {archive}; restore into an empty folder with --folder"
                        )
                    present.append(name)
                    continue
                with replacing(target) as working:
                    with file.open(info) as source, working.open("wb") as copy:
                        result = copy_stream(source, copy, progress)
                    if result != sha256:
                        raise ArchiveError(
                            f"{archive}: {info.filename} is damaged, its SHA-256 is another; take another copy"
                        )
                restored.append(name)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise ArchiveError(f"{archive} is damaged ({error}); take another copy of it") from None
    except OSError as error:
        raise ArchiveError(
            f"{error.filename or archive}: {error.strerror or error}; choose another file or folder"
        ) from None
    return CopyResult(tuple(restored), tuple(present))


def _entries(archive: Path, file: zipfile.ZipFile) -> Iterator[tuple[zipfile.ZipInfo, str, str]]:
    """Yield the files that the metadata list, with name and SHA-256.

    Raises:
        ArchiveError: metadata or a listed file are missing, declare impossible sizes, or share a name.
    """
    infos = {info.filename: info for info in file.infolist()}
    metadata = [name for name in infos if PurePosixPath(name).name == METADATA_NAME and name.count("/") == 1]
    if len(metadata) != 1 or infos[metadata[0]].file_size > MAX_METADATA_BYTES:
        raise ArchiveError(f"{archive} is not the archive of a specimen: it has no {METADATA_NAME} in one folder")
    root = metadata[0].partition("/")[0]
    try:
        graph = json.loads(file.read(metadata[0]))["@graph"]
        listed = {str(e["@id"]): str(e["sha256"]) for e in graph if e.get("@type") == "File" and "sha256" in e}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ArchiveError(f"{archive}: {METADATA_NAME} cannot be understood ({error}); take another copy") from None
    names = set[str]()
    for identifier, sha256 in listed.items():
        info = infos.get(f"{root}/{identifier.removeprefix('./')}")
        name = PurePosixPath(identifier).name
        place = f"{CERTIFICATES}/" if PurePosixPath(identifier) == PurePosixPath(CERTIFICATES) / name else ""
        if info is None:
            raise ArchiveError(f"{archive}: {identifier} is listed and missing; take another copy")
        # Only the name is used, so that no path leaves the folder, without characters that Windows and terminals reject.
        if name in ("", ".", "..") or name in names or "\\" in name or ":" in name or name != visible_text(name):
            raise ArchiveError(f"{archive}: {visible_text(identifier)} has no usable name, or the name of another file")
        if info.file_size > MAX_PACKING_RATIO * max(info.compress_size, 1):
            raise ArchiveError(f"{archive}: {identifier} declares {info.file_size} bytes, which cannot be packed in it")
        names.add(name)
        yield info, place + name, sha256


def _add(file: zipfile.ZipFile, name: str, path: Path, progress: Progress) -> dict[str, Any]:
    """Copy a file into the archive and return its size and hash as they were copied."""
    info = zipfile.ZipInfo.from_file(path, name, strict_timestamps=False)
    info.compress_type = zipfile.ZIP_DEFLATED
    with path.open("rb") as source, file.open(info, "w", force_zip64=info.file_size > COPY_CHUNK_BYTES) as target:
        sha256 = copy_stream(source, target, progress, info.file_size)
        size = source.tell()
    return {"contentSize": str(size), "sha256": sha256}


def _crate(
    specimen: str,
    runs: Sequence[RunSummary],
    members: Mapping[str, Sequence[Path]],
    files: Mapping[str, Mapping[str, Any]],
    licence: str,
    provenance: Provenance,
) -> dict[str, Any]:
    """Return the RO-Crate metadata: the archive, people, instruments, the specimen, a data set for each run, and every file."""
    simulated = [run for run in runs if run.simulated]
    mark = "SIMULATED: " if len(simulated) == len(runs) else "partly SIMULATED: " if simulated else ""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    root = {
        "name": f"{mark}specimen {specimen}",
        "description": f"{mark}{len(runs)} runs of the tactor {specimen}, with what was identified from them",
        "author": provenance.authors,
        "contributor": provenance.checkers,
        "about": {"@id": SPECIMEN_ID},
        "mentions": provenance.measurements,
        "hasPart": [{"@id": f"./{name}/"} for name in members] + [{"@id": f"./{name}"} for name in files],
    }
    graph = _heads(root, now, licence)
    values: list[dict[str, Any]] = []
    by_stem = {PurePosixPath(run.path).stem: run for run in runs}
    for name, part in members.items():
        record: dict[str, Any] = {
            "@id": f"./{name}/",
            "@type": "Dataset",
            "hasPart": [{"@id": f"./{name}/{path.name}"} for path in part],
        }
        if (run := by_stem.get(name)) is None:
            title = (
                f"{specimen}: {'certificates' if name == CERTIFICATES else 'sheet, calibrations, campaign and report'}"
            )
            record |= {"name": mark + title, "dateCreated": now, "author": provenance.authors}
        else:
            record |= _describe_run(run, values) | {
                "author": people_of([run.operator]),
                "contributor": people_of(run.checked_by.split(", ")),
            }
        graph.append(record)
        graph += [
            {
                "@id": f"./{name}/{path.name}",
                "@type": "File",
                "name": path.name,
                "encodingFormat": MEDIA_TYPES.get(path.suffix, "application/octet-stream"),
                **files[f"{name}/{path.name}"],
            }
            for path in part
        ]
    return {"@context": "https://w3id.org/ro/crate/1.1/context", "@graph": graph + values + list(provenance.entities)}


def _heads(root: Mapping[str, Any], now: str, licence: str) -> list[dict[str, Any]]:
    """Return the entities of the metadata file, the archive, the program and the licence."""
    metadata = {"@id": METADATA_NAME, "@type": "CreativeWork", "about": {"@id": "./"}, "dateCreated": now}
    crate = {"conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"}, "sdPublisher": {"@id": "#tactor-bench"}}
    dataset = {"@id": "./", "@type": "Dataset", "datePublished": now, "license": {"@id": licence or NO_LICENCE}}
    return [
        metadata | crate,
        dataset | dict(root),
        {"@id": "#tactor-bench", "@type": "SoftwareApplication", "name": "Tactor Bench", "version": version()},
        {
            "@id": licence or NO_LICENCE,
            "@type": "CreativeWork",
            "name": licence or "no licence given",
            "description": "" if licence else "The owner of the data gave no licence; ask before they are used.",
        },
    ]


def _describe_run(run: RunSummary, values: list[dict[str, Any]]) -> dict[str, Any]:
    """Return name, date, verdict, tags and note of a run; its results are appended to `values`."""
    mark = "SIMULATED " if run.simulated else ""
    identifiers = []
    for number, estimate in enumerate(run.record.estimates):
        identifiers.append({"@id": f"#{safe_name(run.name)}-{number}"})
        values.append(
            {
                **identifiers[-1],
                "@type": "PropertyValue",
                "name": estimate.name,
                "value": estimate.value,
                "unitText": estimate.unit,
                "description": f"standard error {estimate.standard_error}",
            }
        )
    keywords = [*(tag for tag in run.tags.split(",") if tag), run.protocol, *(["SIMULATED"] if run.simulated else [])]
    return {
        "name": f"{mark}{run.protocol} of {run.specimen}, {format_time(run.start_time)}",
        "dateCreated": run.start_time,
        "description": f"{run.verdict_text}{f': {run.verdict_reasons}' if run.verdict_reasons else ''}",
        "text": run.note or run.estimates_text,
        "keywords": ", ".join(keywords),
        "variableMeasured": identifiers,
    }
