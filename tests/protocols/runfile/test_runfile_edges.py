"""Run files at their edges: names of one second, locks of other programs, empty tables, results that cannot be stored."""

import os
import re
import shutil
import time
from contextlib import suppress
from dataclasses import astuple, replace
from datetime import datetime
from pathlib import Path
from unittest import mock

import h5py
import numpy as np
import pytest

from drivers import Block, Hold, Scale
from protocols.base import EntryStarted, LogMessage, Quality, RunStatus, Series, SeriesAxis
from protocols.runfile import transaction as journals
from protocols.runfile.checksums import _digest, changed_names
from protocols.runfile.errors import FileLostError, RunReadError, StorageError
from protocols.runfile.fields import read_text
from protocols.runfile.open import open_run, translate_read_errors
from protocols.runfile.presence import FilePresence, process_is_alive
from protocols.runfile.reader import Run, _largest_point
from protocols.runfile.repair import repair_folder, repair_run
from protocols.runfile.schema import AIR_COLUMNS, EVENT_DTYPE, REPAIRED
from protocols.runfile.transaction import has_journal, journal_path, replay_journal, transaction
from protocols.runfile.writer import RunFileWriter
from tests.helpers.run_files import SCALES
from tests.protocols.runfile.test_runfile import RECORD, Spot, new

SECOND = replace(RECORD, start_time="2026-01-02T03:04:05.000+00:00")


@pytest.mark.deep
def test_runs_of_one_second_are_numbered_up_to_a_thousand(tmp_path: Path) -> None:
    first, second = (RunFileWriter.new(tmp_path, SECOND, Spot) for _ in range(2))
    for file in (first, second):
        file.finish(RunStatus.STOPPED, "")
    stem = first.path.stem
    assert second.path.name == f"{stem}-2.h5"
    for number in range(3, 1000):
        (tmp_path / f"{stem}-{number}.h5").touch()
    with pytest.raises(StorageError, match="holds a thousand runs of this second; choose another folder"):
        RunFileWriter.new(tmp_path, SECOND, Spot)
    (tmp_path / f"{stem}-999.h5").unlink()
    last = RunFileWriter.new(tmp_path, SECOND, Spot)
    last.finish(RunStatus.STOPPED, "")
    assert last.path.name == f"{stem}-999.h5"


def test_two_openings_of_a_run_share_nothing(tmp_path: Path) -> None:
    """HDF5 shares types of texts and contents between openings of its own, beyond the end of the first (h5py issue 2920)."""
    file = new(tmp_path)
    file.finish(RunStatus.COMPLETED, "first")
    with Run(file.path) as before:
        assert before.record.reason == "first"
        changed = file.path.read_bytes().replace(b"first", b"later")
        file.path.write_bytes(changed)
        with open_run(file.path) as one, open_run(file.path) as other:
            assert read_text(one["entry"], "reason") == "later"
            assert h5py.h5o.get_info(one.id).fileno != h5py.h5o.get_info(other.id).fileno
        assert before.record.protocol == SECOND.protocol


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs the list of open files")
def test_a_closed_run_leaves_no_file_open(tmp_path: Path) -> None:
    file = new(tmp_path)
    file.finish(RunStatus.COMPLETED, "")
    unreadable = tmp_path / "cut.h5"
    unreadable.write_bytes(file.path.read_bytes()[:-100])
    opened = len(os.listdir("/proc/self/fd"))  # noqa: PTH208 - a Path.iterdir would count itself
    with Run(file.path) as run:
        assert run.record.status is RunStatus.COMPLETED
    with pytest.raises(RunReadError):
        Run(unreadable)
    assert len(os.listdir("/proc/self/fd")) == opened  # noqa: PTH208


