"""Explore state: slider values, undo, export."""

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from app.archive.replay import MeasuredResponse, read_measured_response
from app.cli.main import main
from app.cli.model_options import read_settings
from app.common.undo import UndoHistory
from app.explore.engine import ExploreRequest, ResponseEngine
from app.explore.fit import fit_runs
from app.explore.sliders import GROUPS, SLIDERS
from app.explore.state import PRESET_TITLES, ExploreSetting, describe_difference, make_preset, make_study
from app.identification import shape_count_of_file
from app.live.latest_only import LatestOnlyWorker
from model.identification.fit_options import FitCancelled, FitOptions
from model.parameter_spec import ParameterError
from model.response.harmonic_response import amplifier_response
from model.series import Series
from model.specimen import Specimen, replace_variables, variable_specs
from model.studies.parameter_study import STUDY_PRESETS
from protocols.runfile.reader import RunReadError
from tests.helpers.run_files import crashed_run, finished_run


def test_every_variable_of_the_model_has_a_slider_that_holds_its_default() -> None:
    assert SLIDERS.keys() == variable_specs().keys()
    assert sum(len(group) for group in GROUPS.values()) == len(SLIDERS)
    for name, slider in SLIDERS.items():
        value = ExploreSetting().value(name)
        assert slider.low <= value <= slider.high
        assert slider.value_at(slider.position(value)) == pytest.approx(value, rel=1e-3, abs=1e-12)
        assert variable_specs()[name].is_valid([slider.low, slider.high]).all()


def test_all_values_at_once_are_those_one_by_one() -> None:
    for name in PRESET_TITLES:
        setting = make_preset(name).setting
        assert setting.all_values == {n: setting.value(n) for n in SLIDERS}


def test_a_skin_slider_puts_the_tactor_on_the_skin_and_what_follows_follows() -> None:
    setting = ExploreSetting().with_value("delta", 0.01)
    assert setting.on_skin
    free, stretched = ExploreSetting().value("k_s"), setting.value("k_s")
    assert stretched > 5 * free
    pinned = setting.with_value("k_s", 123.0)
    assert pinned.with_value("delta", 0.05).value("k_s") == 123.0
    assert pinned.with_default("k_s") == setting


@pytest.mark.parametrize("kind", ["json", "toml", "file"])
@pytest.mark.parametrize("name", PRESET_TITLES)
def test_copied_parameters_are_understood_by_set(kind: str, name: str, tmp_path: Path) -> None:
    setting = make_preset(name).setting.with_value("m_add", 5e-3)
    text = setting.as_json() if kind == "json" else setting.as_toml()
    if kind == "file":
        (tmp_path / "tactor.toml").write_text(text, "utf-8")
        text = f"@{tmp_path / 'tactor.toml'}"
    got = replace_variables(Specimen(), read_settings([text]))
    assert (got.tactor, got.skin) == (setting.specimen.tactor, setting.specimen.skin)


def test_the_command_takes_what_was_copied(capsys: pytest.CaptureFixture[str]) -> None:
    text = ExploreSetting().with_value("m_add", 1.75e-3).as_toml()
    assert tomllib.loads(text)["m_add"] == 1.75e-3
    assert main(["model", "modes", "-n", "7", "--json", "--set", text]) == 0
    assert json.loads(capsys.readouterr().out)["undamped"]["free_frequency"][0] == pytest.approx(300.9, abs=0.1)


@pytest.mark.parametrize("text", ["{ half", "@no such file", "a = \nb = 1"])
def test_a_text_of_many_that_is_none_gets_a_sentence(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["model", "modes", "--set", text]) == 2
    assert "--set" in capsys.readouterr().err


def test_presets_are_the_papers_studies() -> None:
    for name, make in STUDY_PRESETS.items():
        study, begin = make(), make_preset(name)
        question = ExploreRequest(begin.setting, begin.kept_curves, 250.0, 160.0)
        *_, picture = ResponseEngine().compute(question)
        assert picture.kept_curves is not None
        for line, row in zip(picture.kept_curves, study.run().values, strict=True):
            np.testing.assert_allclose(
                np.interp(100.0, line.frequency_hz, 2 * abs(line.fundamental)), row[99], rtol=2e-3
            )


def test_undo_goes_back_a_slider_at_a_time() -> None:
    history = UndoHistory(ExploreSetting())
    for mass in (1e-3, 2e-3, 3e-3):
        history.push(history.current.with_value("m_add", mass), "m_add")
    history.push(history.current.with_value("delta", 0.01), "delta")
    assert history.undo()
    assert history.current.values == {"m_add": 3e-3}
    assert history.undo()
    assert history.current == ExploreSetting()
    assert not history.undo()
    assert history.redo()
    assert history.current.values == {"m_add": 3e-3}
    history.push(ExploreSetting())
    assert not history.can_redo


def test_differences_in_words() -> None:
    table, old = ExploreSetting(), ExploreSetting().with_value("m_add", 1e-3)
    for before, after, words in ((old, old.with_value("m_add", 2e-3), "m_add = 2 g"), (table, table, "Table I")):
        assert describe_difference(before, after) == words


def test_a_study_varies_what_the_kept_curves_do_else_the_slider() -> None:
    begin = make_preset("fig10")
    assert make_study(begin.setting, begin.kept_curves, "E_m", (100.0,)).vary == {"E_m": (1e3, 1e6, 1e7, 1e8, 1e9)}
    alone = make_study(ExploreSetting(), (), "delta", (100.0, 200.0))
    assert alone.shape == (9,)
    assert alone.run().values.shape == (9, 2)


