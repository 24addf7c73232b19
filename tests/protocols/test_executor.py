"""Executor: results of steps, unsupported steps reported, the card read during analysis."""

import re
import threading
import tracemalloc
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers import Hold, LevelAction, Sine
from drivers.bench.drive_limits import HvAmplifier
from protocols.base import (
    Ask,
    BlockDiscarded,
    BlockStored,
    Log,
    Play,
    PointMeasured,
    Prompt,
    Quality,
    ReadMeter,
    Record,
    Recording,
    RecordingFinished,
    RunStatus,
    SettlingFinished,
)
from protocols.runfile.reader import Run
from tests.helpers.scripted_protocol import SETTLE, SHORT, Hesitant, Scripted, Spot
from tests.helpers.simulated_bench import Trigger, laboratory, run


def test_prompts_notes_and_recordings_are_answered(tmp_path: Path) -> None:
    prompt = Prompt("enable-high-voltage", "Press when ready.")
    protocol = Scripted(script=(Log("hello"), Ask(prompt), SETTLE, Record(0.05)))
    with laboratory() as lab:
        ran = run(protocol, tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED
    assert protocol.__dict__["answers"][1] == "done"
    settled = protocol.__dict__["answers"][2]
    assert settled.settled
    assert 0 < settled.after_s <= SETTLE.limit_s + lab.bench.block_s
    recording = protocol.__dict__["answers"][3]
    assert recording.drive_v.shape == recording.displacement_m.shape == (250,)
    with Run(ran.path) as file:
        assert file.points()["mean"].tolist() == [recording.displacement_m.mean()]
        assert next(file.recordings()).drive_v.tolist() == recording.drive_v.tolist()


@pytest.mark.deep
def test_a_person_may_take_a_minute_to_answer_without_losing_the_card(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab, operator=Hesitant(lab.operator, 1200))
        assert lab.bench.clock.now() > 60
        assert ran.status == RunStatus.COMPLETED
    with Run(ran.path) as file:
        assert file.trace.sample_count < 10 * 5000  # the wait itself is no measurement


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ((ReadMeter("scale"),), "this bench has no meter 'scale' .it has: none."),
    ],
)
def test_what_the_bench_cannot_do_is_a_sentence(script: tuple, says: str, tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Scripted(script=script), tmp_path, lab)
    assert ran.status == RunStatus.FAILED
    assert re.search(says, ran.reason)


@pytest.mark.parametrize(
    ("script", "is_long_enough"),
    [
        ((Play(Hold(3.5, 1.0), 0.9), Record(1.0)), True),
        ((Play(Hold(3.5, 1.0), 5.0),), False),
        ((Play(Hold(3.5, 1.0), 0.9), Record(5.0)), False),
        ((Record(5.0, Hold(3.5, 1.0)),), False),
    ],
)
def test_nothing_is_recorded_or_waited_beyond_the_end_of_a_level(
    script: tuple, is_long_enough: bool, tmp_path: Path
) -> None:
    """The generator plays a level as a finite waveform: what is recorded afterwards would be taken for the level."""
    with laboratory() as lab:
        ran = run(Scripted(script=script), tmp_path, lab)
    assert ran.status == (RunStatus.COMPLETED if is_long_enough else RunStatus.FAILED)
    assert (re.search(r"\blevel\b.*\bin \d\.\d s\b", ran.reason) is None) == is_long_enough
    assert ran.report.ends_at_rest


