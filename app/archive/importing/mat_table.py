"""MAT file reader: named vectors, a structure of vectors, or an export of this program."""

import importlib.util
import pickle
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from app.archive.importing.import_table import ImportTable, TableColumn, split_heading
from app.common import truncate_text
from drivers import Deadline
from drivers.watchdog import python_command, python_environment
from protocols.base import TableImportError


def read_mat_table(path: Path) -> ImportTable:
    """Read the table of a MAT file.

    Raises:
        TableImportError: it cannot be read, or holds no vectors.
    """
    _check_sizes(path)
    return _table(path, _load_mat(path, READER_SCRIPT))


def read_mat73_table(path: Path) -> ImportTable:
    """Read the table of a MAT file of version 7.3, which is HDF5.

    Raises:
        TableImportError: it cannot be read, holds no vectors, or hdf5storage is not installed.
    """
    if importlib.util.find_spec("hdf5storage") is None:
        raise TableImportError(
            f"{path} is a MATLAB file of version 7.3, which needs the library hdf5storage; install it with: pip install 'tactor-bench[formats]', "
            "or save the file again: save('file.mat', '-v7')"
        )
    return _table(path, _load_mat(path, READER_SCRIPT_73))


def _table(path: Path, whole: Mapping[str, Any]) -> ImportTable:
    named = {name: value for name, value in whole.items() if not name.startswith("__")}
    structures = {name: value for name, value in named.items() if isinstance(value, dict)}
    table = named
    if "points" in structures:
        table = structures["points"]
    elif not any(_is_vector(value) for value in named.values()) and len(structures) == 1:
        table = next(iter(structures.values()))
    units = table.get("units", {}) if isinstance(table.get("units"), dict) else {}
    vectors = dict(_vector_columns(table, "points" in structures))
    if not vectors:
        have = ", ".join(named) or "nothing"
        raise TableImportError(
            f"{path} holds no vectors of numbers (it has: {have}); save the columns as vectors: save('file.mat', 'frequency_Hz', ...)"
        )
    columns = []
    for head, values in vectors.items():
        name, unit = split_heading(head)
        stem = head if head in units else head.rpartition("_")[0]
        if stem in units:
            name, unit = head, str(units[stem])
        columns.append(TableColumn(head, name, unit, values))
    longest = max(len(column.cells) for column in columns)
    about = structures.get("about", {}) if "points" in structures else {}
    return ImportTable(path, tuple(columns), range(1, longest + 1), "element {}", metadata=about)


MATRIX_TYPE, COMPRESSED_TYPE = 14, 15
"""MAT element types: container, and compressed without padding to 8 bytes."""

READER_SCRIPT = """import pickle, sys
from scipy.io import loadmat
sys.stdout.buffer.write(pickle.dumps(loadmat(sys.argv[1], simplify_cells=True)))"""
"""Run in a separate process: scipy's reader crashes on some damaged files."""
READER_SCRIPT_73 = """import pickle, sys
import numpy
from hdf5storage import loadmat
from protocols.runfile.foreign_file_check import check_file_structure

def plain(value):
    # A structure is a mapping, or an array of one record; vectors have two dimensions.
    if isinstance(value, dict):
        return {str(name): plain(each) for name, each in value.items()}
    value = numpy.asarray(value)
    if value.dtype.names:
        record = value.reshape(-1)[0]
        return {name: plain(record[name]) for name in value.dtype.names}
    if value.dtype == object:
        return plain(value.reshape(-1)[0]) if value.size == 1 else None
    if value.dtype.kind in 'US':
        return ''.join(map(str, value.reshape(-1)))
    return value.item() if value.size == 1 else value.squeeze()

check_file_structure(sys.argv[1])
named = {name: plain(value) for name, value in loadmat(sys.argv[1]).items()}
sys.stdout.buffer.write(pickle.dumps({name: value for name, value in named.items() if value is not None}))"""
"""As READER_SCRIPT, for version 7.3; links to other files and sizes beyond the file are refused before anything is read."""


def _load_mat(path: Path, script: str) -> dict[str, Any]:
    """Read a MAT file in a separate process."""
    try:
        done = subprocess.run(  # noqa: S603 - this very Python, and our own text
            python_command("-c", script, str(path.resolve())),
            env=python_environment(),
            capture_output=True,
            timeout=Deadline.MAT_READER.seconds,
            check=False,
        )
        if done.returncode == 0:
            return dict(pickle.loads(done.stdout))  # noqa: S301 - from the text above
        reason = done.stderr.decode(errors="replace").strip().rpartition("\n")[2] or "its reader crashed"
    except (subprocess.TimeoutExpired, pickle.UnpicklingError, EOFError):
        reason = "it cannot be read to its end"
    raise TableImportError(
        f"{path} is not a readable MAT file ({truncate_text(reason)}); save it again: save('file.mat', '-v7')"
    )


def _check_sizes(path: Path) -> None:
    """Reject elements longer than their container: scipy allocates the declared size before it reads."""
    data = path.read_bytes()
    order: Literal["little", "big"] = "big" if data[126:128] == b"MI" else "little"
    inside = [(128, len(data))]
    while inside:
        at, stop = inside.pop()
        while at + 8 <= stop:
            kind, size = (int.from_bytes(data[at + i : at + i + 4], order) for i in (0, 4))
            at += 8
            if kind >> 16:  # a short one, its value within its tag
                continue
            if size > stop - at:
                raise TableImportError(
                    f"{path} is cut off or damaged, {size - stop + at} bytes are missing; copy it again"
                )
            if kind == MATRIX_TYPE:
                inside.append((at, at + size))
            at += size if kind == COMPRESSED_TYPE else -(-size // 8) * 8


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "iufb" and value.size > 1


def _vector_columns(table: Mapping[str, Any], single_row: bool) -> Iterator[tuple[str, Sequence[float]]]:
    """Return columns by name, matrices split by column; with `single_row`, scalars form a table of one row."""
    single = single_row and any(np.ndim(value) == 0 and isinstance(value, int | float) for value in table.values())
    for name, value in table.items():
        if isinstance(value, dict | str) or np.asarray(value).dtype.kind not in "iufb":
            continue
        values = np.asarray(value, float)
        if single:
            values = values.reshape(1, -1) if values.size > 1 else values.reshape(1)
        if values.ndim == 2:
            yield from ((f"{name}_{i}", values[:, i - 1].tolist()) for i in range(1, values.shape[1] + 1))
        elif values.ndim == 1:
            yield name, values.tolist()
