"""The interlock on the card's real wire, by the volts at the simulated specimen: dead processes, faults, runs, commissioning."""

import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.config import BenchConfig
from app.session import commissioning as app_commissioning
from app.session import commissioning_record, connect
from app.session.commissioning import INTERLOCK_ON, commission
from app.session.commissioning_record import load_record
from drivers import ArmedBench, Bench, BenchError, Hold, UnsafeError, WallClock
from drivers.evidence.assumption import OutputCheck
from drivers.nidaq.digital_lines import NiDigitalLines
from protocols.base import Prompt
from protocols.commissioning.interlock import measure_interlock
from protocols.commissioning.sequence import Commissioned
from protocols.commissioning.verdict import CheckedOutput, MeasuredTimes, OutputVerdict
from sim_hardware.bench import SimulatedBench
from sim_hardware.operator import SimulatedOperator
from sim_hardware.plant.parameters import InterlockParameters
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.double_faults import INTERLOCK, INTERLOCKED, OFF_WITHIN_S, double_cell, live_until
from tests.helpers.simulated_bench import simulated
from tests.helpers.waiting import wait_until

MONITOR = {"name": "specimen", "channel": "ai2", "kind": "voltage-monitor", "gain": 1000.0}
RATE_HZ = 2000.0
PATIENT = replace(INTERLOCK, monostable_s=2.0)
"""The interlock of most tests: that of `INTERLOCK` is switched off by a busy computer's pause of half a second."""
STATED = {"line": PATIENT.line, "state_line": PATIENT.state_line, "monostable_s": PATIENT.monostable_s}


class Switch:
    """The operator at the amplifier of a simulated bench."""

    def __init__(self, bench: SimulatedBench) -> None:
        self.disable, self.enable = bench.disable_hv, bench.enable_hv


@contextmanager
def interlocked(parameters: InterlockParameters = PATIENT, **tables: Any) -> Iterator[tuple[Bench, SimulatedBench]]:
    """A bench on its wires whose bench file states the interlock; `parameters` are of the simulated one."""
    truth = simulated(plant_rate_hz=20_000.0, modes=3).simulation_parameters
    world = SimulatedBench(replace(truth, interlock=parameters), WallClock(1.0))
    with ServedBench(world) as served, connect(bench_file(served, **tables), without_commissioning="a test") as opened:
        yield opened.bench, world


def bench_file(served: ServedBench, **tables: Any) -> BenchConfig:
    return BenchConfig.model_validate(
        {
            "generator": {"resource": f"TCPIP::127.0.0.1::{served.scpi.port}::SOCKET", "timeout_s": 1.0},
            "card": {"server": f"127.0.0.1:{served.card.port}"},
            "sensor": {"delay_s": 1e-4},
            "watchdog": {"silence_s": 2.0},
            "interlock": STATED,
            **tables,
        }
    )


def specimen_v(world: SimulatedBench) -> float:
    """Volts on the simulated specimen now."""
    volts, hv = world.history.read([world.now()])
    return float(world.parameters.amplifier.map.specimen_v(volts[0])) if hv[0] else 0.0


def read(armed: ArmedBench, bench: Bench, seconds: float) -> None:
    until_s = bench.clock.now() + seconds
    while bench.clock.now() < until_s:
        armed.read_block()


@pytest.mark.deep
@pytest.mark.breaks_the_drive
@pytest.mark.skipif(os.name != "posix", reason="programs cannot be frozen here")
@pytest.mark.parametrize("source", ["33511B", "SDG1032X", "card"])
@pytest.mark.parametrize(
    "pair",
    [("program killed", "watchdog killed"), ("program killed", "watchdog frozen"), ("program killed", "wire cut")],
    ids=" x ".join,
)
def test_a_held_level_is_off_the_specimen_within_a_second_when_nothing_is_left_that_could_act(
    source: str, pair: tuple[str, str], tmp_path: Path
) -> None:
    if source == "card" and "watchdog" in pair[1]:
        pytest.skip("it has no watchdog behind a server")
    seen = double_cell(source, INTERLOCKED, pair, tmp_path)
    assert seen.faults == [], seen.text + seen.next_text
    assert seen.off_s <= INTERLOCK.monostable_s + OFF_WITHIN_S, seen.words
    assert seen.off_s < seen.rest_s or math.isnan(seen.rest_s)


