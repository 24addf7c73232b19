"""Bench file: units, all errors reported at once with their lines, unknown keys rejected."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from app.common.units import UnitError, read_range, read_value, to_number
from app.config.bench_file import BenchConfig, ConfigError, load_bench
from drivers.sensors.laser_sensor import LaserSensor
from protocols.measurements.sine_dwell import SineDwell
from sim_hardware.plant.parameters import SimulationParameters


def load(folder: Path, text: str) -> BenchConfig:
    file = folder / "bench.toml"
    file.write_text(text)
    return load_bench(str(file))


def test_the_bench_that_comes_with_the_program_names_its_whole_truth() -> None:
    config = load_bench("ideal")
    assert config.simulated
    assert set(config.simulation["tactor"]) == set(SimulationParameters().tactor.__dataclass_fields__)
    sensor = config.sensor.laser_sensor
    assert sensor.delay_s == pytest.approx(1e-4)
    expected = LaserSensor(
        "simulated laser displacement sensor", 1e-4, 0.0, -10, 10, sensor.delay_s, 0.002, "SIM-1", ""
    )
    assert sensor == expected


def test_units_are_understood(tmp_path: Path) -> None:
    config = load(tmp_path, '[generator]\nresource = "x"\ntimeout_s = "500 ms"\n[sensor]\ngain_m_per_v = "0.1 mm/V"\n')
    assert config.generator.timeout_s == 0.5
    assert config.sensor.gain_m_per_v == pytest.approx(1e-4)


def test_every_fault_is_told_at_once_with_its_line(tmp_path: Path) -> None:
    text = """name = "b"
