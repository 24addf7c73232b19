"""Design questions on the Explore page: answered off the window's thread from sliders or calibration, as the command does."""

import json
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from app.explore import DesignQuestion, ExploreSetting, answer_design
from app.gui.explore import design_panel
from app.gui.explore.page import ExplorePage
from app.gui.shell.page_host import EXPLORE
from app.identification.calibrations import Calibrations, write_calibrations
from model import ParameterError, Specimen, Tactor
from model.response import exact_response
from model.studies.design import required_mass
from tests.helpers.calibrations import calibration
from tests.helpers.main_window import Stage, find, until
from tests.helpers.messages import assert_names
from tests.helpers.session_events import OPENED

ERRORS = {"k2": (7.1e-3, 2e-5), "m_add": (7.9e-3, 1e-4), "c0": (150.0, 4.0), "mu": (-1.3e-5, 1e-7), "mass_fraction": (0.7, 0.01)}  # fmt: skip


def first_number(text: str) -> float:
    return float(text.split()[0])


@pytest.fixture
def calibrated(tmp_path: Path) -> Path:
    write_calibrations(tmp_path, "T7", Calibrations((calibration(1, ERRORS),), 1))
    return tmp_path


@pytest.mark.deep
def test_the_answers_of_the_calibration_are_those_of_the_command(
    calibrated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (found,) = answer_design(DesignQuestion(ExploreSetting(), 160.0, 100e-6, 200.0, (calibrated, "T7")))
    given = ("--specimen", "T7", "--folder", str(calibrated), "--json")
    assert main(["model", "added-mass", "--frequency", "160 Hz", *given]) == 0
    moving, _, placed, _ = json.loads(capsys.readouterr().out)["added-mass"]["needed"]
    assert main(["model", "drive", "--amplitude", "100 um", "--frequency", "200 Hz", *given]) == 0
    (drive,) = json.loads(capsys.readouterr().out)["drive"]["needed"]
    assert found.mass.startswith(f"{moving} (95 %: ")
    assert f"to put into the cylinder: {placed} (95 %: " in found.mass
    assert f"{drive} (95 %: " in found.drive
    with pytest.raises(ParameterError, match="T9 has no calibration that can be used"):
        next(answer_design(DesignQuestion(ExploreSetting(), 160.0, 100e-6, 200.0, (calibrated, "T9"))))


def test_an_unreachable_answer_is_its_reason_and_the_other_one_is_given() -> None:
    (found,) = answer_design(DesignQuestion(ExploreSetting(), 20.0, 1e-2, 200.0))
    with pytest.raises(ParameterError) as reason:
        required_mass(Specimen(), 20.0)
    assert str(reason.value).casefold() in found.mass.casefold()
    assert_names(found.drive, 5, "V")
    assert "95 %" not in found.drive, "there is no value"


def test_the_page_asks_in_the_background_and_again_when_a_slider_moves(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: list[bool] = []

    def answer(question: DesignQuestion) -> object:
        threads.append(threading.current_thread() is threading.main_thread())
        return answer_design(question)

    monkeypatch.setattr(design_panel, "answer_design", answer)
    stage.happen(OPENED)
    stage.window.tabs.select_page(EXPLORE)
    page = stage.window.tabs.explore
    assert isinstance(page, ExplorePage)
    panel = page.design
    assert panel.isHidden()
    page.toolbar.design_button.click()
    panel.source_box.setCurrentIndex(0)
    until(lambda: panel.mass_label.text() and "sliders" in panel.source_label.text(), "for the answers")
    first = first_number(panel.mass_label.text())
    f = np.linspace(140.0, 180.0, 4001)
    peak_hz = f[np.abs(exact_response(replace(Tactor(), m_add=1e-3 * first), f)).argmax()]
    assert peak_hz == pytest.approx(160.0, abs=0.2)
    page.model.set_value("k2", 8e-3)
    until(lambda: first_number(panel.mass_label.text()) > 1.05 * first, "for a stiffer tactor's")
    find(stage.window, "explore.design.resonance").setText("abc")
    panel.ask()
    assert "abc" in panel.source_label.text()
    assert panel.mass_label.text() == ""
    assert threads
    assert not any(threads)
