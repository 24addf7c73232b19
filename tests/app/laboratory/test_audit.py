"""Audit trail: what it records, and that changes of files and of lines are detected; several writers at once."""

import json
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from app.archive.audit_trail import begin_audit, verify_audit
from app.archive.notes import write_notes
from app.archive.trash import move_to_trash, restore_from_trash
from app.cli.main import main
from app.common import ExitCode
from app.common.audit_chain import LOG_NAME, AuditError, append_entry, audited_folder, read_entries
from protocols.runfile.names import notes_path
from tactor_bench import open_run
from tests.helpers.run_files import finished_run


@pytest.fixture(autouse=True)
def own_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platformdirs.user_config_path", lambda *_, **__: tmp_path / "settings")
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")


def entries_of(folder: Path, count: int) -> list[str]:
    return [append_entry(folder, "note", f"line {i}", "Anna", {}, {"value": i / 3}).hash for i in range(count)]


def test_a_changed_removed_moved_or_added_line_is_detected(tmp_path: Path) -> None:
    hashes = entries_of(tmp_path, 5)
    path = tmp_path / LOG_NAME
    good = path.read_bytes().splitlines(keepends=True)
    entries, problems = read_entries(tmp_path)
    assert ([entry.hash for entry in entries], problems) == (hashes, [])
    assert entries[0].by.startswith("Anna (")

    def after(lines: list[bytes]) -> list[str]:
        path.write_bytes(b"".join(lines))
        return read_entries(tmp_path)[1]

    assert after([*good[:2], good[2].replace(b"line 2", b"line X"), *good[3:]]) == [
        f"entry 3 ({entries[2].time}, note of line X) was changed"
    ]
    for lines, number in (
        ([*good[:2], *good[3:]], 4),
        ([good[0], good[2], good[1], *good[3:]], 3),
        ([*good[:3], good[1], *good[3:]], 2),
    ):
        assert after(lines)[0] == (
            f"entry {number} ({entries[number - 1].time}) does not follow the one before it: lines are missing or were put in"
        )
    assert "damaged" in after([*good[:2], b"hello\n", *good[3:]])[0]
    rewritten = json.loads(good[2])
    rewritten["subject"] = "line X"  # with a hash of its own that fits
    from app.common.audit_chain import _hash

    rewritten["hash"] = _hash({name: value for name, value in rewritten.items() if name != "hash"})
    assert "entry 4" in after([*good[:2], json.dumps(rewritten).encode() + b"\n", *good[3:]])[0]
    assert after(good[:3]) == [], "an end that was cut off shows only against a head hash"
    result = verify_audit(tmp_path, hashes[4])
    assert result.problems == (f"no line has the hash {hashes[4][:12]}...: lines up to it were changed or removed",)
    assert verify_audit(tmp_path, hashes[1][:12].upper()).problems == ()
    with pytest.raises(AuditError, match="at least its first 12 digits"):
        verify_audit(tmp_path, "3f1c")


@pytest.mark.parametrize("cut", [1, 2, 40])
def test_a_line_that_a_power_cut_left_incomplete_stays_on_record(tmp_path: Path, cut: int) -> None:
    entries_of(tmp_path, 3)
    path = tmp_path / LOG_NAME
    path.write_bytes(path.read_bytes()[:-cut])
    whole = cut == 1  # only its end of line is missing
    problems = read_entries(tmp_path)[1]
    assert problems == ([] if whole else ["the last line is not complete: the program was killed, or the file was cut"])
    entries_of(tmp_path, 2)
    entries, problems = read_entries(tmp_path)
    assert (len(entries), problems) == (5 if whole else 4, [])
    lines = path.read_bytes().split(b"\n")
    path.write_bytes(b"\n".join([*lines[:2], lines[2].replace(b"note", b"nope"), *lines[3:]]))
    assert read_entries(tmp_path)[1], "what was left incomplete is in the chain, too"


def test_nothing_is_written_where_no_trail_was_begun(tmp_path: Path) -> None:
    run = finished_run(tmp_path)
    write_notes(run, tags=("good",))
    assert audited_folder(run) is None
    assert not (tmp_path / LOG_NAME).exists()
    assert main(["audit", "verify", str(tmp_path)]) == ExitCode.USAGE


