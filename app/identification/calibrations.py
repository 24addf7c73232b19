"""Calibration files: versions of accepted estimates of a specimen, in one JSON file in the folder of its runs.

One version is active. Versions are never removed: a new one is accepted, or an older one made active again.
"""

import contextlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.common import record_audit
from model import ParameterError
from protocols.base import read_json_file, visible_values, write_atomic
from protocols.runfile import folded_name, other_specimen_message, safe_name

if TYPE_CHECKING:
    from model.identification import Calibration

FORMAT = "tactor-bench-calibrations"
SUFFIX = ".calibrations.json"


class CalibrationError(Exception):
    """The calibrations of a specimen cannot be read or written; the message gives file and reason."""


@dataclass(frozen=True, slots=True)
class Calibrations:
    """All versions of one specimen, and which one is active (0: none)."""

    versions: "tuple[Calibration, ...]" = ()
    active: int = 0

    def get(self, version: int | None = None) -> "Calibration":
        """Return one version; the active one by default.

        Raises:
            CalibrationError: the version does not exist.
        """
        number = self.active if version is None else version
        for calibration in self.versions:
            if calibration.version == number:
                return calibration
        have = ", ".join(str(c.version) for c in self.versions) or "none"
        which = f"version {number} of its calibration" if number else "calibration"
        raise CalibrationError(f"there is no {which}; versions: {have}")


def calibrations_path(folder: Path, specimen: str) -> Path:
    """Return the path of a specimen's calibration file; an earlier version's file if it holds the specimen's."""
    path, earlier = (folder / f"{name(specimen)}{SUFFIX}" for name in (safe_name, folded_name))
    if earlier != path and not path.exists() and earlier.exists():
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            if specimen in (each["specimen"] for each in visible_values(read_json_file(earlier))["versions"]):
                return earlier
    return path


def read_calibrations(folder: Path, specimen: str) -> Calibrations:
    """Read all calibrations of a specimen; empty without a file.

    Raises:
        CalibrationError: the file cannot be read, is damaged, or holds calibrations of another specimen.
    """
    from model.identification import Calibration  # slow to load, and most specimens have no file

    path = calibrations_path(folder, specimen)
    try:
        record: dict[str, Any] = visible_values(read_json_file(path))
        if record.get("format") != FORMAT:
            raise CalibrationError(f"{path} holds no calibrations of this program; move it away")
        versions = tuple(Calibration.from_record(each) for each in record["versions"])
        if others := [each.specimen for each in versions if each.specimen != specimen]:
            raise CalibrationError(other_specimen_message(path, SUFFIX, others[0], specimen))
        for each in versions:
            if each.reduced:
                describe_correction(each.reduced)  # raises for values of a wrong type
        return Calibrations(versions, int(record["active"]))
    except FileNotFoundError:
        return Calibrations()
    except (OSError, ArithmeticError, ValueError, KeyError, TypeError, AttributeError, ParameterError) as error:
        raise CalibrationError(f"{path} cannot be read: {error}; restore it from a copy, or move it away") from error


def write_calibrations(folder: Path, specimen: str, calibrations: Calibrations) -> Path:
    """Write all calibrations atomically.

    Raises:
        CalibrationError: it cannot be written.
    """
    path = calibrations_path(folder, specimen)
    record = {
        "format": FORMAT,
        "active": calibrations.active,
        "versions": [each.as_record() for each in calibrations.versions],
    }
    try:
        write_atomic(path, json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    except (OSError, ValueError) as error:
        raise CalibrationError(f"{path} cannot be written: {error}") from error
    newest = calibrations.versions[-1] if calibrations.versions else None
    record_audit(
        "calibration",
        path,
        subject=specimen,
        active=calibrations.active,
        newest=newest.version if newest else 0,
        accepted_by=newest.accepted_by if newest else "",
        decision=newest.decision if newest else "",
    )
    return path


def describe_correction(record: Mapping[str, Any]) -> str:
    """Return the corrected instrument calibration that a version is based on, as text.

    Args:
        record: `Calibration.reduced`, as `Correction.as_record` made it.

    Raises:
        KeyError, TypeError, ValueError: the record is damaged.
    """
    sensor, amplifier = record["sensor"], record["amplifier"]
    parts = [f"raw samples reduced again with {record['bench']} (SHA-256 {record['sha256'][:16]}...)"]
    if sensor:
        when = sensor["calibrated"] or "date not recorded"
        parts.append(f"{sensor['name']} {sensor['serial']}, {sensor['gain_m_per_v']:.6g} m/V, calibrated {when}")
    if amplifier:
        parts.append(
            f"{amplifier['name']} {amplifier['serial']}, {amplifier['slope_below']:g} and {amplifier['slope_above']:g} V/V"
        )
    return "; ".join(parts)
