"""Safe shutdown over real connections: the program runs in its own process, the test monitors the voltage.

The faults that are marked slow are in the fault matrix, too, where the clock is virtual and program and bench are one process.
"""

import re
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from app.common.exit_codes import ExitCode
from drivers.errors import MANUAL_SHUTDOWN_INSTRUCTIONS
from protocols.base import RunStatus
from protocols.runfile.reader import Run
from tests.helpers.program import program, safe

patient = partial(program, watchdog="silence_s = 5")
"""A busy computer's pauses are what tests of the watchdog are about."""


@pytest.mark.deep
def test_a_run_on_a_bench_file_ends_at_rest_with_every_point(tmp_path: Path) -> None:
    with patient(tmp_path, "frequencies_hz=100,160") as (run, _):
        run.arm()
        assert run.end() == ExitCode.DONE, run.text
        assert safe(run.bench).outside_rest_s > 0.5
        assert "SIMULATED" not in run.text  # to the program this is a real bench
    with Run(run.file) as file:
        assert file.record.status == RunStatus.COMPLETED
        assert len(file.points()["frequency"]) == 2


@pytest.mark.one_in(2)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment", [pytest.param("high voltage OFF", marks=pytest.mark.deep), "25.0"])
def test_ctrl_c_and_sigterm_go_to_rest_and_keep_what_was_measured(number: int, moment: str, tmp_path: Path) -> None:
    with patient(tmp_path) as (run, _):
        if moment == "25.0":
            run.arm()
        run.wait_for(moment)
        run.process.send_signal(number)
        assert run.end() == ExitCode.FAILED, run.text
        safe(run.bench)
    with Run(run.file) as file:
        assert file.record.status == RunStatus.STOPPED
        assert (len(file.points()["frequency"]) > 0) == (moment == "25.0")


@pytest.mark.deep
def test_burst_of_a_killed_program_ends_at_rest_by_itself(tmp_path: Path) -> None:
    """Even without a watchdog."""
    settings = ("frequencies_hz=100", "settle_limit_s=0.5", "record_s=1")
    with program(tmp_path, *settings, watchdog="enabled = false") as (run, _):
        run.arm()
        run.wait_for("No watchdog: the bench file disables it")
        run.wait_for("high voltage is on")
        while run.bench.report().outside_rest_s < 0.2:
            time.sleep(0.02)
        run.process.kill()
        run.end()
        bench = run.bench
        deadline = bench.clock.now() + 60.0
        while not bench.report().ends_at_rest and bench.clock.now() < deadline:
            bench.clock.sleep(0.05)
        safe(bench)
    with Run(run.file) as file:
        assert file.record.state == "crashed"
        assert file.trace.sample_count > 1000


@pytest.mark.deep
def test_the_generators_wire_cut_mid_run_ends_at_measured_rest(tmp_path: Path) -> None:
    """The generator can no longer be commanded; its finite burst ends, and the card measures this."""
    with patient(tmp_path, "settle_limit_s=0.5", "frequencies_hz=100,150,200") as (run, _):
        run.arm()
        run.wait_for("100.0")
        run.bench.inject("scpi-dropped")
        assert run.end() == ExitCode.FAILED, run.text
        assert "At rest: the card sees 2.500 V" in run.text
        with Run(run.file) as file:
            assert re.search(r"TCPIP::127\.0\.0\.1::\d+::SOCKET", file.record.reason)
        safe(run.bench)


@pytest.mark.deep
@pytest.mark.breaks_the_drive
def test_the_generators_power_lost_mid_run_is_unsafe_and_says_what_to_do(tmp_path: Path) -> None:
    with patient(tmp_path, "settle_limit_s=0.5") as (run, _):
        run.arm()
        run.wait_for("25.0")
        run.bench.inject("generator-power-off")
        assert run.end() == ExitCode.UNSAFE, run.text
        assert MANUAL_SHUTDOWN_INSTRUCTIONS in run.text
    with Run(run.file) as file:
        assert file.record.status == RunStatus.UNSAFE
        assert len(file.points()["frequency"]) >= 1


@pytest.mark.deep
def test_card_lost_mid_run_is_unsafe_because_rest_cannot_be_measured(tmp_path: Path) -> None:
    with patient(tmp_path, "settle_limit_s=0.5") as (run, _):
        run.arm()
        run.wait_for("25.0")
        run.bench.inject("card-unplugged")
        assert run.end() == ExitCode.UNSAFE, run.text
        assert MANUAL_SHUTDOWN_INSTRUCTIONS in run.text
        safe(run.bench)  # the source obeyed all the same


@pytest.mark.deep
def test_samples_lost_mid_run_fail_the_run_at_measured_rest(tmp_path: Path) -> None:
    with patient(tmp_path, "settle_limit_s=0.5") as (run, _):
        run.arm()
        run.wait_for("25.0")
        run.bench.inject("card-overrun")
        assert run.end() in (ExitCode.FAILED, ExitCode.UNSAFE), run.text
        assert "scans were lost because the program read too late; lower the rate" in run.text
        safe(run.bench)
