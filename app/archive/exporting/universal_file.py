"""Export of frequency responses as a Universal File: data sets 151 (header), 164 (units) and 58 (functions).

Format: Structural Dynamics Research Corporation, "Universal Dataset Number 58: Function at Nodal DOF", kept by the University of
Cincinnati (ceas3.uc.edu/sdrluff); written with pyuff.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyuff

from app.archive.exporting.parts import ExportError, Part
from app.common import Progress, version
from model import Array
from protocols.base import usable_mask, visible_text
from protocols.runfile.reader import Run

ID_CHARACTERS = 80
"""Length of each of the five lines that identify a function."""
SPACING_TOLERANCE = 1e-6
"""Relative differences between steps that the six digits of the increment do not show."""

GENERAL, FREQUENCY_RESPONSE, COHERENCE = 0, 4, 6
"""Function types of data set 58; type 0 holds the standard uncertainty, for which the format has none."""
UNKNOWN_QUANTITY, GENERAL_QUANTITY, DISPLACEMENT_QUANTITY, FREQUENCY_QUANTITY = 0, 1, 8, 18
"""Specific data types of an axis in data set 58."""
MIN_FREQUENCIES = 2
"""What pyuff writes; one frequency is no curve."""
RESPONSE_NODE, DRIVE_NODE = 1, 2
"""The centre of the tactor, and the amplifier's input."""
NORMAL_DIRECTION, SCALAR_DIRECTION = 3, 0


@dataclass(frozen=True, slots=True)
class ResponseFunction:
    """A frequency response, (N,) each: complex displacement over drive (m/V), its standard uncertainty, coherence or None."""

    label: str
    frequency_hz: Array
    response: np.ndarray[tuple[int], np.dtype[np.complex128]]
    response_errors: Array
    coherence: Array | None = None
    drive_amplitude_v: float = math.nan


def write_uff(run: Run, _parts: Sequence[Part], path: Path, progress: Progress) -> None:
    """Write every frequency response of a run: its points over frequency, and its response curves.

    Raises:
        ExportError: it has none.
        OperationCancelled: `progress` is cancelled.
    """
    functions = [each for each in frequency_responses(run) if each.frequency_hz.size >= MIN_FREQUENCIES]
    if not functions:
        raise ExportError(
            f"{run.path.name} has no frequency response of {MIN_FREQUENCIES} or more frequencies, and a Universal File holds nothing else; take csv"
        )
    file = pyuff.UFF(str(path))
    sets = [_header(run), _units()]
    for number, function in enumerate(functions, 1):
        sets += _function_sets(run, function, number)
    for number, each in enumerate(sets):
        progress.raise_if_cancelled()
        file.write_sets(each, "add" if number else "overwrite")
        progress.update((number + 1) / len(sets))


def frequency_responses(run: Run) -> Iterator[ResponseFunction]:
    """Yield the frequency responses of a run; points that are not usable are left out."""
    points = run.points()
    if {"frequency", "fundamental", "phase", "drive_amplitude"} <= points.keys():
        usable = usable_mask(points["quality"])
        for name in ("fundamental", "phase", "drive_amplitude"):
            usable &= np.isfinite(points[name])
        order = np.flatnonzero(usable)[np.argsort(points["frequency"][usable], kind="stable")]
        if order.size:
            drive = points["drive_amplitude"][order]
            phase = points["phase"][order]
            yield ResponseFunction(
                "points",
                points["frequency"][order],
                points["fundamental"][order] / drive * np.exp(1j * phase),
                points["fundamental_errors"][order] / drive,
                drive_amplitude_v=float(np.median(drive)),
            )
    for curve in run.series():
        if curve.is_complex:
            errors = np.full(curve.x.size, math.nan) if curve.errors is None else curve.errors
            yield ResponseFunction(curve.title, curve.x, curve.y, errors, curve.coherence)


def _header(run: Run) -> dict[str, Any]:
    date, time = _date_and_time(run.start_time)
    return {
        "type": 151,
        "model_name": _line(run.specimen),
        "description": _line(f"{_mark(run)}{run.protocol}, {run.path.name}"),
        "db_app": "Tactor Bench",
        "program": _line(f"Tactor Bench {version()}"),
        # Times of the measurement, so that two exports of a run are equal.
        **dict.fromkeys(("date_db_created", "date_db_saved", "date_file_written"), date),
        **dict.fromkeys(("time_db_created", "time_db_saved", "time_file_written"), time),
    }


