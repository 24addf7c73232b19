"""Verdicts of protocols on their own results, runs without response, and verdicts on old files."""

import re
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import pytest

from app.cli.main import main
from app.services.prompts import prompts_of_run
from protocols.base import Outcome, RunStatus
from protocols.measurements.result_checks import added_mass_checks, labelled_weight_checks
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.static_loading import StaticLoading
from protocols.measurements.wiring_check import WiringCheck
from protocols.rejudgement import judge_file
from protocols.runfile.reader import Run
from protocols.runner import conclusion
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run

OLD_RUNS = Path(__file__).parents[1] / "data" / "format-2" / "runs"
FREQUENCIES = (100.0, 120.0, 150.0, 160.0, 180.0)


def weights(factors: dict[float, float]) -> dict[float, dict[float, list[tuple[float, float]]]]:
    return {
        mass: {side: [(1e-4 * side_factor * factor, 1e-8)] * 3 for side, side_factor in ((1.0, 1.0), (-1.0, 1.1))}
        for mass, factor in factors.items()
    }


def test_weight_that_deviates_is_named() -> None:
    (check,) = labelled_weight_checks(weights({0.02: 1.0, 0.05: 1.22, 0.1: 1.01, 0.2: 0.99, 0.5: 1.0}))
    assert not check.passed
    assert_names(check.name, "50", "g")
    assert check.value == pytest.approx(0.061, rel=0.01)
    assert "61" in check.text
    assert "weigh the weight labelled 50 g" in check.text


def test_heaviest_weight_that_deviates_is_named() -> None:
    (check,) = labelled_weight_checks(weights({0.02: 1.0, 0.1: 1.0, 0.5: 0.8}))
    assert not check.passed
    assert "500 g" in check.name


def test_sound_weights_pass_and_two_weights_are_not_decided() -> None:
    (check,) = labelled_weight_checks(weights({0.02: 1.0, 0.05: 1.02, 0.1: 0.99}))
    assert check.passed
    assert labelled_weight_checks(weights({0.02: 1.0, 0.05: 1.3})) == ()


def test_added_mass_beside_the_line_is_named() -> None:
    labels = [2e-3, 4e-3, 6e-3, 8e-3]
    actual = [2e-3, 4e-3, 7e-3, 8e-3]
    frequency = [(1e-5 * (mass + 5e-3) ** 1.0) ** -0.5 for mass in actual]
    (check,) = added_mass_checks(labels, frequency, [0.0] * 4)
    assert not check.passed
    assert "6 g" in check.name
    assert check.value == pytest.approx(7e-3, rel=0.02)
    (right,) = added_mass_checks(actual, frequency, [0.0] * 4)
    assert right.passed
    assert added_mass_checks(labels[:3], frequency[:3], [0.0] * 3) == ()


def test_dwell_whose_laser_is_lost_is_no_result(tmp_path: Path) -> None:
    with laboratory() as lab:
        lab.control.inject("sensor-out-of-range")
        ran = run(SineDwell(frequencies_hz=FREQUENCIES), tmp_path, lab)
    assert (ran.status, ran.verdict.outcome) == (RunStatus.STOPPED, Outcome.NO_RESULT)
    with Run(ran.path) as file:
        assert file.record.verdict == ran.verdict
    assert judge_file(ran.path) == ran.verdict


@pytest.mark.deep
def test_dwell_with_the_membrane_left_on_is_doubtful(tmp_path: Path) -> None:
    with laboratory() as lab:
        lab.control.inject("membrane-left-on")
        ran = run(SineDwell(frequencies_hz=(100.0, 150.0)), tmp_path, lab)
    assert ran.verdict.outcome is Outcome.DOUBTFUL
    (failed,) = (check for check in ran.verdict.checks if not check.passed)
    assert ran.verdict.reasons[0].startswith(failed.figure)
    assert failed.remedy in ran.verdict.reasons[0]
    assert_names(failed.name, "paper's")
    assert_names(failed.remedy, "membrane")
    assert judge_file(ran.path) == ran.verdict


@pytest.mark.deep
def test_static_loading_names_the_weight_that_weighs_61_g(tmp_path: Path) -> None:
    with laboratory() as lab:
        lab.control.inject("weight-mislabelled")
        ran = run(StaticLoading(repeats=1, sides="MFC up", weights_kg=(0.02, 0.05, 0.1)), tmp_path, lab)
    assert ran.verdict.outcome is Outcome.DOUBTFUL
    assert re.search(r"\b50 g\b.*: 61\.0", ran.verdict.reasons[0])


@pytest.mark.parametrize("name", ["20261122T015919Z_T1_sine-dwell.h5", "20261122T015928Z_T1_static-loading.h5"])
def test_old_run_is_judged_when_asked(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = Path(shutil.copy(OLD_RUNS / name, tmp_path))
    with Run(path) as file:
        assert file.record.verdict.outcome is Outcome.NOT_JUDGED
        points = {column: values.tolist() for column, values in file.points().items()}
    before = path.read_bytes()
    main(["judge", str(path)])
    assert path.read_bytes() == before
    outcome = judge_file(path).outcome
    assert outcome is not Outcome.NOT_JUDGED
    assert str(outcome) in capsys.readouterr().out
    main(["judge", str(path), "--store"])
    with Run(path) as file:
        assert file.record.verdict.outcome is outcome
        assert str({column: values.tolist() for column, values in file.points().items()}) == str(points)
    with h5py.File(path) as plain:
        assert int(plain.attrs["format_version"]) == 2


def test_clock_set_back_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    check = conclusion.ComputerClockCheck()
    assert check.message() == ""

    class SetBack(datetime):
        @classmethod
        def now(cls, tz: Any = None) -> datetime:
            return datetime.now(UTC) - timedelta(days=40)

    monkeypatch.setattr(conclusion, "datetime", SetBack)
    assert "set back by 40 d" in check.message()


def test_run_that_nobody_can_answer_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.cli.headless.operator_reachable", lambda: False)
    bench = tmp_path / "bench.toml"
    bench.write_text('[generator]\nresource = "TCPIP::127.0.0.1::9::SOCKET"\n')
    for command, protocol in (
        (["run", "static-loading"], StaticLoading()),
        (["run", "sine-dwell"], SineDwell()),
        (["check"], WiringCheck()),
    ):
        assert main([*command, "--bench", str(bench), "--out", str(tmp_path / "runs")]) == 2
        said = " ".join(capsys.readouterr().err.split())
        assert " needs an operator, and standard input is not a terminal, so nobody can answer: " in said
        assert (
            ". Nothing was moved. Start it at a terminal (over the network: ssh -t, or tmux), or in the window" in said
        )
        assert f": '{prompts_of_run(protocol, 2.5)[0].text}'" in said
    assert not (tmp_path / "runs").exists()
