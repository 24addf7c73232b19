"""Specimen page: the sheet is read, edited, saved and undone; every page with a specimen leads to it."""

from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLineEdit, QWidget

from app.gui.shell.page_host import CAMPAIGN, EXPLORE, MEASURE
from app.gui.specimen.page import SpecimenPage
from app.identification.sheet_file import create_sheet, edit_sheet, load_sheet
from app.identification.specimen_sheet import SheetEntry, SpecimenSheet
from protocols.runfile.mountings import read_mountings
from tests.helpers.main_window import OpenStage, Stage, find, until
from tests.helpers.messages import assert_names

pytestmark = pytest.mark.deep


def opened(stage: Stage) -> SpecimenPage:
    """Open the sheet by its key and wait for it."""
    stage.press(Qt.Key.Key_F7)
    page = stage.window.central.specimen_page
    until(lambda: page.isVisible() and not page._worker.pending, "for the sheet")
    return page


def enter(page: SpecimenPage, name: str, field: str, text: str) -> None:
    """Type into a field, leave it, and wait for what is written."""
    edit = find(page, f"sheet.{name}.{field}")
    edit.setText(text)
    edit.editingFinished.emit()
    until(lambda: not page._worker.pending, "for the file")


def test_a_specimen_without_a_sheet_gets_one_by_typing(open_stage: OpenStage, tmp_path: Path) -> None:
    stage = open_stage()
    page = opened(stage)
    assert page.source_label.text().casefold().startswith(SpecimenSheet().description.casefold())
    assert page.make_sheet_button.isVisible()
    assert find(page, "sheet.L.value").placeholderText() == "22"
    assert find(page, "sheet.L.instrument").placeholderText() == "Table I: ruler"
    enter(page, "L", "value", "22.1")
    sheet = load_sheet(tmp_path, "T7")
    assert (sheet.entries["L"].value, sheet.entries["L"].uncertainty) == pytest.approx((22.1e-3, 0.3e-3))
    assert sheet.entries["L"].date
    assert not page.make_sheet_button.isVisible()
    assert find(page, "sheet.L.note").text() == "the instrument is missing"
    enter(page, "L", "value", "22,1")
    assert "decimal point" in find(page, "sheet.L.note").text()
    assert load_sheet(tmp_path, "T7") == sheet  # what is at fault is not written
    enter(page, "L", "value", "22.3 mm")
    assert load_sheet(tmp_path, "T7").entries["L"].value == pytest.approx(22.3e-3)
    for _ in range(3):
        page.undo()
    until(lambda: not page._worker.pending, "for the file")
    assert load_sheet(tmp_path, "T7").entries == {}
    page.redo()
    until(lambda: not page._worker.pending, "for the file")
    assert load_sheet(tmp_path, "T7").entries["L"].value == pytest.approx(22.1e-3)


def test_a_sheet_is_made_from_table_one_and_read_again_if_another_program_changes_it(
    open_stage: OpenStage, tmp_path: Path
) -> None:
    page = opened(open_stage())
    page.make_sheet_button.click()
    until(lambda: not page._worker.pending, "for the file")
    sheet = load_sheet(tmp_path, "T7")
    assert sheet.path is not None
    assert not page.make_sheet_button.isVisible()
    edit_sheet(sheet.path, {"L2": SheetEntry("L2", 15.1e-3, 0.1e-3, "caliper", "2026-11-20")}, {})
    enter(page, "L", "value", "22.1")
    assert_names(page.message_label.text(), sheet.path.name, "changed")
    assert find(page, "sheet.L2.value").text() == "15.1"
    assert set(load_sheet(tmp_path, "T7").entries) == {"L2"}
    enter(page, "L", "value", "22.1")
    assert set(load_sheet(tmp_path, "T7").entries) == {"L", "L2"}


def test_one_click_records_that_the_plate_was_clamped_anew(open_stage: OpenStage, tmp_path: Path) -> None:
    page = opened(open_stage())
    page.mount_buttons["plate"].click()
    until(lambda: not page._worker.pending, "for the file")
    (mounting,) = read_mountings(tmp_path, "T7")
    assert mounting.part == "plate"
    assert_names(page.message_label.text(), "T7.mountings.json")


def test_every_field_has_a_name_for_a_screen_reader_and_is_reached_by_tab(open_stage: OpenStage) -> None:
    page = opened(open_stage())
    edits = page.form.findChildren(QLineEdit)
    assert len(edits) > 50
    assert all(edit.accessibleName() for edit in edits)
    assert len({edit.accessibleName() for edit in edits}) == len(edits)
    reached, at = set[QWidget](), page.nextInFocusChain()
    while at is not page and at not in reached:
        reached.add(at)
        at = at.nextInFocusChain()
    assert reached >= set(edits)


def test_the_form_fits_a_small_window_in_both_themes(open_stage: OpenStage) -> None:
    stage = open_stage()
    page = opened(stage)
    for appearance in ("light", "dark"):
        stage.window.look.set_appearance(appearance)
        stage.window.resize(900, 470)
        until(lambda: stage.window.width() == 900, "for the size")
        assert page._area.horizontalScrollBar().maximum() == 0
        assert page.form.width() <= page._area.viewport().width()


def test_measure_explore_and_campaign_say_whether_there_is_a_sheet_and_open_it(
    open_stage: OpenStage, tmp_path: Path
) -> None:
    stage = open_stage()
    tabs = stage.window.tabs
    tabs.sheets.start()
    for index, name in ((MEASURE, "measure"), (EXPLORE, "explore"), (CAMPAIGN, "campaign")):
        tabs.select_page(index)
        page = tabs.page(index)
        assert isinstance(page, QWidget)
        button = find(page, f"{name}.sheet")
        until(lambda button=button: button.text() == "No sheet …", "for the sheet")
        assert SpecimenSheet().description.casefold() in button.toolTip().casefold()
    create_sheet(tmp_path, "T7")
    tabs.select_page(MEASURE)
    button = find(tabs.measure, "measure.sheet")
    until(lambda: button.text() == "Sheet …", "for the sheet")
    button.click()
    assert stage.window.central.specimen_page.isVisible()
    stage.press(Qt.Key.Key_Escape)
    assert not stage.window.central.is_covered
