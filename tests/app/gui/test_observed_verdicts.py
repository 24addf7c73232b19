"""Faults of the setup as an operator observes them: terminal, window, list and report name the verdict and its cause."""

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from app.cli.main import main
from app.common.text_table import Table
from app.gui.runs.run_table import COLUMNS
from app.gui.shell.page_host import RUNS
from app.report.content import build_report
from app.report.document import Paragraph
from protocols.base import Outcome, RunEnded, RunStarted
from protocols.registry import PROTOCOLS
from protocols.runfile.reader import Run
from tests.helpers.main_window import Stage, find, until
from tests.helpers.report_specimen import blocks_of
from tests.helpers.session_events import AT_REST, OPENED

HEADERS = {
    Outcome.DOUBTFUL: "△ doubtful",
    Outcome.NO_RESULT: "○ no result",
    Outcome.DID_NOT_PASS: "⊘ did not pass",
}
EXIT_CODES = {Outcome.DOUBTFUL: 0, Outcome.NO_RESULT: 4, Outcome.DID_NOT_PASS: 1}


@dataclass(frozen=True)
class Case:
    fault: str
    outcome: Outcome
    cause: str
    """What every place must say, beside the outcome."""
    command: tuple[str, ...]


CASES = {
    "a wiring check with a stuck laser": Case(
        "sensor-stuck", Outcome.DID_NOT_PASS, "check the sensor's distance and wiring", ("check",)
    ),
    "a dwell with the laser lost": Case(
        "sensor-out-of-range",
        Outcome.NO_RESULT,
        "laser",
        ("run", "sine-dwell", "--set", "frequencies_hz=100,150,160,170,200", "--set", "record_s=0.1"),
    ),
    "a dwell with the membrane left on": Case(
        "membrane-left-on",
        Outcome.DOUBTFUL,
        "make sure that no membrane and nothing else touches the tactor",
        ("run", "sine-dwell", "--set", "frequencies_hz=140,160", "--set", "record_s=0.1"),
    ),
    "a sweep with the membrane left on": Case(
        "membrane-left-on",
        Outcome.NO_RESULT,
        "make sure that no membrane and nothing else touches the tactor",
        ("run", "sweep", "--set", "start_hz=80", "--set", "stop_hz=300"),
    ),
    "a mass resonance with a 50 g weight of 61 g": Case(
        "weight-mislabelled",
        Outcome.DOUBTFUL,
        "added mass of 50 g, by the line through the others: 61 g",
        ("run", "mass-resonance", "--set", "masses_kg=0.02,0.03,0.04,0.05,0.06", "--set", "start_hz=20", "--set",
         "stop_hz=220", "--set", "low_hz=35", "--set", "high_hz=200", "--set", "sweep_s=20", "--set",
         "sample_rate_hz=1000", "--set", "peak_to_peak_v=2"),
    ),
    "a membrane sag without a membrane": Case(
        "membrane-missing",
        Outcome.NO_RESULT,
        "make sure that the membrane is clamped under the sensor",
        ("run", "membrane-sag", "--set", "repeats=2", "--set", "settle_s=1", "--set", "sample_rate_hz=1000"),
    ),
}  # fmt: skip


def plain(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.deep
@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_a_fault_of_the_setup_is_named_in_terminal_window_list_and_report(
    case: Case, stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path
    words = [
        "--bench",
        "ideal",
        *case.command,
        "--fault",
        case.fault,
        "--speed",
        "max",
        "--out",
        str(folder),
        "--specimen",
        "T1",
    ]
    assert main(words) == EXIT_CODES[case.outcome]
    terminal = plain("".join(capsys.readouterr()))
    assert case.outcome in terminal.casefold()
    assert case.cause in terminal
    assert "completed: all points measured" not in terminal
    (path,) = folder.glob("*.h5")

    assert main(["runs", str(folder)]) == 0
    assert case.outcome in plain(capsys.readouterr().out)
    assert main(["runs", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)
    assert main(["show", str(path)]) == 0
    assert case.cause in plain(capsys.readouterr().out)

    report, _, _ = build_report(folder, "T1")
    said = [block.text for block in blocks_of(report, Paragraph)]
    said += [cell for table in blocks_of(report, Table) for row in table.rows for cell in row]
    assert case.outcome in plain(" ".join(said))
    assert case.cause in plain(" ".join(said))

    with Run(path) as run:
        verdict, protocol, status, reason = (
            run.record.verdict,
            run.record.protocol,
            run.record.status,
            run.record.reason,
        )
        parameters = PROTOCOLS[protocol].model_validate(run.record.parameters)
    assert verdict.outcome is case.outcome
    stage.window.measure_page.run_panel.set_protocol(parameters)
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(RunStarted(protocol, str(path), 6.0, 2, True), AT_REST)
    stage.happen(RunEnded(status, reason, str(path), (), verdict))
    assert stage.window.strip.view.run.note.startswith(HEADERS[case.outcome])
    assert stage.window.grab().save(str(tmp_path / "live.png"))
    stage.window.tabs.setCurrentIndex(RUNS)
    page = stage.window.tabs.runs
    until(lambda: page.list.model.rowCount() == 1, "for the run")
    assert case.outcome in page.list.model.index(0, COLUMNS.index("verdict")).data().casefold()
    page.open_selected()
    until(lambda: page.viewer.run is not None, "for the run's plots")
    assert case.cause in find(page, "run.card.reason").text()
    assert stage.window.grab().save(str(tmp_path / "runs.png"))
