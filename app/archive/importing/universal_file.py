"""Universal File reader: the frequency response of displacement over drive voltage in data set 58, read with pyuff."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from app.archive.importing.import_table import ImportTable, TableColumn
from app.common import truncate_text
from model import Array
from protocols.base import TableImportError

START = re.compile(rb"\s{0,4}-1\s*\r?\n\s{0,5}\d{1,4}b?[\s\d]*\r?\n")
"""Delimiter and number of the first data set."""
BINARY_SET = re.compile(rb"^\s{0,4}58b", re.MULTILINE)
"""Data sets whose bytes may contain a delimiter by chance."""
GENERAL, FREQUENCY_RESPONSE = 0, 4
"""Function types of data set 58. This program's exports have the standard uncertainty as a general function."""
DERIVATIVES = {8: 0, 11: 1, 12: 2}
"""Specific data types displacement, velocity and acceleration: how often the displacement is differentiated."""
MILLIMETRE_CODES = {5: 1e-3, 8: 1e-3, 6: 1e-2, 2: 0.3048, 4: 0.3048, 7: 0.0254}
"""Metres in the unit of length of a units code of data set 164; 1 otherwise."""
DRIVE_AMPLITUDE = re.compile(r"drive amplitude ([0-9.e+-]+) V")


def is_universal_file(data: bytes) -> bool:
    """Return whether the file begins like a Universal File."""
    return START.match(data[:400]) is not None


def read_universal_file(path: Path, data: bytes) -> ImportTable:
    """Read the only frequency response of a Universal File.

    Raises:
        TableImportError: it cannot be read, has no or several responses, or a response of other quantities.
    """
    delimiters = [line.strip() for line in data.splitlines()].count(b"-1")
    if not data.rstrip().endswith(b"-1") or (delimiters % 2 and BINARY_SET.search(data) is None):
        raise TableImportError(
            f"{path} is a Universal File that is cut off: its last data set has no end; copy it again"
        )
    sets = _read_sets(path)
    response = _only_response(path, sets)
    metres = next((MILLIMETRE_CODES.get(int(s.get("units_code", 1)), 1.0) for s in sets if s.get("type") == 164), 1.0)
    frequency_hz = np.asarray(response["x"], float)
    if not frequency_hz.size == np.size(response["data"]) == int(response["num_pts"]):
        raise TableImportError(
            f"{path}: the response has {np.size(response['data'])} values, and its header says {response['num_pts']}; copy it again"
        )
    receptance = metres * np.asarray(response["data"], complex) / _differentiation(path, response, frequency_hz)
    columns = [
        _column("frequency", "Hz", frequency_hz),
        _column("receptance", "m/V", np.abs(receptance)),
        _column("phase", "rad", np.angle(receptance)),
    ]
    text = " ".join(str(response.get(f"id{i}", "")) for i in range(1, 6))
    if match := DRIVE_AMPLITUDE.search(text):
        columns.append(_column("drive_amplitude", "V", np.full(frequency_hz.size, float(match[1]))))
    about: dict[str, Any] = {"simulated": 1} if "SIMULATED" in text else {}
    for each in sets:
        if each.get("type") == 151 and (name := str(each.get("model_name", "")).strip()) not in ("", "NONE"):
            about["specimen"] = name
        if _is_uncertainty(each, response):
            columns.append(_column("receptance_errors", "m/V", metres * np.asarray(each["data"], float)))
    rows = range(1, frequency_hz.size + 1)
    return ImportTable(path, tuple(columns), rows, "line {} of the response", metadata=about)


def _only_response(path: Path, sets: list[dict[str, Any]]) -> dict[str, Any]:
    responses = [each for each in sets if each.get("type") == 58 and each.get("func_type") == FREQUENCY_RESPONSE]
    if len(responses) == 1:
        return responses[0]
    count = (
        f"{len(responses)} frequency responses" if responses else "no frequency response (data set 58, function type 4)"
    )
    raise TableImportError(f"{path} has {count}; give a file with one")


def _is_uncertainty(one: dict[str, Any], response: dict[str, Any]) -> bool:
    """Whether a data set is the statistical standard uncertainty of all values of a response."""
    same = one.get("type") == 58 and one.get("func_id") == response.get("func_id")
    title = str(one.get("id1", "")) if same and one.get("func_type") == GENERAL else ""
    return "uncertainty" in title and "(total)" not in title and np.size(one["data"]) == np.size(response["data"])


def _read_sets(path: Path) -> list[dict[str, Any]]:
    import pyuff

    try:
        sets = pyuff.UFF(str(path)).read_sets()
    except Exception as error:  # noqa: BLE001 - pyuff raises bare exceptions, and any error by a damaged file
        raise TableImportError(
            f"{path} is not a readable Universal File ({truncate_text(str(error))}); export it again, or save a table as CSV"
        ) from None
    return [sets] if isinstance(sets, dict) else list(sets)


def _differentiation(path: Path, response: dict[str, Any], frequency_hz: Array) -> Any:
    """Return the factor between the response's quantity and displacement, and refuse responses to anything but volts."""
    ordinate, unit = (
        int(response.get("ordinate_spec_data_type", 0)),
        str(response.get("orddenom_axis_units_lab", "")).strip(),
    )
    if ordinate not in DERIVATIVES:
        raise TableImportError(
            f"{path}: the ordinate has the specific data type {ordinate}; a response of displacement (8), velocity (11) or acceleration (12) is needed"
        )
    if unit.casefold() not in ("v", "volt", "volts"):
        raise TableImportError(
            f"{path}: the response is per '{unit or 'NONE'}'; a response per volt at the amplifier's input is needed (label of the denominator: V)"
        )
    return (2j * np.pi * frequency_hz) ** DERIVATIVES[ordinate]


def _column(name: str, unit: str, values: Array) -> TableColumn:
    return TableColumn(f"{name} [{unit}]", name, unit, values.tolist())
