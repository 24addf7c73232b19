"""The command `calibration`: accept, show, compare and activate versions of a specimen's estimates."""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from app.cli.identify import IdentifyOptions, identify_runs
from app.cli.identify_tables import estimate_table
from app.cli.options import JSON_OBJECT, define_command, folder_option, option, switch
from app.cli.output import CommandResult, render
from app.common.errors import UsageError
from app.common.tables import Column, Table
from app.identification import calibrations
from app.identification.calibrations import CalibrationError, Calibrations
from model.identification import Calibration, compare_calibrations


@dataclass(frozen=True)
class ShowCalibrationOptions:
    """Options of `calibration show`."""

    specimen: str = option()
    version: int | None = option("--version", type=int)
    folder: Path = folder_option()
    json: bool = switch("--json", JSON_OBJECT)


@dataclass(frozen=True)
class DiffOptions:
    """Options of `calibration diff`."""

    specimen: str = option()
    first: int = option(type=int)
    second: int = option(type=int)
    folder: Path = folder_option()
    json: bool = switch("--json", JSON_OBJECT)


@dataclass(frozen=True)
class UseOptions:
    """Options of `calibration use`."""

    specimen: str = option()
    version: int = option(type=int)
    folder: Path = folder_option()
    json: bool = switch("--json", JSON_OBJECT)


def calibration(options: ShowCalibrationOptions | DiffOptions | UseOptions) -> int:
    """Run `tactor-bench calibration show|diff|use SPECIMEN`."""
    try:
        known = calibrations.read_calibrations(options.folder, options.specimen)
        if isinstance(options, DiffOptions):
            return render(_difference_result(known.get(options.first), known.get(options.second)), options.json)
        chosen = known.get(options.version)
        if isinstance(options, UseOptions):
            known = replace(known, active=chosen.version)
            calibrations.write_calibrations(options.folder, options.specimen, known)
        return render(_version_result(chosen, known), options.json)
    except CalibrationError as error:
        raise UsageError(f"specimen {options.specimen}: {error}") from None


def _version_result(version: Calibration, calibrations: Calibrations) -> CommandResult:
    simulated = ", SIMULATED" if version.simulated else ""
    active = "active" if version.version == calibrations.active else f"version {calibrations.active} is active"
    title = f"Specimen {version.specimen}, version {version.version} ({active}){simulated}"
    notes = [
        f"{version.method}, accepted {version.accepted_at} by {version.accepted_by or 'nobody named'}, program {version.code}",
        f"from {', '.join(version.runs)}",
    ]
    return CommandResult(
        "calibration show",
        {name: value for name, value in version.fixed.items() if value is not None},
        (estimate_table(title, version.estimates),),
        (*notes, *_correction_lines(version), *([version.note] if version.note else []), *_version_lines(calibrations)),
        extra={"version": version.version, "active": calibrations.active, "record": version.as_record()},
    )


def _version_lines(calibrations: Calibrations) -> list[str]:
    """Return one line that lists all versions, if there are several."""
    if len(calibrations.versions) < 2:
        return []
    each = (
        f"{c.version} ({c.accepted_at[:10]}{', ' + c.accepted_by if c.accepted_by else ''}"
        f"{', active' if c.version == calibrations.active else ''})"
        for c in calibrations.versions
    )
    return [f"versions: {'; '.join(each)}"]


def _correction_lines(version: Calibration) -> list[str]:
    """Return the corrected instrument calibration that a version is based on."""
    if not version.reduced:
        return []
    sensor, amplifier = version.reduced["sensor"], version.reduced["amplifier"]
    words = [f"raw samples reduced anew with {version.reduced['bench']} (SHA-256 {version.reduced['sha256'][:16]}...)"]
    if sensor:
        when = sensor["calibrated"] or "date not recorded"
        words.append(f"{sensor['name']} {sensor['serial']}, {sensor['gain_m_per_v']:.6g} m/V, calibrated {when}")
    if amplifier:
        words.append(
            f"{amplifier['name']} {amplifier['serial']}, {amplifier['slope_below']:g} and {amplifier['slope_above']:g} V/V"
        )
    return ["; ".join(words)]


def _difference_result(old: Calibration, new: Calibration) -> CommandResult:
    every = compare_calibrations(old, new)
    table = Table(
        "changes",
        f"Specimen {new.specimen}: version {old.version} to {new.version}",
        (
            Column("name", "", [c.name for c in every], "parameter"),
            Column("before", "", [c.before for c in every]),
            Column("after", "", [c.after for c in every]),
            Column("unit", "", [c.unit for c in every]),
            Column("standard_errors", "", [c.sigmas for c in every], "in standard errors", format_spec="+.1f"),
        ),
    )
    return CommandResult("calibration diff", {}, (table,))


def _define_calibration(parser: argparse.ArgumentParser) -> None:
    parser.description = "What was accepted of a specimen: one version after the other, one of them active."
    parser.epilog = "example: tactor-bench calibration show T7"
    verbs = parser.add_subparsers(title="what", metavar="WHAT", required=True)
    define_command(
        verbs.add_parser("accept", help="identify these runs and keep the result: identify --accept"),
        IdentifyOptions,
        lambda options: identify_runs(options, accept=True),
        epilog="example: calibration accept runs/*_T7_*.h5 --by 'K. Tanaka'",
    )
    define_command(
        verbs.add_parser("show", help="one version, the active one by default"),
        ShowCalibrationOptions,
        calibration,
        epilog="example: calibration show T7",
    )
    define_command(
        verbs.add_parser("diff", help="what changed between two versions"),
        DiffOptions,
        calibration,
        epilog="example: calibration diff T7 1 2",
    )
    define_command(
        verbs.add_parser("use", help="make another version the active one"),
        UseOptions,
        calibration,
        epilog="example: calibration use T7 1",
    )


COMMANDS: Mapping[str, Callable[[argparse.ArgumentParser], None]] = {"calibration": _define_calibration}
