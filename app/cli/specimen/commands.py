"""The command `specimen`: sheets with the measured dimensions and masses of specimens."""

from collections.abc import Sequence
from datetime import UTC, date, datetime
from pathlib import Path

from app.cli.options import FOLDER, JSON_OBJECT, CommandGroup, argument, command, option, specimen_argument
from app.cli.output import CommandResult, render
from app.common import (
    Column,
    ExitCode,
    Table,
    UnitError,
    UsageError,
    print_line,
    print_message,
    read_stated,
    usage_errors,
)
from app.identification import (
    SheetEntry,
    SheetError,
    SpecimenSheet,
    create_sheet,
    edit_sheet,
    load_sheet,
    question_sheet,
    sheet_unit,
)
from model import ParameterError, format_with_uncertainty
from model.identification import MOUNTING_EFFECTS, format_size, parameter_spec
from protocols.runfile import sheet_path

TEXT_FIELDS = ("serial", "batch", "photograph", "notes")


@command("T7")
class ShowSheetCommand:
    """Show the prior values for the fits of a specimen."""

    specimen: str = argument()
    folder: Path = FOLDER
    json: bool = JSON_OBJECT

    @usage_errors(SheetError)
    def execute(self) -> int:
        return render(sheet_result(load_sheet(self.folder, self.specimen)), self.json)


def sheet_result(sheet: SpecimenSheet) -> CommandResult:
    """Return a sheet as a table, with serial number, batch, photograph and notes."""
    entries = list(sheet.values.values())
    scale = {e.name: sheet_unit(e.name) for e in entries}
    table = Table(
        "sheet",
        f"Specimen {sheet.specimen}: dimensions and masses, with standard uncertainties",
        (
            Column("name", "", [e.name for e in entries], "parameter"),
            Column("stated", "", [_format(e) for e in entries], "value"),
            Column("shown_unit", "", [scale[e.name][1] for e in entries], "unit"),
            Column("instrument", "", [e.instrument if e.measured else "" for e in entries]),
            Column("date", "", [e.date for e in entries]),
            Column("source", "", ["sheet" if e.measured else f"Table I: {e.instrument}" for e in entries]),
            Column("meaning", "", [parameter_spec(e.name).description for e in entries]),
            Column("value", "", [e.value for e in entries], displayed=False),
            Column("uncertainty", "", [e.uncertainty for e in entries], displayed=False),
            Column("unit", "", [parameter_spec(e.name).unit for e in entries], displayed=False),
        ),
    )
    texts = {name: getattr(sheet, name) for name in TEXT_FIELDS}
    notes = [f"{name}: {text}" for name, text in {**texts, **sheet.descriptions}.items() if text]
    sizes = [f"{p} {format_size(s, None, MOUNTING_EFFECTS[p].unit)}" for p, s in sheet.mountings.items()]
    if sizes:
        notes.append(f"standard deviation between mountings: {', '.join(sizes)}")
    extra = {
        **texts,
        "mountings": dict(sheet.mountings),
        "descriptions": dict(sheet.descriptions),
        "file": str(sheet.path) if sheet.path else None,
    }
    return CommandResult("specimen show", {}, (table,), (*notes, f"{sheet.description}."), extra=extra)


def _format(entry: SheetEntry) -> str:
    factor, _ = sheet_unit(entry.name)
    return format_with_uncertainty(factor * entry.value, factor * entry.uncertainty)


@command("T7")
class NewSheetCommand:
    """Write a commented sheet, with no value in use."""

    specimen: str = argument(type=specimen_argument)
    folder: Path = FOLDER

    @usage_errors(SheetError)
    def execute(self) -> int:
        path = create_sheet(self.folder, self.specimen).path
        print_message(f"{path}: no value is in use yet. Fill it in, or use 'tactor-bench specimen set'")
        return ExitCode.DONE


@command("T7 'h_Al=0.203 mm +- 0.002 mm' --instrument micrometer")
class SetSheetCommand:
    """Set values with their uncertainties, serial number, batch, photograph or notes."""

    specimen: str = argument(type=specimen_argument)
    settings: Sequence[str] = argument(
        "'L=22.1 mm +- 0.05 mm', 'rho1=11.2 g/m +- 1 %%', serial=MFC-042, batch=B1, photograph=FILE or notes=TEXT",
        nargs="+",
        metavar="NAME=VALUE",
    )
    instrument: str = option("instrument that measured the values, e.g. 'caliper 150 mm'")
    date: str = option("day of the measurement (default: today)", metavar="YYYY-MM-DD")
    folder: Path = FOLDER
    json: bool = JSON_OBJECT

    @usage_errors(SheetError)
    def execute(self) -> int:
        entries, texts = {}, {}
        day = self._day()
        for setting in self.settings:
            name, equals, stated = (part.strip() for part in setting.partition("="))
            if not equals:
                raise UsageError(f"{setting}: write NAME=VALUE, for example 'L=22.1 mm +- 0.05 mm'")
            if name in TEXT_FIELDS:
                texts[name] = stated
            else:
                with usage_errors(UnitError, ParameterError, about=setting):
                    entries[name] = SheetEntry(name, *read_stated(stated, parameter_spec(name)), self.instrument, day)
        path = sheet_path(self.folder, self.specimen)
        if not path.exists():
            NewSheetCommand(self.specimen, self.folder).execute()
        load_sheet(self.folder, self.specimen)  # refused if it is of another specimen
        sheet = edit_sheet(path, entries, texts)
        print_message(f"wrote {path}")
        return render(sheet_result(sheet), self.json)

    def _day(self) -> str:
        if not self.date:
            return datetime.now(UTC).date().isoformat()
        try:
            return date.fromisoformat(self.date).isoformat()
        except ValueError:
            raise UsageError(f"--date {self.date}: write a day as YYYY-MM-DD, for example 2026-11-20") from None


@command("T7")
class CheckSheetCommand:
    """List implausible and missing values; exit code 1 if there are any."""

    specimen: str = argument()
    folder: Path = FOLDER

    @usage_errors(SheetError)
    def execute(self) -> int:
        sheet = load_sheet(self.folder, self.specimen)
        if sheet.path is None:
            raise UsageError(
                f"there is no {sheet_path(self.folder, self.specimen)}; 'tactor-bench specimen new {self.specimen}' writes one"
            )
        questions = list(question_sheet(sheet))
        for question in questions:
            print_line(question)
        print_line(
            f"{sheet.description}." if questions else f"{sheet.description}; no implausible and no missing value."
        )
        return ExitCode.FAILED if questions else ExitCode.DONE


VERBS = CommandGroup(
    "Edit specimen sheets: dimensions and masses of a specimen, each with standard uncertainty, instrument and date, in a commented TOML "
    "file beside its runs. They enter every fit with their uncertainties; a missing value is taken from the paper's Table I with the "
    "uncertainties of ruler and caliper.",
    "example: tactor-bench specimen set T7 'L=22.1 mm +- 0.05 mm' --instrument caliper",
    {"new": NewSheetCommand, "set": SetSheetCommand, "show": ShowSheetCommand, "check": CheckSheetCommand},
)
