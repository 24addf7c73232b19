"""Invalid input to every command and option: an error message and an exit code, never a traceback."""

import argparse
import errno
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.cli import headless as commands
from app.cli.main import complete_parser, main
from app.common.exit_codes import ExitCode
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run

TEXTS = ("", "nan", "-1e400", "☃ [red]x", "x" * 300)
FILES = ("", "x" * 300, "/dev/full", "folder", "/proc/nowhere/x.png")

SHORT = ("--set", "frequencies_hz=200", "--set", "record_s=0.05", "--set", "min_cycles=5")
FURTHER = {
    "run": ("--speed", "max", *SHORT),
    "check": ("--speed", "max", "--set", "record_s=0.5", "--set", "wait_s=0.1"),
    "model step": ("--duration=0.01",),
    "model membrane": ("--pre-stretch=0",),
    "model convergence": ("--shapes=3", "--frequencies=50"),
    "study": ("--vary=delta=0,0.01", "--frequencies=50", "--samples=2"),
    "figures": ("--only=fig4",),
}
"""What makes a command quick; what is hostile comes after it and wins."""

POSITIONAL = {"protocol": "sine-dwell", "run": "run.h5", "runs": "run.h5", "file": "new.toml", "folder": "folder"}


def commands_of(parser: argparse.ArgumentParser, name: str = "") -> Iterator[tuple[str, argparse.ArgumentParser]]:
    deeper = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if name:
        yield name, parser
    for action in deeper:
        for word, inner in action.choices.items():
            yield from commands_of(inner, f"{name} {word}".strip())


