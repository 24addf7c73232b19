"""The command `certificate`: calibration certificates of the instruments, and when each is due."""

import csv
from dataclasses import asdict, replace
from datetime import UTC, datetime
from math import copysign
from pathlib import Path

from app.cli.options import FOLDER, JSON_OBJECT, CommandGroup, argument, command, option
from app.cli.output import CommandResult, print_answer, render
from app.common import Column, ExitCode, Table, UsageError, print_line, print_message, usage_errors
from app.config import (
    ROLES,
    BenchDraft,
    Certificate,
    CertificateColumn,
    CertificateError,
    ConfigError,
    SensorCalibrationError,
    calibration_of_certificate,
    due_after,
    read_certificates,
    store_certificate,
)
from drivers import open_regular
from model import format_quantity


@command("dcc.xml --role weights --due 2027-05-31")
class AddCertificateCommand:
    """Add a certificate: a DCC of version 3, or typed values."""

    dcc: Path | None = argument("digital calibration certificate, version 3", nargs="?", metavar="DCC.xml")
    role: str = option(", ".join(ROLES), metavar="INSTRUMENT")
    number: str = option("number of the certificate (default: from the DCC; so are the following options)")
    laboratory: str = option("that calibrated", metavar="NAME")
    date: str = option("date of the calibration", metavar="YYYY-MM-DD")
    due: str = option("last day of the calibration's validity", metavar="YYYY-MM-DD")
    months: int = option("interval from the calibration to the due date, months; instead of --due", 0, metavar="N")
    item: str = option("maker and model", metavar="TEXT")
    serial: str = option("serial number; identifies the instrument in a run")
    table: Path | None = option("points: 'name [unit]' columns; a column 'u(name) [unit]' has k = 1", metavar="CSV")
    pdf: Path | None = option("certificate as a PDF, copied into the folder", metavar="FILE")
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
            print_message("It has no due date and gives no warnings: add --due or --months")
        if not certificate.serial and certificate.role != "weights":
            print_message("It has no serial number and applies to no run: add --serial")
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
    table = []
    for heading, values in columns.items():
        name, _, unit = heading.removesuffix("]").partition(" [")
        if not name.startswith("u("):
            errors = columns.get(f"u({name}) [{unit}]", columns.get(f"u({name})", []))
            table.append(CertificateColumn(name, unit or "1", tuple(values), tuple(errors)))
    return tuple(table)


@command()
class ListCertificatesCommand:
    """List the certificates by due date; exit code 1 if one has expired."""

    folder: Path = FOLDER
    json: bool = JSON_OBJECT

    def execute(self) -> int:
        certificates, problems = read_certificates(self.folder)
        today = datetime.now(UTC).date()
        left = [each.days_left(today) for each in certificates]
        table = Table(
            "certificates",
            f"Calibration certificates in {self.folder}",
            (
                Column("due", None, [each.due or "not stated" for each in certificates]),
                Column("state", None, [each.state(today) for each in certificates]),
                Column("days_left", None, ["" if days is None else str(days) for days in left], "days left"),
                Column("role", None, [each.role for each in certificates], "instrument"),
                Column("item", None, [each.item for each in certificates]),
                Column("serial", None, [each.serial for each in certificates]),
                Column("number", None, [each.number for each in certificates], "certificate"),
                Column("laboratory", None, [each.laboratory for each in certificates]),
                Column("date", None, [each.date for each in certificates]),
            ),
        )
        render(CommandResult("certificate list", {}, (table,), tuple(problems)), self.json)
        return (
            ExitCode.FAILED
            if problems or any(each.state(today) == "expired" for each in certificates)
            else ExitCode.DONE
        )


def _find(folder: Path, number: str) -> Certificate:
    """Return the certificate of a number, or of the beginning of one.

    Raises:
        UsageError: there is none, or there are several.
    """
    certificates, _ = read_certificates(folder)
    chosen = [each for each in certificates if each.number == number] or [
        each for each in certificates if each.number.startswith(number)
    ]
    if len(chosen) != 1:
        numbers = ", ".join(each.number for each in certificates) or "none"
        raise UsageError(f"there is no single certificate '{number}' in {folder}; there are: {numbers}")
    return chosen[0]


@command("D-K-1234 --bench bench1.toml")
class UseCertificateCommand:
    """Write gain, zero, uncertainty, serial number and dates of a sensor's certificate into a bench file, in place of the typed
    ones. A table or a polynomial (coefficients in mm, mm/V, mm/V^2 ...) becomes the best line in the sensor's valid range.
    """

    number: str = argument("number of the certificate, or its beginning")
    bench: str = option("bench file; its comments stay", metavar="FILE")
    folder: Path = FOLDER

    @usage_errors(SensorCalibrationError, ConfigError)
    def execute(self) -> int:
        one, draft = _find(self.folder, self.number), BenchDraft.load(self.bench)
        if not draft.has_file:
            raise UsageError(
                "name your bench file: --bench FILE; a simulated bench that comes with the program is not changed"
            )
        if one.role != "sensor":
            raise UsageError(
                f"certificate {one.number} is of the {one.role}; only values of the sensor are used in a bench file"
            )
        before = draft.config.sensor
        if before.serial and before.serial.casefold() != one.serial.casefold():
            raise UsageError(
                f"certificate {one.number} is of the sensor #{one.serial or 'without a serial number'}, and {self.bench} has #{before.serial}; choose the other one"
            )
        calibration = calibration_of_certificate(one, (before.valid_low_v, before.valid_high_v))
        values = calibration.rounded()
        if calibration.is_gain_alone:
            values |= {"zero_v": before.zero_v, "gain_m_per_v": copysign(values["gain_m_per_v"], before.gain_m_per_v)}
        dates = {"serial": one.serial, "calibrated": one.date, "expires": one.due, "certificate": one.number}
        draft.with_tables(sensor={**before.model_dump(), **values, **dates, "calibration_points": ()}).save()
        gains = (before.gain_m_per_v, values["gain_m_per_v"])
        shown = " to ".join(format_quantity(gain, 0.0, "m/V") for gain in gains)
        residual = max(map(abs, calibration.residuals_m), default=0.0)
        print_line(
            f"{self.bench}: gain {shown}, {100 * values['gain_relative_uncertainty']:.2g} %; largest residual of the certificate's values {1e6 * residual:.3g} µm"
        )
        return ExitCode.DONE


@command("D-K-1234")
class ShowCertificateCommand:
    """Show a certificate with its table."""

    number: str = argument("number of the certificate, or its beginning")
    folder: Path = FOLDER
    json: bool = JSON_OBJECT

    def execute(self) -> int:
        one = _find(self.folder, self.number)
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
    "Manage calibration certificates of sensor, amplifier, card, generator and weights, in the folder certificates beside "
    "the runs. A run warns from 30 days before the due date of each of its instruments, found by serial number, and flags "
    "every point after that date.",
    "example: tactor-bench certificate add dcc.xml --role sensor --months 12 --pdf certificate.pdf",
    {
        "add": AddCertificateCommand,
        "list": ListCertificatesCommand,
        "show": ShowCertificateCommand,
        "use": UseCertificateCommand,
    },
)
