"""List of quantities: units and names, estimates of earlier run files, and text of values with uncertainty."""

import pytest

from model import (
    QUANTITIES,
    SCALES,
    Tactor,
    current_name,
    format_quantity,
    format_uncertainty,
    format_with_uncertainty,
    parameter_specs,
    quantity_label,
    shown_unit,
)


def test_every_quantity_is_defined_once_with_a_unit_that_can_be_shown() -> None:
    names = [each.name for each in QUANTITIES.values()]
    assert len(set(names)) == len(names)
    for each in QUANTITIES.values():
        assert each.definition
        assert each.bench == each.unit or each.bench in SCALES
    assert {spec.name for spec in parameter_specs(Tactor)} <= set(QUANTITIES)


@pytest.mark.parametrize(
    ("stored", "now", "label"),
    [
        ("resonance_frequency", "natural_frequency", "natural frequency"),
        ("peak_with_3.2_g", "peak_frequency, 3.2 g", "peak frequency, 3.2 g"),
        ("latency", "bench_latency", "latency of the bench"),
        ("latency_to_50_µm,_after_a_step_to_5_V", "latency, 50 µm, after a step to 5 V", "latency, 50 µm, after a step to 5 V"),
        ("compliance,_MFC_up", "compliance, MFC up", "compliance, MFC up"),
        ("Young_modulus", "E_m", "Young modulus E_m"),
        ("stroke_of_my_own", "stroke of my own", "stroke of my own"),
    ],
)  # fmt: skip
def test_an_estimate_of_any_version_has_the_name_of_its_quantity(stored: str, now: str, label: str) -> None:
    assert current_name(stored) == now
    assert current_name(now.replace(" ", "_")) == current_name(now) == now
    assert quantity_label(now) == label


def test_a_value_is_rounded_to_two_digits_of_its_uncertainty_in_the_unit_of_its_quantity() -> None:
    assert format_with_uncertainty(158.12034, 0.00412, "Hz") == "158.1203 ± 0.0041 Hz"
    assert format_with_uncertainty(0.5, 0.25, "%", signed=True) == "+0.50 ± 0.25 %"
    assert format_with_uncertainty(158.1203, 0.0, "Hz") == "158.12 Hz"
    assert format_uncertainty(4.5e-1, "µm") == "± 0.45 µm"
    assert format_uncertainty(0.0201, "mm") == "± 0.020 mm"
    assert format_uncertainty(123.0, "%") == "± 123 %"
    assert format_quantity(2.2e-2, 1e-4, "m", "L") == "22.00 ± 0.10 mm"
    assert format_quantity(2.2e-5, 1e-7, "m") == "22.00 ± 0.10 µm"
    assert shown_unit("1") == (1.0, "")
