"""Parameter form: meaning and unit of each field, errors shown beside the field."""

from typing import Any

import pytest

from app.gui.widgets.form import check_form, form_fields, format_parameter, protocol_fields
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.static_loading import StaticLoading

TEXTS = {name: format_parameter(getattr(SineDwell(), name)) for name in SineDwell.model_fields}


def test_fields_carry_name_unit_meaning_and_limits() -> None:
    fields = {field.name: field for field in protocol_fields(SineDwell)}
    assert next(iter(fields)) == "frequencies_hz"
    assert list(fields)[-1] == "sample_rate_hz"
    assert fields["frequencies_hz"].is_list
    assert fields["frequencies_hz"].limits == "1 to 2000 Hz"
    assert fields["peak_to_peak_v"].label == "peak to peak"
    assert fields["peak_to_peak_v"].unit == "V"
    assert fields["peak_to_peak_v"].limits == "over 0 to 5 V"
    assert fields["min_cycles"].unit == ""
    assert "settled" in fields["settle_tolerance"].description


def test_other_fields_are_called_as_the_form_calls_them() -> None:
    words = {field.name: field.description for field in form_fields(StaticLoading)}
    assert "counts where 'weight class' is own" in words["weight_errors_kg"]
    assert not any(name in text for name in words if "_" in name for text in words.values())


def test_what_a_protocol_holds_reads_back_as_itself() -> None:
    assert check_form(SineDwell, TEXTS).protocol == SineDwell()


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("peak_to_peak_v", "4", 4.0),
        ("peak_to_peak_v", "4 V", 4.0),
        ("peak_to_peak_v", "4000 mV", 4.0),
        ("record_s", "200 ms", 0.2),
        ("frequencies_hz", "25, 50 Hz, 0.1 kHz", (25.0, 50.0, 100.0)),
        ("frequencies_hz", "25 50\n75", (25.0, 50.0, 75.0)),
        ("min_cycles", "40", 40),
        ("sample_rate_hz", "500 kHz", 500_000.0),
    ],
)
def test_numbers_are_understood_with_and_without_units(name: str, text: str, value: Any) -> None:
    checked = check_form(SineDwell, {**TEXTS, name: text})
    assert not checked.errors
    assert getattr(checked.protocol, name) == value


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("peak_to_peak_v", "6", "6 V is outside the range: over 0 to 5 V"),
        ("peak_to_peak_v", "0", "0 V is outside the range"),
        ("peak_to_peak_v", "4 Hz", "not a quantity in V"),
        ("peak_to_peak_v", "four", "not a number"),
        ("peak_to_peak_v", "  ", "give a value"),
        ("peak_to_peak_v", "nan", "not a number"),
        ("frequencies_hz", "25, 3 kHz", "3000 Hz is outside the range: 1 to 2000 Hz"),
        ("frequencies_hz", ",", "at least 1"),
        ("min_cycles", "20.5", "not a whole number"),
        ("sample_rate_hz", "800", "at least 5000 Hz is needed"),
    ],
)
def test_a_fault_is_told_at_its_field(name: str, text: str, message: str) -> None:
    checked = check_form(SineDwell, {**TEXTS, name: text})
    assert checked.protocol is None
    assert list(checked.errors) == [name]
    assert message in checked.errors[name]


def test_all_faults_are_told_at_once() -> None:
    checked = check_form(SineDwell, {**TEXTS, "peak_to_peak_v": "6 V", "record_s": "soon", "min_cycles": "1"})
    assert set(checked.errors) == {"peak_to_peak_v", "record_s", "min_cycles"}
