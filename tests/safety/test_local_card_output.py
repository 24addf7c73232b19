"""Watchdog of an analogue output of a card in this computer: it takes the output from where a dead program's tasks ended."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.bench.drive_limits import DriveLimits, HvAmplifier
from drivers.bench.watchdog_interface import HeartbeatClock
from drivers.clock import WallClock
from drivers.drive_shapes import Drive, Hold, Sine
from drivers.watchdog.client import WatchdogClient
from drivers.watchdog.config import WatchdogConfig
from drivers.watchdog.log import LOG_NAME
from model.amplifier_map import AmplifierMap
from sim_hardware.bench import SimulatedBench
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.simulated_bench import assert_safe_voltage, simulated
from tests.helpers.watchdog_sources import LocalCardOutput, end_tasks_of_dead_process


def wait(until: Callable[[], object]) -> None:
    deadline = time.monotonic() + 60.0
    while not until():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.deep
@pytest.mark.parametrize("drive", [Hold(4.5, 600.0), Sine(0.05, 2.0, 2.5, 20)], ids=["level", "sine"])
def test_the_watchdog_takes_the_output_from_the_sample_that_a_dead_program_left(drive: Drive, tmp_path: Path) -> None:
    """Two processes with a driver of their own each. The level is measured inside the card before it is moved."""
    bench = SimulatedBench(simulated(source="ao0").simulation_parameters, WallClock(1.0))
    with ServedBench(bench) as served:
        options = {"device": "Dev1", "channel": "ao0", "server": served.card.address}
        source_path = f"{LocalCardOutput.__module__}:{LocalCardOutput.__qualname__}"
        watchdog = WatchdogClient(
            WatchdogConfig(source_path, "", 2.0, options=options, own_connection=False, patience_s=30.0, silence_s=60.0)
        )
        watchdog.set_log_folder(tmp_path)
        clock = HeartbeatClock()
        clock.watchdog = watchdog
        source = LocalCardOutput(clock=clock, **options)
        amplifier = HvAmplifier(source, AmplifierMap(), DriveLimits(), clock, watchdog)
        amplifier.initialize_at_rest()
        watchdog.arm()
        bench.enable_hv()
        amplifier.start_drive(drive)
        wait(lambda: bench.report().end_v > 3.5)
        end_tasks_of_dead_process(served)
        stuck_v = bench.report().end_v
        assert stuck_v > 3.5
        assert watchdog._child.stdin is not None
        watchdog._live.clear()
        watchdog._child.stdin.close()  # what a dead program leaves: a closed pipe
        wait(
            lambda: "was brought to rest" in (tmp_path / LOG_NAME).read_text() if (tmp_path / LOG_NAME).exists() else 0
        )
        report = bench.report()
        assert report.ends_at_rest
        assert report.largest_jump_v < 0.05
        assert_safe_voltage(report)
        watchdog.close()
        source.close()
