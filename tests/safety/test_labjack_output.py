"""Watchdog of a LabJack that plays the drives: a process with its own connection takes a level or a drive to rest without a jump."""

from pathlib import Path

import pytest

from drivers.bench.drive_limits import DriveLimits, HvAmplifier
from drivers.bench.watchdog_interface import HeartbeatClock
from drivers.clock import WallClock
from drivers.drive_shapes import Drive, Hold, Sine
from drivers.labjack.output import RESOLUTION_V, T7Output
from drivers.watchdog.client import WatchdogClient
from drivers.watchdog.config import WatchdogConfig
from drivers.watchdog.log import LOG_NAME
from model.amplifier_map import AmplifierMap
from sim_hardware.bench import SimulatedBench
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.simulated_bench import assert_safe_voltage, simulated
from tests.helpers.waiting import wait_until


@pytest.mark.deep
@pytest.mark.parametrize("drive", [Hold(4.5, 600.0), Sine(0.2, 2.0, 2.5, 200)], ids=["level", "sine"])
def test_the_watchdog_takes_a_labjack_to_rest_when_its_program_is_dead(drive: Drive, tmp_path: Path) -> None:
    bench = SimulatedBench(simulated(source="DAC0").simulation_parameters, WallClock(1.0))
    with ServedBench(bench) as served:
        options = {"device": served.source_address, "channel": "DAC0"}
        watchdog = WatchdogClient(
            WatchdogConfig(
                f"{T7Output.__module__}:{T7Output.__qualname__}",
                "",
                2.0,
                options={**options, "checks_power_up": False},
                patience_s=30.0,
                silence_s=60.0,
            )
        )
        watchdog.set_log_folder(tmp_path)
        clock = HeartbeatClock()
        clock.watchdog = watchdog
        source = T7Output(clock=clock, **options)
        amplifier = HvAmplifier(source, AmplifierMap(), DriveLimits(), clock, watchdog)
        amplifier.initialize_at_rest()
        watchdog.arm()
        bench.enable_hv()
        amplifier.start_drive(drive)
        assert wait_until(lambda: bench.report().end_v > 4.0)
        source.close()
        assert watchdog._child.stdin is not None
        watchdog._live.clear()
        watchdog._child.stdin.close()  # what a dead program leaves: a closed pipe
        log = tmp_path / LOG_NAME
        assert wait_until(lambda: log.exists() and "brought" in log.read_text())
        report = bench.report()
        assert report.end_v == pytest.approx(2.5, abs=RESOLUTION_V)
        assert report.largest_jump_v < 0.01
        assert_safe_voltage(report)
        watchdog.close()
