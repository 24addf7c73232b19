"""Campaign page in the real window, operated by keys: drive voltage, states on the screen, changes on disk."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from PySide6.QtCore import QMimeData, QPoint, QPointF, QSettings, Qt
from PySide6.QtGui import QDragMoveEvent, QDropEvent, QTextDocument
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLabel

from app.campaign.campaign import Campaign
from app.campaign.plan import PAPER_ITEMS, CampaignItem, campaign_path
from app.campaign.status import ItemStatus, NextAction
from app.config.bench_file import BenchConfig
from app.gui.campaign.board import CampaignBoard
from app.gui.campaign.page import CampaignPage
from app.gui.shell.main_window import MainWindow
from protocols.base import Prompt
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.wiring_check import WiringCheck
from protocols.runfile.reader import Run
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.helpers.main_window import Bench, OpenStage, Stage, find, press, until, until_read, whole_window
from tests.helpers.session_events import LIVE, OPENED, STOPPED

CTRL, ALT, SHIFT = (
    Qt.KeyboardModifier.ControlModifier,
    Qt.KeyboardModifier.AltModifier,
    Qt.KeyboardModifier.ShiftModifier,
)
FREE = Prompt("remove-membrane", "Take the membrane off.", hands_on=True)
QUICK = (
    CampaignItem("wiring", "wiring-check", {"record_s": 0.5, "wait_s": 0.2}),
    CampaignItem("dwell", "sine-dwell", {"frequencies_hz": (120, 150, 160), "record_s": 0.2}, ("wiring",)),
    CampaignItem("again", "sine-dwell", {"frequencies_hz": (100,), "record_s": 0.2}, ("dwell",), (FREE,)),
)

Carry = Callable[[Qt.Key, Qt.KeyboardModifier], None]


def settle(page: CampaignPage) -> None:
    until_read(page.controller)


def details_text(board: CampaignBoard) -> str:
    return "\n".join(label.text() for label in board.details.details_area.viewport().findChildren(QLabel))


def states(page: CampaignPage) -> list[str]:
    assert page.controller.summary is not None
    return [row.status_text for row in page.controller.summary.items]


def on_disk(folder: Path) -> dict[str, dict]:
    return {item["name"]: item for item in json.loads(campaign_path(folder, "T7").read_text("utf-8"))["items"]}


@pytest.fixture
def bench(config: BenchConfig) -> Bench:
    return Bench(config)


@pytest.fixture
def window(
    qt: QApplication,
    bench: Bench,
    config: BenchConfig,
    settings: QSettings,
    tmp_path: Path,
    no_widget_left_behind: None,
) -> Iterator[MainWindow]:
    """A window whose last campaign was not finished."""
    Campaign.create(tmp_path, "T7", True, QUICK)
    settings.setValue("campaign/open", str(campaign_path(tmp_path, "T7")))
    with whole_window(bench, config, SineDwell(), tmp_path, settings) as window:
        yield window
        assert bench.laboratory is not None
        report = bench.laboratory.control.report()
    assert_safe_voltage(report)


@pytest.mark.deep
def test_the_result_card_of_a_wiring_check_offers_to_accept_it(window: MainWindow, tmp_path: Path) -> None:
    controller = window.tabs.campaign.controller
    press(window, Qt.Key.Key_2, CTRL)
    settle(window.tabs.campaign)
    press(window, Qt.Key.Key_F5)
    until(lambda: window.state.busy, "for a run")
    press(window, Qt.Key.Key_1, CTRL)
    until(lambda: not window.state.busy, "for its end")
    accept = window.measure_page.run_panel.result_card.buttons["accept"]
    until(accept.isVisible, "for the offer")
    assert accept.property("kind") == "primary"
    accept.click()
    settle(window.tabs.campaign)
    (run,) = on_disk(tmp_path)["wiring"]["accepted"]
    assert run == Path(window.state.outcome.path).name
    assert controller.summary.acceptable == {}
    assert not accept.isVisible()


@pytest.mark.deep
def test_a_campaign_that_was_left_is_carried_on_by_keys_alone(window: MainWindow, bench: Bench, tmp_path: Path) -> None:
    press(window, Qt.Key.Key_2, CTRL)
    page = window.tabs.campaign
    settle(page)
    board = page.board
    assert board.decision.heading.text() == "Measure wiring: Wiring check"
    assert "−20 … +60 V" in board.decision.detail.text()
    assert "0 of 3 done" in board.header.progress_label.text()

    def carry_out(key: Qt.Key, modifier: Qt.KeyboardModifier = Qt.KeyboardModifier.NoModifier) -> None:
        press(window, key, modifier)
        until(lambda: window.state.busy, "for a run")
        assert board.side_stack.currentWidget() is board.live_pane
        until(lambda: not window.state.busy, "for its end")
        settle(page)

    carry_out(Qt.Key.Key_F5)
    assert states(page)[0] == "done, to be accepted"
    assert board.decision.heading.text() == "Accept the result of wiring?"
    assert "µm/V" in board.decision.detail.text()
    assert " ± " in details_text(board)
    QTest.keyClick(board.item_list, Qt.Key.Key_Return)
    settle(page)
    (accepted,) = on_disk(tmp_path)["wiring"]["accepted"]
    assert (tmp_path / accepted).exists()
    assert board.decision.heading.text() == "Measure dwell: Sine dwell"

    bench.at_a_point = lambda _: bench.session.stop()
    carry_out(Qt.Key.Key_F5)
    assert states(page)[1] == "unfinished"
    assert board.decision.heading.text() == "Go on with dwell: Sine dwell"
    bench.at_a_point = lambda _: None
    carry_out(Qt.Key.Key_F5)
    dwell = page.controller.summary.item("dwell").state
    with Run(dwell.run) as run:
        assert run.resumed_from is not None
        assert {*map(int, run.points()["entry"])} == {0, 1, 2}

    assert board.item_list.selected_item == "dwell"
    press(window, Qt.Key.Key_X)
    settle(page)
    assert on_disk(tmp_path)["dwell"]["rejected"] == [dwell.run.name]
    press(window, Qt.Key.Key_Z, CTRL)
    settle(page)
    assert on_disk(tmp_path)["dwell"]["rejected"] == []
    assert states(page)[1] == "done, to be accepted"


@pytest.mark.deep
def test_what_needs_no_hands_follows_by_itself(window: MainWindow, tmp_path: Path) -> None:
    press(window, Qt.Key.Key_2, CTRL)
    page = window.tabs.campaign
    settle(page)
    press(window, Qt.Key.Key_F5, CTRL)
    until(
        lambda: states(page)[1].startswith("done") and not window.state.busy and not page.controller.queue_active,
        "for two runs",
    )
    settle(page)
    assert states(page) == ["done, to be accepted", "done, to be accepted", "missing"]
    assert len(list(tmp_path.glob("*.h5"))) == 2
    assert page.controller.estimates is not None
    assert page.controller.estimates.problem in details_text(page.board)


@pytest.fixture
def page(open_stage: OpenStage, tmp_path: Path) -> tuple[Stage, CampaignPage]:
    Campaign.create(tmp_path, "T7", True, (*QUICK, CampaignItem("last", "wiring-check")))
    stage = open_stage()
    stage.press(Qt.Key.Key_2, CTRL)
    page = stage.window.tabs.campaign
    until(lambda: page.start_pane.campaign_list.count() == 1, "for the campaigns of the folder")
    page.start_pane.campaign_list.setFocus()
    QTest.keyClick(page.start_pane.campaign_list, Qt.Key.Key_Return)
    settle(page)
    return stage, page


def test_order_and_what_is_left_out_are_changed_by_keys_and_taken_back(
    page: tuple[Stage, CampaignPage], tmp_path: Path
) -> None:
    stage, shown = page
    items = shown.board.item_list
    items.select_item("last")
    stage.press(Qt.Key.Key_Up, ALT)
    settle(shown)
    assert list(on_disk(tmp_path)) == ["wiring", "dwell", "last", "again"]
    assert items.selected_item == "last"
    items.select_item("dwell")
    stage.press(Qt.Key.Key_Up, ALT)
    settle(shown)
    assert list(on_disk(tmp_path)) == ["wiring", "dwell", "last", "again"]
    assert "dwell needs wiring before it" in find(shown, "campaign.message").text()
    stage.press(Qt.Key.Key_S)
    settle(shown)
    assert on_disk(tmp_path)["dwell"]["skipped"]
    assert states(shown)[1] == "skipped"
    assert not find(shown, "campaign.message").isVisible()
    stage.press(Qt.Key.Key_Z, CTRL)
    stage.press(Qt.Key.Key_Z, CTRL)
    settle(shown)
    assert list(on_disk(tmp_path)) == ["wiring", "dwell", "again", "last"]
    assert not on_disk(tmp_path)["dwell"]["skipped"]
    stage.press(Qt.Key.Key_Y, CTRL)
    settle(shown)
    assert list(on_disk(tmp_path)) == ["wiring", "dwell", "last", "again"]


def test_details_follow_the_chosen_item_after_the_list_and_not_under_the_live_plots(
    page: tuple[Stage, CampaignPage],
) -> None:
    stage, shown = page
    board, heading = shown.board, find(shown, "campaign.item")
    board.item_list.select_item("last")
    until(lambda: heading.text().startswith("last:"), "for the details of the chosen item")
    board.item_list.select_item("dwell")
    assert heading.text().startswith("last:"), "the list is painted first"
    assert board.details.heading_label.text().startswith("dwell:"), "what acts on the details has those of the choice"
    stage.happen(OPENED, *LIVE)
    board.item_list.select_item("wiring")
    stage.happen(*STOPPED[:1])
    assert board.side_stack.currentWidget() is board.live_pane
    assert heading.text().startswith("dwell:")
    stage.happen(*STOPPED[1:])
    until(lambda: heading.text().startswith("wiring:"), "for the details after the run")


@pytest.mark.deep
def test_an_item_is_dragged_to_another_place(page: tuple[Stage, CampaignPage], tmp_path: Path) -> None:
    _, shown = page
    items = shown.board.item_list
    items.select_item("last")
    area = items.visualItemRect(items.item(0))
    top = QPointF(area.center().x(), area.top() + 1)
    drag = (QMimeData(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier)
    items.dragMoveEvent(QDragMoveEvent(QPoint(*map(int, top.toTuple())), Qt.DropAction.MoveAction, *drag))
    items.dropEvent(QDropEvent(top, Qt.DropAction.MoveAction, *drag))
    settle(shown)
    assert list(on_disk(tmp_path)) == ["last", "wiring", "dwell", "again"]
    assert [items.item(at).text().split(":")[0] for at in range(4)] == ["last", "wiring", "dwell", "again"]


def test_a_run_started_by_mouse_leaves_the_keyboard_to_the_list_whose_enter_accepts(
    page: tuple[Stage, CampaignPage],
) -> None:
    stage, shown = page
    stage.happen(OPENED)
    settle(shown)
    run = shown.board.decision.buttons["run"]
    run.setFocus()
    QTest.mouseClick(run, Qt.MouseButton.LeftButton)
    until(lambda: stage.session.runs, "for the run")
    stage.happen(*LIVE)
    assert not run.isVisible()
    assert stage.window.focusWidget() is shown.board.item_list


@pytest.mark.deep
def test_the_session_is_given_what_must_be_set_up_and_keys_rest_while_it_runs(
    page: tuple[Stage, CampaignPage], tmp_path: Path
) -> None:
    stage, shown = page
    stage.press(Qt.Key.Key_F5)
    settle(shown)
    assert stage.session.runs == []
    assert "the bench is still being connected" in find(shown, "campaign.message").text()
    stage.happen(OPENED)
    for name in ("wiring", "dwell"):
        shown.controller.modify(lambda campaign, name=name: campaign.skip(name))
    settle(shown)
    stage.press(Qt.Key.Key_F5)
    until(lambda: stage.session.runs, "for the run")
    assert stage.session.runs == [(SineDwell(frequencies_hz=(100.0,), record_s=0.2), tmp_path, "T7")]
    assert stage.session.prepared == [(FREE,)]
    stage.happen(*LIVE)
    shown.board.item_list.select_item("last")
    stage.press(Qt.Key.Key_S)
    assert not on_disk(tmp_path)["last"]["skipped"]
    stage.happen(*STOPPED)
    settle(shown)
    stage.press(Qt.Key.Key_F5, SHIFT)
    until(lambda: len(stage.session.runs) == 2, "for the chosen one")
    assert stage.session.runs[1][0] == WiringCheck()


@pytest.mark.deep
def test_a_campaign_is_begun_by_a_name_and_comes_back_at_the_next_start(
    open_stage: OpenStage, tmp_path: Path, settings: QSettings
) -> None:
    stage = open_stage()
    stage.press(Qt.Key.Key_2, CTRL)
    first = stage.window.tabs.campaign
    until(first.start_pane.specimen_edit.hasFocus, "for the line to type in")
    QTest.keyClick(first.start_pane.specimen_edit, Qt.Key.Key_Return)
    settle(first)
    assert list(on_disk(tmp_path)) == [item.name for item in PAPER_ITEMS]
    stage.window.close_session(force=True)
    until(lambda: not stage.window.isVisible(), "for the window to close")
    again = open_stage().window.tabs.campaign
    settle(again)
    assert again.controller.summary.path == campaign_path(tmp_path, "T7")
    assert again.controller.summary.next_item.state.next_action is NextAction.RUN
    assert again.controller.summary.items[1].state.status is ItemStatus.WAITING


@pytest.mark.deep
def test_a_simulated_run_is_never_made_for_a_real_specimen(page: tuple[Stage, CampaignPage], tmp_path: Path) -> None:
    stage, shown = page
    Campaign.create(tmp_path, "R1", False, QUICK)
    shown.open(campaign_path(tmp_path, "R1"))
    until(lambda: shown.controller.summary is not None and shown.controller.summary.specimen == "R1")
    stage.happen(OPENED)
    settle(shown)
    assert not find(shown, "campaign.simulated").isVisible(), "the campaign is real, whatever bench is open"
    assert not find(shown, "campaign.step.run").isEnabled()
    assert "the campaign is real, the open bench is simulated" in find(shown, "campaign.step.run").toolTip()
    stage.press(Qt.Key.Key_F5)
    settle(shown)
    assert stage.session.runs == []
    assert "the campaign of R1 is of a real bench" in find(shown, "campaign.message").text()


@pytest.mark.deep
def test_a_simulated_campaign_is_marked_on_a_real_bench(page: tuple[Stage, CampaignPage]) -> None:
    stage, shown = page
    stage.happen(OPENED)
    settle(shown)
    stage.window.controller.state = replace(stage.window.state, simulated=False)
    stage.window.controller.changed.emit()
    assert find(shown, "campaign.simulated").isVisible()
    assert not find(shown, "campaign.step.run").isEnabled()


@pytest.mark.deep
def test_a_result_is_reviewed_beside_what_it_is_compared_with(window: MainWindow, tmp_path: Path) -> None:
    press(window, Qt.Key.Key_2, CTRL)
    page = window.tabs.campaign
    settle(page)
    details, decision = page.board.details, page.board.decision
    assert details.stack.currentWidget() is details.details_area, "nothing is measured yet"

    def measure() -> None:
        press(window, Qt.Key.Key_F5)
        until(lambda: window.state.busy, "for a run")
        until(lambda: not window.state.busy, "for its end")
        settle(page)

    def compared() -> str:
        document = QTextDocument()
        document.setHtml(decision.compared_label.text())
        return document.toPlainText()

    measure()
    until(compared, "for the review")
    first = details.reviewed_path
    assert details.stack.currentWidget() is details.plots
    assert "Static gain above rest\n142.73 µm/V (" in compared()
    assert "✓ 4 of 4 points usable, ✓ 13 of 13 checks passed" in decision.quality_label.text()
    assert "Rest, read back" in decision.card.checks_label.text()
    assert details.plots.chart.layer(details.plots.kind.title).x.size == 4
    assert "Good" in find(decision, "review.verdict").text(), "the same card as on the other pages"
    assert find(decision, "review.simulated").isVisibleTo(decision)
    accept = decision.buttons["accept"]
    assert accept.isVisible()
    assert not decision.buttons["run"].isVisible(), "one decision at a time"
    asked: list[str] = []
    decision.card.requested.connect(lambda action, _: asked.append(action))
    window.tabs.results._report_job.start = lambda *_: None  # type: ignore[method-assign]
    find(decision, "review.report").click()
    assert asked == ["report"]
    QTest.keyClick(page.board.item_list, Qt.Key.Key_A)
    settle(page)
    assert states(page)[0] == "done, accepted"

    page.board.item_list.select_item("wiring")
    QTest.keyClick(page.board.item_list, Qt.Key.Key_M)
    settle(page)
    assert "wiring is to be measured again" in window.status_line.label.text()
    assert page.controller.summary.item("wiring").state.run == first, "what counted before still counts"
    height = page.board.item_list.y()
    page.board.item_list.select_item("wiring")
    press(window, Qt.Key.Key_F5, SHIFT)
    until(lambda: window.state.busy, "for a run")
    until(lambda: not window.state.busy, "for its end")
    settle(page)
    assert states(page)[0] == "new result, to be accepted"
    until(lambda: details.reviewed_path != first and "Before" in compared(), "for the review of the new run")
    settle(page)
    assert page.board.item_list.y() == height, "the layout does not move"
    change = compared().partition("Before, and the change")[2].partition("Static gain above rest\n")[2]
    assert change.partition("\n")[0].endswith("%)"), "the change since the result before"
    assert details.run_box.count() == 2
    details.run_box.setCurrentIndex(1)
    details.run_box.activated.emit(1)
    assert details.reviewed_path == first
    assert not accept.isEnabled(), "the first is accepted already"
    details.run_box.setCurrentIndex(0)
    details.run_box.activated.emit(0)
    settle(page)
    accept.click()
    settle(page)
    assert states(page)[0] == "done, accepted"
    assert page.controller.summary.item("wiring").state.run != first
    window.status_line.undo_button.click()
    settle(page)
    assert page.controller.summary.item("wiring").state.run == first
