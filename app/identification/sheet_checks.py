"""Questions about a specimen sheet: implausible sizes, uncertainties and dates, and missing values."""

from collections.abc import Iterator
from datetime import UTC, datetime

from app.identification.specimen_sheet import SheetEntry, SpecimenSheet, sheet_unit
from app.identification.table_one import TABLE_ONE, USUAL_RANGES
from model.identification import parameter_spec

FAR_FROM_TABLE = 0.5
"""Relative difference from Table I that is questioned: another tactor, or another unit."""
LARGE_UNCERTAINTY = 0.3
"""Relative uncertainty that is questioned."""


def question_entry(entry: SheetEntry) -> Iterator[str]:
    """Yield the implausible and missing facts of one value of a sheet."""
    name, value = entry.name, entry.value
    factor, unit = sheet_unit(name)
    low, high = USUAL_RANGES.get(name, (0.0, float("inf")))
    table_value = float(parameter_spec(name).default or 0.0)
    if value and not low <= abs(value) <= high:
        yield f"{name} is {factor * value:.4g} {unit}, usually {factor * low:g} to {factor * high:g} {unit}: is the unit right?"
    elif name in TABLE_ONE and table_value and abs(value / table_value - 1) > FAR_FROM_TABLE:
        yield f"{name} is {factor * value:.4g} {unit}, the paper's is {factor * table_value:.4g} {unit}: is it right?"
    if value and entry.uncertainty > LARGE_UNCERTAINTY * abs(value):
        yield f"{name}: the uncertainty is {100 * entry.uncertainty / abs(value):.0f} % of the value: is its unit right?"
    if not entry.instrument:
        yield f"{name}: the instrument is missing"
    if not entry.date:
        yield f"{name}: the date is missing"
    elif entry.date > datetime.now(UTC).date().isoformat():
        yield f"{name}: the date {entry.date} is in the future"


def question_sheet(sheet: SpecimenSheet) -> Iterator[str]:
    """Yield the implausible facts of a sheet: sizes, uncertainties, dates, and a missing photograph."""
    for entry in sheet.entries.values():
        yield from question_entry(entry)
    if sheet.photograph and sheet.path and not (sheet.path.parent / sheet.photograph).exists():
        yield f"there is no photograph {sheet.path.parent / sheet.photograph}"
    if sheet.missing:
        yield f"not measured, so Table I is used: {', '.join(sheet.missing)}"
