"""Study file: values of a parameter study in one HDF5 file, written chunk by chunk.

`/entry/data` (NXdata) holds the values over their named axes, with units, so that a NeXus viewer shows a plot;
`/entry/parameters` holds the fixed parameters, `/entry/process` the program, its versions and the study's description. The file
has a working name during the computation; a file under its final name is complete.
"""

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from math import prod
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from model import variable_specs
from model.studies import MEASURE_UNITS, Axis, Study
from protocols.runfile.creation import create_group, software_versions
from protocols.runfile.errors import READ_FAILURES, StorageError, translate_write_errors
from protocols.runfile.foreign_file_check import StructureError, check_structure
from protocols.runfile.schema import RESERVE_BYTES

FORMAT = "tactor-bench-study"
FORMAT_VERSION = 1


@dataclass(frozen=True, slots=True)
class StudyParameter:
    """A fixed parameter: SI value, unit, description."""

    name: str
    value: float
    unit: str
    description: str = ""


@dataclass(frozen=True, slots=True)
class StudyHeader:
    """Metadata of a study, before its computation."""

    title: str
    signal: str
    unit: str
    axes: tuple[Axis, ...]
    complex: bool = False
    parameters: tuple[StudyParameter, ...] = ()
    description: Mapping[str, Any] | None = None

    @classmethod
    def of(cls, study: Study) -> Self:
        """Return the header of a study."""
        specs = variable_specs()
        return cls(
            title=study.title,
            signal=study.measure,
            unit=MEASURE_UNITS[study.measure],
            axes=study.axes,
            complex=study.measure == "receptance",
            parameters=tuple(StudyParameter(n, v, specs[n].unit, specs[n].description) for n, v in study.fixed.items()),
            description={
                "measure": study.measure,
                "n": study.n,
                "amplitude_v": study.amplitude_v,
                "offset_v": study.offset_v,
                "amplifier": asdict(study.amplifier),
            },
        )

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis."""
        return tuple(len(axis.values) for axis in self.axes)


class StudyFileWriter:
    """Writes a study file as a context manager; an error leaves no file."""

    def __init__(self, path: Path, header: StudyHeader) -> None:
        """Create the file under its working name.

        Raises:
            StorageError: the folder, the disk or an existing file prevents it.
        """
        check_output_path(path)
        names = [header.signal, *(axis.name for axis in header.axes)]
        if len({*names}) < len(names):
            raise StorageError(f"a study file needs names that differ, not {', '.join(names)}; rename one")
        need = prod(header.shape) * (16 if header.complex else 8) + RESERVE_BYTES
        free = shutil.disk_usage(path.parent).free
        if free < need:
            raise StorageError(
                f"the study needs {need / 1e6:.0f} MB but the disk of {path.parent} has {free / 1e6:.0f} MB left; "
                "free some space, choose another folder, or vary less"
            )
        self.path, self._partial_path = path, path.with_name(path.name + ".part")
        self._shape = header.shape
        with translate_write_errors("study", self.path, "choose another place"):
            self._file = h5py.File(self._partial_path, "w")
            self._values = self._create(header)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            with translate_write_errors("study", self.path, "choose another place"):
                self._file.close()
                if error is None:
                    self._partial_path.replace(self.path)
        finally:
            self._partial_path.unlink(missing_ok=True)

    def write(self, start: int, block: NDArray[Any]) -> None:
        """Store rows `start`.. of the values, shape (sets, last axis), in the order of their index.

        Raises:
            StorageError: the disk rejects the data.
        """
        with translate_write_errors("study", self.path, "choose another place"):
            row = 0
            for box in index_slices(start, start + len(block), self._shape[:-1]):
                shape = tuple(s.stop - s.start for s in box)
                count = prod(shape)
                self._values[(*box, slice(None))] = block[row : row + count].reshape(*shape, self._shape[-1])
                row += count

    def _create(self, header: StudyHeader) -> h5py.Dataset:
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self._file.attrs.update({"NX_class": "NXroot", "default": "entry", "creator": "tactor-bench", "file_time": now})
        self._file.attrs.update({"format": FORMAT, "format_version": FORMAT_VERSION})
        entry = create_group(self._file, "entry", "NXentry", default="data")
        entry["title"] = header.title
        process = create_group(entry, "process", "NXprocess")
        versions = software_versions()
        process["program"], process["version"] = "tactor-bench", versions["tactor-bench"]
        process["software"] = json.dumps(versions)
        process["study"] = json.dumps(dict(header.description or {}))
        parameters = create_group(entry, "parameters", "NXcollection")
        for p in header.parameters:
            parameters[p.name] = p.value
            parameters[p.name].attrs.update({"units": p.unit, "long_name": p.description})
        data = create_group(entry, "data", "NXdata", signal=header.signal, axes=[axis.name for axis in header.axes])
        for i, axis in enumerate(header.axes):
            data[axis.name] = np.asarray(axis.values, float)
            data[axis.name].attrs.update({"units": axis.unit, "long_name": _long_name(axis.name, axis.unit)})
            data.attrs[f"{axis.name}_indices"] = [i]
        values = data.create_dataset(header.signal, header.shape, "c16" if header.complex else "f8")
        values.attrs.update({"units": header.unit, "long_name": _long_name(header.signal, header.unit)})
        return values


@dataclass(frozen=True, slots=True)
class LoadedStudy:
    """A study as read: values over `axes`, the last of them frequency."""

    title: str
    signal: str
    unit: str
    axes: tuple[Axis, ...]
    values: NDArray[Any]
    parameters: tuple[StudyParameter, ...]
    description: Mapping[str, Any]
    software: Mapping[str, str]


def read_study(path: Path) -> LoadedStudy:
    """Read a study file.

    Raises:
        StorageError: it is missing, damaged, of another kind or of a newer version.
    """
    try:
        with h5py.File(path) as file:
            check_structure(file, path)
            if file.attrs.get("format") != FORMAT:
                raise StorageError(
                    f"{path} is not a study of this program; give a file that 'tactor-bench study --out' wrote"
                )
            if file.attrs["format_version"] > FORMAT_VERSION:
                raise StorageError(f"{path} was written by a newer version of this program; update it")
            entry, data = file["entry"], file["entry/data"]
            signal = str(data.attrs["signal"])
            axes = (Axis(n, str(data[n].attrs["units"]), tuple(data[n][:].tolist())) for n in data.attrs["axes"])
            parameters = (
                StudyParameter(n, float(p[()]), str(p.attrs["units"]), str(p.attrs["long_name"]))
                for n, p in entry["parameters"].items()
            )
            return LoadedStudy(
                entry["title"].asstr()[()],
                signal,
                str(data[signal].attrs["units"]),
                tuple(axes),
                data[signal][...],
                tuple(parameters),
                json.loads(entry["process/study"].asstr()[()]),
                json.loads(entry["process/software"].asstr()[()]),
            )
    except (*READ_FAILURES, StructureError) as error:
        raise StorageError(f"{path} cannot be read as a study: {error}") from error


def check_output_path(path: Path) -> None:
    """Reject an output path without a folder, or with an existing file other than a study.

    Raises:
        StorageError: the reason and the remedy.
    """
    if not path.parent.is_dir():
        raise StorageError(f"{path} cannot be written: there is no folder {path.parent}; create it or choose another")
    if path.exists():
        try:
            with h5py.File(path) as file:
                ours = file.attrs.get("format") == FORMAT
        except OSError:
            ours = False
        if not ours:
            raise StorageError(f"{path} exists and is not a study, so it is not overwritten; choose another name")


def index_slices(start: int, stop: int, shape: Sequence[int]) -> Iterator[tuple[slice, ...]]:
    """Yield the flat indices start..stop of an array as few slices, in order."""
    if start >= stop:
        return
    if not shape:
        yield ()
        return
    row = prod(shape[1:])
    first, last = -(-start // row), stop // row
    if first > last:  # all within one row
        yield from (
            (slice(last, last + 1), *box) for box in index_slices(start - last * row, stop - last * row, shape[1:])
        )
        return
    if start < first * row:
        yield from ((slice(first - 1, first), *box) for box in index_slices(start - (first - 1) * row, row, shape[1:]))
    if first < last:
        yield (slice(first, last), *(slice(0, n) for n in shape[1:]))
    yield from ((slice(last, last + 1), *box) for box in index_slices(0, stop - last * row, shape[1:]))


def _long_name(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name
