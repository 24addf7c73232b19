"""Parameter form: meaning and unit of each field, errors shown beside the field."""

from typing import Any

import pytest

from app.common.units import read_value
from app.services import check_form, form_fields, format_parameter, protocol_fields, scaled
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.static_loading import StaticLoading
from protocols.registry import PROTOCOLS

COMMON = ("air_temperature_c", "air_within_k", "air_steady_s", "air_longest_s")
TEXTS = {name: format_parameter(getattr(SineDwell(), name)) for name in SineDwell.model_fields}


def test_fields_carry_name_unit_meaning_and_limits() -> None:
    fields = {field.name: field for field in protocol_fields(SineDwell)}
    assert next(iter(fields)) == "frequencies_hz"
    assert list(fields)[-5:] == ["sample_rate_hz", *COMMON]
    assert fields["frequencies_hz"].is_list
    expected = {
        "frequencies_hz": ("frequencies", "Hz", "1 … 2000 Hz"),
        "peak_to_peak_v": ("peak to peak", "V", "over 0 to 5 V"),
        "min_cycles": ("min cycles", "", "3 … 100000"),
    }
    assert {name: (fields[name].label, fields[name].unit, fields[name].limits) for name in expected} == expected
    assert "settled" in fields["settle_tolerance"].description


def test_other_fields_are_called_as_the_form_calls_them() -> None:
    words = {field.name: field.description for field in form_fields(StaticLoading)}
    assert "counts with 'weight class' own" in words["weight_errors_kg"]
    assert not any(name in text for name in words if "_" in name for text in words.values())


def test_what_a_protocol_holds_reads_back_as_itself() -> None:
    assert check_form(SineDwell, TEXTS).value == SineDwell()


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
    assert getattr(checked.value, name) == value


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("peak_to_peak_v", "6", "6 V is outside the range: over 0 to 5 V"),
        ("peak_to_peak_v", "0", "0 V is outside the range"),
        ("peak_to_peak_v", "4 Hz", "not a quantity in V"),
        ("peak_to_peak_v", "four", "not a number"),
        ("peak_to_peak_v", "  ", "give a value"),
        ("peak_to_peak_v", "nan", "not a number"),
        ("frequencies_hz", "25, 3 kHz", "3000 Hz is outside the range: 1 … 2000 Hz"),
        ("frequencies_hz", ",", "at least 1"),
        ("min_cycles", "20.5", "not a whole number"),
        ("sample_rate_hz", "800", "at least 5000 Hz is needed"),
    ],
)
def test_a_fault_is_told_at_its_field(name: str, text: str, message: str) -> None:
    checked = check_form(SineDwell, {**TEXTS, name: text})
    assert checked.value is None
    assert list(checked.errors) == [name]
    assert message in checked.errors[name]


def test_all_faults_are_told_at_once() -> None:
    checked = check_form(SineDwell, {**TEXTS, "peak_to_peak_v": "6 V", "record_s": "soon", "min_cycles": "1"})
    assert set(checked.errors) == {"peak_to_peak_v", "record_s", "min_cycles"}


def test_masses_and_lengths_are_shown_in_units_of_the_bench() -> None:
    fields = {field.name: field for field in form_fields(StaticLoading)}
    assert (fields["weights_kg"].unit, fields["weight_errors_kg"].unit) == ("g", "mg")
    assert fields["zero_limit_m"].unit == "µm"
    texts = {name: format_parameter(scaled(getattr(StaticLoading(), name), fields[name].factor)) for name in fields}
    assert texts["weights_kg"].startswith("20, 50, ")
    assert texts["weight_errors_kg"].startswith("1.4, 1.7, ")
    assert check_form(StaticLoading, texts, fields).value == StaticLoading(), "not one digit is lost"
    written = read_value(StaticLoading, "weights_kg", "7.73, 0.05 kg, 100...200 step 50", (1e3, "g"))
    assert written == (0.00773, 0.05, 0.1, 0.15, 0.2)
    checked = check_form(StaticLoading, {**texts, "offset_kg": "-1"}, fields)
    assert checked.errors["offset_kg"].startswith("-1 g is outside the range: ")
    assert fields["seed"].limits == "from 0"


@pytest.mark.deep
def test_what_every_protocol_holds_reads_back_from_its_form() -> None:
    for name in PROTOCOLS:
        kind = PROTOCOLS[name]
        protocol = kind.model_validate({})
        fields = {field.name: field for field in form_fields(kind)}
        texts = {n: format_parameter(scaled(getattr(protocol, n), field.factor)) for n, field in fields.items()}
        texts |= {n: getattr(protocol, n) for n, field in fields.items() if field.is_switch}
        checked = check_form(kind, texts, fields)
        assert checked.value == protocol, (name, checked.errors)
