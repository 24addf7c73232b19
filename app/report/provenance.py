"""Provenance tables of a report: held values, point quality, instruments, software, file hashes."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from app.common import Table, display_unit, pluralize
from app.report.document import Block, LimitOutcome
from app.report.figures_of_merit import SpecimenSummary
from app.report.rounding import SPACE, typeset_number, typeset_unit
from app.report.runs import InstrumentRecord, ReportRun
from app.report.specimen import TACTOR_NAMES, SpecimenModel
from model.identification import SPECIMEN_PARAMETERS


def held_values(specimen: SpecimenModel) -> list[Block]:
    """Return the table of parameters that were held."""
    identified = specimen.identified_names
    fit = None if specimen.identification is None else specimen.identification.joint_fit
    free = () if fit is None else fit.free_parameters
    rows = [
        (name, SPECIMEN_PARAMETERS[name].description, _format_value(value, SPECIMEN_PARAMETERS[name].unit))
        for name, value in {**asdict(specimen.tactor), **asdict(specimen.membrane)}.items()
        if name not in identified
        and name not in free
        and (name in TACTOR_NAMES or specimen.damping_by_elongation or "E_m" in identified)
    ]
    note = "Taken from the paper's Table I, as if they were exact: their errors are in none of the errors given here."
    return [Table.of_rows("Held, not identified", ("parameter", "meaning", "value"), rows, note)] if rows else []


def _format_value(value: float, unit: str) -> str:
    """Format a value; lengths in millimetres."""
    factor, shown = (1e3, "mm") if unit == "m" else display_unit(unit)
    return f"{typeset_number(factor * value)} {typeset_unit(shown)}"


def quality_table(runs: Sequence[ReportRun]) -> Table:
    """Return the table of runs with their points and quality flags."""
    heads = ("run", "protocol", "begun (UTC)", "ended", "kind", "points", "not usable", "flags")
    rows = [
        (
            run.name,
            run.summary.protocol,
            run.summary.start_time[:16].replace("T", " "),
            run.summary.state,
            ", ".join(["simulated"] * run.summary.simulated + ["imported"] * run.imported),
            str(run.summary.points),
            str(run.summary.points - run.usable_count),
            format_flags(run.flag_counts),
        )
        for run in runs
    ]
    return Table.of_rows("Runs and the quality of their points", heads, rows)


def format_flags(counts: Mapping[str, int]) -> str:
    """Format the numbers of flagged points: `2 clipped, 1 noisy`."""
    return ", ".join(f"{count} {flag}" for flag, count in sorted(counts.items()))


def instrument_table(runs: Sequence[ReportRun]) -> Table:
    """Return the table of instruments with their calibrations."""
    users: dict[InstrumentRecord, list[ReportRun]] = {}
    for run in runs:
        for instrument in run.instruments:
            users.setdefault(instrument, []).append(run)
    rows, highlighted = [], set()
    for at, (each, used) in enumerate(users.items()):
        unknown = "unknown" if each.role == "sensor" else ""
        expires = each.expires or unknown
        if late := sum(run.uses_expired(each) for run in used):
            highlighted.add(at)
            expires += f", before {pluralize(late, 'run')}"
        calibration = (each.calibrated or unknown, expires, each.gain)
        rows.append((each.role, each.identity, each.serial, *calibration, f"{len(used)} of {len(runs)}"))
    heads = ("role", "identity", "serial", "calibrated", "expires", "gain known to", "runs")
    return Table.of_rows("Instruments", heads, rows, highlighted_rows=frozenset(highlighted))


def software_tables(runs: Sequence[ReportRun]) -> list[Table]:
    """Return the table of software versions, if any is known."""
    used = Counter(run.software for run in runs if run.software)
    rows = [(software, str(count)) for software, count in sorted(used.items())]
    return [Table.of_rows("Measured with", ("software", "runs"), rows)] if rows else []


def hash_table(runs: Sequence[ReportRun]) -> Table:
    """Return the table of run file hashes, by which later changes are detected."""
    rows = tuple((run.name, run.sha256 or "could not be read") for run in runs)
    return Table.of_rows("Run files", ("file", "SHA-256"), rows, monospace=True)


def report_record(
    specimen: str,
    summary: SpecimenSummary,
    runs: Sequence[ReportRun],
    outcomes: Sequence[LimitOutcome],
    fingerprint: str,
    software_version: str,
) -> dict[str, Any]:
    """Return the content of the report for JSON, SI."""
    found = summary.specimen.identification
    return {
        "specimen": specimen,
        "simulated": any(run.summary.simulated for run in runs),
        "imported": any(run.imported for run in runs),
        "passed": all(o.verdict == "pass" for o in outcomes) if outcomes else None,
        "limits": [{k: v.replace(SPACE, " ") for k, v in asdict(o).items()} for o in outcomes],
        "parameters": [asdict(e) for e in summary.specimen.estimates],
        "unidentified": [] if found is None else list(found.unidentified),
        "merits": [
            {"name": m.name, "value": m.value, "standard_error": m.standard_error, "unit": m.unit}
            for m in summary.figures_of_merit.values()
        ],
        "runs": [
            {"file": run.name, "points": run.summary.points, "usable": run.usable_count, "sha256": run.sha256}
            for run in runs
        ],
        "fingerprint": fingerprint,
        "code": software_version,
    }
