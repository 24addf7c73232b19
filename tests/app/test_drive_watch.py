"""Drive watch: the first block without the drive is noticed, and no block of a sound run is taken for one."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from app.live.drive_watch import DriveWatch
from app.live.session_link import SessionAdapter
from app.session.bench_connection import connect
from app.session.state import DriveSeen
from drivers.drive import Drive, Hold, LinearSweep, Sine
from protocols.base import PointMeasured, Protocol, RunEnded
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.sweep import Sweep
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runner.request import RunRequest
from tests.helpers.simulated_bench import simulated

REST_V, BLOCK_S = 2.5, 0.05


def watched(drive: Drive, blocks: Iterable[tuple[float, float]]) -> list[bool]:
    watch = DriveWatch(REST_V)
    watch.start_drive(drive)
    lost = []
    for low_v, high_v in blocks:
        watch.check_block(low_v, high_v, BLOCK_S)
        lost.append(watch.lost)
    return lost


@pytest.mark.parametrize(
    ("drive", "blocks", "lost"),
    [
        (Sine(160.0, 2.5, 2.5, 1000), [(0, 5), (0, 5), (0.0, 0.001), (0, 5)], [False, False, True, False]),
        (Sine(160.0, 2.5, 2.5, 1000), [(2.5, 2.501)] * 3, [False] * 3),  # at rest between two entries
        (Sine(1.0, 2.5, 2.5, 10), [(4.99, 5.0)] * 3, [False] * 3),  # the crest of a slow sine
        (LinearSweep(25, 525, 300, 2.5, 2.5), [(0, 5), (0.0, 0.001)], [False, True]),
        (Hold(4.0, 1.0), [(2.5, 3.0), (3.0, 4.0), (4.0, 4.0), (0.0, 0.0), (0.0, 0.0)], [False] * 4 + [True]),
    ],
)
def test_a_block_without_the_drive(drive: Drive, blocks: list[tuple[float, float]], lost: list[bool]) -> None:
    assert watched(drive, blocks) == lost


def test_every_phase_of_a_sine_swings_enough() -> None:
    drive = Sine(6.0, 2.5, 2.5, 100)
    t = np.arange(0, BLOCK_S, 1e-4)
    blocks = [2.5 + 2.5 * np.sin(2 * np.pi * 6.0 * t + phase) for phase in np.linspace(0, 2 * np.pi, 100)]
    assert not any(watched(drive, [(b.min(), b.max()) for b in blocks]))


def seen_in(protocol: Protocol, folder: Path, fault: str = "") -> tuple[list[DriveSeen], float, float]:
    """Run a protocol through the window's adapter; return what was seen, and bench time of fault and first report."""
    adapter = SessionAdapter(lambda: connect(simulated(), None))
    broken_s = [0.0]

    def break_it(event: object) -> None:
        if fault and isinstance(event, PointMeasured) and not broken_s[0]:
            adapter.faults.inject(fault)
            broken_s[0] = adapter.feed.streamed_s

    adapter.events.subscribe(break_it)
    adapter.session.start()
    adapter.session.run(RunRequest(protocol, folder, "T1"))
    assert adapter.session.finished.wait(60)
    assert adapter.session.close(10)
    events = list(adapter.pending_events())
    assert any(isinstance(e.event, RunEnded) for e in events)
    seen = [(e.event, e.streamed_s) for e in events if isinstance(e.event, DriveSeen)]
    return [event for event, _ in seen], broken_s[0], seen[0][1] if seen else 0.0


@pytest.mark.breaks_the_drive
def test_a_cable_that_comes_off_is_shown_within_two_blocks(tmp_path: Path) -> None:
    seen, broken_s, seen_s = seen_in(SineDwell(frequencies_hz=(100.0,) * 10), tmp_path, "drive-cable-off")
    assert seen[0].lost
    assert abs(seen[0].high_v) < 0.01
    assert seen_s - broken_s < 0.5


@pytest.mark.deep
@pytest.mark.parametrize(
    "protocol",
    [SineDwell(frequencies_hz=(25.0, 250.0)), Sweep(), VoltageSteps(repeats=1)],
    ids=lambda protocol: protocol.name,
)
def test_a_sound_run_never_loses_its_drive(protocol: Protocol, tmp_path: Path) -> None:
    assert seen_in(protocol, tmp_path)[0] == []
