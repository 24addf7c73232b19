"""Clocks: real time at a speed, and bench time that several processes share and that waits for a late reader."""

import math
import subprocess
import sys
from collections import UserList
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from drivers.clock import READER_GONE_S, SharedTime, WallClock
from drivers.nidaq.analog_input import NiDigitizer
from sim_hardware.bench import SimulatedBench
from sim_hardware.nidaq.input_task import LATE_S
from sim_hardware.nidaq.task import SimulatedNiDevice
from sim_hardware.plant import SimulationParameters
from tests.helpers.simulated_bench import installed
from tests.wires.ni_library import NiLibrary


class Real:
    """Real time of the test."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 1000.0
        monkeypatch.setattr("drivers.clock.time", SimpleNamespace(monotonic=lambda: self.now_s, sleep=self.pass_))

    def pass_(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def real(monkeypatch: pytest.MonkeyPatch) -> Real:
    return Real(monkeypatch)


def test_processes_have_the_same_time(real: Real, tmp_path: Path) -> None:
    bench = SharedTime(tmp_path / "time", 10.0, new=True)
    real.pass_(2.0)
    program = WallClock(10.0, SharedTime(tmp_path / "time", 10.0))
    assert bench.now() == pytest.approx(20.0)
    assert program.now() == pytest.approx(20.0)


def test_time_waits_for_a_late_reader_and_runs_on_from_there(real: Real, tmp_path: Path) -> None:
    bench, program = (SharedTime(tmp_path / "time", 10.0, new=new) for new in (True, False))
    bench.wait_at(3.0)
    real.pass_(0.4)
    assert [program.now(), bench.now()] == pytest.approx([3.0, 3.0], abs=1e-4)
    bench.wait_at(5.0)
    assert program.now() == pytest.approx(3.0)
    real.pass_(0.1)
    assert program.now() == pytest.approx(4.0)
    real.pass_(0.3)
    assert [program.now(), bench.now()] == pytest.approx([5.0, 5.0], abs=1e-4)
    bench.wait_at(2.0)  # never back
    real.pass_(0.1)
    assert [program.now(), bench.now()] == pytest.approx([5.0, 5.0], abs=1e-4)


@pytest.mark.parametrize("moment", range(1, 5))
@pytest.mark.one_in(1)
def test_a_limit_that_another_process_sets_in_the_middle_of_a_reading_does_not_turn_time_back(
    moment: int, real: Real, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, program = (SharedTime(tmp_path / "time", 10.0, new=new) for new in (True, False))
    bench.wait_at(3.0)
    real.pass_(20.0)  # the reader has gone
    left = iter(range(moment, -10, -1))

    class Numbers(UserList[float]):
        def __getitem__(self, place: Any) -> Any:
            if next(left) == 0:
                bench.wait_at(201.0)  # the next reader begins
            return bench._numbers[place]

        def __setitem__(self, place: Any, number: Any) -> None:
            bench._numbers[place] = number

    monkeypatch.setattr(program, "_numbers", Numbers())
    assert program.now() == pytest.approx(200.0, abs=1e-3)
    assert SharedTime(tmp_path / "time", 10.0).now() == pytest.approx(200.0, abs=1e-3)


@pytest.mark.one_in(1)
def test_a_number_that_another_process_writes_is_never_read_as_zero(tmp_path: Path) -> None:
    """It would set the bench time back to its beginning, where it stands still for as long as it has run."""
    path = tmp_path / "time"
    program = SharedTime(path, 10.0, new=True)
    write = (
        "import sys; from pathlib import Path; from drivers.clock import SharedTime; shared = SharedTime(Path(sys.argv[1]), 10.0)\n"
        "for at in range(300_000): shared.wait_at(1e9)"
    )
    program.wait_at(1e9)
    with subprocess.Popen([sys.executable, "-c", write, path]) as bench:
        limits: set[float] = set()
        while bench.poll() is None:
            limits.update(program._numbers[2] for _ in range(10_000))
    assert limits == {1e9}
    assert bench.returncode == 0


def test_time_runs_on_without_a_reader(real: Real, tmp_path: Path) -> None:
    bench = SharedTime(tmp_path / "time", 10.0, new=True)
    bench.wait_at(3.0)
    real.pass_(READER_GONE_S - 0.01)
    assert bench.now() == pytest.approx(3.0)
    real.pass_(0.02)
    assert 3.0 < bench.now() < 3.5
    first, second = bench.now(), bench.now()
    assert first < second
    bench.wait_at(math.inf)
    assert bench.now() > 3.0


def test_sleeping_ends_in_bench_time(real: Real, tmp_path: Path) -> None:
    clock = WallClock(10.0, SharedTime(tmp_path / "time", 10.0, new=True))
    assert clock.shared is not None
    clock.shared.wait_at(1.0)
    clock.sleep(2.0)
    assert clock.now() >= 2.0
    assert real.now_s - 1000.0 > 0.2 + (READER_GONE_S - 0.1) - 0.1
    WallClock(2.0).sleep(-1.0)


def test_a_bench_at_raised_speed_falls_behind_with_its_reader_and_loses_no_scans(real: Real, tmp_path: Path) -> None:
    """The reader takes ten times as long for a block as the bench."""
    speed, block_s, reading_s, blocks = 20.0, 0.4, 0.2, 50
    clock = WallClock(speed, SharedTime(tmp_path / "time", speed, new=True))
    bench = SimulatedBench(SimulationParameters(), clock)
    with installed(NiLibrary(SimulatedNiDevice(bench.card, clock, bench.faults))):
        card = NiDigitizer("Dev1", ("ai0", "ai1"), clock)
        with card.stream(1000.0, round(block_s * 1000.0)) as stream:
            begin_s, next_scan = clock.now(), 0
            for _ in range(blocks):
                block = stream.read()
                assert block.start == next_scan
                next_scan = block.stop
                real.pass_(reading_s)
            passed_s = clock.now() - begin_s
        card.close()
    assert passed_s == pytest.approx((blocks + 1) * block_s + LATE_S, abs=0.1)
    assert passed_s < 0.2 * blocks * reading_s * speed
