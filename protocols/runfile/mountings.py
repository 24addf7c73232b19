"""Mountings of a specimen: all of them in a small JSON file beside its runs, and the present ones in each run file."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from protocols.base import SpecimenMounted, event_record, read_json_file, visible_values, write_atomic
from protocols.runfile.errors import NotesError
from protocols.runfile.fields import read_object
from protocols.runfile.names import mountings_path

if TYPE_CHECKING:
    import h5py

MAX_MOUNTINGS_BYTES = 4000
"""Longest text of the mountings in a run file."""


def mountings_text(mountings: Sequence[SpecimenMounted]) -> str:
    """Return the mountings as JSON for a run file; without names of operators if it would be too long."""
    text = json.dumps({"mountings": [event_record(each) for each in mountings]}, ensure_ascii=False, allow_nan=False)
    if len(text.encode("utf-8", "replace")) <= MAX_MOUNTINGS_BYTES:
        return text
    return mountings_text([replace(each, who="") for each in mountings])


def read_mounting_state(entry: "h5py.Group") -> tuple[SpecimenMounted, ...]:
    """Return the mountings in a run file; none in files of earlier versions."""
    stored = read_object(entry, "mountings")["mountings"] if "mountings" in entry else ()
    return tuple(SpecimenMounted.from_record(each) for each in stored)


def read_mountings(folder: Path, specimen: str) -> tuple[SpecimenMounted, ...]:
    """Return every mounting of a specimen, the oldest first; none without a file.

    Raises:
        NotesError: the file exists and is not understood.
    """
    path = mountings_path(folder, specimen)
    try:
        record = visible_values(read_json_file(path))
        if record["specimen"] != specimen:
            raise ValueError(f"it is of specimen {record['specimen']}")
        return tuple(SpecimenMounted.from_record(each) for each in record["mountings"])
    except (FileNotFoundError, NotADirectoryError):  # the latter is told when the run file is created
        return ()
    except (OSError, ValueError, TypeError, AttributeError, LookupError) as error:
        raise NotesError(
            f"the mountings {path} cannot be read ({error}); correct the file or take it away, the runs are untouched"
        ) from None


def add_mounting(folder: Path, specimen: str, mounting: SpecimenMounted) -> Path:
    """Add a mounting to the file of a specimen, and return its path.

    Raises:
        NotesError: the file cannot be written, or the existing file is not understood and would be lost.
    """
    every, path = (*read_mountings(folder, specimen), mounting), mountings_path(folder, specimen)
    record = {"specimen": specimen, "mountings": [event_record(each) for each in every]}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, json.dumps(record, indent=1, ensure_ascii=False) + "\n")
    except OSError as error:
        raise NotesError(f"the mountings {path} cannot be written: {error.strerror or error}") from None
    return path
