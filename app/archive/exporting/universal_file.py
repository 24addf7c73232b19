"""Export of series as a Universal File: data sets 151 (header), 164 (units) and 58 (functions).

Format: Structural Dynamics Research Corporation, "Universal Dataset Number 58: Function at Nodal DOF", kept by the University of
Cincinnati (ceas3.uc.edu/sdrluff); written with pyuff.
"""

from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from app.archive.exporting.parts import POINTS, ExportedRun, ExportError, Part, points_series
from app.common import Progress
from drivers.watchdog import version
from model import Array
from protocols.base import Series, SeriesAxis, visible_text
from protocols.runfile import ENTRY_COLUMN

ID_CHARACTERS = 80
"""Length of each of the five lines that identify a function."""
SPACING_TOLERANCE = 1e-6
"""Relative differences between steps that the six digits of the increment do not show."""

AXIS_CHARACTERS = 20
"""Length of the name and of the unit of an axis."""
GENERAL, TIME_RESPONSE, FREQUENCY_RESPONSE, COHERENCE = 0, 1, 4, 6
"""Function types of data set 58; type 0 holds standard uncertainty and fit, for which the format has none."""
UNKNOWN_QUANTITY, GENERAL_QUANTITY, DISPLACEMENT_QUANTITY = 0, 1, 8
"""Specific data types of an axis in data set 58."""
ABSCISSA_QUANTITIES = {"Hz": 18, "s": 17, "V": GENERAL_QUANTITY, "N": 9, "kg": GENERAL_QUANTITY}
MIN_VALUES = 2
"""Smallest number of values that pyuff writes; one value is no curve."""
RESPONSE_NODE, DRIVE_NODE = 1, 2
"""The centre of the tactor, and the amplifier's input."""
NORMAL_DIRECTION, SCALAR_DIRECTION = 3, 0


def uff_writer(run: ExportedRun, _parts: Sequence[Part]) -> Callable[[Path, Progress], None]:
    """Return the function that writes the series of a run and its points over their axis; it raises OperationCancelled.

    Raises:
        ExportError: it has none.
    """
    sets = [_header(run), _units()]
    number = 0
    points = (points_series(run),) if run.points() else ()
    for series in (*points, *run.series()):
        finite = series.at(np.isfinite(series.x) & np.isfinite(series.y))
        if finite.x.size >= MIN_VALUES:
            number += 1
            sets += _function_sets(run, finite, number)
    if not number:
        raise ExportError(
            f"{run.path.name} has no series of {MIN_VALUES} or more values, and a Universal File holds nothing else; take csv"
        )
    return partial(_write_sets, sets)


def _write_sets(sets: Sequence[dict[str, Any]], path: Path, progress: Progress) -> None:
    import pyuff

    file = pyuff.UFF(str(path))
    for number, each in enumerate(sets):
        progress.raise_if_cancelled()
        file.write_sets(each, "add" if number else "overwrite")
        progress.update((number + 1) / len(sets))


