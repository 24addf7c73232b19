"""Result card: verdict, quantities and file stay after a run, with what can be done next."""

from pathlib import Path

import pytest

from app.gui.tabs import RUNS
from protocols.base import EstimatedQuantity, RunEnded, RunStatus
from tests.helpers.main_window import Stage, find
from tests.helpers.session_events import AT_REST, LIVE, OPENED, STOPPED, point

ESTIMATES = tuple(
    EstimatedQuantity(name, value, 0.01 * value, unit, "fit")
    for name, value, unit in (
        ("resonance", 158.3, "Hz"),
        ("damping ratio", 0.21, "1"),
        ("k2", 7e-3, "N m^2"),
        ("mu", 1.33e-5, "N m/V"),
    )
)


@pytest.mark.deep
def test_the_result_stays_until_the_next_run(stage: Stage) -> None:
    card = stage.window.measure_page.run_panel.result_card
    stage.happen(OPENED)
    assert card.isHidden()
    stage.window.start_run()
    ended = RunEnded(RunStatus.COMPLETED, "all points measured", "runs/one.h5", ESTIMATES)
    stage.happen(*LIVE, point(0, 100.0), AT_REST, ended)
    assert not card.isHidden()
    assert "NOT JUDGED" in find(card, "result.verdict").text()
    assert find(card, "result.value-0").text() == "158.3 ± 1.6 Hz"
    assert "mu" in find(card, "result.more").text()
    assert find(card, "result.file").text() == "one.h5"
    assert find(card, "result.simulated").isVisibleTo(card)
    assert not find(card, "result.continue").isVisibleTo(card), "nothing is missing"
    find(card, "result.again").click()
    assert len(stage.session.runs) == 2
    assert card.isHidden()


@pytest.mark.deep
def test_a_stopped_run_is_continued_from_its_card(stage: Stage) -> None:
    card = stage.window.measure_page.run_panel.result_card
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), *STOPPED)
    assert "STOPPED" in find(card, "result.verdict").text()
    find(card, "result.continue").click()
    assert stage.session.again == [(Path("run.h5"), (), stage.window.tabs.folder)]


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
