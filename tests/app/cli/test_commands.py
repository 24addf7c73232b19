"""Command line: arguments, output and exit codes. In process, on the virtual clock."""

import json
from pathlib import Path

import pytest

from app.cli.main import main
from app.common.exit_codes import ExitCode
from protocols.runfile.reader import Run
from tests.helpers.messages import assert_names

SHORT = ["--set", "frequencies_hz=100, 160", "--set", "record_s=100 ms", "--set", "min_cycles=10"]


def sim(folder: Path, *more: str) -> list[str]:
    return ["--bench", "ideal", "run", "sine-dwell", "--speed", "max", "--out", str(folder), *SHORT, *more]


def test_a_run_leaves_a_file_that_show_tells_about(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(sim(tmp_path, "--specimen", "T9", "--seed", "5")) == ExitCode.DONE
    output = capsys.readouterr().err
    assert "SIMULATED" in output
    assert "At rest: the card sees 2.500 V" in output
    (file,) = tmp_path.glob("*_T9_sine-dwell.h5")
    assert main(["show", str(file)]) == ExitCode.DONE
    shown = capsys.readouterr().out
    assert "Sine dwell of T9   SIMULATED" in shown
    assert "good: all points measured" in shown
    assert "160.000" in shown
    with Run(file) as run:
        assert run.record.configuration["simulation"]["seed"] == 5


def test_json_is_one_object_a_line_in_si_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(sim(tmp_path, "--json")) == ExitCode.DONE
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    point = next(e["point"] for e in events if e["event"] == "PointMeasured")
    assert point["frequency"] == pytest.approx(100, abs=0.01)
    assert point["fundamental"] == pytest.approx(362e-6, rel=0.01)
    assert events[-1]["event"] == "RunEnded"
    assert events[-1]["status"] == "completed"
    assert main(["show", events[-1]["path"], "--json"]) == ExitCode.DONE
    record = json.loads(capsys.readouterr().out)
    assert record["points"]["fundamental"][0] == point["fundamental"]
    assert record["units"]["fundamental"] == "m"


@pytest.mark.deep
def test_the_demo_without_a_window_leaves_file_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--no-window", "--speed", "max", "--out", str(tmp_path)]) == ExitCode.DONE
    (file,), (picture,) = tmp_path.glob("*.h5"), tmp_path.glob("*.png")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 20_000
    assert file.stem == picture.stem
    assert "--no-window" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["run", "cheese"], "'cheese'"),
        (["run", "sine-dwell", "--set", "volts=3"], "'volts'"),
        (["run", "sine-dwell", "--set", "volts"], "write NAME=VALUE"),
        (["run", "sine-dwell", "--set", "peak_to_peak_v=7 V"], "7 V"),
        (["run", "sine-dwell", "--set", "min_cycles=inf"], "min_cycles"),
        (
            ["run", "sine-dwell", "--set", "frequencies_hz=9 kHz"],
            "9000 Hz",
        ),
        (["run", "sine-dwell", "--set", "record_s=3 kg"], "'3 kg'"),
        (["run", "sine-dwell", "--speed", "99"], "--speed 99"),
        (["run", "sine-dwell", "--bench", "/nowhere.toml"], "/nowhere.toml"),
        (["--bench", "/nowhere.toml", "run", "sine-dwell"], "/nowhere.toml"),
        (["show", "/nowhere.h5"], "/nowhere.h5"),
        (["dance"], "invalid choice: 'dance'"),
        (["run", "sine-dwell", "--seed", "x"], "'x'"),
    ],
)
def test_bad_input_gets_one_clear_sentence_and_exit_code_2(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == ExitCode.USAGE
    output = capsys.readouterr().err
    assert says in output
    assert "Traceback" not in output


def test_speed_on_a_real_bench_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "bench.toml"
    file.write_text('[generator]\nresource = "TCPIP::127.0.0.1::9::SOCKET"\n')
    assert main(["run", "sine-dwell", "--bench", str(file), "--speed", "2"]) == ExitCode.USAGE
    assert "--speed" in capsys.readouterr().err


def test_a_missing_ni_driver_says_what_to_install(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.cli.headless.operator_reachable", lambda: True)
    file = tmp_path / "bench.toml"
    file.write_text('[generator]\nresource = "TCPIP::127.0.0.1::9::SOCKET"\n')
    assert (
        main(["run", "sine-dwell", "--operator", "Anna", "--bench", str(file), "--out", str(tmp_path)])
        == ExitCode.FAILED
    )
    assert_names(capsys.readouterr().err, "ni.com/daqmx", "--bench", "sim")


def test_a_run_that_cannot_be_stored_fails_with_exit_code_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(sim(Path("/proc/nowhere"))) == ExitCode.FAILED
    assert "/proc/nowhere" in capsys.readouterr().err


def test_every_command_has_help_with_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("run", "window", "demo", "show"):
        with pytest.raises(SystemExit) as left:
            main([command, "--help"])
        assert left.value.code == 0
        (example,) = (line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("example:"))
        assert example[1:3] == ["tactor-bench", command]
