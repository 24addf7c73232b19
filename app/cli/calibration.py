"""What `tactor-bench calibration` does: show a version of what was accepted of a specimen, compare two, use another."""

import argparse
from dataclasses import replace

from app.cli.identify_tables import estimate_table
from app.cli.output import CommandResult, ResultColumn, ResultTable, render
from app.common.errors import UsageError
from app.identification import calibrations
from app.identification.calibrations import CalibrationError, Calibrations
from model.identification.calibration import Calibration, compare_calibrations


def calibration(options: argparse.Namespace) -> int:
    """`tactor-bench calibration show|diff|use SPECIMEN`."""
    try:
        known = calibrations.read_calibrations(options.folder, options.specimen)
        match options.what:
            case "show":
                return render(_version_result(known.get(options.version), known), options)
            case "diff":
                return render(_difference_result(known.get(options.first), known.get(options.second)), options)
            case _:
                chosen = known.get(options.version)
                calibrations.write_calibrations(options.folder, options.specimen, replace(known, active=chosen.version))
                return render(_version_result(chosen, replace(known, active=chosen.version)), options)
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
    """All versions in a line, where there are several."""
    if len(calibrations.versions) < 2:
        return []
    each = (
        f"{c.version} ({c.accepted_at[:10]}{', ' + c.accepted_by if c.accepted_by else ''}"
        f"{', active' if c.version == calibrations.active else ''})"
        for c in calibrations.versions
    )
    return [f"versions: {'; '.join(each)}"]


def _correction_lines(version: Calibration) -> list[str]:
    """Which corrected calibration of the instruments a version rests on."""
    if not version.reduced:
        return []
    sensor, amplifier = version.reduced["sensor"], version.reduced["amplifier"]
    words = [f"raw samples reduced anew with {version.reduced['bench']} (SHA-256 {version.reduced['sha256'][:16]}...)"]
    if sensor:
        when = sensor["calibrated"] or "nobody tells when"
        words.append(f"{sensor['name']} {sensor['serial']}, {sensor['gain_m_per_v']:.6g} m/V, calibrated {when}")
    if amplifier:
        words.append(
            f"{amplifier['name']} {amplifier['serial']}, {amplifier['slope_below']:g} and {amplifier['slope_above']:g} V/V"
        )
    return ["; ".join(words)]


def _difference_result(old: Calibration, new: Calibration) -> CommandResult:
    every = compare_calibrations(old, new)
    table = ResultTable(
        "changes",
        f"Specimen {new.specimen}: version {old.version} to {new.version}",
        (
            ResultColumn("name", "", [c.name for c in every], "parameter"),
            ResultColumn("before", "", [c.before for c in every]),
            ResultColumn("after", "", [c.after for c in every]),
            ResultColumn("unit", "", [c.unit for c in every]),
            ResultColumn("standard_errors", "", [c.sigmas for c in every], "in standard errors", format_spec="+.1f"),
        ),
    )
    return CommandResult("calibration diff", {}, (table,))
