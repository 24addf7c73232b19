"""`tactor-bench protocols`, `resume`, and `run ./my_protocol.py`: in process, on the virtual clock."""

import json
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.cli.main import main
from app.common.exit_codes import ExitCode
from protocols import registry
from protocols.base import Outcome, Quality
from protocols.runfile.reader import Run
from tests.helpers.messages import assert_names

SHORT = ["--set", "record_s=100 ms", "--set", "min_cycles=10"]

MINE = """
from protocols.measurements.sine_dwell import SineDwell


class Mine(SineDwell):
    \"\"\"A dwell of our own.\"\"\"

    name = "mine"
    title = "Mine"
"""


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """What a test has made known is forgotten after it."""
    before = dict(registry.PROTOCOLS)
    yield
    registry.PROTOCOLS.clear()
    registry.PROTOCOLS.update(before)


def measured(folder: Path, protocol: str = "sine-dwell", frequencies: str = "100,155,160") -> Path:
    folder.mkdir(exist_ok=True)
    arguments = ["--speed", "max", "--out", str(folder), "--specimen", "T9", "--set", f"frequencies_hz={frequencies}"]
    assert main(["run", protocol, *arguments, *SHORT]) == ExitCode.DONE
    (file,) = folder.glob("*.h5")
    return file


def flags(path: Path) -> list[tuple[int, int, bool]]:
    with Run(path) as run:
        points = run.points()
    return [
        (int(entry), round(f), Quality.SUPERSEDED in Quality(int(q)))
        for entry, f, q in zip(points["entry"], points["frequency"], points["quality"], strict=True)
    ]


@pytest.mark.deep
def test_some_frequencies_are_measured_again_into_a_file_beside_the_old_one(tmp_path: Path) -> None:
    first = measured(tmp_path / "runs")
    assert main(["resume", str(first), "--again", "155,160", "--speed", "max"]) == ExitCode.DONE
    (second,) = set((tmp_path / "runs").glob("*_T9_sine-dwell*.h5")) - {first}
    assert flags(second) == [(0, 100, False), (1, 155, True), (2, 160, True), (1, 155, False), (2, 160, False)]
    with Run(second) as run:
        assert run.resumed_from == first
        assert [r.entry for r in run.recordings()] == [0, 1, 2, 1, 2]


@pytest.mark.deep
def test_what_has_no_response_is_measured_again_by_that_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dark = tmp_path / "dark.toml"
    text = Path("sim_hardware/ideal.toml").read_text(encoding="utf-8")
    dark.write_text(text.replace("mu = -1.33e-5", "mu = -1e-13"), encoding="utf-8")
    arguments = ["--speed", "max", "--out", str(tmp_path), "--set", "frequencies_hz=100,160", *SHORT]
    assert main(["run", "sine-dwell", "--bench", str(dark), *arguments]) == ExitCode.NO_RESULT
    (first,) = tmp_path.glob("*.h5")
    told = " ".join(capsys.readouterr().err.split())
    with Run(first) as run:
        assert run.record.verdict.outcome is Outcome.NO_RESULT
        assert run.record.verdict.reasons
        assert all(reason in told for reason in run.record.verdict.reasons)
    assert main(["resume", str(first), "--again", "flagged", "--speed", "max"]) == ExitCode.DONE
    (second,) = set(tmp_path.glob("*.h5")) - {first}
    assert flags(second)[2:] == [(0, 100, False), (1, 160, False)]
    assert main(["resume", str(second), "--again", "flagged"]) == ExitCode.USAGE
    assert_names(capsys.readouterr().err, second.name, "flagged")


@pytest.mark.one_in(100)
@pytest.mark.parametrize(
    ("more", "says"),
    [
        ([], "is complete: there is nothing to resume"),
        (["--again", "17"], "'17'"),
    ],
)
def test_what_cannot_be_gone_on_with_is_a_sentence(
    more: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = measured(tmp_path)
    assert main(["resume", str(first), *more]) == ExitCode.USAGE
    assert says in capsys.readouterr().err


@pytest.mark.deep
def test_added_points_are_known_by_their_frequency_when_a_run_goes_on(tmp_path: Path) -> None:
    refined = ["--set", "frequencies_hz=140,160,180", "--set", "refine_to_hz=12"]
    assert main(["run", "sine-dwell", "--speed", "max", "--out", str(tmp_path), *SHORT, *refined]) == ExitCode.DONE
    (first,) = tmp_path.glob("*.h5")
    assert flags(first) == [(0, 140, False), (1, 160, False), (2, 180, False), (3, 150, False), (4, 170, False)]
    assert main(["resume", str(first), "--again", "150", "--speed", "max"]) == ExitCode.DONE
    (second,) = set(tmp_path.glob("*.h5")) - {first}
    assert flags(second)[3:] == [(3, 150, True), (4, 170, False), (3, 150, False)]


@pytest.mark.deep
def test_a_labs_own_file_runs_and_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text(MINE)
    first = measured(tmp_path / "runs", str(mine), "100,160")
    del registry.PROTOCOLS["mine"]  # as after a restart
    assert main(["resume", str(first), "--again", "160"]) == ExitCode.USAGE
    assert "'mine'" in capsys.readouterr().err
    assert main(["resume", str(first), "--again", "160", "--protocol", str(mine), "--speed", "max"]) == ExitCode.DONE
    assert main(["run", str(tmp_path / "none.py")]) == ExitCode.USAGE
    assert str(tmp_path / "none.py") in capsys.readouterr().err


def test_protocols_lists_what_there_is_plug_ins_included(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = type(
        "Brought",
        (registry.PROTOCOLS["sine-dwell"],),
        {"__doc__": "Brought along.", "name": "brought", "title": "Brought"},
    )
    points = [SimpleNamespace(name="good", load=lambda: kind), SimpleNamespace(name="bad", load=lambda: 1 / 0)]
    monkeypatch.setattr(metadata, "entry_points", lambda group: points)
    assert main(["protocols"]) == ExitCode.DONE
    captured = capsys.readouterr()
    assert "sine-dwell  " in captured.out
    assert "Brought along." in captured.out
    assert "'bad'" in captured.err
    assert main(["protocols", "sine-dwell", "--json"]) == ExitCode.DONE
    parameters = {row["parameter"]: row for row in json.loads(capsys.readouterr().out)}
    assert (parameters["peak_to_peak_v"]["default"], parameters["peak_to_peak_v"]["unit"]) == ("5", "V")