COMMANDS = dict(commands_of(complete_parser()))
LEAVES = [
    name for name, p in COMMANDS.items() if not any(isinstance(a, argparse._SubParsersAction) for a in p._actions)
]


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    with laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(200,), record_s=0.05, min_cycles=5), tmp_path_factory.mktemp("run"), lab)
    return ran.path.read_bytes()


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, measured: bytes) -> Path:
    """A folder with a run in it, and nothing of the network or the screen."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    (tmp_path / "folder").mkdir()
    (tmp_path / "run.h5").write_bytes(measured)
    monkeypatch.setattr("drivers.list_resources", lambda: ([], []))
    monkeypatch.setattr("app.cli.bench.find_devices", lambda *_: ([], []))
    monkeypatch.setattr("app.gui.display_check.has_screen", lambda: False)
    monkeypatch.setattr("app.services.cluster.CONNECT_TIMEOUT_S", 0.1)
    quick = SineDwell(frequencies_hz=(200,), record_s=0.05, min_cycles=5)
    make = commands.make_protocol
    monkeypatch.setattr(
        commands, "make_protocol", lambda *asked: quick if asked == ("sine-dwell", []) else make(*asked)
    )
    return tmp_path


FIRST: dict[tuple[str, Any], tuple[int, str]] = {}
"""A number of every option, and the first command that has it: that one gets all values, the others, which share it, one."""
for leaf in LEAVES:
    for shared in COMMANDS[leaf]._actions:
        if shared.option_strings:
            FIRST.setdefault((shared.option_strings[-1], shared.type), (len(FIRST), leaf))


def attacks(name: str) -> Iterator[list[str]]:
    """Command lines of one command: every option and positional with every value, one at a time."""
    parser = COMMANDS[name]
    positional = [a for a in parser._actions if not a.option_strings]
    good = [POSITIONAL[a.dest] for a in positional if a.dest in POSITIONAL and a.nargs != "?"]
    base = [*name.split(), *good, *FURTHER.get(name, ())]
    if {"--speed"} & parser._option_string_actions.keys() and "--speed" not in base:
        base += ["--speed", "max"]
    for i, _ in enumerate(good):
        yield from ([*name.split(), *good[:i], value, *good[i + 1 :]] for value in (*TEXTS, *FILES))
    for action in parser._actions:
        if not action.option_strings or action.nargs == 0:
            continue
        option = action.option_strings[-1]
        values = FILES if getattr(action.type, "__name__", "") == "path_argument" else TEXTS
        at, first = FIRST[option, action.type]
        for value in values if first == name else values[at % len(values) :][:1]:
            yield [*base, f"{option}={value}"] if option.startswith("--") else [*base, option, value]


LONG = {"commission", "figures", "identify", "model step", "run"}
"""Commands that work for seconds where the question makes sense."""


@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.deep] if n in LONG else []) for n in LEAVES])
def test_nothing_that_can_be_asked_ends_in_a_traceback(name: str, here: Path, capsys: Any, caplog: Any) -> None:
    for arguments in attacks(name):
        code = main(arguments)
        captured = capsys.readouterr()
        assert code in (0, 1, 2, 3), arguments
        assert "Traceback" not in captured.err, arguments
        assert not [record for record in caplog.records if record.exc_info], arguments  # an error of this program
        assert code == 0 or len(captured.err.split()) >= 5, arguments


# -- the simulated bench's own numbers ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("modes = 0", "simulation.modes must be from 3 to 40, not 0"),
        ("plant_rate_hz = 10", "simulation.plant_rate_hz must be from 10000 to 1e+06, not 10"),
        ("window_s = 1e9", "simulation.window_s must be from 0.1 to 60, not 1e+09"),
        ("speed = 50", "simulation.speed must be from 1 to 20, not 50"),
        ("seed = -1", "simulation.seed must not be negative, not -1"),
        ("plant_rate = 1e5", "simulation: unknown plant_rate"),
        ("x = " + "[" * 5000, "is not valid TOML"),
        ("seed = " + "9" * 5000, "is not valid TOML"),
        ("#" * 1_000_001, "is longer than 1 MB"),
    ],
)
def test_a_bench_that_cannot_be_simulated_is_a_sentence(text: str, says: str, here: Path, capsys: Any) -> None:
    (here / "bench.toml").write_text(f"[simulation]\n{text}\n")
    assert main(["run", "sine-dwell", "--bench", "bench.toml"]) == ExitCode.USAGE
    assert says in capsys.readouterr().err


def test_a_seed_is_no_negative_number(here: Path, capsys: Any) -> None:
    assert main(["run", "sine-dwell", "--seed", "-1"]) == ExitCode.USAGE
    assert "'-1' is not a seed; give a whole number from 0 on" in capsys.readouterr().err


READERS = (
    "import {}",
    "certificate add {}",
    "restore {}",
    "run sine-dwell --bench {}",
    "label --list {}",
    "report T1 --logo {}",
    "model modes --set @{}",
)


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize("kind", ["device", "pipe"])
def test_a_pipe_or_device_in_the_place_of_a_file_is_not_read(
    command: str, kind: str, here: Path, capsys: Any, tmp_path: Path
) -> None:
    """Reading it would not end."""
    path = Path("/dev/zero") if kind == "device" else tmp_path / "pipe"
    if kind == "pipe":
        os.mkfifo(path)
    Path("runs").mkdir()
    assert main(command.format(path).split()) in (ExitCode.USAGE, ExitCode.FAILED)
    assert "pipe" in capsys.readouterr().err


def test_a_bench_file_that_is_too_long_is_not_read_to_its_end(here: Path, capsys: Any) -> None:
    Path("long.toml").write_bytes(b"#" * 1_000_002)
    assert main(["run", "sine-dwell", "--bench", "long.toml"]) == ExitCode.USAGE
    assert "long.toml is longer than 1 MB and no bench file" in capsys.readouterr().err


def test_a_folder_of_runs_that_is_a_file_is_another_folder_to_choose(here: Path, capsys: Any) -> None:
    Path("runs").write_text("no folder")
    assert main(["run", "sine-dwell", "--speed", "max", *SHORT, "--out", "runs"]) == ExitCode.FAILED
    told = capsys.readouterr().err
    assert_names(told, "folder")
    assert "mountings" not in told


def test_an_interruption_within_hdf5_is_one(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any) -> None:
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    Path("runs").mkdir()
    monkeypatch.setattr("app.cli.runs.scanned_catalogue", interrupted)
    assert main(["runs"]) == ExitCode.FAILED


@pytest.mark.parametrize("name", ["certificates", "audit.jsonl", "runs"])
def test_a_folder_that_the_disk_does_not_show_is_a_sentence(
    name: str, here: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = os.stat

    def stat(path: Any, *args: Any, **kwargs: Any) -> os.stat_result:
        if not isinstance(path, int) and Path(os.fsdecode(path)).name == name:
            raise OSError(errno.EIO, os.strerror(errno.EIO), path)
        return shown(path, *args, **kwargs)

    with monkeypatch.context() as patched:
        patched.setattr(os, "stat", stat)
        code = main(["run", "sine-dwell", "--speed", "max", *SHORT, "--out", "runs"])
    printed = capsys.readouterr().err
    assert code == (ExitCode.USAGE if name == "runs" else ExitCode.DONE)
    wrong = [words for words in ("Traceback", "error of this program") if words in printed]
    assert not wrong
    assert len(list(Path("runs").glob("*.h5"))) == (code == ExitCode.DONE)


@pytest.mark.skipif(os.name == "nt", reason="names are Unicode there")
def test_a_folder_whose_name_is_not_utf_8_holds_runs(here: Path, capsys: Any) -> None:
    folder = os.fsdecode(b"old disk \xff")
    assert main(["run", "sine-dwell", "--speed", "max", *SHORT, "--out", folder]) == ExitCode.DONE
    (file,) = Path(folder).glob("*.h5")
    for command in (
        "runs {}",
        "show {file}",
        "export {file}",
        "export {file} --format xlsx",
        "archive unnamed --no-report --folder {}",
    ):
        words = [word.format(folder, file=file) for word in command.split()]
        assert main(words) == ExitCode.DONE, command
    assert "Traceback" not in capsys.readouterr().err


# -- names ---------------------------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_a_long_name_is_shortened_in_the_files_name_and_whole_inside(here: Path, capsys: Any) -> None:
    name = "größer" * 30
    assert main(["run", "sine-dwell", "--speed", "max", *SHORT, "--out", "runs", "--specimen", name]) == 0
    (file,) = (here / "runs").glob("*.h5")
    assert len(file.name.encode()) < 150
    assert "größer" in file.name
    capsys.readouterr()
    assert main(["show", str(file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["specimen"] == name


def test_measured_data_is_not_overwritten_by_an_answer_of_the_model(here: Path, capsys: Any) -> None:
    before = (here / "run.h5").read_bytes()
    assert main(["model", "static", "--csv", "run.h5"]) == ExitCode.USAGE
    assert "run.h5 holds a run or a study and is not overwritten" in capsys.readouterr().err
    assert (here / "run.h5").read_bytes() == before


@pytest.mark.parametrize("name", ["x.txt", "x", "x.h5"])
def test_a_picture_of_an_unknown_kind_is_refused_before_it_is_drawn(name: str, here: Path, capsys: Any) -> None:
    for arguments in (["show", "run.h5"], ["model", "modes"]):
        assert main([*arguments, "--picture", name]) == ExitCode.USAGE
        assert "a picture ends in .png, .pdf, .svg" in capsys.readouterr().err
        assert not (here / name).exists()


# -- run files that are none ----------------------------------------------------------------------------------------------


def cut(data: bytes, share: float) -> bytes:
    return data[: round(share * len(data))]


def scratched(data: bytes, seed: int) -> bytes:
    spoilt = np.frombuffer(data, np.uint8).copy()
    place = np.random.default_rng(seed).integers(48, len(data), 60)
    spoilt[place] ^= 0xFF
    return spoilt.tobytes()


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda data: b"", "bad.h5 is empty; give a run file"),
        (lambda data: b"hello", "bad.h5 is no HDF5 file; give a run file"),
        (lambda data: cut(data, 0.5), "bytes are there; copy it again"),
        (lambda data: cut(data, 0.9), "bytes are there; copy it again"),
        *((lambda data, seed=seed: scratched(data, seed), "bad.h5 is damaged") for seed in range(4)),
    ],
)
def test_a_spoilt_run_is_told_in_a_sentence(spoil: Any, says: str, here: Path, measured: bytes, capsys: Any) -> None:
    (here / "bad.h5").write_bytes(spoil(measured))
    for more in ([], ["--json"], ["--picture", "x.png"]):
        assert main(["show", "bad.h5", *more]) == ExitCode.USAGE
        captured = capsys.readouterr()
        assert says in captured.err
        assert captured.out == ""


def test_what_is_no_file_at_all_is_no_run(here: Path, capsys: Any) -> None:
    os.mkfifo(here / "pipe")
    for name, says in (("folder", "is a folder"), ("pipe", "is no file"), ("/dev/full", "is no file")):
        assert main(["show", name]) == ExitCode.USAGE
        assert f"{name} {says}; give a run file" in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_says_so(here: Path, capsys: Any) -> None:
    (here / "run.h5").chmod(0)
    assert main(["show", "run.h5"]) == ExitCode.USAGE
    assert "run.h5 cannot be read: Permission denied" in capsys.readouterr().err


@pytest.mark.deep
def test_any_protocol_is_shown_and_drawn(here: Path, capsys: Any) -> None:
    assert main(["check", *FURTHER["check"], "--out", "runs"]) == 0
    (file,) = (here / "runs").glob("*.h5")
    capsys.readouterr()
    assert main(["show", str(file), "--picture", "x.png"]) == 0
    assert "2.600 V: drive reads back" in capsys.readouterr().out
    assert (here / "x.png").stat().st_size > 10_000
