"""Thermometers: values of IEC 60751, of a thermistor's data sheet and of a table, and coefficients that are refused."""

import numpy as np
import pytest

from drivers.thermometers import read_coefficients, temperature_c
from tests.helpers.electrical.bench import with_inputs
from tests.helpers.simulated_bench import simulated
from tests.protocols.test_air import THERMOMETER

PT100 = "100, 3.9083e-3, -5.775e-7, -4.183e-12"


def test_a_platinum_resistance_has_the_values_of_the_standard() -> None:
    ohms = np.array([18.52, 60.26, 92.16, 100.0, 107.79, 138.51, 313.71])  # IEC 60751, table 1, to 0.01 ohm
    found = temperature_c("callendar-van-dusen", read_coefficients("callendar-van-dusen", PT100), ohms)
    assert found == pytest.approx([-200.0, -100.0, -20.0, 0.0, 20.0, 100.0, 600.0], abs=0.02)


def test_a_thermistor_has_the_values_of_its_data_sheet() -> None:
    usual = read_coefficients("steinhart-hart", "1.129148e-3, 2.34125e-4, 8.76741e-8")  # 10 kohm, B 3950
    assert temperature_c("steinhart-hart", usual, np.array([32650.0, 10_000.0, 3603.0])) == pytest.approx(
        [0.0, 25.0, 50.0], abs=0.1
    )
    assert np.isnan(temperature_c("steinhart-hart", usual, np.array([-1.0]))).all()


def test_a_table_is_linear_between_its_pairs_and_ends_with_them() -> None:
    table = read_coefficients("table", "0, 0, 0.000397, 10, 0.000798, 20")  # type K, V
    found = temperature_c("table", table, np.array([0.0002, 0.0005975, -1e-6, 0.001]))
    assert found[:2] == pytest.approx([5.04, 15.0], abs=0.01)
    assert np.isnan(found[2:]).all()


@pytest.mark.parametrize(
    ("curve", "text"),
    [("line", "1"), ("table", "0, 0, 1"), ("table", "1, 0, 0, 10"), ("steinhart-hart", "1, 2"), ("table", "a, b")],
)
def test_coefficients_that_do_not_suit_the_curve_are_refused(curve: str, text: str) -> None:
    with pytest.raises(ValueError, match=r"numbers|pairs"):
        with_inputs(simulated(), {**THERMOMETER, "curve": curve, "coefficients": text})


def test_the_gain_error_of_a_thermometer_is_an_error_of_the_temperature() -> None:
    table = {**THERMOMETER, "unit": "ohm", "gain_relative_uncertainty": 1e-3, "curve": "callendar-van-dusen"}
    (channel,) = with_inputs(simulated(), {**table, "coefficients": PT100}).channels
    celsius, error = channel.input_channel.reading(138.51)
    assert celsius == pytest.approx(100.0, abs=0.02)
    assert error == pytest.approx(0.1385 / 0.379, rel=0.01)
