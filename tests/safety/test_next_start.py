"""The next start after a death of the program, of the watchdog or of both: rest is measured, or the run is unsafe."""

import contextlib
import re
import time
from pathlib import Path

import grpc
import nidaqmx
import psutil
import pytest
from nidaqmx.constants import AcquisitionType

from app.common.exit_codes import ExitCode
from drivers.bench.rest import SWITCH_OFF_NOW
from drivers.clock import WallClock
from drivers.errors import MANUAL_SHUTDOWN_INSTRUCTIONS
from drivers.generators.keysight import Keysight33500
from drivers.transport.visa import VisaLink
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.program import program, safe, start

SETTINGS = ("frequencies_hz=100", "settle_limit_s=1", "record_s=1")


@contextlib.contextmanager
def reserved_by_another_client(served: ServedBench):
    """The card's input as a client without a session name leaves it."""
    channel = grpc.insecure_channel(served.card.address)
    with nidaqmx.Task(grpc_options=nidaqmx.GrpcSessionOptions(channel, "")) as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
        task.start()
        yield
    channel.close()


def hold_level(served: ServedBench, level_v: float) -> None:
    """Leave the generator at a level, as a program and a watchdog that were killed together leave it."""
    source = Keysight33500(VisaLink(served.scpi.resource), WallClock())
    source.is_at_rest(2.5, 0.0, 5.0)
    source.stop()
    source.ramp_to(level_v, abs(level_v - 2.5) / 5.0)
    source.close()


@pytest.mark.deep
def test_after_the_death_of_the_program_the_next_start_measures_rest_and_runs(tmp_path: Path) -> None:
    with program(tmp_path, *SETTINGS, watchdog="silence_s = 5") as (first, _):
        first.go_live()
        first.process.kill()
        first.end()
        second = start(first.bench, tmp_path, *SETTINGS)
        try:
            second.answer("must be ON now", first.bench.enable_hv, "on")
            assert second.end() == ExitCode.DONE, second.text
            assert "Since the last start the watchdog wrote" in second.text
        finally:
            second.close()
        safe(first.bench)


@pytest.mark.deep
def test_after_the_death_of_both_the_level_they_left_is_told_and_ramped_to_rest(tmp_path: Path) -> None:
    with program(tmp_path, *SETTINGS, watchdog="silence_s = 5") as (first, served):
        first.go_live()
        for process in (*psutil.Process(first.process.pid).children(), first.process):
            process.kill()
        first.end()
        bench = first.bench
        deadline = time.monotonic() + 30.0
        while not bench.report().ends_at_rest and time.monotonic() < deadline:  # the burst ends by itself
            time.sleep(0.1)
        hold_level(served, 1.18)
        assert bench.report().end_v == pytest.approx(1.18, abs=0.01)
        second = start(bench, tmp_path, *SETTINGS)
        try:
            second.wait_for("DANGER")
            second.answer("must be ON now", bench.enable_hv, "on")
            assert second.end() == ExitCode.DONE, second.text
            assert re.search(r"DANGER.*\bearlier\b.*\b1\.18\d V\b", second.text)
        finally:
            second.close()
        safe(bench)


@pytest.mark.deep
def test_where_the_card_cannot_be_had_a_level_that_was_left_is_ramped_down_and_the_run_is_unsafe(
    tmp_path: Path,
) -> None:
    with program(tmp_path, *SETTINGS, watchdog="silence_s = 5") as (first, served):
        first.arm()
        assert first.end() == ExitCode.DONE, first.text
        bench = first.bench
        hold_level(served, 1.18)
        with reserved_by_another_client(served):
            second = start(bench, tmp_path, *SETTINGS)
            try:
                assert second.end() == ExitCode.UNSAFE, second.text
            finally:
                second.close()
        assert SWITCH_OFF_NOW in second.text
        assert MANUAL_SHUTDOWN_INSTRUCTIONS in second.text
        safe(bench)


@pytest.mark.deep
def test_without_its_server_at_the_next_start_a_level_that_was_left_is_ramped_down_and_the_program_is_unsafe(
    tmp_path: Path,
) -> None:
    with program(tmp_path, *SETTINGS, watchdog="silence_s = 5") as (first, served):
        first.arm()
        assert first.end() == ExitCode.DONE, first.text
        bench = first.bench
        hold_level(served, 1.18)
        bench.inject("grpc-gone")
        second = start(bench, tmp_path, *SETTINGS)
        try:
            assert second.end() == ExitCode.UNSAFE, second.text
        finally:
            second.close()
            bench.clear()
        assert MANUAL_SHUTDOWN_INSTRUCTIONS in second.text
        assert "An earlier program left a drive or a level on the source; it was ramped to rest now" in second.text
        safe(bench)
