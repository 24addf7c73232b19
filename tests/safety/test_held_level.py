"""A held level and a staircase return to rest by themselves when every process of the program is killed."""

from pathlib import Path

import numpy as np
import psutil
import pytest

from drivers.clock import WallClock
from sim_hardware.bench import SimulatedBench
from sim_hardware.service.served_bench import ServedBench
from sim_hardware.testing.safe_volts import STEP_V
from tests.helpers import one_drive
from tests.helpers.program import Program, start, store_commissioning
from tests.helpers.simulated_bench import simulated
from tests.helpers.waiting import wait_until

LEASE_S, RETURN_S = 5.0, 2.0 / 5.0
SETTINGS = ("levels_v=4.5", "repeats=1", "rest_s=0.5", "hold_s=100")


def kill_every_process(running: Program) -> None:
    for process in (*psutil.Process(running.process.pid).children(recursive=True), running.process):
        process.kill()


@pytest.mark.deep
@pytest.mark.parametrize("drive", ["level", "arbitrary"])
@pytest.mark.parametrize(("model", "margin_s"), [("33511B", 2.0), ("DG1032Z", 2.0), ("SDG1032X", 1.0)])
def test_a_generator_returns_to_rest_by_itself_after_the_death_of_program_and_watchdog(
    model: str, margin_s: float, drive: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within the time that `unattended_rest_s` states, without a jump, killed in the middle of a level or a staircase."""
    bench = SimulatedBench(simulated(generator={"model": model}).simulation_parameters, WallClock(1.0))
    planned = one_drive.DRIVES[drive](8.0)
    stated_s = planned.duration_s + (margin_s + 2 * 1.5 / 5.0 if drive == "level" else 0.0)
    with ServedBench(bench) as served:
        resource = f"TCPIP::127.0.0.1::{served.scpi.port}::SOCKET"
        monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
        store_commissioning(resource)
        (tmp_path / "bench.toml").write_text(
            'name = "bench under test"\n[levels]\nlaser_lost = "warning"\nstroke = "warning"\n'
            f'[generator]\nresource = "{resource}"\n[card]\nserver = "{served.card.address}"\n'
            "[sensor]\ndelay_s = 1e-4\n[watchdog]\nsilence_s = 2\n"
        )
        running = start(bench, tmp_path, f"drive={drive}", "drive_s=8", protocol=one_drive.__file__)
        try:
            running.arm()
            reached_v = 3.999 if drive == "level" else 3.95  # the whole level, or the second step of the staircase
            assert wait_until(lambda: bench.report().end_v > reached_v)
            assert "was commissioned with this firmware" in running.text
            children = psutil.Process(running.process.pid).children()
            living = [child for child in children if child.status() != psutil.STATUS_ZOMBIE]
            assert any("drivers.watchdog.process" in child.cmdline() for child in living)
            kill_every_process(running)
            killed_s = bench.clock.now()
            held_v = bench.report().end_v
            assert wait_until(lambda: bench.clock.now() > killed_s + stated_s + 0.5)
            report = bench.report()
            t = np.arange(killed_s - 2.0, bench.clock.now() - 0.05, 1e-3)
            volts = bench.history.volts(t)
            last_s = t[np.abs(volts - 2.5) > 0.01][-1]
        finally:
            running.close()
    assert abs(held_v - 2.5) > 0.3
    if drive == "level":
        assert held_v == pytest.approx(4.0, abs=2e-3)
    assert last_s > killed_s + 1.0  # no process ended it
    assert last_s - killed_s < stated_s
    assert volts[-1] == pytest.approx(2.5, abs=1e-3)
    assert report.ends_at_rest
    assert report.largest_jump_v <= STEP_V + 1e-6


@pytest.mark.deep
def test_after_the_death_of_every_process_a_held_level_returns_to_rest_by_itself(tmp_path: Path) -> None:
    bench = SimulatedBench(simulated(source="ao0").simulation_parameters, WallClock(1.0))
    with ServedBench(bench) as served:
        (tmp_path / "bench.toml").write_text(
            'name = "bench under test"\n[source]\nkind = "card-output"\n'
            f'[card]\nserver = "{served.card.address}"\n[sensor]\ndelay_s = 1e-4\n'
        )
        running = start(bench, tmp_path, *SETTINGS, protocol="voltage-steps")
        try:
            running.answer("must be ON now", bench.enable_hv, "on")
            for level_v in (4.5, 2.5, 4.5):  # the loop before the first level, and the level
                assert wait_until(lambda level_v=level_v: abs(bench.report().end_v - level_v) < 1e-3)
            held_s = bench.clock.now()
            assert wait_until(lambda: bench.clock.now() > held_s + LEASE_S + RETURN_S + 1.0)
            assert bench.report().end_v == pytest.approx(4.5, abs=1e-3)  # renewed, or it would be at rest by now
            kill_every_process(running)
            killed_s = bench.clock.now()
            assert wait_until(lambda: bench.clock.now() > killed_s + LEASE_S + RETURN_S + 0.5)
            t = np.arange(held_s, bench.clock.now() - 0.05, 1e-3)
            volts = bench.history.volts(t)
            assert np.abs(volts[t < killed_s] - 4.5).max() < 1e-3
            assert volts[-1] == pytest.approx(2.5, abs=1e-3)
            assert t[np.abs(volts - 2.5) > 0.01][-1] - killed_s < LEASE_S + RETURN_S + 0.1
            assert np.abs(np.diff(volts)).max() < 0.02
        finally:
            running.close()
