"""Calibration certificates of instruments: number, laboratory, dates, table with uncertainties; a file each beside the runs."""

import hashlib
import json
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from datetime import date as Day  # noqa: N812 - a certificate has a field `date`
from pathlib import Path
from typing import Any

from app.common import record_audit
from drivers import open_regular
from protocols import PROTOCOLS
from protocols.base import read_json_file, visible_values, write_atomic
from protocols.runfile import safe_name

CERTIFICATES = "certificates"
"""Folder of the certificates within the folder of the runs."""
SUFFIX = ".certificate.json"
ROLES = ("sensor", "amplifier", "card", "generator", "weights", "other")
WARNING_DAYS = 30
"""Days before the due date in which every run warns."""


class CertificateError(ValueError):
    """A certificate cannot be read or stored; the message gives file, entry and remedy."""


@dataclass(frozen=True, slots=True)
class CertificateColumn:
    """A quantity of the table: values in the unit of the certificate; standard uncertainties (k = 1), empty if none are stated."""

    name: str
    unit: str
    values: tuple[float, ...]
    standard_uncertainties: tuple[float, ...] = ()


@dataclass(frozen=True)
class Certificate:
    """A calibration certificate.

    Attributes:
        number: number by the laboratory.
        date: of the calibration, ISO 8601.
        due: last day of the calibration's validity, ISO 8601; empty if not stated.
        role: of the instrument at a bench.
        item: maker and model.
        serial: serial number, which identifies the instrument in a run.
        columns: table of points.
        files: names of the attached files with their SHA-256.
    """

    number: str
    laboratory: str
    date: str
    item: str = ""
    serial: str = ""
    role: str = "other"
    due: str = ""
    columns: tuple[CertificateColumn, ...] = ()
    files: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        for name in ("date", "due"):
            if value := getattr(self, name):
                _check_day(name, value)
        if self.due and self.date and self.due < self.date:
            raise CertificateError(
                f"certificate {self.number} is due on {self.due}, before its date {self.date}; correct one of them"
            )
        if self.role not in ROLES:
            raise CertificateError(f"there is no instrument '{self.role}'; there are: {', '.join(ROLES)}")

    @property
    def name(self) -> str:
        """Calibrated instrument as text."""
        return " ".join(filter(None, (self.role, self.item, self.serial and f"#{self.serial}")))

    def days_left(self, today: Day) -> int | None:
        """Return the days until the due date, negative after it; None if it is not stated."""
        return (Day.fromisoformat(self.due) - today).days if self.due else None

    def state(self, today: Day) -> str:
        """Return `valid`, `due soon`, `expired`, or `no due date`."""
        return calibration_state(self.due, today) if self.due else "no due date"

    def warning(self, today: Day) -> str:
        """Return the warning before and after the due date; empty otherwise."""
        left = self.days_left(today)
        if left is None or left > WARNING_DAYS:
            return ""
        about = f"The calibration of {self.name} (certificate {self.number})"
        if left < 0:
            return f"{about} expired on {self.due}; every point of this run is flagged. Have it calibrated and add the new certificate: tactor-bench certificate add"
        return f"{about} is due on {self.due}, in {left} days"


def calibration_state(due: str, today: Day) -> str:
    """Return the state of a calibration by its last day, ISO 8601: `valid`, `due soon` or `expired`."""
    left = (Day.fromisoformat(due) - today).days
    return "expired" if left < 0 else "due soon" if left <= WARNING_DAYS else "valid"


