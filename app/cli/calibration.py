"""What `tactor-bench calibration` does: show a version of what was accepted of a specimen, compare two, use another."""

import argparse
from dataclasses import replace

from app.cli.identify_tables import parameters
from app.cli.output import Answer, Column, Table, deliver
from app.common.errors import UsageError
from app.identification import calibrations
from app.identification.calibrations import CalibrationError, Calibrations
from model.identification.calibration import Calibration, changes


def calibration(options: argparse.Namespace) -> int:
    """`tactor-bench calibration show|diff|use SPECIMEN`."""
    try:
        known = calibrations.read(options.folder, options.specimen)
        match options.what:
            case "show":
                return deliver(_shown(known.get(options.version), known), options)
            case "diff":
                return deliver(_difference(known.get(options.first), known.get(options.second)), options)
            case _:
                chosen = known.get(options.version)
                calibrations.write(options.folder, options.specimen, replace(known, active=chosen.version))
                return deliver(_shown(chosen, replace(known, active=chosen.version)), options)
    except CalibrationError as error:
        raise UsageError(f"specimen {options.specimen}: {error}") from None


def _shown(one: Calibration, known: Calibrations) -> Answer:
    simulated = ", SIMULATED" if one.simulated else ""
    active = "active" if one.version == known.active else f"version {known.active} is active"
    title = f"Specimen {one.specimen}, version {one.version} ({active}){simulated}"
    notes = [
        f"{one.method}, accepted {one.accepted_at} by {one.accepted_by or 'nobody named'}, program {one.code}",
        f"from {', '.join(one.runs)}",
    ]
    return Answer(
        "calibration show",
        {name: value for name, value in one.fixed.items() if value is not None},
        (parameters(title, one.estimates),),
        (*notes, *_reduced(one), *([one.note] if one.note else []), *_versions(known)),
        more={"version": one.version, "active": known.active, "record": one.as_record()},
    )


def _versions(known: Calibrations) -> list[str]:
    """All versions in a line, where there are several."""
    if len(known.versions) < 2:
        return []
    each = (
        f"{c.version} ({c.accepted_at[:10]}{', ' + c.accepted_by if c.accepted_by else ''}"
        f"{', active' if c.version == known.active else ''})"
        for c in known.versions
    )
    return [f"versions: {'; '.join(each)}"]


def _reduced(one: Calibration) -> list[str]:
    """Which corrected calibration of the instruments a version rests on."""
    if not one.reduced:
        return []
    sensor, amplifier = one.reduced["sensor"], one.reduced["amplifier"]
    words = [f"raw samples reduced anew with {one.reduced['bench']} (SHA-256 {one.reduced['sha256'][:16]}...)"]
    if sensor:
        when = sensor["calibrated"] or "nobody tells when"
        words.append(f"{sensor['name']} {sensor['serial']}, {sensor['gain_m_per_v']:.6g} m/V, calibrated {when}")
    if amplifier:
        words.append(
            f"{amplifier['name']} {amplifier['serial']}, {amplifier['slope_below']:g} and {amplifier['slope_above']:g} V/V"
        )
    return ["; ".join(words)]


def _difference(before: Calibration, after: Calibration) -> Answer:
    every = changes(before, after)
    table = Table(
        "changes",
        f"Specimen {after.specimen}: version {before.version} to {after.version}",
        (
            Column("name", "", [c.name for c in every], "parameter"),
            Column("before", "", [c.before for c in every]),
            Column("after", "", [c.after for c in every]),
            Column("unit", "", [c.unit for c in every]),
            Column("standard_errors", "", [c.standard_errors for c in every], "in standard errors", form="+.1f"),
        ),
    )
    return Answer("calibration diff", {}, (table,))