def test_what_is_not_physical_is_refused() -> None:
    with pytest.raises(ParameterError, match="L1"):
        _ = ExploreSetting().with_value("L1", 16e-3).specimen


def test_measured_points_come_in_order_with_their_drive(tmp_path: Path) -> None:
    run = read_measured_response(finished_run(tmp_path, frequencies=(160.0, 100.0)))
    assert run.frequency_hz.tolist() == [100.0, 160.0]
    assert (run.simulated, run.peak_to_peak_v, run.fundamental.fit_rows.all()) == (True, 5.0, True)
    assert len(read_measured_response(crashed_run(tmp_path)).frequency_hz) == 1
    (tmp_path / "x.h5").write_text("nothing")
    with pytest.raises(RunReadError, match=r"x\.h5"):
        read_measured_response(tmp_path / "x.h5")


@pytest.mark.parametrize("simulated", [False, True], ids=["real", "simulated with 7 shapes"])
@pytest.mark.parametrize(("truth", "begin"), [
    (ExploreSetting({"m_add": 6.5e-3, "c0": 210.0, "mu": -1.1e-5}), ExploreSetting()),
    (ExploreSetting({"delta": 0.01, "k_s": 9e3, "c_s": 420.0}, on_skin=True), ExploreSetting({"delta": 0.01}, on_skin=True)),
])  # fmt: skip
def test_a_fit_finds_the_parameters_the_points_were_made_with(
    truth: ExploreSetting, begin: ExploreSetting, simulated: bool, tmp_path: Path
) -> None:
    specimen, path = truth.specimen, finished_run(tmp_path)
    f = np.array([25, 50, 75, 100, 125, 150, 160, 170, 185, 200, 225, 250], float)
    n = shape_count_of_file(path) if simulated else FitOptions.n
    made = amplifier_response(specimen.tactor, f, skin=specimen.skin, n=n)
    run = MeasuredResponse(
        path,
        "made",
        simulated,
        5.000001,
        Series(f, made.peak_to_peak, 0 * f + 1e-6),
        Series(f, made.fundamental, 0 * f + 1e-7),
    )
    fitted = fit_runs([run], begin)
    found = fitted.setting
    for name, value in truth.values.items():
        assert found.value(name) == pytest.approx(value, rel=2e-3), name
    assert "± has noise and dimensions by ruler and caliper" in fitted.summary


@pytest.mark.deep
def test_the_errors_of_a_fit_contain_those_of_ruler_and_caliper(tmp_path: Path) -> None:
    """Noise alone makes the added mass uncertain by 1e-5 of it, the dimensions by some percent."""
    f = np.array([25, 50, 75, 100, 125, 150, 160, 170, 185, 200, 225, 250], float)
    made = amplifier_response(ExploreSetting().specimen.tactor, f, n=FitOptions.n)
    run = MeasuredResponse(
        tmp_path,
        "made",
        False,
        5.000001,
        Series(f, made.peak_to_peak, 0 * f + 1e-6),
        Series(f, made.fundamental, 0 * f + 1e-8),
    )
    text = fit_runs([run], ExploreSetting()).summary
    found = re.match(r"added mass \((7\.\d+) ± (0\.\d+)\) g, by noise below 0\.01; ", text)
    assert found is not None, text
    assert float(found[1]) == pytest.approx(7.73, abs=0.02)
    assert 0.01 < float(found[2]) / 7.73 < 0.1


def test_a_fit_can_be_cancelled(tmp_path: Path) -> None:
    with pytest.raises(FitCancelled):
        fit_runs([read_measured_response(finished_run(tmp_path))], ExploreSetting(), lambda: True)


def test_a_fit_without_a_usable_point_is_a_sentence(tmp_path: Path) -> None:
    run = read_measured_response(finished_run(tmp_path))
    none = np.zeros(2, bool)
    run = replace(
        run, peak_to_peak=replace(run.peak_to_peak, usable=none), fundamental=replace(run.fundamental, usable=none)
    )
    with pytest.raises(ValueError, match=re.escape(run.label)):
        fit_runs([run], ExploreSetting())


def test_of_many_questions_the_newest_is_answered() -> None:
    begun, go_on, told, done = Event(), Event(), [], Event()

    def compute(question: int) -> Iterator[str]:
        begun.set()
        go_on.wait(60)
        yield f"first of {question}"
        yield f"second of {question}"

    def tell(question: int, answer: str | Exception) -> None:
        told.append(answer)
        if answer == "second of 4":
            done.set()

    latest = LatestOnlyWorker(compute, tell, "test")
    latest.submit(1)
    begun.wait(60)
    for question in (2, 3, 4):
        latest.submit(question)
    go_on.set()
    done.wait(60)
    latest.close()
    assert told == ["first of 1", "first of 4", "second of 4"]


def test_an_error_is_told_and_the_next_question_still_answered() -> None:
    reported: list[object] = []
    heard = Event()

    def compute(question: int) -> Iterator[float]:
        yield 1 / question

    def tell(question: int, answer: float | Exception) -> None:
        reported.append(answer)
        heard.set()

    latest = LatestOnlyWorker(compute, tell, "test")
    for question in (0, 2):
        heard.clear()
        latest.submit(question)
        heard.wait(60)
    latest.close()
    assert isinstance(reported[0], ZeroDivisionError)
    assert reported[1] == 0.5


@pytest.mark.deep
def test_the_window_loads_without_the_linear_algebra() -> None:
    code = "import app.gui.shell.main_window, sys; print('scipy.linalg' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
