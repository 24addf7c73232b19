"""Identification page: parameters, budget and held values; the likeliest cause is freed; doubtful results need a reason."""

import re
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt

from app.gui.specimen.identification_page import IdentificationPage, IdentificationSubject
from app.identification import calibrations
from app.identification.result_text import ADEQUACY_TEXT
from app.identification.specimen_sheet import SpecimenSheet
from tests.helpers.importing import brought
from tests.helpers.laboratory import Laboratory, measure
from tests.helpers.main_window import OpenStage, Stage, find, until
from tests.helpers.messages import assert_names

pytestmark = pytest.mark.deep

REASON = "only the compliance is needed for the mount"


def table(path: Path, head: str, *columns: Any) -> Path:
    """Write columns as a table."""
    lines = (",".join(f"{value:.8g}" for value in row) for row in zip(*columns, strict=True))
    path.write_text("\n".join((head, *lines, "")))
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folder of T7's runs: loads, and nine added masses of which 70 % act."""
    found: Any = measure(Laboratory(mass_fraction=7.73 / 11), 3, small=True).runs
    loading, _, masses, *_ = found
    force = (loading.load_n, 1e6 * loading.deflection_m, 1e6 * loading.errors_m)
    peaks = (1e3 * masses.mass_kg, masses.frequency_hz, masses.errors_hz)
    brought(table(tmp_path / "s.csv", "load [N],deflection [um],u_deflection [um]", *force), "--specimen", "T7")
    head = "mass [g],frequency [Hz],u_frequency [Hz]"
    return brought(table(tmp_path / "m.csv", head, *peaks), "--specimen", "T7").parent


def identified(stage: Stage, folder: Path) -> IdentificationPage:
    """Open the identification of T7 and wait for its fit."""
    page = stage.window.central.identification_page
    stage.window.central.show_identification(IdentificationSubject(folder, "T7"))
    until(lambda: page.result is not None and not page._worker.pending, "for the fit")
    return page


def fit_plain(page: IdentificationPage) -> None:
    """Fit the beam model alone."""
    find(page, "identification.plain").click()
    until(lambda: page.result is not None and not page._worker.pending, "for the fit of the beam model alone")


def test_where_no_specimen_is_named_those_with_results_are_offered(
    open_stage: OpenStage, folder: Path, tmp_path: Path
) -> None:
    page = open_stage(folder=folder).window.central.identification_page
    page.show_subject(IdentificationSubject(tmp_path / "empty", ""))
    until(lambda: "measure a specimen first" in page.message_label.text(), "for the empty folder")
    assert page.specimens.isHidden()
    page.show_subject(IdentificationSubject(folder, ""))
    until(lambda: not page.specimens.isHidden(), "for the specimens")
    assert not find(page, "identification.fit").isVisibleTo(page), "nothing is chosen"
    assert find(page, "identification.specimen.T7").text() == "T7, 2 runs"
    find(page, "identification.specimen.T7").click()
    assert page.subject.specimen == "T7"
    assert page.specimens.isHidden()
    until(lambda: page.result is not None and not page._worker.pending, "for the fit")


def test_the_mass_fraction_is_proposed_first_and_the_fit_with_it_is_accepted(
    open_stage: OpenStage, folder: Path
) -> None:
    stage = open_stage(folder=folder)
    page = identified(stage, folder)
    assert page.verdict_label.text() == "ADEQUATE"
    assert "beyond the beam model: the masses put in the cylinder act as 7" in page.text_label.text().replace("B", "b")
    fit_plain(page)
    assert page.verdict_label.text() == ADEQUACY_TEXT[False]
    assert "act as 7" in page.finding_label.text()
    lines = page.text_label.text().split("\n")
    assert_names(lines[0], "Assumed", "c0")
    assert lines[1].casefold().startswith(SpecimenSheet().description.casefold())
    assert lines[2].startswith("Held as exact")
    assert "m_add 7.73 g" in lines[2]
    page.accept_button.click()
    assert "write why the result is to be used all the same" in page.accept_message.text()
    assert calibrations.read_calibrations(folder, "T7").versions == ()
    without = page.result.joint_fit.chi_square
    find(page, "identification.also.mass_fraction").click()
    until(lambda: page.result is not None and not page._worker.pending, "for the fit with it")
    assert page.verdict_label.text() == "ADEQUATE"
    assert page.result.joint_fit.chi_square < without
    names = [page.table.item(at, 0).text() for at in range(page.table.rowCount())]
    assert {"k2", "mass_fraction"} <= set(names)
    assert {bar.name for bar in page.budget_plot.bars} == set(names)
    for bar in page.budget_plot.bars:
        assert sum(share for _, share in bar.shares) == pytest.approx(1)
    assert "k2: " in page.budget_plot.accessibleDescription()
    assert page.reason_edit.isHidden()
    page.accept_button.click()
    until(page.accept_message.text, "for the calibration")
    assert "Accepted as version 1 of T7, now active" in page.accept_message.text()
    assert "mass_fraction" in {e.name for e in calibrations.read_calibrations(folder, "T7").get().estimates}


def test_a_doubtful_result_is_accepted_with_a_written_reason_only(open_stage: OpenStage, folder: Path) -> None:
    page = identified(open_stage(folder=folder), folder)
    fit_plain(page)
    page.reason_edit.setText(REASON)
    page.by_edit.setText("K. Tanaka")
    page.accept_button.click()
    until(page.accept_message.text, "for the calibration")
    accepted = calibrations.read_calibrations(folder, "T7").get()
    assert (accepted.reason, accepted.accepted_by) == (REASON, "K. Tanaka")
    assert accepted.doubt.startswith(ADEQUACY_TEXT[False])


def test_runs_are_chosen_and_a_specimen_without_any_says_so(open_stage: OpenStage, folder: Path) -> None:
    stage = open_stage(folder=folder)
    page = identified(stage, folder)
    assert re.findall(r"\d+", page.runs_button.text()) == ["2", "2"]
    item = page.run_list.item(0)
    item.setCheckState(Qt.CheckState.Unchecked)
    assert re.findall(r"\d+", page.runs_button.text()) == ["1", "2"]
    page.identify_button.click()
    until(lambda: page.result is not None and not page._worker.pending, "for the fit")
    assert len(page.result.observations.runs) == 1
    stage.window.central.show_pages()
    stage.press(Qt.Key.Key_F7)
    sheet = stage.window.central.specimen_page
    until(lambda: sheet.isVisible() and not sheet._worker.pending, "for the sheet")
    edit = find(sheet, "sheet.L.value")
    edit.setText("22.1")
    edit.editingFinished.emit()
    until(lambda: not sheet._worker.pending, "for the file")
    stage.window.central.show_pages()
    stage.press(Qt.Key.Key_F7, Qt.KeyboardModifier.ShiftModifier)
    until(lambda: "T7.specimen.toml: 1 measured value" in page.text_label.text(), "for the fit with the sheet")
    until(lambda: not page._worker.pending, "for the end of the fit")
    stage.window.tabs.measure.run_panel.specimen_edit.setText("T9")
    stage.window.central.show_pages()
    stage.press(Qt.Key.Key_F7, Qt.KeyboardModifier.ShiftModifier)
    until(lambda: not page._worker.pending, "for the runs")
    assert page.message_label.text().startswith("There is no run of T9 with a result")
    assert page._content.isHidden()