@pytest.mark.deep
def test_high_voltage_comes_at_measured_rest_and_goes_after_it() -> None:
    with interlocked() as (bench, world):
        with bench.armed(RATE_HZ, lambda _: None, Switch(world)) as armed:
            armed.start_drive(Hold(4.0, 6.0))
            read(armed, bench, 1.5)
            assert specimen_v(world) == pytest.approx(900.0, abs=1.0)
            with armed.specimen_access(Switch(world)):
                assert wait_until(lambda: NiDigitalLines.is_closed(bench.interlock._lines) is False)  # type: ignore[arg-type]
            assert specimen_v(world) == pytest.approx(0.0, abs=5.0)
            assert world.history.high_voltage_on
        assert armed.final_rest is not None
        assert armed.final_rest.confirmed
        assert wait_until(lambda: bool(world.report()) and not world.history.high_voltage_on)
        report = world.report()
        assert (report.switched_at_rest, report.ends_at_rest) == (True, True)
        # A second run on the same bench: the relay has opened, and closes again.
        with bench.armed(RATE_HZ, lambda _: None, Switch(world)) as armed:
            assert world.history.high_voltage_on
            read(armed, bench, 1.0)


def drive_until(bench: Bench, world: SimulatedBench, fault: str, runs_on_s: float) -> None:
    """Hold 900 V on the specimen, inject a fault, and read on for this time."""
    with bench.armed(RATE_HZ, lambda _: None, Switch(world)) as armed:
        armed.start_drive(Hold(4.0, 60.0))
        read(armed, bench, 0.5)
        assert specimen_v(world) > 800.0
        world.inject(fault)
        read(armed, bench, runs_on_s)


@pytest.mark.deep
@pytest.mark.breaks_the_drive
def test_an_interlock_that_opens_ends_the_run_at_rest_and_high_voltage_does_not_return() -> None:
    with interlocked() as (bench, world):
        with pytest.raises(BenchError, match="opened") as told:
            drive_until(bench, world, "interlock-line-off", 5.0)
        assert not isinstance(told.value, UnsafeError)
        assert world.report().ends_at_rest
        begun_s = world.faults.active_since("interlock-line-off", np.array([world.now()]))[0]
        assert live_until(world, begun_s) - begun_s <= PATIENT.monostable_s + OFF_WITHIN_S
        world.clear("interlock-line-off")
        begun_s = world.now()
        assert wait_until(lambda: world.now() > begun_s + 1.0)
        assert live_until(world, begun_s) == begun_s
        assert not world.history.high_voltage_on


@pytest.mark.deep
@pytest.mark.breaks_the_drive
def test_a_run_that_cannot_be_brought_to_rest_loses_its_high_voltage_and_says_so() -> None:
    words = r"interlock.*\b2 s"
    with interlocked() as (bench, world):
        with pytest.raises(UnsafeError, match=words):
            drive_until(bench, world, "scpi-dropped", 0.0)
        ended_s = world.now()
        assert wait_until(lambda: bool(world.report()) and not world.history.high_voltage_on)
        assert live_until(world, ended_s) - ended_s <= PATIENT.monostable_s + OFF_WITHIN_S
        assert world.report().end_v == pytest.approx(4.0, abs=0.01)  # the source stayed where it was
        world.clear("scpi-dropped")


@pytest.mark.deep
@pytest.mark.parametrize(
    ("fault", "words"),
    [("interlock-line-off", "supply"), ("interlock-relay-stuck", "stuck")],
)
def test_a_bench_whose_interlock_does_not_move_is_not_armed(fault: str, words: str) -> None:
    with interlocked() as (bench, world):
        if fault == "interlock-relay-stuck":
            with bench.armed(RATE_HZ, lambda _: None, Switch(world)):
                world.inject(fault)
        world.inject(fault)
        with (
            pytest.raises(BenchError, match=words),
            bench.armed(RATE_HZ, lambda _: None, Switch(world)),
        ):
            pytest.fail("it was armed")


def injecting(bench: Bench, world: SimulatedBench, fault: str) -> None:
    """Inject a fault at the moment when the heartbeat ends."""
    end: Callable[[], None] = bench.interlock.end

    def end_with_fault() -> None:
        world.inject(fault)
        end()

    bench.interlock.end = end_with_fault  # type: ignore[method-assign]


