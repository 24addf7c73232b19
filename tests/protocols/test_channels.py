"""Further input channels: from the bench file to the run file, the levels, exports and the Python interface."""

import json
import tomllib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import tactor_bench as tb
from app.archive.exporting.export import export_run
from app.config.bench_file import BenchConfig, ConfigError, load_bench
from app.session.bench_connection import connect
from model import AmplifierMap
from protocols.base import LevelExceeded, RunStatus
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.reader import Run
from protocols.runfile.schema import FURTHER_CHANNELS
from protocols.signals.sine import fit_sine
from sim_hardware.plant.parameters import SimulationParameters
from tests.helpers.electrical.truth import true_admittance
from tests.helpers.scripted_protocol import SHORT
from tests.helpers.simulated_bench import laboratory, run, simulated

MONITORS = """
[[channels]]
name = "amplifier_voltage"
channel = "ai2"
unit = "V"
gain = 1000.0
kind = "voltage-monitor"

[[channels]]
name = "amplifier_current"
channel = "ai3"
unit = "A"
gain = 0.01
kind = "current-monitor"

[[channels]]
name = "nothing"
channel = "ai5"
unit = "kPa"
gain = 2.0
offset = 3.0
"""


def with_monitors(**levels: Any) -> BenchConfig:
    record = simulated().model_dump() | tomllib.loads(MONITORS)
    return BenchConfig.model_validate({**record, "levels": {**record["levels"], **levels}})


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with laboratory(with_monitors()) as lab:
        ran = run(SHORT, tmp_path_factory.mktemp("runs"), lab)
    assert (ran.status, [e for e in ran.events if isinstance(e, LevelExceeded)]) == (RunStatus.COMPLETED, [])
    return ran.path


def test_the_monitors_show_what_the_amplifier_makes_of_the_drive(measured: Path) -> None:
    with Run(measured) as file:
        trace, rows = file.trace, file.trace.last_recording().rows
        assert trace.further_channels == {"amplifier_voltage": "V", "amplifier_current": "A", "nothing": "kPa"}
        voltage = trace.channel_values("amplifier_voltage", *rows)
        current = trace.channel_values("amplifier_current", *rows)
        expected = AmplifierMap().specimen_v(trace.drive_v(*rows))
        later_s = trace.channel_scale("amplifier_voltage").skew_s
        assert later_s > 0
        slope = 2 * np.pi * 160 * 1500
        assert np.abs(voltage - expected).max() < slope * later_s + 10  # it is converted later than the drive
        ratio = np.divide(*(fit_sine(x, trace.rate_hz, 160.0, 8).fundamental for x in (current, voltage)))
        assert np.abs(ratio) == pytest.approx(
            np.abs(true_admittance(SimulationParameters(), np.array([160.0])))[0], rel=0.03
        )
        assert trace.channel_values("nothing", *rows).mean() == pytest.approx(3.0, abs=1e-3)


def test_calibration_and_units_are_in_the_file(measured: Path) -> None:
    with h5py.File(measured) as file:
        trace = file["entry/trace"]
        assert list(trace.attrs[FURTHER_CHANNELS]) == ["amplifier_voltage", "amplifier_current", "nothing"]
        assert trace["nothing"].attrs["scaled_units"] == "kPa"
        assert trace["amplifier_voltage"].attrs["kind"] == "voltage-monitor"
        assert trace["nothing_volts_to_units"][:].tolist() == [2.0, 3.0]
        assert len({trace[name].shape for name in ("drive", "displacement", "nothing")}) == 1
        assert [each["name"] for each in json.loads(file["entry/configuration"][()])["channels"]] == list(
            trace.attrs[FURTHER_CHANNELS]
        )


@pytest.mark.deep
def test_a_bench_of_two_channels_writes_no_trace_of_further_ones(tmp_path: Path) -> None:
    with laboratory() as lab:
        path = run(SHORT, tmp_path, lab).path
    with h5py.File(path) as file, Run(path) as opened:
        assert FURTHER_CHANNELS not in file["entry/trace"].attrs
        assert opened.trace.further_channels == {}


