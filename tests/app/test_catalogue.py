"""Run catalogue: lists the files of the folder, whatever happens to the files or the index."""

import errno
import hashlib
import json
import math
import os
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from contextlib import closing
from pathlib import Path
from unittest import mock

import h5py
import pytest

from app.archive import annotate_runs, copy_runs_into, move_to_trash, restore_from_trash
from app.archive.catalogue import SCHEMA, Catalogue, ScanResult, index_path
from app.archive.notes import read_tags, write_notes
from app.archive.run_filter import RunFilter
from app.archive.run_reading import read_run_summary
from app.archive.run_search import read_since
from app.archive.run_summary import RunState, RunSummary
from app.cli.main import main
from app.common import Progress
from app.common.exit_codes import ExitCode
from model import quantity_label
from protocols.base import CheckResult, Outcome, RunStatus, Verdict
from protocols.rejudgement import judge_file
from protocols.runfile.errors import NotesError, RunReadError
from protocols.runfile.names import notes_path
from protocols.runfile.reader import Run
from protocols.runfile.sidecar import Notes, _digest, change_notes, listed_record, read_notes
from tests.helpers.messages import assert_names
from tests.helpers.report_specimen import DWELL, TRUTH
from tests.helpers.run_files import begun_run, crashed_run, finished_run, newer_run
from tests.helpers.simulated_bench import laboratory, simulated
from tests.helpers.simulated_bench import run as measured


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("archive")
    finished_run(folder, "T7")
    finished_run(folder, "T8")
    return folder


@pytest.fixture
def folder(two_runs: Path, tmp_path: Path) -> Path:
    return shutil.copytree(two_runs, tmp_path / "runs")


@pytest.fixture
def catalogue(folder: Path, tmp_path: Path) -> Catalogue:
    made = Catalogue(folder, tmp_path / "index.sqlite")
    made.scan()
    return made


def scanned(folder: Path, tmp_path: Path) -> dict[str, RunSummary]:
    catalogue = Catalogue(folder, tmp_path / "scanned.sqlite")
    catalogue.scan()
    return named(catalogue)


def named(catalogue: Catalogue) -> dict[str, RunSummary]:
    return {entry.specimen: entry for entry in catalogue.entries()}


def test_every_run_is_listed_with_what_its_file_says(catalogue: Catalogue) -> None:
    entries = named(catalogue)
    assert entries.keys() == {"T7", "T8"}
    one = entries["T7"]
    assert (one.state, one.protocol, one.simulated, one.points) == ("completed", "sine-dwell", 1, 2)
    assert one.estimates_text == f"{quantity_label('natural_frequency')} 158.350 ± 0.010 Hz"
    assert one.started_at is not None


