"""Result card: verdict, quantities and file stay after a run, with what can be done next."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QTextDocument
from PySide6.QtWidgets import QApplication

from app.common import sentence_case
from app.gui.results.card import BUDGET, rich_table
from app.gui.results.report_job import ReportJob
from app.gui.shell.page_host import RUNS
from model import quantity_label
from protocols.base import BenchArmed, EstimatedQuantity, PointMeasured, Quality, RunEnded, RunStarted, RunStatus
from protocols.measurements.mass_resonance import MassPoint
from tests.helpers.main_window import Stage, find, until
from tests.helpers.session_events import AT_REST, LIVE, LOST, OPENED, STOPPED, point

ESTIMATES = tuple(
    EstimatedQuantity(name, value, 0.01 * value, unit, "fit")
    for name, value, unit in (
        ("natural_frequency", 158.3, "Hz"),
        ("damping ratio", 0.21, "1"),
        ("k2", 7e-3, "N m^2"),
        ("mu", 1.33e-5, "N m/V"),
    )
)

NATURAL = quantity_label("natural_frequency").capitalize()


@pytest.mark.deep
def test_the_result_stays_until_the_next_run(stage: Stage) -> None:
    card = stage.window.measure_page.run_panel.result_card
    stage.happen(OPENED)
    assert card.isHidden()
    stage.window.start_run()
    ended = RunEnded(RunStatus.COMPLETED, "all points measured", "runs/one.h5", ESTIMATES)
    stage.happen(*LIVE, point(0, 100.0), AT_REST, ended)
    assert not card.isHidden()
    assert "Not judged" in find(card, "result.verdict").text()
    assert shown_figure(card) == (NATURAL, "158 Hz", BUDGET, "± 1.6 Hz statistical")
    assert "Moment per volt" in find(card, "result.more").text()
    assert find(card, "result.file").text() == "one.h5"
    assert not find(card, "result.simulated").isVisibleTo(card)  # the ribbon marks it
    assert not find(card, "result.continue").isVisibleTo(card), "nothing is missing"
    find(card, "result.again").click()
    assert len(stage.session.runs) == 2
    assert "Preliminary" in find(card, "result.verdict").text()
    assert not find(card, "result.again").isVisibleTo(card)


def shown_figure(card: Any) -> tuple[str, ...]:
    """The key figure of a card: name, figure with unit, and its two uncertainties."""
    name, figure, unit, total, noise = (
        find(card, f"result.{part}").text() for part in ("name", "figure", "unit", "total", "statistical")
    )
    return name, f"{figure} {unit}", total, noise


def test_interference_is_never_the_key_figure(stage: Stage) -> None:
    card = stage.window.measure_page.run_panel.result_card
    stage.happen(OPENED)
    stage.window.start_run()
    hum = EstimatedQuantity("interference_at_rest", 1.5e-7, 1e-8, "m", "hum")
    stage.happen(*LIVE, point(0, 100.0), AT_REST, RunEnded(RunStatus.COMPLETED, "done", "run.h5", (hum, ESTIMATES[0])))
    assert shown_figure(card)[:2] == (NATURAL, "158 Hz")
    assert sentence_case(quantity_label(hum.name)) in find(card, "result.more").text()


def test_the_uncertainty_of_the_sensors_gain_stands_with_what_it_scales(stage: Stage) -> None:
    card = stage.window.measure_page.run_panel.result_card
    stage.happen(replace(OPENED, gain_uncertainty=0.005))
    stage.window.start_run()
    compliance = EstimatedQuantity("compliance", 1.4e-4, 1e-8, "m/N", "fit")
    stage.happen(
        *LIVE, point(0, 100.0), AT_REST, RunEnded(RunStatus.COMPLETED, "done", "run.h5", (compliance, ESTIMATES[0]))
    )
    assert shown_figure(card) == ("Compliance", "140.0 µm/N", "± 0.70 µm/N total", "± 0.010 µm/N statistical")
    assert card.bar.statistical_share == pytest.approx(0.01 / 0.7, rel=0.01)


def test_the_reasons_of_a_verdict_are_whole_where_there_is_room_and_whole_in_the_tool_tip_elsewhere(
    stage: Stage,
) -> None:
    card = stage.window.measure_page.run_panel.result_card
    reason = "; ".join(
        f"weight {at} did not land on the specimen, and is not a point of the result" for at in range(1, 7)
    )
    stage.window.resize(1920, 1080)
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, AT_REST, RunEnded(RunStatus.COMPLETED, reason, "run.h5"))
    assert card.reason_label.text() == f"Not judged: {reason}"
    card.set_room(150)
    assert card.reason_label.text().endswith(" …")
    assert card.reason_label.toolTip() == f"Not judged: {reason}"


@pytest.mark.deep
def test_a_stopped_run_is_continued_from_its_card(stage: Stage) -> None:
    card = stage.window.measure_page.run_panel.result_card
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), *STOPPED)
    assert "Stopped" in find(card, "result.verdict").text()
    find(card, "result.continue").click()
    assert stage.session.again == [(Path("run.h5"), (), stage.window.tabs.folder)]


def test_a_run_that_ended_unsafe_is_continued_once_it_was_acknowledged(stage: Stage) -> None:
    window, card = stage.window, stage.window.measure_page.run_panel.result_card
    stage.happen(OPENED)
    window.start_run()
    stage.happen(*LIVE, point(0, 100.0), *LOST)
    assert "Unsafe" in find(card, "result.verdict").text()
    assert find(card, "result.continue").isVisibleTo(card)
    assert not find(card, "result.continue").isEnabled(), "the message is not acknowledged yet"
    stage.press(Qt.Key.Key_F4)
    find(card, "result.continue").click()
    assert [again[0] for again in stage.session.again] == [Path("run.h5")]


@pytest.mark.deep
def test_a_run_is_opened_from_its_card(stage: Stage) -> None:
    opened: list[Path] = []
    stage.window.tabs.runs.open_run = opened.append  # type: ignore[method-assign]
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), *STOPPED)
    find(stage.window, "result.open").click()
    assert opened == [Path("run.h5")]
    assert stage.window.tabs.currentIndex() == RUNS


@pytest.mark.deep
def test_masses_and_their_peaks_are_a_table_with_the_hint_in_the_words_of_the_form(stage: Stage) -> None:
    card = stage.window.measure_page.run_panel.result_card
    stage.happen(OPENED)
    stage.window.start_run()
    started = RunStarted("mass-resonance", "run.h5", 900.0, 9, True)
    hint = (
        "9.75 g: the peak at 136.7 Hz lies near the edge of the band; widen it (low and high) before more mass is added"
    )
    ended = RunEnded(RunStatus.FAILED, "scans were lost", "run.h5", hints=(hint,))
    stage.happen(started, BenchArmed(), mass_point(0, 1.75e-3, 247.61), mass_point(1, 2.75e-3, 205.98), AT_REST, ended)
    table = find(card, "result.more").text().replace("\u00a0", " ")
    for words in ("Mass", "Frequency", "1.75 g", "247.610 ± 0.020 Hz", "2.75 g"):
        assert words in table
    assert hint in find(card, "result.hints").text()
    assert find(card, "result.continue").text() == "Continue with 2 of 9"
    assert find(card, "result.continue").isVisibleTo(card)


@pytest.mark.deep
def test_the_report_of_the_specimen_is_written_by_another_process(tmp_path: Path, stage: Stage) -> None:
    said: list[str] = []
    opened: list[QUrl] = []
    job = ReportJob(said.append, stage.window, opened.append)
    job.start(tmp_path, "T7")
    until(lambda: len(said) > 1, "for the report")
    assert "No report of T7" in said[-1]
    assert not opened


def mass_point(index: int, mass: float, frequency: float) -> PointMeasured:
    values = (mass, frequency, 0.02, frequency, 0.02, frequency, 0.02, 0.2, 0.001, 1e-4, 0.999, 1.0)
    return PointMeasured(index, MassPoint(*values, int(Quality.SIMULATED)), index)


def test_a_value_too_long_for_the_narrowest_card_is_broken_and_a_short_one_is_not() -> None:
    long, short = (rich_table([("Moment", value)]) for value in ("−12.4852 ± 0.0052 N mm/kV", "155.92 ± 0.13 Hz"))
    assert ("nowrap" in long, "nowrap" in short) == (False, True)


def test_a_unit_of_several_words_is_not_broken_over_two_lines(qt: QApplication) -> None:
    document = QTextDocument()
    document.setHtml(rich_table([("Entropy", "163.245 ± 0.036 J/(K mol)")]))
    document.setTextWidth(180)
    document.size()  # lays it out
    block = document.find("163.245").block()
    lines = [block.layout().lineAt(k) for k in range(block.layout().lineCount())]
    texts = [block.text()[line.textStart() :][: line.textLength()] for line in lines]
    assert texts == ["163.245 ", "±\u00a00.036\u00a0J/\u2060(K\u00a0mol)"]
