"""The command `certificate`: calibration certificates of the instruments, and when each is due."""

import csv
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path

from app.cli.options import FOLDER, JSON_OBJECT, CommandGroup, argument, command, option
from app.cli.output import CommandResult, print_answer, render
from app.common import Column, ExitCode, Table, UsageError, print_line, print_message, usage_errors
from app.config import (
    ROLES,
    Certificate,
    CertificateColumn,
    CertificateError,
    due_after,
    read_certificates,
    store_certificate,
)
from protocols.base import open_regular


@command("dcc.xml --role weights --due 2027-05-31")
class AddCertificateCommand:
    """Add a certificate: a DCC of version 3, or typed values."""

    dcc: Path | None = argument("digital calibration certificate, version 3", nargs="?", metavar="DCC.xml")
    role: str = option(", ".join(ROLES), metavar="INSTRUMENT")
    number: str = option("number of the certificate (default: from the DCC, as for the following options)")
    laboratory: str = option("that calibrated", metavar="NAME")
    date: str = option("of the calibration", metavar="YYYY-MM-DD")
    due: str = option("last day on which the calibration holds", metavar="YYYY-MM-DD")
    months: int = option("due so many months after its date, instead of --due", 0, metavar="N")
    item: str = option("maker and model", metavar="TEXT")
    serial: str = option("serial number, by which the instruments of a run are matched")
    table: Path | None = option("points: 'name [unit]' columns; a column 'u(name) [unit]' has k = 1", metavar="CSV")
    pdf: Path | None = option("the certificate as a PDF, copied beside it", metavar="FILE")
    folder: Path = FOLDER

    @usage_errors(CertificateError)
    def execute(self) -> int:
        from app.config import read_dcc

        base = read_dcc(self.dcc) if self.dcc else Certificate("", "", "")
        given = {
            name: value
            for name in ("role", "number", "laboratory", "date", "item", "serial", "due")
            if (value := getattr(self, name).strip())
        }
        certificate = replace(base, **given)
        if missing := [name for name in ("number", "laboratory", "date") if not getattr(certificate, name)]:
            raise UsageError(f"the certificate has no {missing[0]}: give it with --{missing[0]}")
        if not self.role:
            raise UsageError(f"name the instrument: --role {'|'.join(ROLES)}")
        if self.months:
            certificate = replace(certificate, due=due_after(certificate.date, self.months))
        if self.table:
            certificate = replace(certificate, columns=_read_table(self.table))
        path = store_certificate(self.folder, certificate, [each for each in (self.dcc, self.pdf) if each])
        print_line(str(path))
        if not certificate.due:
            print_message("It has no due date, so nothing will warn: add it with --due or --months")
        if not certificate.serial and certificate.role != "weights":
            print_message("It has no serial number, so no run is matched with it: add it with --serial")
        return ExitCode.DONE


def _read_table(path: Path) -> tuple[CertificateColumn, ...]:
    """Read the points of a certificate from a CSV file.

    Raises:
        CertificateError: it cannot be read, or a cell is no number.
    """
    try:
        with open_regular(path, "r", newline="", encoding="utf-8-sig") as file:
            head, *rows = [row for row in csv.reader(file) if row]
        columns = {name.strip(): [float(row[i]) for row in rows] for i, name in enumerate(head)}
    except (OSError, ValueError, IndexError, csv.Error) as error:
        raise CertificateError(
            f"{path} is no table of points ({error}); write a header such as 'displacement [mm],u(displacement) [mm]' and numbers"
        ) from None
    found = []
    for heading, values in columns.items():
        name, _, unit = heading.removesuffix("]").partition(" [")
        if not name.startswith("u("):
            errors = columns.get(f"u({name}) [{unit}]", columns.get(f"u({name})", []))
            found.append(CertificateColumn(name, unit or "1", tuple(values), tuple(errors)))
    return tuple(found)


@command()
class ListCertificatesCommand:
    """Certificates by due date; exit code 1 if one has expired."""

    folder: Path = FOLDER
    json: bool = JSON_OBJECT

    def execute(self) -> int:
        found, problems = read_certificates(self.folder)
        today = datetime.now(UTC).date()
        left = [each.days_left(today) for each in found]
        table = Table(
            "certificates",
            f"Calibration certificates in {self.folder}",
            (
                Column("due", None, [each.due or "not stated" for each in found]),
                Column("state", None, [each.state(today) for each in found]),
                Column("days_left", None, ["" if days is None else str(days) for days in left], "days left"),
                Column("role", None, [each.role for each in found], "instrument"),
                Column("item", None, [each.item for each in found]),
                Column("serial", None, [each.serial for each in found]),
                Column("number", None, [each.number for each in found], "certificate"),
                Column("laboratory", None, [each.laboratory for each in found]),
                Column("date", None, [each.date for each in found]),
            ),
        )
        render(CommandResult("certificate list", {}, (table,), tuple(problems)), self.json)
        return ExitCode.FAILED if problems or any(each.state(today) == "expired" for each in found) else ExitCode.DONE


@command("D-K-1234")
class ShowCertificateCommand:
    """A certificate with its table."""

    number: str = argument("of the certificate, or its beginning")
    folder: Path = FOLDER
    json: bool = JSON_OBJECT

    def execute(self) -> int:
        found, _ = read_certificates(self.folder)
        chosen = [each for each in found if each.number == self.number] or [
            each for each in found if each.number.startswith(self.number)
        ]
        if len(chosen) != 1:
            known = ", ".join(each.number for each in found) or "none"
            raise UsageError(f"there is no single certificate '{self.number}' in {self.folder}; there are: {known}")
        (one,) = chosen
        lines = [
            f"Certificate {one.number} of {one.laboratory}, {one.date}: {one.name}",
            f"due {one.due or 'not stated'}: {one.state(datetime.now(UTC).date())}",
            *(f"attached {name}, SHA-256 {digest[:16]}..." for name, digest in one.files),
        ]
        for column in one.columns:
            errors = one_line(column.standard_uncertainties)
            stated = f"; standard uncertainties {errors}" if errors else ""
            lines.append(f"{column.name} [{column.unit}]: {one_line(column.values)}{stated}")
        return print_answer(asdict(one), lines, self.json)


def one_line(values: tuple[float, ...]) -> str:
    """Return numbers as text; equal ones once."""
    return f"{values[0]:.7g}" if values and len(set(values)) == 1 else ", ".join(f"{value:.7g}" for value in values)


VERBS = CommandGroup(
    "Calibration certificates of sensor, amplifier, card, generator and weights, in the folder certificates beside the runs. A run warns from 30 days before the due "
    "date of an instrument that it uses, by serial number, and flags every point after it.",
    "example: tactor-bench certificate add dcc.xml --role sensor --months 12 --pdf certificate.pdf",
    {
        "add": AddCertificateCommand,
        "list": ListCertificatesCommand,
        "show": ShowCertificateCommand,
    },
)
