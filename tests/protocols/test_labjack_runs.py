"""Runs with a LabJack T7 as the card, over its wire: results of the same truth, a stream that dies, lost scans, commissioning."""

import math
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.campaign.campaign import Campaign
from app.campaign.queue import CampaignRunner
from app.campaign.status import ItemStatus
from app.config.bench_file import BenchConfig
from app.session.bench_connection import BenchConnection, connect
from app.session.commissioning_record import make_record
from app.session.session import Session
from drivers.bench.bench import Bench
from drivers.clock import WallClock
from drivers.evidence.assumption import OutputCheck
from drivers.interfaces import Identity
from drivers.labjack.output import RESOLUTION_V
from protocols.base import DriveStarted, EntryStarted, Event, EventBus, Operator, Protocol, RunEnded, RunStatus
from protocols.measurements.free_decay import FreeDecay
from protocols.measurements.hysteresis import Hysteresis
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.sweep import Sweep
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runfile.reader import Run
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner
from sim_hardware.bench import SimulatedBench
from sim_hardware.labjack.t7_server import SimulatedT7
from sim_hardware.operator import SimulatedOperator
from sim_hardware.service.served_bench import ServedBench
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.app.test_campaign import QUICK
from tests.helpers.commissioning import commissioned_bench, deviating
from tests.helpers.simulated_bench import Trigger, laboratory, run, simulated
from tests.helpers.wired_bench import SIMULATED

pytestmark = pytest.mark.deep

FREQUENCIES_HZ = (120.0, 160.0, 200.0)
DWELL = SineDwell(frequencies_hz=FREQUENCIES_HZ, record_s=0.2, min_cycles=10)


PLAYS = {"kind": "labjack-output", "external_power": True}
"""Table [source] of a second LabJack that plays the drives."""


def with_labjack(source: dict[str, Any] | None = None, **truth: Any) -> BenchConfig:
    """Return the ideal simulated bench with a LabJack as its card."""
    config = simulated(**truth).model_dump()
    card = {"driver": "labjack-t7", "device": "192.0.2.9"}
    return BenchConfig.model_validate({**config, "card": card, "source": source or {}})


@contextmanager
def labjack_bench() -> Iterator[tuple[Bench, SimulatedBench, SimulatedT7]]:
    with labjack_connection() as (lab, control, device):
        yield lab.bench, control, device


@contextmanager
def labjack_connection(
    source: dict[str, Any] | None = None, **truth: Any
) -> Iterator[tuple[BenchConnection, SimulatedBench, SimulatedT7]]:
    """A bench as the program opens a real one: its source and the LabJack over their connections."""
    control = SimulatedBench(with_labjack(source, **truth).simulation_parameters, WallClock(1.0))
    with ExitStack() as stack:
        served = stack.enter_context(ServedBench(control))
        assert isinstance(served.card, SimulatedT7)
        config = BenchConfig.model_validate(
            {
                "source": {**source, "device": served.source_address} if source else {},
                "generator": {"resource": served.scpi.resource},
                "card": {"driver": "labjack-t7", "device": served.card.address},
                "sensor": {"delay_s": 1e-4},
                "watchdog": {"enabled": False},
            }
        )
        yield stack.enter_context(connect(config, without_commissioning=SIMULATED)), control, served.card


