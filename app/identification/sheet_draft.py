"""Specimen sheet as it is typed in a form: texts in bench units, checked and written to the file."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime
from pathlib import Path

from app.common import UnitError, to_number, truncate_text
from app.identification.sheet_checks import question_entry
from app.identification.sheet_file import TEXTS, SheetError, create_sheet, edit_sheet, load_sheet
from app.identification.specimen_sheet import (
    DIMENSIONS,
    GROUPS,
    SheetEntry,
    SpecimenSheet,
    Weighing,
    sheet_unit,
    table_one_entry,
)
from model import ParameterError
from model.identification import parameter_spec


class SheetChangedError(SheetError):
    """The file of a sheet was changed by another program after it was read."""


ENTRY_FIELDS = ("value", "uncertainty", "instrument", "date")


@dataclass(frozen=True, slots=True)
class EntryText:
    """One value of a sheet as it is typed; numbers without a unit are in the unit of `sheet_unit`.

    A linear density may be typed as it was weighed: `0.588 g / 52 mm`, with the uncertainty `0.01 g / 0.3 mm`.
    """

    value: str = ""
    uncertainty: str = ""
    instrument: str = ""
    date: str = ""

    @property
    def empty(self) -> bool:
        """Whether nothing is typed, so that Table I is used."""
        return not any(getattr(self, name).strip() for name in ENTRY_FIELDS)


@dataclass(frozen=True)
class SheetDraft:
    """All texts of a form."""

    entries: Mapping[str, EntryText] = field(default_factory=dict)
    """Texts by parameter; empty for missing ones."""
    texts: Mapping[str, str] = field(default_factory=dict)
    """Serial number, photograph and notes."""
    descriptions: Mapping[str, str] = field(default_factory=dict)
    """By group."""

    @classmethod
    def of(cls, sheet: SpecimenSheet) -> "SheetDraft":
        """Return the texts of a sheet."""
        return cls(
            {name: _entry_text(entry) for name, entry in sheet.entries.items()},
            {name: getattr(sheet, name) for name in TEXTS},
            {group: sheet.descriptions.get(group, "") for group in GROUPS},
        )

    def with_entry(self, name: str, entry: EntryText) -> "SheetDraft":
        """Return the draft with other texts of one value."""
        return replace(self, entries={**self.entries, name: entry})


@dataclass(frozen=True)
class CheckedDraft:
    """A draft that was read: values, and a message for each field at fault."""

    entries: Mapping[str, SheetEntry]
    faults: Mapping[str, tuple[str, str]]
    """By parameter: the field at fault, and the message."""
    questions: Mapping[str, str]
    """Implausible and missing facts by parameter."""


def check_draft(draft: SheetDraft, specimen: str = "") -> CheckedDraft:
    """Read the texts of a draft."""
    entries: dict[str, SheetEntry] = {}
    faults: dict[str, tuple[str, str]] = {}
    for name, text in draft.entries.items():
        if text.empty:
            continue
        try:
            entries[name] = _read_entry(name, text)
        except _FieldError as error:
            faults[name] = (error.field, str(error))
    sheet = SpecimenSheet(specimen, {name: each for name, each in entries.items() if name not in faults})
    try:
        sheet.tactor, sheet.membrane  # noqa: B018 - raises for lengths in the wrong order
    except ParameterError as error:
        parts = str(error).replace(",", " ").replace(":", " ").split()
        name = next((word for word in parts if word in draft.entries and not draft.entries[word].empty), "")
        if name:
            faults.setdefault(name, ("value", _in_millimetres(error)))
    questions = {
        name: "; ".join(text.removeprefix(f"{name}: ") for text in question_entry(e)) for name, e in entries.items()
    }
    return CheckedDraft(entries, faults, {name: text for name, text in questions.items() if text})


def save_draft(folder: Path, base: SpecimenSheet, draft: SheetDraft) -> SpecimenSheet:
    """Write the differences between a draft and its original sheet, and return the sheet; invalid values are not written.

    Raises:
        SheetChangedError: the file has changed since it was read.
        SheetError: the file cannot be read or written.
    """
    now = load_sheet(folder, base.specimen)
    if now != base:
        raise SheetChangedError(
            f"{now.path or base.path} was changed by another program: the form shows its present values; enter the last value again"
        )
    before, checked = SheetDraft.of(base), check_draft(draft, base.specimen)
    changed = {
        name
        for name in draft.entries.keys() | before.entries.keys()
        if draft.entries.get(name, EntryText()) != before.entries.get(name, EntryText()) and name not in checked.faults
    }
    texts = {name: text for name, text in draft.texts.items() if text != before.texts[name]}
    descriptions = {name: text for name, text in draft.descriptions.items() if text != before.descriptions[name]}
    if not (changed or texts or descriptions):
        return base
    if base.path is None:
        base = create_sheet(folder, base.specimen)
    assert base.path is not None
    removed = {name for name in changed if name not in checked.entries}
    entries = {name: checked.entries[name] for name in changed - removed}
    return edit_sheet(base.path, entries, texts, removed, descriptions)


def today() -> str:
    """Return the day, ISO 8601."""
    return datetime.now(UTC).date().isoformat()


class _FieldError(ValueError):
    def __init__(self, field: str, message: str) -> None:
        super().__init__(message)
        self.field = field


def _read_entry(name: str, text: EntryText) -> SheetEntry:
    spec, weighed = parameter_spec(name), None
    if not text.value.strip():
        raise _FieldError("value", "give the value; the other fields are stored with it")
    stated = text.uncertainty.strip()
    if "/" in text.value and spec.unit == "kg/m" and (parts := text.value.split("/"))[1].strip().endswith("m"):
        weighed = _read_weighing(parts, stated)
        value, uncertainty = weighed.density
    else:
        value = _number(name, "value", text.value)
        if not stated:
            if name not in DIMENSIONS:
                raise _FieldError("uncertainty", "give its standard uncertainty, or a share such as 1 %")
            uncertainty = table_one_entry(name).uncertainty
        elif stated.endswith("%"):
            uncertainty = abs(value) * _quantity(stated.removesuffix("%"), "1", "uncertainty") / 100
        else:
            uncertainty = _number(name, "uncertainty", stated)
    try:
        spec.check(value)
    except ParameterError as error:
        raise _FieldError("value", _in_millimetres(error)) from None
    if not 0 < uncertainty < float("inf"):
        raise _FieldError("uncertainty", "the uncertainty must be greater than 0: no instrument is exact")
    day = text.date.strip()
    try:
        day = date.fromisoformat(day).isoformat() if day else ""
    except ValueError:
        raise _FieldError("date", f"{day} is not a day: write it as 2026-11-20") from None
    return SheetEntry(name, value, uncertainty, text.instrument.strip(), day, weighed=weighed)


def _read_weighing(parts: list[str], stated: str) -> Weighing:
    errors = stated.split("/")
    if len(parts) != 2 or len(errors) != 2:
        raise _FieldError(
            "uncertainty", "give the uncertainties of mass and length as well, for example 0.01 g / 0.3 mm"
        )
    numbers = [
        _quantity(text, unit, field)
        for field, texts in (("value", parts), ("uncertainty", errors))
        for text, unit in zip(texts, ("g", "mm"), strict=True)
    ]
    if not all(number > 0 for number in numbers):
        raise _FieldError("value", "mass, length and their uncertainties must be greater than 0")
    mass, length, u_mass, u_length = (1e-3 * number for number in numbers)
    return Weighing(mass, u_mass, length, u_length)


def _in_millimetres(error: ParameterError) -> str:
    """Return a message of the model with its lengths as the form shows them."""
    return re.sub(r"(-?[\d.]+(?:e[-+]?\d+)?) m\b", lambda match: f"{1e3 * float(match[1]):.6g} mm", str(error))


def _number(name: str, field: str, text: str) -> float:
    """Return a number in SI; a number without a unit is in the unit of the sheet."""
    factor, unit = sheet_unit(name)
    return _quantity(text, unit or "1", field) / factor


def _quantity(text: str, unit: str, field: str) -> float:
    stated, shown = text.strip(), "" if unit == "1" else f" {unit}"
    try:
        return to_number(stated, unit)
    except UnitError:
        remedy = (
            f"write a decimal point: {stated.replace(',', '.')}" if "," in stated else f"write for example 1.5{shown}"
        )
        raise _FieldError(field, f"'{truncate_text(stated)}' is no number{shown and ' in'}{shown}; {remedy}") from None


def _entry_text(entry: SheetEntry) -> EntryText:
    factor, _ = sheet_unit(entry.name)
    value, uncertainty = f"{factor * entry.value:.9g}", f"{factor * entry.uncertainty:.9g}"
    if (weighed := entry.weighed) is not None:
        value = f"{1e3 * weighed.mass:.9g} g / {1e3 * weighed.length:.9g} mm"
        uncertainty = f"{1e3 * weighed.mass_uncertainty:.9g} g / {1e3 * weighed.length_uncertainty:.9g} mm"
    return EntryText(value, uncertainty, entry.instrument, entry.date)
