"""Specimen sheets as they are typed in a form: texts are read, checked, and written to the file."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from app.identification.sheet_draft import EntryText, SheetChangedError, SheetDraft, check_draft, save_draft
from app.identification.sheet_file import create_sheet, edit_sheet, load_sheet
from app.identification.specimen_sheet import SheetEntry, SpecimenSheet

LENGTH = EntryText("22.1", "0.05", "caliper 150 mm", "2026-11-20")
WEIGHED = EntryText("0.588 g / 52 mm", "0.01 g / 0.3 mm", "scale", "2026-11-20")


def test_numbers_are_in_bench_units_unless_another_is_typed() -> None:
    checked = check_draft(
        SheetDraft({"L": LENGTH, "h_Al": replace(LENGTH, value="203 um", uncertainty="1 %"), "rho1": WEIGHED})
    )
    assert (checked.faults, checked.questions) == ({}, {})
    found = {name: (entry.value, entry.uncertainty) for name, entry in checked.entries.items()}
    assert found["L"] == pytest.approx((22.1e-3, 0.05e-3))
    assert found["h_Al"] == pytest.approx((203e-6, 2.03e-6))
    density = 0.588 / 52
    assert found["rho1"] == pytest.approx((density, density * ((0.01 / 0.588) ** 2 + (0.3 / 52) ** 2) ** 0.5))


def test_a_value_without_an_uncertainty_has_that_of_the_instrument_of_table_one() -> None:
    checked = check_draft(SheetDraft({"L": EntryText("22.1")}))
    assert checked.entries["L"].uncertainty == 0.3e-3
    assert checked.questions["L"] == "the instrument is missing; the date is missing"


@pytest.mark.parametrize(
    ("name", "text", "field", "says"),
    [
        ("L", replace(LENGTH, value="22,1"), "value", "'22,1' is no number in mm; write a decimal point: 22.1"),
        ("L", replace(LENGTH, value="22 g"), "value", "'22 g' is no number in mm; write for example 1.5 mm"),
        ("L", replace(LENGTH, value="-3"), "value", "mm"),
        ("L", replace(LENGTH, value=""), "value", "give the value"),
        ("L", replace(LENGTH, uncertainty="0"), "uncertainty", "no instrument is exact"),
        ("L", replace(LENGTH, date="20.11.2026"), "date", "write it as 2026-11-20"),
        ("L1", replace(LENGTH, value="30"), "value", "L1 is 30 mm but must be less than L2 = 15 mm"),
        ("mass_offset", replace(LENGTH, uncertainty=""), "uncertainty", "give its standard uncertainty"),
        ("rho1", replace(WEIGHED, uncertainty="0.01 g"), "uncertainty", "of mass and length"),
        ("rho1", replace(WEIGHED, value="0 g / 52 mm"), "value", "greater than 0"),
    ],
)
def test_a_field_at_fault_has_one_sentence(name: str, text: EntryText, field: str, says: str) -> None:
    checked = check_draft(SheetDraft({name: text}))
    assert list(checked.faults) == [name]
    assert checked.faults[name][0] == field
    assert says in checked.faults[name][1]


def test_what_is_typed_is_written_and_read_back(tmp_path: Path) -> None:
    empty = SpecimenSheet("T7")
    assert save_draft(tmp_path, empty, SheetDraft.of(empty)).path is None  # nothing typed, nothing written
    draft = replace(
        SheetDraft.of(empty),
        entries={"L": LENGTH, "rho1": WEIGHED, "L1": EntryText("30", "0.3")},
        texts={"serial": "MFC-042", "photograph": "", "notes": 'cut by "saw"'},
        descriptions={"plate": "EN AW-1050"},
    )
    sheet = save_draft(tmp_path, empty, draft)
    assert sheet == load_sheet(tmp_path, "T7")
    assert set(sheet.entries) == {"L", "rho1"}  # L1 is at fault and stays in the form
    assert (sheet.serial, sheet.notes, sheet.descriptions["plate"]) == ("MFC-042", 'cut by "saw"', "EN AW-1050")
    assert SheetDraft.of(sheet).entries == {"L": LENGTH, "rho1": WEIGHED}
    back = save_draft(tmp_path, sheet, replace(SheetDraft.of(sheet), entries={"rho1": WEIGHED}))
    assert set(back.entries) == {"rho1"}
    assert '#L = { value = "22.1 mm"' in (tmp_path / "T7.specimen.toml").read_text("utf-8")


def test_a_sheet_that_was_changed_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    sheet = create_sheet(tmp_path, "T7")
    assert sheet.path is not None
    edit_sheet(sheet.path, {"L2": SheetEntry("L2", 15.1e-3, 0.1e-3)}, {})
    with pytest.raises(SheetChangedError, match=re.escape(sheet.path.name)):
        save_draft(tmp_path, sheet, SheetDraft.of(sheet).with_entry("L", LENGTH))
    assert set(load_sheet(tmp_path, "T7").entries) == {"L2"}