def _units() -> dict[str, Any]:
    return {
        "type": 164,
        "units_code": 1,
        "units_description": "SI: m, N, K",
        "temp_mode": 1,
        "length": 1.0,
        "force": 1.0,
        "temp": 1.0,
        "temp_offset": 0.0,
    }


def _function_sets(run: Run, function: ResponseFunction, number: int) -> Iterator[dict[str, Any]]:
    drive = f", drive amplitude {function.drive_amplitude_v:.6g} V" if math.isfinite(function.drive_amplitude_v) else ""
    lines = {
        "id2": _line(f"{_mark(run)}{run.specimen}, {run.protocol}, {function.label}"),
        "id3": _line(run.start_time),
        "id4": _line(run.path.name),
        "id5": _line(f"phase against the recorded drive{drive}"),
    }
    frequency_hz = function.frequency_hz
    common = lines | {
        "type": 58,
        "binary": 0,
        "load_case_id": 0,
        "rsp_ent_name": "CENTRE",
        "rsp_node": RESPONSE_NODE,
        "rsp_dir": NORMAL_DIRECTION,
        "ref_ent_name": "INPUT",
        "ref_node": DRIVE_NODE,
        "ref_dir": SCALAR_DIRECTION,
        "x": frequency_hz,
        "num_pts": frequency_hz.size,
        "abscissa_spacing": int(_evenly_spaced(frequency_hz)),
        "abscissa_min": float(frequency_hz[0]),
        "abscissa_inc": float(frequency_hz[1] - frequency_hz[0]),
        "abscissa_spec_data_type": FREQUENCY_QUANTITY,
        "abscissa_axis_lab": "Frequency",
        "abscissa_axis_units_lab": "Hz",
    }
    ratio = {
        "ordinate_spec_data_type": DISPLACEMENT_QUANTITY,
        "ordinate_len_unit_exp": 1,
        "ordinate_axis_lab": "Displacement",
        "ordinate_axis_units_lab": "m",
        "orddenom_spec_data_type": GENERAL_QUANTITY,
        "orddenom_axis_lab": "Drive",
        "orddenom_axis_units_lab": "V",
    }
    yield (
        common
        | ratio
        | {
            "func_type": FREQUENCY_RESPONSE,
            "func_id": number,
            "id1": "Frequency response: displacement of the centre / amplifier input voltage",
            "data": function.response,
        }
    )
    if np.isfinite(function.response_errors).any():
        yield (
            common
            | ratio
            | {
                "func_type": GENERAL,
                "func_id": number,
                "id1": "Standard uncertainty (statistical) of the modulus of the frequency response",
                "data": np.nan_to_num(function.response_errors, nan=0.0),
            }
        )
    if function.coherence is not None:
        yield common | {
            "func_type": COHERENCE,
            "func_id": number,
            "id1": "Coherence of displacement and drive",
            "ordinate_spec_data_type": UNKNOWN_QUANTITY,
            "ordinate_axis_lab": "Coherence",
            "orddenom_spec_data_type": UNKNOWN_QUANTITY,
            "data": function.coherence,
        }


def _evenly_spaced(values: Array) -> bool:
    steps = np.diff(values)
    return bool(np.allclose(steps, steps[0], rtol=SPACING_TOLERANCE, atol=0))


def _mark(run: Run) -> str:
    return "SIMULATED " if run.simulated else ""


def _line(text: str) -> str:
    """Return a line of the header: printable ASCII, as readers take columns by bytes."""
    plain = visible_text(text).encode("ascii", "replace").decode("ascii")
    return plain[:ID_CHARACTERS] or "NONE"


def _date_and_time(start_time: str) -> tuple[str, str]:
    """Return date and time in the two forms of data set 151, both of at most ten characters."""
    try:
        begun = datetime.fromisoformat(start_time)
    except ValueError:
        return "NONE", "NONE"
    months = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")  # of no locale
    return f"{begun:%d}-{months[begun.month - 1]}-{begun:%y}", f"{begun:%H:%M:%S}"