@pytest.fixture(scope="module")
def with_ni(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """Amplitudes and phases of the same truth with an NI card."""
    with laboratory() as lab:
        return figures(run(DWELL, tmp_path_factory.mktemp("ni"), lab).path)


def figures(path: Path) -> np.ndarray:
    with Run(path) as file:
        points = file.points()
    return np.array([points[name] for name in ("fundamental", "phase")])


def test_a_dwell_with_a_labjack_in_this_process_is_that_with_an_ni_card(with_ni: np.ndarray, tmp_path: Path) -> None:
    with laboratory(with_labjack()) as lab:
        assert lab.bench.digitizer.identity.serial == "470012345"
        ran = run(DWELL, tmp_path, lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    np.testing.assert_allclose(figures(ran.path)[0], with_ni[0], rtol=1e-3)
    np.testing.assert_allclose(figures(ran.path)[1], with_ni[1], atol=1e-3)


def test_a_dwell_over_the_wire_of_a_labjack_is_that_with_an_ni_card(with_ni: np.ndarray, tmp_path: Path) -> None:
    with labjack_bench() as (bench, control, _):
        runner = Runner(RunRequest(DWELL, tmp_path, "T1"), bench, SimulatedOperator(control), EventBus())
        ended = runner.run()
        assert ended.status is RunStatus.COMPLETED, ended.reason
        assert_safe_voltage(control.report())
    np.testing.assert_allclose(figures(runner.path)[0], with_ni[0], rtol=1e-3)
    np.testing.assert_allclose(figures(runner.path)[1], with_ni[1], atol=1e-3)


WITHIN_4_9_V: dict[str, Protocol] = {
    "sine-dwell": SineDwell(frequencies_hz=FREQUENCIES_HZ, record_s=0.2, min_cycles=10, peak_to_peak_v=4.0),
    "free-decay": FreeDecay(edges=4),
    "hysteresis": Hysteresis(frequencies_hz=(1.0, 5.0), cycles=4, peak_to_peak_v=4.0),
    "voltage-steps": VoltageSteps(levels_v=(1.5, 3.5), repeats=2, rest_s=0.3, read_s=0.3, hold_s=0.5),
}


@pytest.mark.parametrize("name", list(WITHIN_4_9_V))
def test_a_run_with_a_labjack_as_source_and_another_as_card_is_that_with_a_generator(name: str, tmp_path: Path) -> None:
    """Within the step of its converter, 1.2 mV."""
    amplitudes = []
    for source in ({}, PLAYS):
        with laboratory(with_labjack(source)) as lab:
            ran = run(WITHIN_4_9_V[name], tmp_path / str(len(source)), lab)
        assert ran.status is RunStatus.COMPLETED, ran.reason
        amplitudes.append((ran.report.lowest_v, ran.report.highest_v, *_displacements(ran.points)))
    assert ran.report.largest_jump_v < 0.01
    assert ran.report.end_v == pytest.approx(2.5, abs=RESOLUTION_V)
    np.testing.assert_allclose(amplitudes[0][:2], amplitudes[1][:2], atol=2 * RESOLUTION_V)
    np.testing.assert_allclose(amplitudes[0][2:], amplitudes[1][2:], rtol=5e-3)


def _displacements(points: list[Any]) -> list[float]:
    """Return the displacement of each point that has one, in its protocol's own sense."""
    names = ("fundamental", "peak_to_peak", "displacement")
    return [float(getattr(point, name)) for point in points for name in names if hasattr(point, name)]


def test_a_dwell_with_a_labjack_as_source_over_both_wires_ends_at_measured_rest(tmp_path: Path) -> None:
    with labjack_connection(PLAYS) as (lab, control, _):
        assert lab.bench.amplifier.identity.serial != lab.bench.digitizer.identity.serial
        request = RunRequest(WITHIN_4_9_V["sine-dwell"], tmp_path, "T1")
        ended = Runner(request, lab.bench, SimulatedOperator(control), EventBus()).run()
        assert ended.status is RunStatus.COMPLETED, ended.reason
        assert_safe_voltage(control.report())


@pytest.mark.breaks_the_drive
def test_a_source_that_loses_power_in_mid_run_is_unsafe_and_the_manual_steps_are_told(tmp_path: Path) -> None:
    with laboratory(with_labjack(PLAYS)) as lab:
        cut = Trigger(lambda event: isinstance(event, DriveStarted), lambda: lab.control.inject("generator-power-off"))
        ran = run(WITHIN_4_9_V["sine-dwell"], tmp_path, lab, cut, safe=False)
    assert ran.status is RunStatus.UNSAFE
    assert ran.reason.startswith("UNSAFE")
    assert ran.report.end_v == 0.0


def test_a_labjack_that_starts_at_zero_volts_is_never_given_high_voltage(tmp_path: Path) -> None:
    with laboratory(with_labjack(PLAYS, card={"power_up_v": 0.0})) as lab:
        ran = run(WITHIN_4_9_V["sine-dwell"], tmp_path, lab, safe=False)
    assert ran.status is RunStatus.FAILED
    assert re.search(r"\b0\.0000\b.*\b1\.2\b", ran.reason)
    assert ran.report.live_s == 0
    assert ran.report.end_v == pytest.approx(2.5, abs=RESOLUTION_V)


def test_a_source_that_relies_on_an_unmeasured_interlock_is_refused_despite_the_override() -> None:
    control = SimulatedBench(simulated(source="DAC0").simulation_parameters, WallClock(1.0))
    with ServedBench(control) as served:
        config = BenchConfig.model_validate(
            {
                "source": {"kind": "labjack-output", "device": served.source_address},
                "card": {"server": served.card.address},
                "interlock": {"line": "port0/line0"},
                "watchdog": {"enabled": False},
            }
        )
        with connect(config, without_commissioning=SIMULATED) as lab:
            assert "-500" in lab.bench.high_voltage_refusal
        with connect(config, without_commissioning=SIMULATED, measures_interlock=True) as lab:
            assert not lab.bench.high_voltage_refusal


def test_commissioning_passes_with_a_labjack_as_source() -> None:
    commissioned = commissioned_bench(with_labjack(PLAYS))
    assert deviating(commissioned) == set()
    record = make_record(Identity("LabJack", "T7", "470054321"), True, 1e5, commissioned, "labjack-t7")
    rows = {row["property"]: row["verdict"] for row in record["assumptions"]}
    assert {rows["repetition"], rows["lost connection in mid-drive"]} == {"pass"}
    assert "power-up level" in rows


def run_with_fault(folder: Path, act: Any) -> tuple[RunEnded, list[Event], Path, SimulatedBench]:
    """Run the dwell; call `act` with the LabJack and the bench in the second drive."""
    drives, events = 0, []
    with labjack_bench() as (bench, control, device):

        def observe(event: Event) -> None:
            nonlocal drives
            events.append(event)
            drives += isinstance(event, DriveStarted)
            if drives == 2 and isinstance(event, DriveStarted):
                act(device, control)

        runner = Runner(RunRequest(DWELL, folder, "T1"), bench, SimulatedOperator(control), EventBus(observe))
        ended = runner.run()
        assert control.report().ends_at_rest
        return ended, events, runner.path, control


def test_a_stream_that_dies_in_mid_run_ends_at_measured_rest_with_its_data(tmp_path: Path) -> None:
    def kill(device: SimulatedT7, _: SimulatedBench) -> None:
        device.stream_peer_gone = True

    ended, _, path, _ = run_with_fault(tmp_path, kill)
    assert ended.status is RunStatus.FAILED
    assert "127.0.0.1" in ended.reason
    with Run(path) as file:
        np.testing.assert_allclose(file.points()["frequency"], FREQUENCIES_HZ[:1], atol=0.05)


def test_an_entry_that_lost_scans_in_a_labjack_is_measured_again(tmp_path: Path) -> None:
    def overrun(_: SimulatedT7, control: SimulatedBench) -> None:
        control.inject("card-overrun")
        control.clear("card-overrun")

    ended, events, path, _ = run_with_fault(tmp_path, overrun)
    assert ended.status is RunStatus.COMPLETED, ended.reason
    assert [event.index for event in events if isinstance(event, EntryStarted)] == [0, 1, 1, 2]
    with Run(path) as file:
        np.testing.assert_allclose(file.points()["frequency"], FREQUENCIES_HZ, atol=0.05)


@pytest.mark.parametrize(("traits", "found"), [("", set()), ("skew=double", {OutputCheck.SKEW})])
def test_commissioning_measures_the_time_between_the_conversions_of_a_labjack(
    traits: str, found: set[OutputCheck]
) -> None:
    commissioned = commissioned_bench(with_labjack(card={"traits": traits}))
    assert deviating(commissioned) == found
    (skew,) = [check for check in commissioned.checks if check.check is OutputCheck.SKEW]
    identity = Identity("Keysight", "33511B", "MY1")
    record = make_record(identity, True, 1e5, commissioned, "labjack-t7")
    rows = {row["property"]: row["verdict"] for row in record["assumptions"]}
    assert rows["time between conversions"] == ("differs" if traits else "pass")
    assert rows["settling and ghosting"] == "pass"
    assert "channel skew" not in rows  # a row of NI's cards
    assert skew.value == pytest.approx(
        45e-6 if traits else 0.0, abs=1e-6
    )  # three conversions between the two of the drive


def carry_out(campaign: Campaign, lab: BenchConnection, operator: Operator) -> None:
    conductor = CampaignRunner(campaign)
    session = Session(lambda: nullcontext(lab), [conductor], operator)
    session.start()
    try:
        for _ in QUICK:
            line = campaign.next_item()
            assert line is not None
            conductor.start(session, line)
            assert session.finished.wait(120)
    finally:
        assert session.close(60)


@pytest.mark.parametrize("wire", ["in-process", "modbus"])
def test_a_campaign_with_a_labjack_is_carried_out_to_its_end(wire: str, tmp_path: Path) -> None:
    campaign = Campaign.create(tmp_path, "T1", wire == "in-process", QUICK)
    if wire == "in-process":
        with laboratory(with_labjack()) as lab:
            carry_out(campaign, lab, lab.operator)
            assert_safe_voltage(lab.control.report())
    else:
        with labjack_connection() as (lab, control, _):
            carry_out(campaign, lab, SimulatedOperator(control))
            assert_safe_voltage(control.report())
    assert campaign.next_item() is None
    assert {state.status for state in campaign.item_states()} == {ItemStatus.DONE}


FIVE: dict[str, Protocol] = {
    "sine-dwell": DWELL,
    "sweep": Sweep(periods=3),
    "free-decay": FreeDecay(edges=6),
    "hysteresis": Hysteresis(frequencies_hz=(0.5, 1.0, 2.0, 5.0), cycles=5),
    "voltage-steps": VoltageSteps(levels_v=(1.5, 2.0, 3.0, 3.5), repeats=3, rest_s=0.3, read_s=0.3, hold_s=0.5),
}
SEEDS = 6


def estimates(name: str, card: str, seed: int, noise_seed: int, folder: Path) -> dict[str, tuple[float, float]]:
    """Return the estimates and the columns with errors of a run, (value, error) by name."""
    config = with_labjack if card == "labjack" else simulated
    with laboratory(config(seed=seed, noise_seed=noise_seed)) as lab:
        ran = run(FIVE[name], folder / f"{name} {card} {seed}", lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    with Run(ran.path) as file:
        found = {each.name: (each.value, each.standard_error) for each in file.record.estimates}
        points = file.points()
    for column in points:
        for at, error in enumerate(np.atleast_1d(points.get(f"{column}_errors", ()))):
            found[f"{column} {at}"] = float(points[column][at]), float(error)
    return found


@pytest.mark.parametrize("name", list(FIVE))
def test_results_with_a_labjack_and_with_an_ni_card_agree_within_their_combined_errors(
    name: str, tmp_path: Path
) -> None:
    """Two standard errors in 95 %, and no offset: over seeds of instruments and of noise, all figures of a protocol."""
    z: list[float] = []
    for seed in range(1, SEEDS + 1):
        ni = estimates(name, "ni", seed, 100 + seed, tmp_path)
        labjack = estimates(name, "labjack", seed, 200 + seed, tmp_path)
        assert ni.keys() == labjack.keys()
        pairs = [(*ni[key], *labjack[key]) for key in ni]
        z += [(b - a) / math.hypot(u, v) for a, u, b, v in pairs if u > 0 and v > 0 and math.isfinite(a - b)]
    beyond = np.abs(z) > 2
    assert len(z) >= SEEDS
    # Figures of one run share their noise: the limit is 95 % less three standard deviations of a third of them.
    assert beyond.mean() <= 0.05 + 3 * math.sqrt(0.05 * 0.95 * 3 / len(z)), (beyond.mean(), z)
    assert abs(np.mean(z)) < 3 * math.sqrt(3 / len(z))