def store_certificate(folder: Path, certificate: Certificate, attachments: Iterable[Path] = ()) -> Path:
    """Store a certificate beside the runs, with copies of the attached files; return its file.

    Raises:
        CertificateError: there is one of that number already, or a file cannot be copied or written.
    """
    place = folder / CERTIFICATES
    stem = safe_name(certificate.number)
    path = place / f"{stem}{SUFFIX}"
    try:
        place.mkdir(parents=True, exist_ok=True)
        if path.exists():
            raise CertificateError(f"{path} is there already and is not overwritten; move it away to add another")
        files = []
        for source in attachments:
            with open_regular(source) as file:
                data = file.read()
            name = f"{stem}{source.suffix.casefold()}"
            if not (place / name).exists():
                shutil.copyfile(source, place / name)
            files.append((name, hashlib.sha256(data).hexdigest()))
        certificate = replace(certificate, files=tuple(files))
        text = json.dumps(asdict(certificate), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        write_atomic(path, text)
    except OSError as error:
        raise CertificateError(
            f"{error.filename or path} cannot be copied or written: {error.strerror or error}"
        ) from None
    record_audit("certificate", path, *(place / name for name, _ in certificate.files), subject=certificate.number)
    return path


def read_certificates(folder: Path) -> tuple[list[Certificate], list[str]]:
    """Return the certificates beside the runs by due date, those without one last; and a sentence for each damaged file."""
    certificates, problems, paths = list[Certificate](), list[str](), list[Path]()
    try:
        paths = sorted((folder / CERTIFICATES).glob(f"*{SUFFIX}"))
    except OSError as error:
        problems.append(f"the certificates in {folder / CERTIFICATES} cannot be read ({error}); check the disk")
    for path in paths:
        try:
            certificates.append(_from_record(visible_values(read_json_file(path))))
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            problems.append(f"the certificate {path} cannot be read ({error}); restore it from a copy, or add it again")
    return sorted(certificates, key=lambda each: (not each.due, each.due, each.number)), problems


def certificates_of_bench(
    certificates: Iterable[Certificate], serials: Iterable[str], protocol: str
) -> list[Certificate]:
    """Return the newest certificate of each instrument that a run uses: by serial number, and the weights where it uses them."""
    used = {serial.casefold() for serial in serials if serial}
    kind = PROTOCOLS.get(protocol)
    weighed = kind is not None and kind.uses_weights
    newest: dict[tuple[str, str], Certificate] = {}
    for each in sorted(certificates, key=lambda one: one.date):
        if each.serial.casefold() in used or (weighed and each.role == "weights"):
            newest[each.role, each.serial.casefold()] = each
    return list(newest.values())


def bench_warnings(folder: Path, configuration: Mapping[str, Any], protocol: str) -> tuple[str, tuple[str, ...]]:
    """Return sentences on expired calibrations of a bench's instruments, which flag points, and on calibrations that are due soon or cannot be read.

    Args:
        folder: of the runs.
        configuration: tables of the bench file, with the identities that the instruments answered.
        protocol: name of the protocol.
    """
    certificates, problems = read_certificates(folder)
    if not (certificates or problems):
        return "", ()
    tables = [each for each in configuration.values() if isinstance(each, Mapping)]
    serials = {str(table.get("serial", "")) for table in tables}
    identities = configuration.get("identities", {})
    serials |= {str(identity).rpartition("#")[2] for identity in identities.values() if "#" in str(identity)}
    today = datetime.now(UTC).date()
    states = [
        (each.state(today), each.warning(today)) for each in certificates_of_bench(certificates, serials, protocol)
    ]
    expired = ". ".join(warning for state, warning in states if state == "expired")
    return expired, (*(warning for state, warning in states if state == "due soon"), *problems)


def due_after(day: str, months: int) -> str:
    """Return the day some months of 30.44 days after a day, ISO 8601.

    Raises:
        CertificateError: the day is none.
    """
    return (_check_day("date", day) + timedelta(days=round(30.44 * months))).isoformat()


def _check_day(name: str, text: str) -> Day:
    try:
        return Day.fromisoformat(text)
    except ValueError:
        raise CertificateError(f"{name} '{text[:40]}' is no day; write it as YYYY-MM-DD") from None


def _from_record(record: dict[str, Any]) -> Certificate:
    columns = tuple(
        CertificateColumn(
            str(each["name"]),
            str(each["unit"]),
            tuple(map(float, each["values"])),
            tuple(map(float, each["standard_uncertainties"])),
        )
        for each in record.pop("columns")
    )
    files = tuple((str(name), str(digest)) for name, digest in record.pop("files"))
    return Certificate(**{name: str(value) for name, value in record.items()}, columns=columns, files=files)
