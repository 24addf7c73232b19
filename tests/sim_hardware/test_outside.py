"""A generator that shares nothing with the simulators here drives the simulated amplifier, specimen and card."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from app.config.bench_file import BenchConfig
from drivers import BenchError
from protocols.base import Outcome, Protocol, RunStatus
from protocols.measurements.hysteresis import Hysteresis
from protocols.measurements.latency import OnsetLatency
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.sweep import Sweep
from protocols.measurements.voltage_steps import VoltageSteps
from sim_hardware.generators.outside import GROUP, OutsideEngine
from sim_hardware.plant.segments import ConstantSegment, Segment
from tests.drivers.test_self_test import Switch, refusal
from tests.helpers.commissioning import commissioned_bench, deviating
from tests.helpers.simulated_bench import laboratory, run, simulated

SHORT: tuple[Protocol, ...] = (
    SineDwell(frequencies_hz=(75, 140)),
    Sweep(),
    VoltageSteps(levels_v=(0.5, 5.0), repeats=1, hold_s=2.0),
    Hysteresis(frequencies_hz=(2.0,)),
    OnsetLatency(repeats=1, frequencies_hz=(150.0,)),
)


@pytest.fixture
def outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BenchConfig:
    """The ideal bench with the entry point `box` of an installed package."""
    info = tmp_path / "box-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: box\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\nbox = tests.sim_hardware.outside_box:Box\nnone = math:pi\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    return simulated(generator={"outside": "box"})


def measured(protocol: Protocol, config: BenchConfig, folder: Path) -> np.ndarray:
    with laboratory(config) as lab:
        ran = run(protocol, folder, lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    assert ran.verdict.outcome is Outcome.GOOD, ran.verdict.reasons
    y = protocol.axes[1]
    return np.array([[getattr(point, y), getattr(point, f"{y}_errors", 0.0)] for point in ran.points])


@pytest.mark.parametrize("protocol", [pytest.param(each, id=each.name) for each in SHORT])
def test_protocols_measure_with_it_as_with_the_own_generator(
    protocol: Protocol, outside: BenchConfig, tmp_path: Path
) -> None:
    (there, error), (here, _) = (measured(protocol, config, tmp_path).T for config in (outside, simulated()))
    assert (np.abs(there - here) < 0.002 * np.abs(here) + 5 * error).all(), (there, here, error)


FOREIGN = (
    "TRIG:DEL 2",
    "FUNC:ARB:ADV TRIG",
    "OUTP:POL INV",
    "OUTP:MODE GAT",
    "BURS:MODE GAT",
    "BURS:PHAS 90",
    "BURS:NCYC 7",
    "TRIG:SOUR IMM",
    "TRIG:COUN 3",
    "UNIT:ANGL RAD",
    "VOLT:UNIT VRMS",
    "OUTP:LOAD 50",
    "SUM:STAT ON",
    "AM:STAT ON",
    "FREQ:MODE SWE",
    "VOLT:LIM:STAT ON",
    "FORM:BORD NORM",
    "FUNC:ARB:FILT OFF",
)
"""Settings that another user leaves."""


@pytest.mark.one_in(3)
@pytest.mark.parametrize("command", FOREIGN)
def test_what_another_user_left_is_taken_back_at_arming(command: str, outside: BenchConfig) -> None:
    with laboratory(outside) as lab:
        assert refusal(lab, Switch(lab.control)) == ""
        lab.control.link().write(command)
        reason, report = refusal(lab, Switch(lab.control)), lab.control.report()
        assert max(report.highest_v - 2.5, 2.5 - report.lowest_v) < 0.06
        assert report.largest_jump_v < 0.05
        assert report.ends_at_rest
        assert not reason, "the settings that this box knows are set at arming"


@pytest.mark.deep
def test_it_is_commissioned_like_an_own_generator(outside: BenchConfig) -> None:
    found = commissioned_bench(outside)
    assert deviating(found) == set(), found.checks
    assert 0.05 < found.times.stop_s < 1.0


@pytest.mark.parametrize("fault", ["drive-cable-off", "scpi-silent", "scpi-garbled", "generator-power-off"])
def test_faults_of_wires_and_power_keep_high_voltage_off(fault: str, outside: BenchConfig) -> None:
    with laboratory(outside) as lab:
        lab.control.inject(fault)
        assert refusal(lab, Switch(lab.control))
        assert lab.control.report().live_s == 0


def test_an_unknown_entry_point_and_one_that_makes_nothing_are_refused(outside: BenchConfig) -> None:
    for name, words in (("other", "no package has this entry point"), ("none", "cannot be made: TypeError")):
        with pytest.raises((BenchError, ValueError), match=words), laboratory(simulated(generator={"outside": name})):
            pass


class Failing:
    def message(self, data: bytes, now_s: float) -> bytes:
        raise RuntimeError("of somebody else")

    def output(self):
        return lambda t: np.zeros(t.size // 2)


def test_a_generator_that_raises_is_silent_until_its_power_returns(caplog: pytest.LogCaptureFixture) -> None:
    emitted: list[Segment] = []
    engine = OutsideEngine(Failing(), lambda make: emitted.append(make(0.0)), lambda: 0.0)
    assert engine.execute("*IDN?") is None
    assert engine.hung
    assert "The outside generator failed" in caplog.text
    with pytest.raises(ValueError, match="yields"):
        emitted[0].volts(np.zeros(4))
    engine.set_power(on=False)
    assert emitted[-1] == ConstantSegment(0.0)
    engine.set_power(on=True)
    assert not engine.hung
