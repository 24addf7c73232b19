"""Scans lost by a late reader: the entry is measured again once, automatically, and the run continues to its end."""

import contextlib
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nidaqmx.stream_readers import AnalogUnscaledReader

from drivers.bench.bench import LevelSettings
from drivers.bench.watchdog_interface import NoWatchdog
from drivers.interfaces import Block
from drivers.nidaq.analog_input import NiStream
from drivers.sensors import LaserSensor
from model.amplifier_map import AmplifierMap
from protocols.base import (
    ChannelCalibration,
    EntryStarted,
    Event,
    LogMessage,
    PromptShown,
    Quality,
    RecordingFinished,
    RestMeasured,
    RunStatus,
    SettlingFinished,
)
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.reader import Run
from protocols.runner.acquisition import RecordingBuffer, RunAcquisition
from sim_hardware.nidaq.in_process_digitizer import SimulatedStream
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import Trigger, laboratory, run
from tests.helpers.waiting import wait_until
from tests.helpers.wired_bench import wired

DWELL = SineDwell(frequencies_hz=(100, 200, 150), record_s=0.1, min_cycles=5)
LATE_S = 15.0
"""Longer than the card's buffer."""


def messages(events: list[object]) -> list[str]:
    return [event.text for event in events if isinstance(event, LogMessage) and "measured again" in event.text]


def test_during_an_analysis_the_card_is_read_up_to_the_present_and_no_further() -> None:
    blocks: list[Block] = []

    def read() -> Block:
        assert len(blocks) < 100
        blocks.append(Block(50 * len(blocks), np.zeros((2, 50), np.int16)))
        return blocks[-1]

    armed: Any = SimpleNamespace(discard_block=read, stream=SimpleNamespace(start_time_s=0.0), rate_hz=1000.0)
    bench: Any = SimpleNamespace(
        clock=SimpleNamespace(now=lambda: 1.0), block_s=0.05, watchdog=NoWatchdog(), levels=LevelSettings(),
        sensor=LaserSensor("laser", 1e-4), amplifier=SimpleNamespace(map=AmplifierMap()), channels=(),
    )  # fmt: skip
    recorder: Any = SimpleNamespace(notify=lambda _: None)
    acquisition = RunAcquisition(bench, recorder, lambda: None)
    try:
        assert acquisition.run_analysis(armed, lambda: wait_until(lambda: len(blocks) >= 20))
    finally:
        acquisition.close()
    assert blocks[-1].stop == 1000


@pytest.mark.deep
def test_an_entry_that_lost_scans_is_measured_again_by_itself(tmp_path: Path) -> None:
    with laboratory() as lab:
        late = Trigger(
            lambda event: isinstance(event, SettlingFinished) and len(entries) == 2,
            lambda: lab.bench.clock.sleep(LATE_S),
        )
        entries: list[EntryStarted] = []
        ran = run(DWELL, tmp_path, lab, lambda e: entries.append(e) if isinstance(e, EntryStarted) else None, late)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    assert [entry.index for entry in entries] == [0, 1, 1, 2]
    (told,) = messages(ran.events)
    assert told.startswith("200 Hz")
    assert "is measured again, because scans were lost" in told
    assert ran.report.ends_at_rest
    with Run(ran.path) as file:
        np.testing.assert_allclose(file.points()["frequency"], (100, 200, 150), atol=0.05)
        np.testing.assert_allclose(file.points()["drive_amplitude"], file.points()["drive_amplitude"][0], rtol=0.01)


def test_an_entry_whose_recording_lacks_scans_again_keeps_the_flag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    finish = RecordingBuffer.finish

    def lacking(buffer: RecordingBuffer, scans: int) -> Any:
        recorded, quality = finish(buffer, scans)
        return recorded, quality | Quality.DROPPED

    monkeypatch.setattr(RecordingBuffer, "finish", lacking)
    with laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(100,), record_s=0.1, min_cycles=5), tmp_path, lab)
    assert [event.index for event in ran.events if isinstance(event, EntryStarted)] == [0, 0]
    assert ran.status is RunStatus.COMPLETED
    assert [bool(Quality(point.quality) & Quality.DROPPED) for point in ran.points] == [True]


@pytest.mark.one_in(100)
@pytest.mark.parametrize("moment", [PromptShown, RecordingFinished])
def test_scans_that_are_lost_while_none_are_recorded_change_nothing(
    moment: type[Event], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An operator who takes their time, or the analysis of a record, on a computer that is busy with other work."""
    restarted = threading.Event()
    restart, point = SimulatedStream.restart, SineDwell.point

    def restart_and_tell(stream: SimulatedStream) -> None:
        restart(stream)
        restarted.set()

    def analyse(protocol: SineDwell, *arguments: Any) -> Any:
        assert restarted.wait(30.0)
        return point(protocol, *arguments)

    monkeypatch.setattr(SimulatedStream, "restart", restart_and_tell)
    monkeypatch.setattr(SineDwell, "point", analyse)
    with laboratory() as lab:
        late = Trigger(lambda event: isinstance(event, moment), lambda: lab.bench.clock.sleep(LATE_S))
        ran = run(DWELL, tmp_path, lab, late)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    assert [event.index for event in ran.events if isinstance(event, EntryStarted)] == [0, 1, 2]
    assert messages(ran.events) == []


def test_an_entry_that_loses_scans_again_ends_the_run_at_measured_rest(tmp_path: Path) -> None:
    repeated_at_rest: list[bool] = []

    def late(event: object) -> None:
        if isinstance(event, SettlingFinished):
            lab.bench.clock.sleep(LATE_S)
        if messages([event]):
            repeated_at_rest.append(lab.bench.amplifier.is_source_at_rest())

    with laboratory() as lab:
        ran = run(DWELL, tmp_path, lab, late)
    assert (ran.status, len(messages(ran.events)), repeated_at_rest) == (RunStatus.FAILED, 1, [True])
    assert ran.reason.startswith(str(lab.bench.digitizer.identity))
    assert_names(ran.reason, "scans", "rate")
    assert any(isinstance(event, RestMeasured) and event.confirmed for event in ran.events)


@pytest.mark.deep
def test_scans_that_another_reader_took_are_a_gap_by_the_cards_own_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after a reply that the network lost: the task has handed the scans out, and this program does not have them."""
    monkeypatch.setattr("drivers.nidaq.analog_input.REMOTE_COUNT_S", 0.0)
    taken = 100
    with wired() as on_wires, contextlib.closing(on_wires.bench.digitizer.stream(5000.0, 250)) as stream:
        assert isinstance(stream, NiStream)
        channels = ChannelCalibration.pair(stream.scales, on_wires.bench.sensor)
        first = stream.read()
        buffer = RecordingBuffer(channels, first)
        buffer.add(stream.read())
        assert buffer.finish(500)[1] is Quality.GOOD
        AnalogUnscaledReader(stream._task.in_stream).read_int16(np.zeros((len(stream._raw), taken), np.int16), taken)
        behind = stream.read()
        assert behind.start == first.start + 500 + taken
        buffer.add(behind)
        buffer.add(stream.read())
        assert Quality.DROPPED in buffer.finish(1000)[1]