@pytest.mark.deep
def test_drive_and_displacement_are_those_of_a_bench_without_monitors(measured: Path, tmp_path: Path) -> None:
    """But for the rate, which five channels share, and the noise."""
    with laboratory() as lab:
        plain = run(SHORT, tmp_path, lab).path
    with Run(measured) as five, Run(plain) as two:
        for name in ("frequency", "fundamental", "drive_amplitude"):
            assert five.points()[name] == pytest.approx(two.points()[name], rel=2e-3)


def test_exports_have_a_column_for_each_channel(measured: Path, tmp_path: Path) -> None:
    with Run(measured) as file:
        (csv,) = export_run(file, tmp_path, "csv", ["raw"])
        (text,) = export_run(file, tmp_path, "json", ["raw"])
        count, last = file.trace.sample_count, float(file.trace.channel_values("nothing")[-1])
    header = csv.read_text().splitlines()[0]
    assert header == "time [s],drive [V],displacement [m],amplifier_voltage [V],amplifier_current [A],nothing [kPa]"
    raw = json.loads(text.read_text())["raw"]
    assert (len(raw["nothing"]), raw["units"]["nothing"]) == (count, "kPa")
    assert raw["nothing"][-1] == pytest.approx(last)


def test_the_python_interface_returns_the_channels(measured: Path) -> None:
    opened = tb.open_run(measured)
    samples = opened.trace(0.5, 0.6)
    assert set(samples.channels) == {"amplifier_voltage", "amplifier_current", "nothing"}
    assert samples.channels["nothing"].shape == samples.drive_v.shape
    assert opened.traces[0].channels["amplifier_voltage"].max() > 1000


@pytest.mark.deep
@pytest.mark.parametrize(
    ("levels", "level", "channel"),
    [
        ({"voltage_v": 1000.0}, "voltage", "amplifier_voltage"),
        ({"current_a": "0.5 mA"}, "current", "amplifier_current"),
    ],
)
def test_a_monitor_beyond_its_level_ends_the_run(
    levels: dict[str, Any], level: str, channel: str, tmp_path: Path
) -> None:
    with laboratory(with_monitors(**{level: "rest"}, **levels)) as lab:
        ran = run(SHORT, tmp_path, lab)
    (event,) = [e for e in ran.events if isinstance(e, LevelExceeded)]
    assert (event.level, event.channel) == (level, channel)
    assert event.value > event.limit
    assert channel in ran.verdict.reasons[0]
    assert ran.report.ends_at_rest


@pytest.mark.deep
def test_the_channels_come_over_the_real_wire(tmp_path: Path) -> None:
    protocol = SineDwell(frequencies_hz=(160,), record_s=0.1, min_cycles=10)
    with connect(with_monitors(), 5.0) as lab:
        ran = run(protocol, tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED, ran.reason
    with Run(ran.path) as file:
        voltage = file.trace.channel_values("amplifier_voltage", *file.trace.last_recording().rows)
        assert (voltage.min(), voltage.max()) == pytest.approx((-500, 1500), abs=20)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[[channels]]\nname = "drive"\nchannel = "ai2"', "is a name of the run file"),
        ('[[channels]]\nname = "A b"\nchannel = "ai2"', "small letters"),
        ('[[channels]]\nname = "a"\nchannel = "ai1"', "ai1 is used twice"),
        ('[[channels]]\nname = "a"\nchannel = "ai2"\ngain = 0', "must not be 0"),
        ('[[channels]]\nname = "a"\nchannel = "ai2"\n[[channels]]\nname = "a_offset"\nchannel = "ai3"', "rename one"),
        ('[[channels]]\nname = "a"\nchannel = "ai2"\nunit = "A"\nkind = "voltage-monitor"', "must be V, as the kind"),
        ('[levels]\nstroke = "loudly"', "levels.stroke"),
        ("[specimen]\ngap_m = 0", "greater than 0"),
    ],
)
def test_wrong_tables_are_refused_with_a_remedy(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(f"{text}\n[simulation]\nseed = 1\n")
    with pytest.raises(ConfigError, match=says):
        load_bench(str(path))