[generator]
resorce = "x"
timeout_s = "3 kg"
[card]
range_v = 30
[sensor]
gain_m_per_v = 0
"""
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text)
    told = str(caught.value)
    for part in (
        "line 3: generator.resorce: unknown key; remove it or correct its spelling",
        "line 4: generator.timeout_s: '3 kg' is not a quantity in s",
        "line 6: card.range_v: must be at most 10, not 30",
        "line 7: sensor: gain_m_per_v must not be 0",
    ):
        assert part in told
    assert "Traceback" not in told


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[generator\n", "is not valid TOML"),
        ("[generator]\n", "generator.resource is missing; give the VISA resource"),
        (
            '[generator]\nresource="x"\n[amplifier]\nrest_v = 7\n',
            "rest 7.0 V must lie inside the input range 0.0..5.0 V",
        ),
        ('[generator]\nresource="x"\n[amplifier]\nslope_above = -1\n', "must be greater than 0, not -1"),
        ("[simulation]\nsede = 3\n", "simulation: unknown sede"),
        ("[simulation.tactor]\nk2 = -1\n", "k2"),
        ('[generator]\nresource="x"\n[sensor]\nvalid_low_v = 5\nvalid_high_v = 1\n', "must lie below valid_high_v"),
        ('[generator]\nresource="x"\ndriver="hp"\n', "keysight-33500"),
        ('[generator]\nresource="x"\ntimeout_s = nan\n', "timeout_s"),
        ('[generator]\nresource="x"\n[interlock]\nline="ao0"\n', "port0/line0"),
        ('[generator]\nresource="x"\n[interlock]\nstate_line="port0/line1"\n', "state_line"),
        ('[generator]\nresource="x"\n[interlock]\nline="port0/line1"\nstate_line="Port0/Line1"\n', "state_line"),
        ('[generator]\nresource="x"\n[interlock]\nmonostable_s=0.1\n', "monostable_s"),
    ],
)
def test_a_wrong_file_is_refused_in_a_sentence(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text)
    assert says in str(caught.value)


def test_a_missing_file_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: No such file or directory; give a bench file or 'sim'"):
        load_bench(str(tmp_path / "none.toml"))


def test_no_configuration_type_accepts_an_unknown_key() -> None:
    seen = [BenchConfig]
    for model in seen:
        assert model.model_config["extra"] == "forbid", model
        for field in model.model_fields.values():
            kind = field.annotation
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                seen.append(kind)
    assert len(seen) >= 5


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("4", "V", 4),
        ("4 V", "V", 4),
        ("400 mV", "V", 0.4),
        ("1.5 kHz", "Hz", 1500),
        ("2 %", "1", 0.02),
        ("1e-3", "s", 1e-3),
        ("628.3185307179586 rad/s", "Hz", 100),
        ("100 cycles/s", "Hz", 100),
        ("6000 rpm", "Hz", 100),
        ("6000 rev/min", "Hz", 100),
        ("100 deg/s", "Hz", 100 / 360),
        ("100 1/s", "Hz", 100),
        ("100 Hz", "rad/s", 628.3185307179586),
        ("180 deg", "rad", 3.141592653589793),
        ("0.5 cycle", "rad", 3.141592653589793),
        ("69 GPa", "Pa", 69e9),
        ("1e5 N/m^2", "Pa", 1e5),
        ("0.1 mm/V", "m/V", 1e-4),
        ("5 g/cm^3", "kg/m^3", 5000),
        ("3 g/(cm s)", "kg/(m s)", 0.3),
        ("3 N*m/kV", "N m/V", 3e-3),
        ("2 g mm**2", "kg m^2", 2e-9),
        ("4 inch", "m", 0.1016),
        ("1 min", "s", 60),
    ],
)
def test_numbers_with_units(text: str, unit: str, number: float) -> None:
    assert to_number(text, unit) == pytest.approx(number)


def test_a_power_of_ten_is_rounded_once() -> None:
    values = [to_number("7.73 g", "kg"), to_number("100 us", "s"), to_number("5 g cm**-3", "kg/m^3")]
    assert values == [7.73e-3, 1e-4, 5e3]


@pytest.mark.parametrize(
    ("text", "unit"), [("100 Bq", "Hz"), ("5 counts/s", "Hz"), ("3 deg", "1"), ("1 rad kg", "kg"), ("1 rad^2/s", "Hz")]
)
def test_angles_and_counts_are_no_pure_numbers(text: str, unit: str) -> None:
    with pytest.raises(UnitError, match="an angle or a count is not a pure number"):
        to_number(text, unit)


@pytest.mark.parametrize(
    "text", ["4 kg", "four", "", "4 V V V!", "1/0", "__import__('os')", "9**9**9**9", "1 V^9999", "4" * 99 + "V"]
)
def test_what_is_no_quantity_is_a_sentence(text: str) -> None:
    with pytest.raises(UnitError, match=r"'.*' is not a (quantity|number)"):
        to_number(text, "V")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("100...115 step 5", (100.0, 105.0, 110.0, 115.0)),
        ("100…112 step 5", (100.0, 105.0, 110.0)),
        ("0.1 kHz .. 90 Hz step 5 Hz", (100.0, 95.0, 90.0)),
        ("25, 100...110 step 10, 300", (25.0, 100.0, 110.0, 300.0)),
        ("50 ... 50 step 1", (50.0,)),
    ],
)
def test_a_list_may_have_ranges(text: str, values: tuple[float, ...]) -> None:
    assert read_value(SineDwell, "frequencies_hz", text) == pytest.approx(values, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("100:200:5", "'100:200:5' is no range; write for example '100...200 step 5', or a list: '25, 50, 75'"),
        ("100...200", "'100...200' is no range; write for example '100...200 step 5', or a list: '25, 50, 75'"),
        ("100...200 step 0", "its step must be greater than 0"),
        ("100...200 step -5", "its step must be greater than 0"),
        ("1...2000 step 1e-3", "'1...2000 step 1e-3' has 1999001 values; a range may have 10000; choose a larger step"),
        ("nan...2 step 1", "is no range"),
        ("1...1e308 step 1e-300", "is no range"),
    ],
)
def test_what_is_no_range_is_refused_in_words(text: str, sentence: str) -> None:
    with pytest.raises(UnitError) as refused:
        read_value(SineDwell, "frequencies_hz", text)
    assert sentence in str(refused.value)


@given(start=st.floats(1, 1000), stop=st.floats(1, 1000), step=st.floats(0.5, 500))
def test_a_range_never_leaves_its_ends(start: float, stop: float, step: float) -> None:
    values = read_range(f"{start!r}...{stop!r} step {step!r}", "Hz")
    low, high = min(start, stop), max(start, stop)
    assert all(low - 1e-9 * high <= value <= high * (1 + 1e-9) for value in values)
    assert values[0] == pytest.approx(start, rel=1e-11)
    assert abs(stop - values[-1]) < step * (1 + 1e-9)