@pytest.mark.breaks_the_drive  # high voltage goes at a level
@pytest.mark.deep
@pytest.mark.parametrize("tables", [{}, {"channels": [MONITOR]}], ids=["displacement", "voltage monitor"])
@pytest.mark.parametrize("release_s", [0.02, 0.4])
def test_commissioning_measures_when_high_voltage_is_gone(tables: dict[str, Any], release_s: float) -> None:
    truth = replace(PATIENT, monostable_s=2.1, release_s=release_s)  # the parts are not as the bench file says
    with interlocked(truth, **tables) as (bench, world):
        found = measure_interlock(bench, Switch(world))
        assert found.check is OutputCheck.INTERLOCK
        assert found.value == pytest.approx(2.1 + release_s, abs=0.15)
        assert (found.verdict, found.high) == (OutputVerdict.PASS, 3.0)
        assert ("monitor" if tables else "displacement") in found.detail
        assert world.report().ends_at_rest
        volts = np.array(
            [entry.segment.volts(np.array([entry.start_s + 1e-3]))[0] for entry in world.history.entries()[1:]]
        )
        assert world.parameters.amplifier.map.specimen_v(volts.max()) <= 310.0


@pytest.mark.deep
@pytest.mark.breaks_the_drive
@pytest.mark.parametrize("fault", ["interlock-relay-stuck", "interlock-never-drops"])
def test_commissioning_finds_an_interlock_that_does_not_switch_off(fault: str) -> None:
    with interlocked(state_line_off(), interlock={**STATED, "state_line": ""}) as (bench, world):
        injecting(bench, world, fault)
        found = measure_interlock(bench, Switch(world))
        assert found.verdict is OutputVerdict.DANGEROUS
        assert found.value > 3.0


@pytest.mark.breaks_the_drive  # high voltage goes at a level
@pytest.mark.deep
def test_commissioning_says_what_it_could_not_measure() -> None:
    with interlocked() as (bench, world):
        world.inject("interlock-line-off")
        found = measure_interlock(bench, Switch(world))
        assert found.verdict is OutputVerdict.NOT_MEASURED
        assert "supply" in found.detail
        world.clear()
        world.inject("sensor-stuck")  # nothing sees the level
        assert measure_interlock(bench, Switch(world)).verdict is OutputVerdict.NOT_MEASURED


def state_line_off() -> InterlockParameters:
    return replace(PATIENT, state_line="")


@pytest.mark.breaks_the_drive  # high voltage goes at a level
@pytest.mark.deep
@pytest.mark.parametrize("off_s", [0.1, 1.2])
def test_the_record_has_the_measured_time_and_a_slow_interlock_keeps_high_voltage_off(
    off_s: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commissioning_record, "user_data_path", lambda *_, **__: tmp_path)
    passed = Commissioned(
        (CheckedOutput(OutputCheck.UNEVEN, 1.0, "1", 0.97, 1.03),), MeasuredTimes(0.2, 0.1, 0.1), (), ()
    )
    monkeypatch.setattr(app_commissioning, "commission_bench", lambda *_: passed)
    monkeypatch.setattr(app_commissioning, "_highest_rate", lambda _: RATE_HZ)
    truth = simulated(plant_rate_hz=20_000.0, modes=3).simulation_parameters
    world = SimulatedBench(replace(truth, interlock=replace(PATIENT, release_s=off_s)), WallClock(1.0))
    with ServedBench(world) as served:
        config = bench_file(served)
        operator = SimulatedOperator(world)
        done = commission(config, None, lambda prompt: operator.show(0, prompt))
        assert not world.history.high_voltage_on
        record = load_record(done.identity)
        assert record is not None
        off = done.result.checks[-1]
        assert off.value == pytest.approx(2.0 + off_s, abs=0.15), off.detail
        with connect(config) as opened:
            assert bool(opened.bench.high_voltage_refusal) == (off_s > 1.0)
            if off_s > 1.0:
                assert OutputCheck.INTERLOCK in opened.bench.high_voltage_refusal
            else:
                assert f"{off.value:.2f} s" in opened.bench.interlock.statement

        def leave(prompt: Prompt) -> None:
            """Leave the commissioning when the source is done, before high voltage is switched on."""
            if prompt == INTERLOCK_ON:
                raise KeyboardInterrupt
            operator.show(0, prompt)

        with pytest.raises(KeyboardInterrupt):
            commission(config, None, leave)
        with connect(config) as opened:
            refusal = opened.bench.high_voltage_refusal
            assert f"{OutputVerdict.NOT_MEASURED}: {OutputCheck.INTERLOCK}" in refusal
            assert "measured)" in opened.bench.interlock.statement