@pytest.mark.deep
def test_each_verdict_is_listed_found_and_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")
    folder = tmp_path / "runs"
    for outcome in Outcome:
        reasons = () if outcome is Outcome.GOOD else (f"{outcome} for a reason; do something",)
        finished_run(folder, outcome.replace(" ", "-"), verdict=Verdict(outcome, reasons))
    crashed_run(folder, "crash")
    Catalogue(folder).scan()
    entries = Catalogue(folder).entries()
    with_result = (
        Outcome.GOOD,
        Outcome.DOUBTFUL,
        Outcome.NOT_JUDGED,
    )  # the last one is completed, by an earlier version
    assert {e.specimen: (e.verdict_text, e.has_result) for e in entries} == {
        **{outcome.replace(" ", "-"): (outcome.value, outcome in with_result) for outcome in Outcome},
        "crash": (RunState.CRASHED, False),
    }
    symbols = {e.verdict_text: e.symbol for e in entries if e.specimen != "crash"}
    assert len(set(symbols.values())) == len(symbols), "distinct without colour"
    assert [e.specimen for e in RunFilter(verdict=Outcome.NO_RESULT).apply(entries)] == ["no-result"]
    searched = RunFilter(search_text=f"{Outcome.DID_NOT_PASS} reason")
    assert [e.specimen for e in searched.apply(entries)] == ["did-not-pass"]
    assert main(["runs", str(folder)]) == 0
    printed = capsys.readouterr().out
    assert "completed" not in printed
    signs = {Outcome.GOOD: "✓", Outcome.DOUBTFUL: "△", Outcome.NO_RESULT: "○", Outcome.DID_NOT_PASS: "⊘"}
    for outcome, symbol in signs.items():
        assert f"{symbol} {outcome}, SIMULATED" in printed
    assert f"{Outcome.NO_RESULT} for a reason; do something" in printed, "with the remedy"
    failed = Outcome.DID_NOT_PASS.value
    assert main(["runs", str(folder), "--verdict", failed, "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    assert (found["verdict"], found["verdict_reasons"]) == (failed, f"{failed} for a reason; do something")
    assert main(["runs", str(folder), "--verdict", "fine"]) == 2
    assert "there are: good, doubtful" in capsys.readouterr().err


def test_what_has_not_changed_is_not_read_again(catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.archive.run_reading.read_run_summary", lambda *_: pytest.fail("it was read"))
    assert catalogue.scan() == ScanResult()


def test_another_program_writes_the_index_while_a_scan_reads(catalogue: Catalogue, folder: Path) -> None:
    entries = catalogue.entries()
    for path in folder.glob("*.h5"):
        os.utime(path, ns=(0, 0))
    (folder / "gone.h5").touch()
    catalogue.scan()
    (folder / "gone.h5").unlink()
    writer, read = sqlite3.connect(catalogue.index, timeout=0.0), []

    def written(path: Path, *rest: object) -> RunSummary | None:
        writer.execute("UPDATE runs SET summary = summary")
        writer.commit()
        read.append(path)
        return read_run_summary(path, *rest)  # type: ignore[arg-type]

    for path in folder.glob("*.h5"):
        os.utime(path)
    with mock.patch("app.archive.run_reading.read_run_summary", written), closing(writer):
        catalogue.scan()
    assert len(read) == 2
    assert {each.path for each in catalogue.entries()} == {each.path for each in entries}


def test_files_added_moved_and_deleted_outside_are_noticed(catalogue: Catalogue, folder: Path) -> None:
    paths = {e.specimen: folder / e.path for e in catalogue.entries()}
    (folder / "old").mkdir()
    paths["T7"].rename(folder / "old" / paths["T7"].name)
    paths["T8"].unlink()
    finished_run(folder, "T9")
    assert catalogue.scan() == ScanResult(added=2, removed=2)
    entries = named(catalogue)
    assert entries.keys() == {"T7", "T9"}
    assert entries["T7"].path == f"old/{paths['T7'].name}"


@pytest.mark.parametrize("damage", ["deleted", "no database", "another schema"])
def test_the_index_can_be_thrown_away(damage: str, catalogue: Catalogue) -> None:
    before = catalogue.entries()
    if damage == "deleted":
        catalogue.index.unlink()
    elif damage == "no database":
        catalogue.index.write_bytes(b"nothing of the kind" * 500)
    else:
        with catalogue._connection() as db:
            db.execute(f"PRAGMA user_version = {SCHEMA - 1}")  # of the version of this program before
    assert catalogue.entries() == []
    catalogue.scan()
    assert catalogue.entries() == before


@pytest.mark.parametrize("row", [b"", b"\0", None, "text"])
def test_a_damaged_row_is_read_from_the_files_again(row: object, catalogue: Catalogue) -> None:
    before = catalogue.entries()
    with catalogue._connection() as db:
        db.execute("UPDATE runs SET summary = ? WHERE path = ?", (row, before[0].path))
    assert catalogue.entries() == before


def test_a_shared_temporary_directory_has_a_folder_of_its_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.archive.catalogue.os.access", lambda *_: False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    place = index_path(tmp_path / "runs").parent
    assert place.parent == tmp_path
    assert not place.stat().st_mode & 0o022
    place.chmod(0o777)  # another user may write in it
    assert index_path(tmp_path / "runs").parent != place


def test_tags_and_notes_outlive_the_index_and_a_move(catalogue: Catalogue, folder: Path) -> None:
    run = folder / named(catalogue)["T7"].path
    write_notes(run, tags=("good", "für Anna"), note='second try, "new" glue\n\x7f')
    assert catalogue.scan() == ScanResult(changed=1)
    catalogue.index.unlink()
    (folder / "moved").mkdir()
    run.rename(folder / "moved" / run.name)  # alone: the notes stay where they were
    catalogue.scan()
    one = named(catalogue)["T7"]
    assert one.tags == "good, für Anna"
    assert one.note == 'second try, "new" glue\n\x7f'


def test_notes_are_not_written_into_the_run(folder: Path) -> None:
    run = next(folder.glob("*_T7_*.h5"))
    before = run.read_bytes()
    write_notes(run, tags=("good",))
    assert run.read_bytes() == before
    write_notes(run, tags=(), note="", listed=None)
    assert not notes_path(run).exists()


def test_notes_that_cannot_be_understood_are_never_overwritten(catalogue: Catalogue, folder: Path) -> None:
    run = folder / named(catalogue)["T7"].path
    half = "{ half a"
    notes_path(run).write_text(half)
    with pytest.raises(NotesError, match=re.escape(notes_path(run).name)) as refused:
        write_notes(run, tags=("good",))
    assert notes_path(run).read_text() == half
    catalogue.scan()
    assert str(refused.value) in named(catalogue)["T7"].note


def test_each_kind_of_trouble_is_shown_for_what_it_is(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    whole = finished_run(folder, "T7")
    crash = crashed_run(folder, "T3")
    newer_run(folder, "T5")
    (folder / "20260101T000000Z_half_sine-dwell.h5").write_bytes(whole.read_bytes()[:-5000])
    (folder / "20260101T000001Z_cut_sine-dwell.h5").write_bytes(crash.read_bytes()[:9000])
    (folder / "20260101T000002Z_text_sine-dwell.h5").write_text("no HDF5 at all")
    with h5py.File(folder / "other.h5", "w") as other:
        other["x"] = 1
    catalogue = Catalogue(folder, tmp_path / "index.sqlite")
    catalogue.scan()
    entries = named(catalogue)
    assert {name: e.state for name, e in entries.items()} == {
        "T7": RunState.COMPLETED,
        "T3": RunState.CRASHED,
        "T5": RunState.NEWER,
        "half": RunState.DAMAGED,
        "cut": RunState.DAMAGED,
        "text": RunState.DAMAGED,
    }
    assert "install a newer version" in entries["T5"].record.reason
    assert_names(entries["half"].record.reason, "cut", whole.stat().st_size, whole.stat().st_size - 5000)
    assert all(str(folder) in entries[name].record.reason for name in ("half", "cut", "text"))
    assert entries["T3"].points == 1


def test_a_run_of_this_program_that_is_being_written_is_listed_unopened(catalogue: Catalogue, folder: Path) -> None:
    path = folder / "20261121T091502Z_T1_sine-dwell.h5"
    path.write_bytes(b"whatever is there by now")
    catalogue.scan(exclude=[path])
    assert (named(catalogue)["T1"].state, named(catalogue)["T1"].protocol) == (RunState.RUNNING, "sine-dwell")


def long_way(path: Path) -> RunSummary | None:
    """The summary of a file without its sidecar, as earlier versions wrote it."""
    with mock.patch("app.archive.run_reading.listed_record", return_value=None):
        return read_run_summary(path, path.name)


def test_a_finished_run_is_listed_from_its_sidecar_as_from_its_data(folder: Path, tmp_path: Path) -> None:
    checks = (
        CheckResult("width", math.nan, "Hz", 1.0, None, "measure more", Outcome.DID_NOT_PASS),
        CheckResult("depth", 1.0, "m", 0.5, 2.0, ""),
    )
    failed = finished_run(folder, "T9", verdict=Verdict(Outcome.DID_NOT_PASS, ("a width\n of \x1b",), checks))
    listed = json.loads(notes_path(failed).read_text("utf-8"))["listed"]["record"]["verdict"]["checks"]
    assert [check["name"] for check in listed] == ["width"]
    judged = finished_run(folder, "T10")
    judge_file(judged, store=True)
    stopped = begun_run(folder, "T11", (100.0,), 5000.0)
    stopped.finish(RunStatus.STOPPED, "stopped by the operator")
    for path in folder.glob("*.h5"):
        whole = long_way(path)
        with mock.patch("app.archive.run_reading.Run", side_effect=AssertionError("it was read")):
            assert read_run_summary(path, path.name) == whole
    assert not notes_path(crashed_run(folder)).exists()
    assert {name: e.verdict for name, e in scanned(folder, tmp_path).items()} == {
        **dict.fromkeys(("T7", "T8", "T11", "T3"), Outcome.NOT_JUDGED),
        "T9": Outcome.DID_NOT_PASS,
        "T10": Outcome.DOUBTFUL,
    }


def test_a_run_that_is_read_while_it_ends_is_listed_with_its_verdict(tmp_path: Path) -> None:
    """HDF5 gives a second reader in the same program what the first one has read."""
    begun = begun_run(tmp_path, "T7", (100.0,), 5000.0)
    with Run(begun.path) as reader:
        assert reader.stored_record().status is RunStatus.RUNNING
        begun.finish(RunStatus.COMPLETED, "", verdict=Verdict(Outcome.GOOD))
        assert read_run_summary(begun.path, begun.path.name).verdict == Outcome.GOOD  # type: ignore[union-attr]


def is_listed(path: Path) -> bool:
    """Whether lists find the record in the sidecar."""
    return listed_record(path, read_notes(notes_path(path))) is not None


def test_a_record_listed_by_a_version_with_other_fields_is_read_from_the_run_file(folder: Path) -> None:
    path = next(folder.glob("*_T7_*.h5"))
    assert is_listed(path)
    with mock.patch("protocols.runfile.sidecar._FIELDS", "protocol title humidity_sensor"):
        assert not is_listed(path)


@pytest.mark.parametrize("place", ["file", "sidecar", "end"])
def test_a_changed_run_is_read_and_not_its_sidecar(place: str, folder: Path) -> None:
    path = next(folder.glob("*_T7_*.h5"))
    assert is_listed(path)
    if place == "file":
        with h5py.File(path, "r+") as file:
            file["entry/points/peak_to_peak"][1] = 3e-3
    else:
        changed = path if place == "end" else notes_path(path)
        data = changed.read_bytes()
        changed.write_bytes(data + b"more" if place == "end" else data.replace(b"frequency", b"FREQUENCY"))
    assert not is_listed(path)
    assert read_run_summary(path, path.name) == long_way(path)
    if place == "file":
        assert '"amplitude_at_resonance", 0.003' in long_way(path).figures_json  # type: ignore[union-attr]


@pytest.mark.parametrize("state", ["copied", "changed", "changed within a tick"])
def test_the_record_in_a_sidecar_is_of_one_state_of_the_file(state: str, folder: Path) -> None:
    path = next(folder.glob("*_T7_*.h5"))
    stat = path.stat()
    data = bytearray(path.read_bytes())
    if state != "copied":
        data[-1] ^= 1
    path.write_bytes(data)
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns + (0 if state == "changed within a tick" else 10**9)))
    assert is_listed(path) == (state != "changed"), "size and time, or else the hash"


def test_a_later_verdict_is_believed_of_the_file_that_was_judged_only(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = next(folder.glob("*_T7_*.h5"))
    judge_file(path, store=True)
    with Run(path) as run:
        assert (run.stored_record().verdict.outcome, run.record.verdict.outcome) == (
            Outcome.NOT_JUDGED,
            Outcome.DOUBTFUL,
        )
    stat = path.stat()
    with h5py.File(path, "r+") as file:
        file["entry/points/peak_to_peak"][1] = 3e-3
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    with Run(path) as run:
        record = run.record
    assert record.verdict.outcome is Outcome.NOT_JUDGED
    assert_names(record.caution, "changed")
    summary = read_run_summary(path, path.name)
    assert summary is not None
    assert summary.verdict == "not judged"
    assert record.caution in summary.explanation
    main(["show", str(path)])
    assert record.caution in capsys.readouterr().out
    judge_file(path, store=True)
    with Run(path) as run:
        assert (run.record.verdict.outcome, run.record.caution) == (Outcome.DOUBTFUL, "")


def test_a_sidecar_gives_no_orders_to_a_terminal(folder: Path) -> None:
    path = next(folder.glob("*_T7_*.h5"))
    listed = dict(read_notes(notes_path(path)).listed or {})
    hostile = {**listed["record"], "specimen": "T7\x1b[2J\n"}
    digest = _digest(json.dumps(hostile, ensure_ascii=False))
    change_notes(path, listed={**listed, "record": hostile, "digest": digest})
    assert is_listed(path)
    entry = read_run_summary(path, path.name)
    assert entry is not None
    assert entry.specimen == r"T7\x1b[2J\n"


def test_notes_are_written_on_a_share_without_locks(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOTSUP, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", refuse)
    path = next(folder.glob("*_T7_*.h5"))
    assert change_notes(path, note="on a share").note == "on a share"
    assert read_notes(notes_path(path)).note == "on a share"
    assert not list(folder.glob(".*.lock"))


@pytest.mark.deep
def test_a_run_file_is_not_touched_after_its_end(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    with laboratory(simulated(tactor={"mu": TRUTH.mu, "c0": TRUTH.c0})) as lab:
        path = measured(DWELL, folder, lab).path
    before, stat = hashlib.sha256(path.read_bytes()).hexdigest(), path.stat()
    for command in (
        ["judge", str(path), "--store"],
        ["checked", str(path), "--by", "Ben"],
        ["runs", str(folder), "--rebuild"],
        ["show", str(path)],
        ["verify", str(path), "--repair"],
        ["identify", str(path), "--free", "mu,c0", "--accept", "--reason", "x"],
        ["report", "T1", "--folder", str(folder), "--out", str(tmp_path)],
        ["export", str(path), "--out", str(tmp_path / "out")],
        ["backup", str(tmp_path / "copies"), "--folder", str(folder)],
        ["archive", "T1", "--folder", str(folder), "--out", str(tmp_path / "T1.eln"), "--no-report"],
    ):
        assert main(command) == ExitCode.DONE, command
    note = "a note"
    annotate_runs([(path, "", "")], "good", note)
    scanned(folder, tmp_path)
    assert hashlib.sha256(path.read_bytes()).hexdigest() == before
    assert path.stat().st_mtime_ns == stat.st_mtime_ns
    assert (tmp_path / "copies" / notes_path(path).name).is_file(), "the backup has the sidecar"
    copy_runs_into([path], tmp_path / "other")
    copied = read_notes(notes_path(tmp_path / "other" / path.name))
    assert (copied.tags, copied.note, [check.name for check in copied.checks]) == (("good",), note, ["Ben"])
    (trashed,) = move_to_trash([path])
    assert read_notes(notes_path(trashed.trashed)) == copied
    assert notes_path(path).exists() is False


ADD_TAGS = """
import sys, pathlib
from app.archive import annotate_runs
run = pathlib.Path(sys.argv[1])
for number in range(20):
    annotate_runs([(run, "", ""), (run, "", "")], f"{sys.argv[2]}{number}", "")
"""


def test_two_programs_that_change_a_sidecar_lose_no_change(folder: Path) -> None:
    run = next(folder.glob("*_T7_*.h5"))
    programs = [subprocess.Popen([sys.executable, "-c", ADD_TAGS, str(run), name]) for name in "ab"]
    assert [program.wait(120) for program in programs] == [0, 0]
    assert set(read_notes(notes_path(run)).tags) == {f"{name}{number}" for name in "ab" for number in range(20)}
    assert not list(folder.glob(".*.lock"))


def test_the_lock_of_a_program_that_died_blocks_nobody(folder: Path) -> None:
    run = next(folder.glob("*_T7_*.h5"))
    notes_path(run).with_name(f".{notes_path(run).name}.lock").write_text("left by a program that was killed")
    write_notes(run, tags=("good",))
    assert read_notes(notes_path(run)).tags == ("good",)


def test_a_copied_run_replaces_no_other_notes(folder: Path, tmp_path: Path) -> None:
    run, target = next(folder.glob("*_T7_*.h5")), tmp_path / "other"
    left = notes_path(target / run.name)
    target.mkdir()
    left.write_text('{"note": "of another run"}')
    with pytest.raises(RunReadError, match="move them away"):
        copy_runs_into([run], target)
    assert left.read_text() == '{"note": "of another run"}'
    assert not (target / run.name).exists()


def test_the_trash_replaces_no_notes(folder: Path) -> None:
    run = next(folder.glob("*_T7_*.h5"))
    write_notes(run, note="mine")
    left = run.parent / ".trash" / notes_path(run).name
    left.parent.mkdir()
    left.write_text('{"note": "of another run"}')
    moved = move_to_trash([run])
    assert left.read_text() == '{"note": "of another run"}'
    notes_path(run).write_text('{"note": "written since"}')
    with pytest.raises(RunReadError, match="or its notes exist again"):
        restore_from_trash(moved)
    assert read_notes(notes_path(run)).note == "written since"
    notes_path(run).unlink()
    assert restore_from_trash(moved) == 1
    assert read_notes(notes_path(run)).note == "mine"


def test_folders_with_new_files_are_noticed_without_a_list_of_them(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "old").mkdir()
    for each in (folder / "old", folder):
        os.utime(each, (1.0e9, 1.0e9))
    catalogue = Catalogue(folder, tmp_path / "index.sqlite")
    catalogue.scan()
    assert not catalogue.has_changed_folder()
    finished_run(folder / "old", "T9")
    assert catalogue.has_changed_folder()
    catalogue.scan()
    assert catalogue.has_changed_folder(), "so new that another change could have the same time"
    monkeypatch.setattr("app.archive.catalogue.SETTLED_NS", 0)
    catalogue.scan()
    assert not catalogue.has_changed_folder()
    shutil.rmtree(folder)
    assert catalogue.has_changed_folder()


def test_a_writer_that_died_is_noticed_though_its_file_has_not_changed(
    catalogue: Catalogue, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = crashed_run(folder, "T3")
    with monkeypatch.context() as alive:
        alive.setattr("protocols.runfile.reader.writer_is_alive", lambda *_: True)
        catalogue.scan()
        assert named(catalogue)["T3"].state == "running"
    before = path.stat().st_mtime_ns
    assert catalogue.scan() == ScanResult(changed=1)
    assert named(catalogue)["T3"].state == "crashed"
    assert path.stat().st_mtime_ns == before


def test_a_scan_can_be_stopped_and_goes_on_later(folder: Path, tmp_path: Path) -> None:
    catalogue = Catalogue(folder, tmp_path / "other.sqlite")
    reported: list[float] = []

    class OneFile(Progress):
        @property
        def cancelled(self) -> bool:
            return len(reported) == 1

        def update(self, fraction: float, text: str = "") -> None:
            reported.append(fraction)

    scanned = catalogue.scan(OneFile())
    assert not scanned.complete
    assert reported == [0.5]
    assert len(catalogue.entries()) == 1
    assert catalogue.scan() == ScanResult(added=1)


def test_a_folder_that_is_not_there_yet_is_empty(tmp_path: Path) -> None:
    catalogue = Catalogue(tmp_path / "none", tmp_path / "index.sqlite")
    assert catalogue.scan() == ScanResult()
    assert catalogue.entries() == []


def test_hidden_folders_are_left_alone(catalogue: Catalogue, folder: Path) -> None:
    shutil.copytree(folder, folder / ".trash")
    assert catalogue.scan() == ScanResult()


@pytest.mark.parametrize(
    ("expected", "found"),
    [
        (RunFilter(), {"T7", "T8"}),
        (RunFilter(specimen="T7"), {"T7"}),
        (RunFilter(search_text="frequency t8"), {"T8"}),
        (RunFilter(search_text="simulated COMPLETED"), {"T7", "T8"}),
        (RunFilter(search_text="t7 t8"), set()),
        (RunFilter(protocol="steps"), set()),
        (RunFilter(state="completed"), {"T7", "T8"}),
        (RunFilter(since="2000"), {"T7", "T8"}),
        (RunFilter(since="2999"), set()),
    ],
)
def test_filters(expected: RunFilter, found: set[str], catalogue: Catalogue) -> None:
    assert {e.specimen for e in expected.apply(catalogue.entries())} == found


@pytest.mark.parametrize(
    ("search", "found"),
    [
        ("t", {"T7", "T8"}),
        ("7", set()),
        ("laser", set()),
        ("sensor:las", {"T7", "T8"}),
        ("specimen:t7", {"T7"}),
        ("specimen:T", set()),
        ("specimen:T*", {"T7", "T8"}),
        ("protocol:dwell frequency", {"T7", "T8"}),
        ('tag:"second try"', {"T8"}),
        ("file:T8", {"T8"}),
        ("after:2999", set()),
        ("before:2999 checked:nobody state:comp result:158", {"T7", "T8"}),
        ("specimen:", {"T7", "T8"}),
    ],
)
def test_words_are_found_by_their_beginnings_and_fields_by_their_names(
    search: str, found: set[str], catalogue: Catalogue, folder: Path
) -> None:
    write_notes(folder / named(catalogue)["T8"].path, tags=("second try",), note="not as T7")
    catalogue.scan()
    assert {e.specimen for e in RunFilter(search).apply(catalogue.entries())} == found


def test_runs_with_the_word_in_specimen_or_tags_come_first(catalogue: Catalogue, folder: Path) -> None:
    write_notes(folder / named(catalogue)["T8"].path, tags=(), note="not as T7")
    catalogue.scan()
    assert [e.specimen for e in RunFilter("T7").apply(catalogue.entries())] == ["T7", "T8"]


@pytest.mark.parametrize(("search", "says"), [("colour:red", "no field 'colour'"), ("after:soon", "not a date")])
def test_a_field_that_does_not_exist_is_named(search: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        RunFilter(search).apply([])


@pytest.mark.parametrize("text", ["2026-11-21", "2026-11", "today", "7d", "12 h"])
def test_dates_as_one_writes_them(text: str) -> None:
    assert read_since(text) < "2100"


@pytest.mark.parametrize("text", ["", "yesterday", "7x", "d"])
def test_what_is_no_date(text: str) -> None:
    with pytest.raises(ValueError, match="not a date"):
        read_since(text)


def test_tags_as_one_writes_them() -> None:
    assert read_tags(" good, second   try ,, good ") == ("good", "second try")
    assert read_notes(Path("nowhere")) == Notes()


def test_the_index_lies_in_the_users_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")
    assert index_path(tmp_path).parent == tmp_path / "cache"
    assert index_path(tmp_path) != index_path(tmp_path / "runs")


def test_one_strange_file_never_empties_the_list(catalogue: Catalogue, folder: Path) -> None:
    good = set(named(catalogue))
    wrong = finished_run(folder, "wrong")
    with h5py.File(wrong, "r+") as file:
        del file["entry/trace/sample_rate"]
        file.create_group("entry/trace/sample_rate")
    notes_path(wrong).write_text("[" * 100_000)
    halves = finished_run(folder, "halves")
    notes_path(halves).write_text('{"tags": ["\\ud800"], "note": "x"}')
    with h5py.File(halves, "r+") as file:
        del file["entry/reason"]
        file["entry/reason"] = "\udcff\x1b[2J".encode("utf-8", "surrogatepass")
    (folder / "leads-nowhere.h5").symlink_to(folder / "none.h5")
    os.mkfifo(folder / "fifo.h5")
    os.mkfifo(folder / "20260101T000000Z_fifo_sine-dwell.notes.json")
    (folder / os.fsdecode(b"caf\xe9.h5")).write_bytes(b"x")
    assert "not UTF-8 text; rename it" in catalogue.scan().skipped[0]
    entries = named(catalogue)
    assert good <= set(entries)
    assert entries["wrong"].state == "damaged"
    assert "sample_rate is a group, not data" in entries["wrong"].record.reason
    assert "nested too deeply" in entries["wrong"].note
    assert entries["halves"].state == "damaged"
    assert entries["halves"].tags == "?"