def test_files_that_were_changed_by_other_programs_are_named(tmp_path: Path) -> None:
    run, other = finished_run(tmp_path / "deep", "T1"), finished_run(tmp_path, "T2")
    begin_audit(tmp_path)
    write_notes(run, tags=("good",), note="glued")
    assert verify_audit(tmp_path).problems == ()
    assert main(["judge", str(run), "--store"]) is not None
    open_run(run).judge(store=True)
    assert verify_audit(tmp_path).problems == (), "later verdicts are recorded, and the run file as it was"
    with h5py.File(other, "r+") as file:
        file["entry/trace/displacement"][3] += 1
    with h5py.File(run, "r+") as file:
        file["entry/points/peak_to_peak"][0] *= 1.01
    run.with_suffix(".notes.json").write_text('{"tags": ["bad"], "note": ""}')
    problems = verify_audit(tmp_path).problems
    changed = sorted((other.name, f"deep/{run.name}", f"deep/{run.stem}.notes.json"))
    assert [problem.partition(" was changed since")[0] for problem in problems] == changed


def test_deletions_are_recorded_and_others_are_detected(tmp_path: Path) -> None:
    first, second = finished_run(tmp_path, "T1"), finished_run(tmp_path, "T2")
    begin_audit(tmp_path)
    moved = move_to_trash([first])
    assert verify_audit(tmp_path).problems == ()
    assert restore_from_trash(moved) == 1
    assert verify_audit(tmp_path).problems == ()
    second.unlink()
    (problem,) = verify_audit(tmp_path).problems
    assert problem.startswith(f"{second.name} is missing since entry 1")
    third = finished_run(tmp_path, "T3")
    assert verify_audit(tmp_path).unrecorded == (third.name, notes_path(third).name)


WRITER = """
import sys
from pathlib import Path
from app.common.audit_chain import append_entry
for i in range(25):
    append_entry(Path(sys.argv[1]), "note", f"{sys.argv[2]} {i}", "", {}, {})
"""


@pytest.mark.deep
def test_several_programs_write_one_chain(tmp_path: Path) -> None:
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path), str(k)]) for k in range(4)]
    assert [writer.wait(240) for writer in writers] == [0] * 4
    entries, problems = read_entries(tmp_path)
    assert problems == []
    assert {entry.subject for entry in entries} == {f"{k} {i}" for k in range(4) for i in range(25)}


@pytest.mark.deep
def test_a_laboratory_day_is_on_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    assert main(["audit", "start", str(runs)]) == ExitCode.DONE
    assert main(["audit", "start", str(runs)]) == ExitCode.USAGE
    settings = ["--set", "frequencies_hz=100,130,150,160,170,200", "--set", "record_s=0.1"]
    run = [
        "run",
        "sine-dwell",
        "--speed",
        "max",
        "--out",
        str(runs),
        "--operator",
        "Anna",
        "--specimen",
        "T7",
        *settings,
    ]
    assert main(run) == ExitCode.DONE
    (path,) = runs.glob("*.h5")
    assert main(["specimen", "set", "T7", "batch=B1", "--folder", str(runs)]) == ExitCode.DONE
    assert main(["checked", str(path), "--by", "Ben"]) == ExitCode.DONE
    capsys.readouterr()
    assert main(["audit", "show", str(runs), "--json"]) == ExitCode.DONE
    entries = json.loads(capsys.readouterr().out)["entries"]
    expected = ["start", "run", "specimen sheet", "notes"]
    assert [entry["action"] for entry in entries] == expected
    assert entries[1]["by"].startswith("Anna (")
    assert entries[1]["details"]["verdict"] == "good"
    assert set(entries[1]["files"]) == {path.name, notes_path(path).name}
    assert entries[3]["details"]["checked_by"] == ["Ben"]
    assert main(["audit", "head", str(runs)]) == ExitCode.DONE
    head = capsys.readouterr().out.strip()
    assert main(["audit", "verify", str(runs), "--head", head]) == ExitCode.DONE
    assert "4 entries: unchanged" in capsys.readouterr().out
    assert main(["audit", "show", str(runs), "--subject", "T7"]) == ExitCode.DONE
    assert "Anna (" in capsys.readouterr().out
    log = runs / LOG_NAME
    log.write_text(log.read_text().replace('"Ben"', '"Bob"'))
    assert main(["audit", "verify", str(runs), "--head", head]) == ExitCode.FAILED
    assert "notes" in capsys.readouterr().out