def test_a_file_that_a_killed_program_left_is_read_while_another_program_locks_it(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    file = new(tmp_path)
    left = shutil.copy(file.path, tmp_path / "left.h5")
    file.finish(RunStatus.COMPLETED, "")
    with left.open("rb") as locked:
        fcntl.flock(locked, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with Run(left) as run:
            assert run.record.status is RunStatus.RUNNING


def test_a_point_belongs_to_the_first_entry_unless_another_is_named(tmp_path: Path) -> None:
    file = new(tmp_path)
    assert [file.append_point(Spot(100.0, 1e-6)), file.append_point(Spot(200.0, 2e-6), 3)] == [0, 1]
    file.finish(RunStatus.COMPLETED, "")
    with Run(file.path) as run:
        assert run.points()["entry"].tolist() == [0, 3]
        assert run.record.point_count == 2


def test_a_point_has_the_air_that_was_read_and_none_that_was_not(tmp_path: Path) -> None:
    temperature, humidity = list(AIR_COLUMNS)[:2]
    file = RunFileWriter.new(tmp_path, RECORD, Spot, air=(temperature, humidity))
    file.append_point(Spot(100.0, 1e-6), air={temperature: 295.5})
    file.finish(RunStatus.COMPLETED, "")
    with Run(file.path) as run:
        assert run.points()[temperature].tolist() == [295.5]
        assert np.isnan(run.points()[humidity]).all()


def test_a_file_that_disappears_while_its_results_are_stored_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = new(tmp_path)

    def disappear(path: Path, *_: object, **__: object) -> None:
        path.unlink()
        raise StorageError("")

    monkeypatch.setattr("protocols.runfile.writer.append_results", disappear)
    with pytest.raises(FileLostError):
        file.finish(RunStatus.COMPLETED, "")


def test_a_table_of_points_without_columns_has_no_points(tmp_path: Path) -> None:
    file = new(tmp_path)
    file.finish(RunStatus.COMPLETED, "")
    with h5py.File(file.path, "r+") as stored:
        for name in list(stored["entry/points"]):
            del stored[f"entry/points/{name}"]
    with Run(file.path) as run:
        assert run.record.point_count == 0


def test_a_file_that_leads_out_of_itself_says_so_and_is_closed(tmp_path: Path) -> None:
    file = new(tmp_path)
    file.finish(RunStatus.COMPLETED, "")
    with h5py.File(file.path, "r+") as stored:
        stored["entry/away"] = h5py.ExternalLink("other.h5", "/x")
    for _ in range(2):
        with pytest.raises(RunReadError, match=rf"{file.path.name}.*entry/away"):
            Run(file.path)
    with h5py.File(file.path, "r+"):  # not while a reader still has it open
        pass


def test_a_file_that_this_program_has_open_with_locks_is_read(tmp_path: Path) -> None:
    file = new(tmp_path)
    file.finish(RunStatus.COMPLETED, "")
    with h5py.File(file.path, "r"), Run(file.path) as run:
        assert run.record.status is RunStatus.COMPLETED


@pytest.mark.parametrize(
    ("error", "words"), [(ValueError("no such row\nat 3"), "no such row"), (KeyError(), "KeyError")]
)
def test_the_reason_of_damage_is_one_line(error: Exception, words: str) -> None:
    with pytest.raises(RunReadError) as told, translate_read_errors(Path("a.h5")):
        raise error
    assert str(told.value) == f"a.h5 is damaged inside ({words}); take another copy of it"


def test_damage_of_a_growing_file_is_not_read_again_for_ever(tmp_path: Path) -> None:
    """HDF5 reads what does not fit its checksum again, as a part that is being written, up to a hundred times."""
    file = new(tmp_path)
    left = tmp_path / "left.h5"
    content = bytearray(file.path.read_bytes())
    file.finish(RunStatus.COMPLETED, "")
    for at in (each.start() for each in re.finditer(b"OHDR", bytes(content))):
        content[at + 8] ^= 0x10
    left.write_bytes(content)
    with pytest.raises(RunReadError, match=rf"{left.name}.*damaged"):
        Run(left)


def test_a_file_whose_results_are_being_stored_says_so(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(500))
    journal_path(path).write_bytes(b"x")
    with pytest.raises(RunReadError, match=r"run.h5: results are being stored in it, .*'tactor-bench verify --repair'"):
        Run(path)


def test_events_without_their_fields_are_named(tmp_path: Path) -> None:
    file = new(tmp_path)
    file.finish(RunStatus.COMPLETED, "")
    with h5py.File(file.path, "r+") as stored:
        del stored["entry/events"]
        stored.create_dataset("entry/events", data=np.zeros(2, [("x", "i4")]))
    with Run(file.path) as run, pytest.raises(RunReadError, match=r"/entry/events has no \w+"):
        list(run.events())


def test_a_repaired_run_of_another_computer_is_crashed(tmp_path: Path) -> None:
    file = new(tmp_path)
    file.finish(RunStatus.COMPLETED, "")
    with h5py.File(file.path, "r+") as stored:
        for name, value in (("host", "elsewhere"), ("status", "running")):
            del stored[f"entry/{name}"]
            stored[f"entry/{name}"] = value
    with Run(file.path) as run:
        assert not run.record.crashed
    with h5py.File(file.path, "r+") as stored:
        stored[f"entry/{REPAIRED}"] = "2026-01-02T03:04:05+00:00"
    with Run(file.path) as run:
        assert run.record.crashed


def test_a_curve_whose_columns_differ_in_length_is_damaged(tmp_path: Path) -> None:
    axes = {"x_axis": SeriesAxis("drive", "V"), "y_axis": SeriesAxis("displacement", "m")}
    loop = Series(np.arange(3.0), np.arange(3.0), **axes, name="loop", label="1 Hz")
    file = new(tmp_path)
    file.finish(RunStatus.COMPLETED, "", (), (loop,))
    with Run(file.path) as run:
        assert len(run.series()) == 1
    with h5py.File(file.path, "r+") as stored:
        (curve,) = stored["entry/curves"].values()
        attributes = dict(curve["displacement"].attrs)
        del curve["displacement"]
        curve["displacement"] = np.arange(2.0)
        curve["displacement"].attrs.update(attributes)
    with Run(file.path) as run, pytest.raises(RunReadError, match=rf"{file.path.name}.*damaged"):
        run.series()


def test_a_file_that_lost_its_latest_bytes_only_is_noticed(tmp_path: Path) -> None:
    file = new(tmp_path)
    before = grown = file.path.stat().st_size
    while grown <= before + 1:  # HDF5 takes space for several points at a time
        before = grown
        file.append_point(Spot(100.0, 1e-6))
        grown = file.path.stat().st_size
    os.truncate(file.path, grown - 1)
    with pytest.raises(StorageError, match="bytes"):
        file.check_presence()
    os.truncate(file.path, grown)
    file.finish(RunStatus.FAILED, "")


def test_the_end_of_a_run_is_its_begin_and_the_time_that_has_passed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not the time of day at its end: the computer's clock may have been set meanwhile."""
    file = new(tmp_path)
    now_s = time.monotonic
    monkeypatch.setattr("protocols.runfile.writer.time.monotonic", lambda: now_s() + 5000.0)
    file.finish(RunStatus.COMPLETED, "")
    with h5py.File(file.path) as stored:
        begin, end = (
            datetime.fromisoformat(stored[f"entry/{name}"][()].decode()) for name in ("start_time", "end_time")
        )
    assert 5000.0 <= (end - begin).total_seconds() < 5600.0


def test_a_file_that_cannot_be_read_within_a_transaction_is_left_as_it_is(tmp_path: Path) -> None:
    """HDF5 may go on after a read that failed, and store what it made of it."""
    path = tmp_path / "run.h5"
    path.write_bytes(b"\1" * 100_000)

    def store() -> None:
        with transaction(path) as changed:
            changed.write(b"\2")
            os.truncate(path, 5)
            changed.seek(60_000)
            with suppress(OSError):
                changed.readinto(bytearray(10))

    with pytest.raises(OSError, match="it ends after 60000 of 100000 bytes"):
        store()
    assert path.read_bytes() == b"\1" * 5
    assert not has_journal(path)


def test_an_announcement_stays_until_the_results_are_stored(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(b"run")
    journal_path(path).touch()
    assert not replay_journal(path, keep_announcement=True)
    assert has_journal(path)
    assert not replay_journal(path)
    assert not has_journal(path)


def test_changes_are_safe_on_the_disk_before_the_file_is_touched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, seen = tmp_path / "run.h5", list[tuple[int, bytes]]()
    path.write_bytes(b"before")
    monkeypatch.setattr(os, "fsync", lambda _: seen.append((journal_path(path).stat().st_size, path.read_bytes())))
    with transaction(path) as changed:
        changed.write(b"behind")
    assert [content for _, content in seen] == [b"before", b"behind"]
    assert seen[0][0] > len(b"behind")


def test_tables_of_a_killed_program_are_cut_to_their_common_length(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = new(tmp_path)
    file.start_stream(1000.0, SCALES)
    file.append_block(Block(0, np.arange(20, dtype=np.int16).reshape(2, 10)), 0.0)
    file._append_rows("trace/drive", np.arange(3, dtype=np.int16))  # it was killed between the two channels
    left = shutil.copy(file.path, tmp_path / "left.h5")
    file.finish(RunStatus.COMPLETED, "")
    monkeypatch.setattr("protocols.runfile.repair.writer_is_alive", lambda *_: False)
    repair_run(left)
    with h5py.File(left) as repaired:
        lengths = {name: repaired[f"entry/trace/{name}"].shape for name in ("drive", "displacement")}
        assert REPAIRED in repaired["entry"]
    assert lengths == {"drive": (10,), "displacement": (10,)}


def test_a_file_that_becomes_shorter_in_a_transaction_is_shorter_on_the_disk(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(b"before")
    with transaction(path) as changed:
        changed.write(b"be")
        changed.truncate(2)
    assert path.read_bytes() == b"be"


def test_a_file_that_a_living_program_creates_is_left_and_that_of_a_dead_one_is_not(tmp_path: Path) -> None:
    mine, dead = (tmp_path / f".run.h5.{process}" for process in (os.getpid(), 2**22 + 1))
    for path in (mine, dead):
        path.touch()
    assert list(repair_folder(tmp_path)) == []
    assert (mine.exists(), dead.exists()) == (True, False)


def test_the_largest_point_has_the_middle_drive_of_the_usable_points() -> None:
    points = {
        "frequency": [100.0, 110.0, 120.0, 130.0, 140.0], "peak_to_peak": [1.0, 2.0, 4.0, 3.0, 9.0],
        "peak_to_peak_errors": [0.1] * 5, "drive_amplitude": [1.0, 4.0, 2.0, 5.0, 9.0], "quality": [0, 0, 0, 0, int(Quality.CLIPPED)],
    }  # fmt: skip
    found = _largest_point({name: np.array(column) for name, column in points.items()})
    assert found is not None
    assert astuple(found) == (120.0, 4.0, 0.1, 3.0)


def test_an_object_that_is_missing_or_new_is_a_change() -> None:
    assert changed_names({"a": "1", "b": "2", "d": "4"}, {"a": "1", "c": "3", "d": "5"}) == ["b", "c", "d"]


def test_the_digest_of_parts_tells_where_each_part_ends() -> None:
    texts = [("abc",), ("a", "bc"), ("ab", "c"), ("a", "b", "c"), ("", "abc"), ("abc", ""), ()]
    assert len({_digest(*parts) for parts in texts}) == len(texts)


def test_a_journal_with_one_changed_byte_or_without_its_end_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(b"before")
    with (
        mock.patch("protocols.runfile.transaction._apply", side_effect=KeyboardInterrupt),
        pytest.raises(KeyboardInterrupt),
        transaction(path) as changed,
    ):
        changed.write(b"behind")
    whole = journal_path(path).read_bytes()
    flipped = (whole[:k] + bytes([whole[k] ^ 1]) + whole[k + 1 :] for k in range(len(whole)))
    for text in (*flipped, *(whole[:k] for k in range(len(whole)))):
        journal_path(path).write_bytes(text)
        assert not replay_journal(path)
        assert (path.read_bytes(), has_journal(path)) == (b"before", False)
    journal_path(path).write_bytes(whole)
    assert replay_journal(path)
    assert path.read_bytes() == b"behind"


def test_every_input_is_read_back_with_its_own_scale_and_skew(tmp_path: Path) -> None:
    scales = Scale((0.3, 2e-4)), Scale((-0.7, 5e-4), skew_s=3e-6)
    counts = np.arange(-20, 20, dtype=np.int16).reshape(2, 20)
    file = RunFileWriter.new(tmp_path, RECORD, Spot)
    file.start_stream(1000.0, scales)
    file.append_block(Block(0, counts), 0.0)
    file.finish(RunStatus.COMPLETED, "")
    with Run(file.path) as run, h5py.File(file.path, locking=False) as stored:
        read = {"drive": run.trace.drive_v(), "displacement": run.trace.displacement_m()}
        assert read["drive"] == pytest.approx(scales[0].to_volts(counts[0]))
        for (name, values), raw, scale in zip(read.items(), counts, scales, strict=True):
            stored_scale = run.trace.channel_scale(name)
            assert (stored_scale.coefficients[:2], stored_scale.skew_s) == (scale.coefficients, scale.skew_s)
            factor, offset = (stored[f"entry/trace/{name}_{kind}"][()] for kind in ("scaling_factor", "offset"))
            assert (raw + offset) * factor == pytest.approx(values)  # as NXdata defines them


def test_earlier_runs_are_the_oldest_first_and_so_are_their_recordings(tmp_path: Path) -> None:
    paths: list[Path] = []
    for k in range(4):
        file = new(
            tmp_path,
            replace(RECORD, continues=paths[-1].name if paths else "", start_time=f"2026-01-0{k + 1}T00:00:00+00:00"),
        )
        file.append_block(Block(0, np.full((2, 10), k, np.int16)), 0.0)
        file.append_recording((0, 10 - k), 0, Hold(2.5, 1.0))
        for entry in (0, k + 1):
            file.append_event(EntryStarted(entry, "", (k,)), 0.0)
        file.finish(RunStatus.STOPPED, "")
        paths.append(file.path)
    with Run(paths[-1]) as run:
        assert run.earlier_runs() == paths[:-1]
        assert [each.drive_v.size for each in run.recordings()] == [10, 9, 8, 7]
        assert {entry: each.key for entry, each in run.entries().items()} == {
            0: (3,),
            1: (0,),
            2: (1,),
            3: (2,),
            4: (3,),
        }


def test_a_file_replaced_by_an_equal_one_while_it_is_written_is_lost(tmp_path: Path) -> None:
    file = new(tmp_path)
    other = shutil.copy(file.path, tmp_path / "other.h5")
    other.replace(file.path)
    with pytest.raises(FileLostError, match=re.escape(file.path.name)):
        file.append_point(Spot(100.0, 1e-6))
    file.finish(RunStatus.FAILED, "")
    assert len(list(tmp_path.glob("*.h5"))) == 2


@pytest.mark.parametrize("cut", [b"", b'{"text": "thi'])
def test_an_event_that_a_kill_cut_is_dropped_and_the_others_stay(
    cut: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, texts = new(tmp_path), ["first", "second " * 400]
    for text in texts:
        file.append_event(LogMessage(text), 0.0)
    if cut:
        file._append_rows("events", np.array([(0.0, 0, LogMessage.kind, cut)], EVENT_DTYPE))
    left = shutil.copy(file.path, tmp_path / "left.h5")
    file.finish(RunStatus.COMPLETED, "")
    monkeypatch.setattr("protocols.runfile.repair.writer_is_alive", lambda *_: False)
    repair_run(left)
    with Run(left) as run:
        assert [event.fields["text"] for event in run.events()] == texts


@pytest.mark.parametrize(
    ("error", "lives"),
    [(None, True), (PermissionError(), True), (ProcessLookupError(), False), (OverflowError(), False)],
)
@pytest.mark.one_in(1)
def test_a_process_of_another_user_is_alive(error: Exception | None, lives: bool) -> None:
    with mock.patch("protocols.runfile.presence.os.kill", side_effect=error):
        assert process_is_alive(4711) is lives


def test_an_event_has_the_row_of_the_samples_that_follow_it(tmp_path: Path) -> None:
    file = new(tmp_path)
    for start in (0, 30):
        file.append_event(LogMessage(""), 0.1)
        file.append_block(Block(start, np.zeros((2, 30), np.int16)), 0.2)
    file.append_event(LogMessage("third " * 400), 0.3)
    file.finish(RunStatus.COMPLETED, "")
    with Run(file.path) as run:
        assert [(event.time_s, event.row) for event in run.events()] == [(0.1, 0), (0.1, 30), (0.3, 60)]


@pytest.mark.skipif(os.name != "posix", reason="locks of journals")
def test_a_journal_that_is_being_applied_is_left_alone_by_others(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(b"old")
    real = journals._apply

    def applied(file: Path, size: int, body: bytes) -> None:
        with mock.patch.object(journals, "_apply", real), pytest.raises(StorageError, match=str(path)):
            replay_journal(path)
        real(file, size, body)

    with mock.patch.object(journals, "_apply", side_effect=applied) as apply, transaction(path) as changed:
        changed.write(b"new")
    apply.assert_called_once()
    assert path.read_bytes() == b"new"


def test_a_file_that_was_cut_below_the_size_of_the_last_look_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(bytes(5000))
    with path.open("r+b") as file:
        presence = FilePresence(path, file.fileno())
        os.truncate(path, 9000)
        presence.check()
        os.truncate(path, 8000)
        with pytest.raises(FileLostError, match=" 8000 "):
            presence.check()
        presence.close()
