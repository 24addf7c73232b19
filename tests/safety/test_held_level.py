"""A level held by the card's analogue output returns to rest by itself when every process of the program is killed."""

import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from drivers.clock import WallClock
from sim_hardware.bench import SimulatedBench
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.program import start
from tests.helpers.simulated_bench import simulated

LEASE_S, RETURN_S = 5.0, 2.0 / 5.0
SETTINGS = ("levels_v=4.5", "repeats=1", "rest_s=0.5", "hold_s=100")


def wait_until(condition) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.1)


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
            wait_until(lambda: abs(bench.report().end_v - 4.5) < 1e-3)
            held_s = bench.clock.now()
            wait_until(lambda: bench.clock.now() > held_s + LEASE_S + RETURN_S + 1.0)
            assert bench.report().end_v == pytest.approx(4.5, abs=1e-3)  # renewed, or it would be at rest by now
            for process in (*psutil.Process(running.process.pid).children(recursive=True), running.process):
                process.kill()
            killed_s = bench.clock.now()
            wait_until(lambda: bench.clock.now() > killed_s + LEASE_S + RETURN_S + 0.5)
            t = np.arange(held_s, bench.clock.now() - 0.05, 1e-3)
            volts = bench.history.volts(t)
            assert np.abs(volts[t < killed_s] - 4.5).max() < 1e-3
            assert volts[-1] == pytest.approx(2.5, abs=1e-3)
            assert t[np.abs(volts - 2.5) > 0.01][-1] - killed_s < LEASE_S + RETURN_S + 0.1
            assert np.abs(np.diff(volts)).max() < 0.02
        finally:
            running.close()