def _header(run: ExportedRun) -> dict[str, Any]:
    date, time = _date_and_time(run.record.start_time)
    return {
        "type": 151,
        "model_name": _line(run.record.specimen),
        "description": _line(f"{_mark(run)}{run.record.protocol}, {run.path.name}"),
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


def _function_sets(run: ExportedRun, series: Series, number: int) -> Iterator[dict[str, Any]]:
    """Yield a series, its uncertainties, fit and coherence, each as a function of the finite values."""
    x, y, axis = series.x, series.y_axis, series.x_axis
    response = "Frequency response: displacement of the centre / amplifier input voltage"
    common = {
        "id2": _line(f"{_mark(run)}{run.record.specimen}, {run.record.protocol}, {series.title}"),
        "id3": _line(run.record.start_time),
        "id4": _line(run.path.name),
        "id5": _line(_drive_line(run, series)),
        "type": 58,
        "func_id": number,
        "binary": 0,
        "load_case_id": 0,
        "rsp_ent_name": "CENTRE",
        "rsp_node": RESPONSE_NODE,
        "rsp_dir": NORMAL_DIRECTION,
        "ref_ent_name": "INPUT",
        "ref_node": DRIVE_NODE,
        "ref_dir": SCALAR_DIRECTION,
        **_abscissa(x),
        "abscissa_spec_data_type": ABSCISSA_QUANTITIES.get(axis.unit, UNKNOWN_QUANTITY),
        "abscissa_axis_lab": _line(axis.name.capitalize(), AXIS_CHARACTERS),
        "abscissa_axis_units_lab": _line(axis.unit, AXIS_CHARACTERS),
    }
    quantity = common | _ordinate(y)
    name = "modulus of the frequency response" if series.is_complex else y.name.replace("_", " ")
    kind = FREQUENCY_RESPONSE if series.is_complex else TIME_RESPONSE if axis.unit == "s" else GENERAL
    title = response if series.is_complex else f"{series.name}: {y.description}"
    yield quantity | {"func_type": kind, "id1": _line(title), "data": series.y}
    for label, values in (
        ("Standard uncertainty (statistical)", series.errors),
        ("Standard uncertainty (total)", series.total_errors),
        (f"Fit ({series.fit_description})", series.fit),
    ):
        finite = np.zeros(0, int) if values is None else np.flatnonzero(np.isfinite(values))
        if values is not None and finite.size >= MIN_VALUES:
            text = _line(f"{label} of the {name}")
            yield quantity | _abscissa(x[finite]) | {"func_type": GENERAL, "id1": text, "data": values[finite]}
    if series.coherence is not None:
        yield common | {
            "func_type": COHERENCE,
            "id1": "Coherence of displacement and drive",
            "ordinate_spec_data_type": UNKNOWN_QUANTITY,
            "ordinate_axis_lab": "Coherence",
            "orddenom_spec_data_type": UNKNOWN_QUANTITY,
            "data": series.coherence,
        }


def _abscissa(x: Array) -> dict[str, Any]:
    return {
        "x": x,
        "num_pts": x.size,
        "abscissa_spacing": int(_evenly_spaced(x)),
        "abscissa_min": float(x[0]),
        "abscissa_inc": float(x[1] - x[0]),
    }


def _ordinate(axis: SeriesAxis) -> dict[str, Any]:
    """Return the description of a function's values: displacement, displacement over drive, or name and unit."""
    if axis.unit not in ("m", "m/V"):
        return {
            "ordinate_spec_data_type": GENERAL_QUANTITY if axis.unit == "V" else UNKNOWN_QUANTITY,
            "ordinate_axis_lab": _line(axis.name.replace("_", " ").capitalize(), AXIS_CHARACTERS),
            "ordinate_axis_units_lab": _line(axis.unit, AXIS_CHARACTERS),
            "orddenom_spec_data_type": UNKNOWN_QUANTITY,
        }
    moved = {
        "ordinate_spec_data_type": DISPLACEMENT_QUANTITY,
        "ordinate_len_unit_exp": 1,
        "ordinate_axis_lab": "Displacement",
        "ordinate_axis_units_lab": "m",
    }
    over_drive = {
        "orddenom_spec_data_type": GENERAL_QUANTITY,
        "orddenom_axis_lab": "Drive",
        "orddenom_axis_units_lab": "V",
    }
    return moved | (over_drive if axis.unit == "m/V" else {"orddenom_spec_data_type": UNKNOWN_QUANTITY})


def _drive_line(run: ExportedRun, series: Series) -> str:
    """Return the reference of the phase of a response, and the amplitude of its drive where the points have it."""
    if not series.is_complex:
        return "NONE"
    points = run.points()
    amplitude = points.get("drive_amplitude", np.zeros(0))
    if series.name == POINTS:
        amplitude = amplitude[np.isin(points["frequency"], series.x)]
    elif (own := points[ENTRY_COLUMN] == series.entry).any() and amplitude.size:
        amplitude = amplitude[own]
    drive = f", drive amplitude {np.median(amplitude):.6g} V" if np.isfinite(amplitude).any() else ""
    return f"phase against the recorded drive{drive}"


def _evenly_spaced(values: Array) -> bool:
    steps = np.diff(values)
    return bool(steps[0] > 0 and np.allclose(steps, steps[0], rtol=SPACING_TOLERANCE, atol=0))


def _mark(run: ExportedRun) -> str:
    return "SIMULATED " if run.record.simulated else ""


def _line(text: str, characters: int = ID_CHARACTERS) -> str:
    """Return a line of the header: printable ASCII, as readers take columns by bytes."""
    plain = visible_text(text).encode("ascii", "replace").decode("ascii")
    return plain[:characters] or "NONE"


def _date_and_time(start_time: str) -> tuple[str, str]:
    """Return date and time in the two forms of data set 151, both of at most ten characters."""
    try:
        begun = datetime.fromisoformat(start_time)
    except ValueError:
        return "NONE", "NONE"
    months = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")  # of no locale
    return f"{begun:%d}-{months[begun.month - 1]}-{begun:%y}", f"{begun:%H:%M:%S}"
