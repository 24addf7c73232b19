"""Every kind of bench: its example loads, and its simulation arms, measures and returns to rest."""

from pathlib import Path

import numpy as np
import pytest

from app.config.bench_file import BenchConfig, ConfigError, load_bench
from app.session.bench_connection import connect
from drivers.drive_shapes import Hold, Sine
from drivers.errors import DriveRejectedError
from drivers.sensors.laser_sensor import PRESETS
from protocols.base import RunStatus
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.simulated_bench import assert_safe_voltage, run, simulated

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "docs" / "benches").glob("*.toml"))


def of_kind(kind: str, **tables) -> BenchConfig:
    """The simulated bench with another source at the amplifier."""
    card = {"traits": "start-route=present"}
    return BenchConfig.model_validate({**simulated(card=card).model_dump(), "source": {"kind": kind}, **tables})


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_loads_as_it_stands(example: Path) -> None:
    config = load_bench(str(example))
    assert not config.simulated
    assert config.sensor.laser_sensor.valid_low_v < config.sensor.laser_sensor.valid_high_v
    assert config.amplifier.rest_v == 2.5


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_is_as_it_stands_a_bench_that_can_be_simulated(example: Path) -> None:
    config = load_bench(str(example)).model_copy(update={"simulation": {}})
    with connect(config) as lab:
        assert lab.bench.name == config.name
        assert set(lab.bench.meters) == set(config.meters)
        assert set(lab.bench.configuration["identities"]) == {
            "generator",
            "amplifier",
            "card",
            "sensor",
            *config.meters,
        }


def test_the_examples_cover_every_kind_of_source_and_meter() -> None:
    configs = [load_bench(str(example)) for example in EXAMPLES]
    assert {config.source.kind for config in configs} == {"generator", "card-output", "dc-supply", "labjack-output"}
    assert {meter.driver for config in configs for meter in config.meters.values()} == {
        "keyence-lkg",
        "optoncdt",
        "capancdt-6200",
    }


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_tells_out_of_range_from_a_displacement(name: str, tmp_path: Path) -> None:
    file = tmp_path / "b.toml"
    file.write_text(f'[generator]\nresource = "x"\n[sensor]\npreset = "{name}"\nserial = "7"\n')
    sensor = load_bench(str(file)).sensor.laser_sensor
    middle_v = (sensor.valid_low_v + sensor.valid_high_v) / 2
    assert sensor.is_valid([middle_v]).all()
    assert sensor.displacement_m([sensor.zero_v])[0] == 0
    assert abs(middle_v - sensor.zero_v) < 0.01
    assert not sensor.is_valid([sensor.valid_low_v - 0.1, sensor.valid_high_v + 0.1]).any()
    most = 20.0 if sensor.measures_velocity else 0.12  # m/s or m
    assert 1e-3 <= (sensor.valid_high_v - sensor.valid_low_v) * abs(sensor.gain_m_per_v) <= most
    assert sensor.delay_s > 0
    assert sensor.serial == "7"


def test_an_il_that_sees_nothing_gives_no_displacement() -> None:
    """Its error output is 5.5 V: at 3 mm/V that would be a displacement of 16.5 mm."""
    sensor = BenchConfig.model_validate(
        {"generator": {"resource": "x"}, "sensor": {"preset": "keyence-il-030"}}
    ).sensor.laser_sensor
    assert sensor.displacement_m([5.0])[0] == pytest.approx(15e-3)
    assert list(sensor.is_valid([5.0, 5.5])) == [True, False]


def test_what_the_bench_file_says_wins_over_the_preset() -> None:
    table = {"preset": "keyence-il-030", "gain_m_per_v": "1 mm/V", "name": "ours"}
    sensor = BenchConfig.model_validate({"generator": {"resource": "x"}, "sensor": table}).sensor.laser_sensor
    assert sensor.gain_m_per_v == pytest.approx(1e-3)
    assert sensor.valid_high_v == 5.25
    assert sensor.name == "ours"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[source]\nkind = "dc-supply"\n', "supply.resource is missing; give the VISA resource of the supply"),
        (
            '[source]\nkind = "zero"\n',
            "line 2: source.kind: must be 'generator', 'card-output', 'dc-supply' or 'labjack-output'",
        ),
        ('[generator]\nresource="x"\n[sensor]\npreset = "il"\n', "there is no preset 'il'; choose from keyence-lk-g30"),
        ('[generator]\nresource="x"\n[meters.a]\ndriver = "optoncdt"\n', "meters.a.port is missing"),
        (
            '[generator]\nresource="x"\n[meters.a]\ndriver = "lk"\nport = "COM3"\n',
            "must be 'keyence-lkg', 'keyence-lkg5000', 'keyence-il', 'optoncdt', 'optoncdt-2300' or 'capancdt-6200', not 'lk'",
        ),
        ('[generator]\nresource="x"\n[meters.a]\ndriver = "optoncdt"\nprot = "COM3"\n', "unknown key"),
        ('[source]\nkind = "card-output"\nstart_trigger = "PFI0"\n', "must be '' or 'ai/SampleClock'"),
    ],
)
def test_a_wrong_table_is_refused_in_a_sentence(text: str, says: str, tmp_path: Path) -> None:
    file = tmp_path / "b.toml"
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_bench(str(file))
    assert says in str(caught.value)


@pytest.mark.deep
@pytest.mark.parametrize("trigger", ["", "ai/SampleClock"])
def test_a_dwell_on_a_bench_without_a_generator(trigger: str, tmp_path: Path) -> None:
    config = of_kind("card-output", source={"kind": "card-output", "start_trigger": trigger})
    with connect(config) as lab:
        ran = run(SineDwell(frequencies_hz=(25.0, 50.0), peak_to_peak_v=2.0), tmp_path, lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    assert [point.frequency for point in ran.points] == pytest.approx([25.0, 50.0], rel=1e-6)
    assert ran.report.highest_v == pytest.approx(3.5, abs=1e-3)


def test_a_held_level_on_a_dc_supply_and_a_sine_that_it_refuses() -> None:
    with connect(of_kind("dc-supply")) as lab:
        blocks = []
        with lab.bench.armed(5000.0, blocks.append, Hands(lab.control)) as armed:
            armed.start_drive(Hold(3.5, 1.0))
            for _ in range(20):
                armed.read_block()
            with pytest.raises(DriveRejectedError, match="can hold and step, but not play a Sine"):
                armed.start_drive(Sine(5.0, 1.0, 2.5, 5))
            with pytest.raises(DriveRejectedError):
                armed.start_drive(Hold(5.5, 1.0))
        lab.bench.clock.sleep(0.5)  # its output falls the last millivolts
        volts = np.concatenate([armed.scales[0].to_volts(block.raw[0]) for block in blocks])
        assert volts.max() == pytest.approx(3.5, abs=0.01)
        assert armed.final_rest is not None
        assert armed.final_rest.confirmed
        assert_safe_voltage(lab.control.report())


class Hands:
    """Operate the amplifier's switch."""

    def __init__(self, bench) -> None:
        self.disable, self.enable = bench.disable_hv, bench.enable_hv


@pytest.mark.parametrize("driver", ["keyence-lkg", "optoncdt"])
def test_a_serial_sensor_is_a_meter_of_the_bench(driver: str) -> None:
    config = BenchConfig.model_validate({**simulated().model_dump(), "meters": {"laser": {"driver": driver}}})
    with connect(config) as lab:
        lab.bench.clock.sleep(0.1)
        reading = lab.bench.meters["laser"].read()
        assert reading.valid
        lab.control.inject("sensor-out-of-range")
        assert not lab.bench.meters["laser"].read().valid
