"""Backup of run files with verified hashes, and the actions after a run: backup, command, plug-ins."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import pytest

from app.archive import after_run as module
from app.archive.after_run import AfterRun
from app.archive.backup import back_up
from app.cli.main import main
from app.common import ExitCode, UsageError
from app.config import BackupTable, BenchConfig, load_bench
from protocols.base import LogMessage, RunEnded, RunStatus
from protocols.runfile.names import notes_path
from protocols.runfile.verify import FileState, verify_run
from tests.helpers.messages import assert_names
from tests.helpers.run_files import finished_run


def bench(backup: Path | None = None) -> BenchConfig:
    return load_bench("ideal").model_copy(update={"backup": BackupTable(folder=str(backup or ""))})


def ended(path: Path) -> RunEnded:
    return RunEnded(RunStatus.COMPLETED, "all points measured", str(path))


def damage(path: Path) -> None:
    """Change one byte of the samples; the time of modification stays as a failing disk leaves it."""
    before = path.stat()
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_new_and_changed_files_are_copied_and_nothing_is_deleted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs, copies = tmp_path / "runs", tmp_path / "copies"
    first = finished_run(runs, "T1")
    (runs / "campaign").mkdir()
    (runs / "campaign" / "T1.json").write_text("{}")
    (runs / ".trash").mkdir()
    (runs / ".trash" / "old.h5").write_text("")
    assert main(["backup", str(copies), "--folder", str(runs), "--json"]) == ExitCode.DONE
    found = json.loads(capsys.readouterr().out)
    assert sorted(found["copied"]) == sorted([first.name, notes_path(first).name, "campaign/T1.json"])
    assert (copies / first.name).read_bytes() == first.read_bytes()
    first.unlink()
    notes_path(first).unlink()
    second = finished_run(runs, "T2")
    (runs / "campaign" / "T1.json").write_text('{"changed": 1}')
    result = back_up(runs, copies)
    assert set(result.copied) == {second.name, notes_path(second).name, "campaign/T1.json"}
    assert verify_run(copies / first.name).state is FileState.GOOD
    assert set(back_up(runs, copies, compare_all=True).already_present) == {
        second.name,
        notes_path(second).name,
        "campaign/T1.json",
    }


def test_a_damaged_run_does_not_replace_its_good_copy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs, copies = tmp_path / "runs", tmp_path / "copies"
    path = finished_run(runs)
    back_up(runs, copies)
    damage(path)
    assert back_up(runs, copies).already_present == (path.name, notes_path(path).name)  # size and time are the same
    assert main(["backup", str(copies), "--folder", str(runs), "--compare"]) == ExitCode.FAILED
    differing, _ = capsys.readouterr().out.splitlines()
    assert_names(differing, path.name, "damaged")
    assert str(path) in differing
    assert str(copies) not in differing, "the copy is good"
    os.utime(path, ns=(0, path.stat().st_mtime_ns + 10**10))
    (problem,) = back_up(runs, copies).problems
    assert "does not replace its earlier copy" in problem
    assert verify_run(copies / path.name).state is FileState.GOOD


def test_a_change_of_the_same_size_right_after_a_backup_is_copied(tmp_path: Path) -> None:
    notes = tmp_path / "runs" / "notes.json"
    notes.parent.mkdir()
    notes.write_text("1")
    os.utime(notes, ns=(0, 10**18 + 5 * 10**8))
    back_up(notes.parent, tmp_path / "copies")
    notes.write_text("2")
    os.utime(notes, ns=(0, 10**18 + 6 * 10**8))
    assert back_up(notes.parent, tmp_path / "copies").copied == (notes.name,)
    assert (tmp_path / "copies" / notes.name).read_text() == "2"


def test_a_copy_that_reads_back_differently_or_of_a_changing_file_is_none(tmp_path: Path) -> None:
    runs, copies = tmp_path / "runs", tmp_path / "copies"
    path = finished_run(runs)
    notes_path(path).unlink()
    with mock.patch("app.archive.backup.file_hash", return_value="0" * 64):
        assert "reads back differently" in back_up(runs, copies).problems[0]
    fsync = os.fsync

    def write_meanwhile(number: int) -> None:
        os.utime(path)
        fsync(number)

    with mock.patch("app.archive.backup.os.fsync", write_meanwhile):
        assert "it is being written" in back_up(runs, copies).problems[0]
    assert list(copies.iterdir()) == []


@pytest.mark.parametrize("target", ["runs", "runs/copies", "."])
def test_a_backup_inside_the_folder_is_refused(target: str, tmp_path: Path) -> None:
    finished_run(tmp_path / "runs")
    with pytest.raises(UsageError, match="one is inside the other"):
        back_up(tmp_path / "runs", tmp_path / target)


def observed(config: BenchConfig, command: str, path: Path) -> list[str]:
    messages: list[LogMessage] = []
    after = AfterRun(messages.append, config, command)
    after.observe(ended(path))
    after.close()
    return [message.text for message in messages]


def test_after_a_run_its_file_is_copied_and_the_command_has_it(tmp_path: Path) -> None:
    path = finished_run(tmp_path / "runs")
    config = bench(tmp_path / "copies")
    script = tmp_path / "note it.py"
    script.write_text(
        "import os, pathlib, sys\n"
        "pathlib.Path(sys.argv[2]).write_text(sys.argv[1] + '|' + os.environ['TACTOR_BENCH_OUTCOME'])\n"
    )
    command = f'"{sys.executable}" "{script}" {{run}} "{tmp_path / "said"}"'
    assert observed(config, command, path) == []
    assert (tmp_path / "copies" / path.name).read_bytes() == path.read_bytes()
    assert (tmp_path / "said").read_text() == f"{path}|not judged"


def _raises(_path: Path, _ended: RunEnded) -> str:
    raise ZeroDivisionError("by design")


def _refuses(path: Path, _ended: RunEnded) -> str:
    return f"{path.stem} was not uploaded"


@pytest.mark.parametrize(
    ("command", "plug_in", "said"),
    [
        ("no-such-program-anywhere", None, "it cannot be started"),
        (f'"{sys.executable}" -c "import sys; print(1); sys.exit(\'no licence\')"', None, "exit code 1. no licence"),
        ("", _raises, "ZeroDivisionError: by design"),
        ("", _refuses, "was not uploaded"),
    ],
)
def test_what_fails_after_a_run_is_one_message(
    command: str,
    plug_in: Callable[[Path, RunEnded], str] | None,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if plug_in is not None:
        point = mock.Mock(load=lambda: plug_in)
        point.name = "notebook"
        monkeypatch.setattr(module, "entry_points", lambda group: [point])
    path = finished_run(tmp_path)
    (message,) = observed(bench(), command, path)
    assert message.split(": ")[0].endswith(f" {path.name}")
    assert said in message


def test_a_backup_folder_that_cannot_be_used_is_a_message(tmp_path: Path) -> None:
    path = finished_run(tmp_path / "runs")
    (tmp_path / "file").write_text("")
    (message,) = observed(bench(tmp_path / "file" / "below"), "", path)
    assert "cannot be used for a backup" in message


def test_a_command_with_an_open_quotation_is_refused_before_the_bench_opens(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "sine-dwell", "--out", str(tmp_path), "--after-run", "upload 'x"]) == ExitCode.USAGE
    assert "--after-run upload 'x" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.deep
def test_a_run_of_the_command_line_ends_with_its_copy(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    text = Path("sim_hardware/ideal.toml").read_text()
    file.write_text(f'{text}\n[backup]\nfolder = "{(tmp_path / "copies").as_posix()}"\n')
    arguments = ["run", "sine-dwell", "--bench", str(file), "--out", str(tmp_path / "runs"), "--speed", "max"]
    assert main([*arguments, "--set", "frequencies_hz=100"]) == ExitCode.DONE
    (run,), (copy,) = (tmp_path / "runs").glob("*.h5"), (tmp_path / "copies").glob("*.h5")
    assert run.read_bytes() == copy.read_bytes()