@pytest.mark.parametrize(("left_s", "is_long_enough"), [(0.23, False), (0.27, True)])
def test_a_level_must_last_for_a_recording_and_the_latency_of_a_block(
    left_s: float, is_long_enough: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(HvAmplifier, "level_remaining_s", property(lambda _: left_s))
    with laboratory() as lab:
        ran = run(Scripted(script=(Record(0.2),)), tmp_path, lab)
    assert ran.status == (RunStatus.COMPLETED if is_long_enough else RunStatus.FAILED)


def test_a_recording_with_its_drive_has_rest_before_it_and_the_whole_drive(tmp_path: Path) -> None:
    drive = Sine(50.0, 1.0, 2.5, 20)
    protocol = Scripted(script=(Record(drive.duration_s, drive, lead_s=0.1), Record(0.05)))
    with laboratory() as lab:
        run(protocol, tmp_path, lab)
    recording = protocol.__dict__["answers"][0]
    volts = recording.drive_v - 2.5
    assert abs(volts[: round(0.1 * recording.rate_hz)]).max() < 0.01
    assert np.sum(volts**2) / recording.rate_hz == pytest.approx(drive.duration_s / 2, rel=0.01)


@pytest.mark.breaks_the_drive
@pytest.mark.parametrize("is_lost", [True, False])
def test_a_recording_of_one_block_that_begins_after_the_drive_was_lost_is_flagged(
    is_lost: bool, tmp_path: Path
) -> None:
    def cut(event: object) -> None:
        if is_lost and isinstance(event, SettlingFinished):
            lab.control.inject("drive-cable-off")
        elif isinstance(event, RecordingFinished):
            lab.control.clear()

    with laboratory() as lab:
        lab.bench.levels = replace(lab.bench.levels, drive=LevelAction.OFF)
        protocol = Scripted(script=(SETTLE, Record(0.05), Record(lab.bench.block_s)))
        run(protocol, tmp_path, lab, cut, safe=False)
    flagged = [Quality.DRIVE_OFF in Quality(each.quality) for each in protocol.__dict__["answers"][1:]]
    assert flagged[0] is is_lost


@pytest.mark.breaks_the_drive
def test_a_recording_in_which_the_drive_was_lost_for_a_while_is_flagged(tmp_path: Path) -> None:
    blocks: list[object] = []

    def cut(event: object) -> None:
        blocks.extend(event for _ in range(isinstance(event, BlockStored) and (bool(blocks) or settled.done)))
        if len(blocks) == 4:
            lab.control.inject("drive-cable-off")
        if len(blocks) == 8:
            lab.control.clear()

    settled = Trigger(lambda event: isinstance(event, SettlingFinished), lambda: None)
    with laboratory() as lab:
        lab.bench.levels = replace(lab.bench.levels, drive=LevelAction.OFF)
        protocol = Scripted(script=(SETTLE, Record(15 * lab.bench.block_s)))
        run(protocol, tmp_path, lab, settled, cut, safe=False)
    assert Quality.DRIVE_OFF in Quality(protocol.__dict__["answers"][1].quality)


@pytest.mark.deep
def test_long_recordings_stay_in_the_file_and_are_read_from_there(tmp_path: Path) -> None:
    """However many and however long: memory is flat. What a protocol gets is what anybody reads from the file later."""
    kept: list[int] = []

    def weigh(event: Any) -> None:
        if isinstance(event, SettlingFinished):
            tracemalloc.start()
        elif isinstance(event, RecordingFinished):
            kept.append(tracemalloc.get_traced_memory()[0])

    protocol = Scripted(script=(SETTLE, Record(0.5), *[Record(2.5)] * 3), sample_rate_hz=20_000)
    seen: list[tuple[Any, Any]] = []
    with laboratory() as lab:
        observed = Trigger(
            lambda e: isinstance(e, PointMeasured),
            lambda: seen.extend((r.drive_v, r.displacement_m) for r in protocol.__dict__["answers"][1:]),
        )
        ran = run(protocol, tmp_path, lab, weigh, observed)
        tracemalloc.stop()
    assert ran.status == RunStatus.COMPLETED
    # One of them is 50 000 scans: 0.2 MB in the blocks that this test keeps, 0.8 MB in volts and metres.
    assert max(np.diff(kept)) < 0.4e6
    with Run(ran.path) as file:
        stored = list(file.recordings())
    assert [r.drive_v.size for r in stored] == [10_000, 50_000, 50_000, 50_000]
    for recording, (drive_v, displacement_m) in zip(stored, seen, strict=True):
        assert (recording.drive_v == drive_v).all()
        assert (recording.displacement_m == displacement_m).all()


def test_the_parts_of_a_recording_are_its_samples_in_order(tmp_path: Path) -> None:
    """One that is read from the run file while the run goes on, and the one that is read from the file afterwards."""
    protocol = Scripted(script=(SETTLE, Record(2.0)), sample_rate_hz=20_000)
    parts: list[Any] = []
    with laboratory() as lab:
        observed = Trigger(
            lambda e: isinstance(e, PointMeasured),
            lambda: parts.extend(
                (p.rows, p.drive_v, p.displacement_m) for p in protocol.__dict__["answers"][1].parts(15_000)
            ),
        )
        ran = run(protocol, tmp_path, lab, observed)
    with Run(ran.path) as file:
        whole = file.trace.recording(0)
    first, stop = whole.rows
    assert [rows for rows, *_ in parts] == [part.rows for part in whole.parts(15_000)]
    assert [rows[1] - rows[0] for rows, *_ in parts] == [13_333, 13_333, 13_334]
    assert (parts[0][0][0], parts[-1][0][1]) == (first, stop)
    for at, name in ((1, "drive_v"), (2, "displacement_m")):
        assert (np.concatenate([part[at] for part in parts]) == getattr(whole, name)).all()
        assert (np.concatenate([getattr(part, name) for part in whole.parts(15_000)]) == getattr(whole, name)).all()


def test_a_step_that_records_longer_than_memory_holds_fails_in_a_sentence(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Scripted(script=(SETTLE, Record(100_000.0))), tmp_path, lab)
    assert ran.status == RunStatus.FAILED
    assert "a recording of 500 million scans does not fit into memory (limit 50 million)" in ran.reason


@pytest.mark.deep
def test_the_card_is_emptied_while_a_point_is_worked_out(tmp_path: Path) -> None:
    """At raised speed a second of thinking is longer than the card holds its scans for us: 10 s here, 15 s are needed."""
    emptied = threading.Semaphore(0)

    class Slow(Scripted):
        def point(self, key: Any, recordings: Sequence[Recording], simulated: bool) -> Spot:
            for _ in range(15):
                lab.bench.clock.sleep(1.0)
                if not all(emptied.acquire(timeout=30) for _ in range(15)):
                    raise ValueError("nobody looked after the card")
            return super().point(key, recordings, simulated)

    with laboratory() as lab:
        looked = [lambda event: emptied.release() if isinstance(event, BlockDiscarded) else None]
        ran = run(Slow(script=(SETTLE, Record(0.1))), tmp_path, lab, *looked)
    assert (ran.status, ran.reason) == (RunStatus.COMPLETED, "all points measured")
