"""Formatting of durations, sizes and values with errors."""

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pytest
from annotated_types import Unit

from app.archive.run_differences import _setting_text
from app.common import check_row
from app.common.formatting import (
    format_bytes,
    format_duration,
    format_outcome,
    format_point,
    format_series,
    typeset,
    typeset_unit,
)
from model import format_with_uncertainty
from protocols.base import CheckResult, Quality, Series, SeriesAxis
from protocols.measurements.sine_dwell import SinePoint
from protocols.runfile.schema import RESPONSE_COLUMNS, is_response
from tests.helpers.run_files import sine_point


@pytest.mark.parametrize(
    ("seconds", "message"),
    [(0, "0 s"), (12.4, "12 s"), (59.6, "1 min 00 s"), (200, "3 min 20 s"), (7500, "2 h 05 min")],
)
def test_durations(seconds: float, message: str) -> None:
    assert format_duration(seconds) == message


def test_a_value_of_one_is_no_unit() -> None:
    for unit, shown in {"1": "", "N m^2": "N m²"}.items():
        assert typeset_unit(unit) == shown
    for text, shown in {
        "1": "1",
        "7 N m^2": "7 N m²",
        "23 degC": "23 °C",
        "skin stiffness k_s": "skin stiffness kₛ",
        "a_model": "a_model",
    }.items():
        assert typeset(text) == shown


@pytest.mark.parametrize(
    ("check", "texts"),
    [
        (CheckResult("signal to noise", 24617.3, "1", 20.0, None, ""), ("24\u202f617", "at least 20", "")),
        (
            CheckResult("drive read back - commanded, worst", -3.5371e-6, "V", -0.002, 0.002, ""),
            ("−0.003537", "−2 … 2", "mV"),
        ),
        (CheckResult("warming", 3.2e-9, "K", None, 1.25e-8, ""), ("3.2 × 10⁻⁹", "at most 1.25 × 10⁻⁸", "K")),
        (CheckResult("latency", math.nan, "s", None, 1.0, ""), ("not seen", "at most 1000", "ms")),
    ],
    ids=["large", "small volts", "smallest", "none"],
)
def test_figures_of_checks_have_no_powers_of_e(check: CheckResult, texts: tuple[str, ...]) -> None:
    row = check_row(check)
    assert (row.figure, row.limits, row.unit) == texts
    assert " - " not in row.name


@pytest.mark.parametrize(("count", "message"), [(812, "812 B"), (593_000, "593 kB"), (1.4e6, "1.4 MB"), (7e9, "7 GB")])
def test_sizes(count: float, message: str) -> None:
    assert format_bytes(count) == message


@pytest.mark.parametrize(
    ("value", "error", "unit", "message"),
    [
        (158.34604, 0.00752, "Hz", "158.3460 ± 0.0075 Hz"),
        (0.21096, 4.6e-5, "1", "0.210960 ± 0.000046"),
        (1234.5, 210.0, "kg", "1234 ± 210 kg"),
        (3.0, 0.0, "m", "3 m"),
        (3.0, float("nan"), "1", "3"),
    ],
)
def test_a_value_has_the_figures_its_error_allows(value: float, error: float, unit: str, message: str) -> None:
    assert format_with_uncertainty(value, error, unit) == message


def test_curve_with_errors_is_summarised_by_its_peak_and_samples_are_not() -> None:
    series = Series(
        np.array([25.0, 151.0, 525.0]),
        np.array([4e-5, 9.2531e-4, 1e-5]),
        np.array([1e-8, 1.2e-7, 1e-8]),
        x_axis=SeriesAxis("frequency", "Hz"),
        y_axis=SeriesAxis("response", "m/V"),
        name="frequency response",
        label="of sweep 2",
    )
    line = format_series(series)
    assert line == "frequency response of sweep 2: 3 lines, 25 to 525 Hz, highest 925.31 ± 0.12 µm/V at 151 Hz"
    assert format_series(replace(series, errors=None)) == ""


def test_how_a_run_ended_is_told_once() -> None:
    for state, reason, shown in (
        ("stopped", "stopped by the operator after 5 of 18 points", "stopped by the operator after 5 of 18 points"),
        ("unsafe", "UNSAFE: rest could not be confirmed", "UNSAFE: rest could not be confirmed"),
        ("completed", "all points measured", "completed: all points measured"),
    ):
        assert format_outcome(state, reason) == shown
    assert format_outcome("crashed", "") == "crashed"


@dataclass(frozen=True)
class Held:
    """A point of a laboratory's protocol."""

    held: Annotated[float, Unit("V"), "level"]
    moved: Annotated[float, Unit("m"), "displacement"]
    moved_errors: Annotated[float, Unit("m"), "its error"]
    drift: Annotated[float, Unit("m/s"), "drift"]
    quality: Annotated[int, Unit("1"), "flags"]


class Faulty(Held):
    """A point whose own summary fails."""

    summary = property(lambda self: f"{self.volts} V")


class Told(Held):
    """A point with a summary of its own."""

    summary = property(lambda self: f"own {self.held:g} V")


@pytest.mark.parametrize(
    ("kind", "quality", "message"),
    [
        (Held, Quality.SIMULATED, "held 3 V, moved 74.412 ± 0.011 µm"),
        (Faulty, Quality.GOOD, "held 3 V, moved 74.412 ± 0.011 µm"),
        (Told, Quality.GOOD, "own 3 V"),
        (Told, Quality.CLIPPED, "own 3 V; not usable: clipped"),
        (Told, Quality.IMPORTED, "held 3 V, moved 74.412 ± 0.011 µm; imported"),
    ],
)
def test_a_point_is_a_line_whatever_its_protocol(kind: type[Held], quality: Quality, message: str) -> None:
    assert format_point(kind(3.0, 74.412e-6, 1.1e-8, math.nan, int(quality))) == message


def test_a_point_of_an_unknown_protocol_has_its_values() -> None:
    point = SimpleNamespace(entry=1, held=3.0, moved=74.4e-6, quality=int(Quality.GOOD))
    assert format_point(point, {"held": "V", "moved": "m"}) == "held 3 V, moved 74.4 µm"
    assert not is_response(point)


def test_a_response_has_all_columns_of_a_point_under_a_sine() -> None:
    assert is_response(SinePoint)
    assert is_response(sine_point(100.0))
    assert not is_response(Held)
    part = {name: 1.0 for name in RESPONSE_COLUMNS if name != "drive_amplitude"}
    assert not is_response(SimpleNamespace(**part))


def test_a_setting_of_minutes_is_in_seconds_like_its_field() -> None:
    assert [_setting_text(300.0, "s"), _setting_text([0.5, 2.0], "s"), _setting_text(0.02, "kg")] == [
        "300 s",
        "0.5, 2 s",
        "20 g",
    ]
