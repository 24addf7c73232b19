"""Verdicts in the window: header, notice, log, table of checks, list and viewer of runs."""

from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QRect, Qt
from PySide6.QtWidgets import QWidget

from app.gui.bench_page.page import SIMULATED
from app.gui.face import DARK, LIGHT, tokens
from app.gui.runs.run_table import COLUMNS
from app.gui.shell.page_host import RUNS
from protocols.base import CheckResult, Outcome, RunEnded, RunStarted, RunStatus, Verdict
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.wiring_check import WiringCheck
from tests.helpers.main_window import Stage, find, until
from tests.helpers.run_files import finished_run
from tests.helpers.session_events import AT_REST, LIVE, OPENED

OPTICS = "check the sensor's distance and wiring"
CHECKS = (
    CheckResult("noise floor", 5e-7, "m", None, 5e-6, "check the laser", Outcome.DID_NOT_PASS),
    CheckResult("gain above rest", 3e-8, "m/V", 1e-6, 1e-3, OPTICS, Outcome.DID_NOT_PASS),
)
FAILED_CHECK = Verdict(Outcome.DID_NOT_PASS, (CHECKS[1].text,), CHECKS)
NO_RESULT = Verdict(Outcome.NO_RESULT, ("no usable point of 18 (18 out of range); bring the target into the range",))


def color_in(widget: QWidget, area: QRect, color: str) -> bool:
    """Whether a colour stands in a part of a widget's picture."""
    image = widget.grab(area).toImage()
    return any(image.pixelColor(x, y).name() == color for x in range(image.width()) for y in range(image.height()))


def end_with(stage: Stage, verdict: Verdict, *begin: Any) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*(begin or LIVE), AT_REST, RunEnded(RunStatus.COMPLETED, "all points measured", "run.h5", (), verdict))


@pytest.mark.one_in(100)
@pytest.mark.parametrize(
    ("verdict", "header", "color"),
    [
        (Verdict(Outcome.GOOD), "✓ good", "green_text"),
        (Verdict(Outcome.DOUBTFUL, ("2 of 18 clipped",)), "△ doubtful", "amber_text"),
        (NO_RESULT, "○ no result", "amber_text"),
        (FAILED_CHECK, "⊘ did not pass", "red_text"),
    ],
)
def test_the_header_shows_the_verdict(stage: Stage, verdict: Verdict, header: str, color: str) -> None:
    for theme in (LIGHT, DARK):
        stage.window.look.set_appearance("dark" if theme is DARK else "light")
        end_with(stage, verdict)
        run = stage.window.strip.view.run
        assert (run.title, run.note.split(",")[0]) == (SineDwell.title, header)
        strip = stage.window.strip
        note = QRect(664, 27, strip.pause_button.x() - 676, 18)
        assert color_in(strip, note, getattr(theme, color))
        assert "ompleted" not in stage.window.state.messages[-1].text


@pytest.mark.deep
def test_no_usable_point_is_told_with_the_remedy_in_the_status_line_and_on_the_card(stage: Stage) -> None:
    end_with(stage, NO_RESULT)
    line, reason = stage.window.status_line.label, find(stage.window, "result.reason")
    assert line.property("tone") == "attention"
    for told in (line.toolTip(), reason.text()):
        assert "o usable point of 18" in told
        assert "bring the target into the range" in told


def test_a_wiring_check_ends_in_the_table_of_its_checks_with_remedies(stage: Stage) -> None:
    expected = [
        ["✕ FAIL", "Gain above rest", "0.03", "1 … 1000", "µm/V", OPTICS],  # what to remedy comes first
        ["✓ pass", "Noise floor", "0.5", "at most 5", "µm", ""],
    ]
    begin = RunStarted("wiring-check", "run.h5", 6.0, 4, True)
    stage.window.measure_page.run_panel.set_protocol(WiringCheck())
    end_with(stage, FAILED_CHECK, begin)
    plots = stage.window.measure_page.live_pane.plots
    assert plots.currentWidget() is plots.checks
    table = plots.checks.table
    rows = [[table.item(r, c).text() for c in range(table.columnCount())] for r in range(table.rowCount())]
    assert rows == expected
    assert plots.checks.caption.text() == "⊘ 1 of 2 checks did not pass"
    assert "gain above rest" in stage.window.status_line.label.toolTip()
    stage.window.start_run()
    stage.happen(begin)
    assert plots.currentWidget() is not plots.checks, "the next run shows its points"


@pytest.mark.deep
def test_the_runs_page_lists_and_opens_verdicts(stage: Stage, tmp_path: Path) -> None:
    signs = {Outcome.GOOD: "✓", Outcome.NO_RESULT: "○", Outcome.DID_NOT_PASS: "⊘", Outcome.NOT_JUDGED: "–"}
    for outcome in signs:
        reasons = () if outcome is Outcome.GOOD else (f"{outcome}; a remedy",)
        finished_run(tmp_path, outcome.replace(" ", "-"), verdict=Verdict(outcome, reasons))
    stage.window.tabs.setCurrentIndex(RUNS)
    page = stage.window.tabs.runs
    until(lambda: page.list.model.rowCount() == 4, "for the runs")
    at = COLUMNS.index("verdict")
    role = Qt.ItemDataRole.AccessibleTextRole
    shown = {page.list.model.index(r, at).data(role) for r in range(4)}
    assert shown == {f"{sign} {outcome.capitalize()}, SIMULATED" for outcome, sign in signs.items()}
    picture = page.list.table.viewport().grab().toImage()
    band = page.list.table.visualRect(page.list.model.index(2, 0))
    seen = {picture.pixelColor(3, y).name() for y in range(band.top() + 4, band.bottom() - 4)}
    assert {tokens().violet, tokens().violet2} & seen, "the hatch of simulated runs"
    combo = find(page, "runs.verdict")
    combo.setCurrentIndex(combo.findData(Outcome.NO_RESULT.value))
    assert [run.specimen for run in page.list.model.summaries] == ["no-result"]
    page.open_selected()
    until(lambda: page.viewer.run is not None, "for the run")
    assert find(page, "run.card.verdict").text() == f"○ {Outcome.NO_RESULT.capitalize()}"
    assert find(page, "run.card.reason").text() == "No result; a remedy"
    assert find(page, "run.card.simulated").isVisibleTo(page.viewer)


def test_the_bench_page_shows_the_check_of_the_open_bench_alone(stage: Stage) -> None:
    stage.press(Qt.Key.Key_5, Qt.KeyboardModifier.ControlModifier)
    page, begin = stage.window.tabs.bench, RunStarted("wiring-check", "run.h5", 6.0, 4, True)
    until(lambda: page.draft is not None, "for the page")
    table, status = find(page, "bench.check.table"), find(page, "bench.check.status")
    end_with(stage, FAILED_CHECK, begin)
    assert (table.isVisible(), status.text()) == (True, "")
    until(lambda: not page.wiring.table.caption.visibleRegion().isEmpty(), "for the verdict in view")
    end_with(stage, Verdict(Outcome.GOOD))
    assert (table.isVisible(), status.text()) == (True, ""), "a later run is not the check"
    shown, other = page.draft.name, next(name for name, _ in SIMULATED if name != page.draft.name)
    page.show_bench(other)
    until(lambda: page.draft.name == other, "for the other bench")
    assert not table.isVisible()
    stage.window.start_run()
    stage.happen(begin)
    assert status.text() == ""
    page.show_bench(shown)
    until(lambda: page.draft.name == shown, "for the open bench")
    assert status.text(), "it runs"
    assert not table.isVisible()
