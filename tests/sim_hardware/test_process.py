"""Simulated bench in its own process: starts, obeys, and never outlives its parent."""

import itertools
import os
import queue
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from drivers.clock import WallClock
from drivers.drive_shapes import Sine
from drivers.errors import BenchError
from drivers.generators.keysight import Keysight33500
from drivers.nidaq.analog_input import NiDigitizer
from drivers.transport.visa import VisaLink
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS
from sim_hardware.plant.history_report import VoltageReport
from sim_hardware.plant.parameters import SimulationParameters
from sim_hardware.service import __main__ as service
from sim_hardware.service.process import BenchProcess
from sim_hardware.service.served_bench import ServedBench

ROOT = Path(__file__).parents[2]


def gone(pid: int) -> bool:
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        if not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
            return True
        time.sleep(0.02)
    return False


@pytest.mark.deep
def test_both_wires_share_one_plant():
    with BenchProcess(SimulationParameters(), speed=10.0) as bench:
        clock = WallClock(10.0, bench.time)
        link = VisaLink(bench.resource, timeout_s=2.0)
        source = Keysight33500(link, clock)
        source.initialize_at_rest(2.5, 0.0, 5.0)
        clock.sleep(0.2)
        bench.enable_hv()
        card = NiDigitizer("Dev1", ("ai0", "ai1"), clock, server=bench.server)
        with card.stream(5e3, 500) as stream:
            source.start_drive(Sine(150.0, 2.5, 2.5, 300))
            # All of the drive is in the stream, however late a slow machine starts it.
            every = (stream.read() for _ in range(600))
            *_, block = itertools.islice((b for b in every if np.ptp(stream.scales[0].to_volts(b.raw[0])) > 4.9), 5)
        volts = stream.scales[0].to_volts(block.raw[0])
        metres = stream.scales[1].to_volts(block.raw[1]) * 1e-4
        assert volts.max() - volts.min() == pytest.approx(5.0, rel=0.01)
        assert metres.max() - metres.min() == pytest.approx(1154e-6, rel=0.02)
        clock.sleep(2.0)
        report = bench.report()
        assert isinstance(report, VoltageReport)
        assert report.ends_at_rest
        assert report.largest_jump_v < 1e-6
        bench.disable_hv()
        card.close()
        link.close()
        pid = bench.pid
    assert gone(pid)


@pytest.mark.deep
def test_faults_by_name_and_refusals_as_errors():
    with BenchProcess() as bench:
        bench.inject("scpi-silent")
        assert bench.active_faults() == ("scpi-silent",)
        bench.clear()
        assert bench.active_faults() == ()
        assert bench.control("now") > 0
        with pytest.raises(BenchError, match=r"'coffee'.*\bscpi-silent\b"):
            bench.inject("coffee")
        with pytest.raises(BenchError, match=r"'explode'.*\binject\b"):
            bench.control("explode")
        with pytest.raises(BenchError, match="inject"):
            bench.control("inject", colour="red")
        os.kill(bench.pid, signal.SIGINT)  # Ctrl-C is not for the bench: the program needs it to come to rest
        assert bench.control("now") > 0
        os.kill(bench.pid, signal.SIGKILL)
        with pytest.raises(BenchError, match="ended with code"):
            bench.control("now")
    with pytest.raises(BenchError, match="closed"):
        bench.control("now")


def test_a_closed_service_does_not_come_back_with_the_next_fault():
    bench = SimulatedBench()
    with ServedBench(bench) as served:
        assert served.control("report")["live_s"] == 0.0
    for fault in FAULT_DESCRIPTIONS:
        bench.inject(fault)
    bench.clear()
    for port in (served.scpi.port, served.card.port):
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", port), timeout=0.5)


@pytest.mark.deep
def test_it_dies_with_a_parent_that_was_killed():
    script = (
        "from sim_hardware.service.process import BenchProcess\nimport time\n"
        "bench = BenchProcess()\nprint(bench.pid, flush=True)\ntime.sleep(240)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=environment) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        assert psutil.pid_exists(pid)
        parent.kill()
    assert gone(pid)


@pytest.mark.deep
def test_a_wrong_configuration_is_refused_in_words():
    request = '{"truth": {"sensor": {"gain": 1}}}\n'
    answer = subprocess.run(
        [sys.executable, "-m", "sim_hardware.service"],
        input=request,
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=180,
    )
    assert answer.returncode == 2
    assert "unknown gain" in answer.stdout


def test_a_bench_that_cannot_start_says_why(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(BenchError, match="ended with code 1"):
        BenchProcess()


def test_the_parent_works_while_the_bench_starts_and_its_error_ends_the_bench():
    children = []
    others = psutil.Process().children()

    def import_something():
        children.extend(child for child in psutil.Process().children() if child not in others)
        raise ImportError("a broken installation")

    with pytest.raises(ImportError, match="broken installation"):
        BenchProcess(meanwhile=import_something)
    assert children
    assert all(gone(child.pid) for child in children)


def test_the_process_ends_with_its_standard_input_even_if_its_threads_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[int] = []
    monkeypatch.setattr(service.sys, "stdin", ["first\n"])
    monkeypatch.setattr(service.time, "sleep", lambda _s: ended.append(-1))
    monkeypatch.setattr(service.os, "_exit", ended.append)
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    service._read_lines(lines)
    assert (lines.get(), lines.get()) == ("first\n", ""), "an empty line ends the main thread"
    assert ended == [-1, 1]
