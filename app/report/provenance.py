"""Provenance tables of a report: held values, point quality, instruments, software, file hashes."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from app.common import Table, display_unit, pluralize
from app.report.document import Block, LimitOutcome
from app.report.rounding import SPACE, typeset_number, typeset_unit
from app.report.runs import ReportRun
from app.report.specimen import TACTOR_NAMES, SpecimenModel
from app.report.summary import SpecimenSummary
from model.identification import SPECIMEN_PARAMETERS


def held_values(specimen: SpecimenModel) -> list[Block]:
    """Return the table of parameters that were held."""
    identified = specimen.identified_names
    free = (
        specimen.identification.joint_fit.free_parameters
        if specimen.identification is not None and specimen.identification.joint_fit is not None
        else ()
    )
    rows = tuple(
        (
            name,
            SPECIMEN_PARAMETERS[name].description,
            _format_value(value, SPECIMEN_PARAMETERS[name].unit),
        )
        for name, value in {**asdict(specimen.tactor), **asdict(specimen.membrane)}.items()
        if name not in identified
        and name not in free
        and (name in TACTOR_NAMES or specimen.damping_by_elongation or "E_m" in identified)
    )
    note = "Taken from the paper's Table I, as if they were exact: their errors are in none of the errors given here."
    return [Table.of_rows("Held, not identified", ("parameter", "meaning", "value"), rows, note)] if rows else []


def _format_value(value: float, unit: str) -> str:
    """Format a value; lengths in millimetres."""
    factor, shown = (1e3, "mm") if unit == "m" else display_unit(unit)
    return f"{typeset_number(factor * value)} {typeset_unit(shown)}"


def quality_table(runs: Sequence[ReportRun]) -> Table:
    """Return the table of runs with their points and quality flags."""
    rows = []
    for run in runs:
        why = ", ".join(f"{count} {flag}" for flag, count in sorted(run.flag_counts.items()))
        kind = ", ".join(word for word, holds in (("simulated", run.simulated), ("imported", run.imported)) if holds)
        begun = run.start_time[:16].replace("T", " ")
        rows.append(
            (
                run.name,
                run.protocol,
                begun,
                run.state,
                kind,
                str(run.point_count),
                str(run.point_count - run.usable_count),
                why,
            )
        )
    heads = ("run", "protocol", "begun (UTC)", "ended", "kind", "points", "not usable", "flags")
    return Table.of_rows("Runs and the quality of their points", heads, tuple(rows))


def instrument_table(runs: Sequence[ReportRun]) -> Table:
    """Return the table of instruments with their calibrations."""
    users: dict[tuple[str, ...], list[ReportRun]] = {}
    for run in runs:
        for i in run.instruments:
            users.setdefault((i.role, i.identity, i.serial, i.calibrated, i.expires, i.gain), []).append(run)
    rows, bad = [], set()
    for at, (key, used) in enumerate(users.items()):
        role, identity, serial, calibrated, expires, gain = key
        late = sum(bool(expires) and expires < run.start_time[:10] for run in used)
        if late:
            bad.add(at)
            expires += f", before {pluralize(late, 'run')}"
        known = role == "sensor"
        cells = (calibrated or ("unknown" if known else ""), expires or ("unknown" if known else ""), gain)
        rows.append((role, identity, serial, *cells, f"{len(used)} of {len(runs)}"))
    heads = ("role", "identity", "serial", "calibrated", "expires", "gain known to", "runs")
    return Table.of_rows("Instruments", heads, tuple(rows), highlighted_rows=frozenset(bad))


def software_tables(runs: Sequence[ReportRun]) -> Iterable[Table]:
    """Yield the table of software versions."""
    used = Counter(run.software for run in runs if run.software)
    if used:
        rows = tuple((words, str(count)) for words, count in sorted(used.items()))
        yield Table.of_rows("Measured with", ("software", "runs"), rows)


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
        "simulated": any(run.simulated for run in runs),
        "imported": any(run.imported for run in runs),
        "passed": all(o.verdict == "pass" for o in outcomes) if outcomes else None,
        "limits": [{k: v.replace(SPACE, " ") for k, v in asdict(o).items()} for o in outcomes],
        "parameters": [] if found is None else [asdict(e) for e in found.estimates],
        "unidentified": [] if found is None else list(found.unidentified),
        "merits": [asdict(m) | {"unit": m.unit} for m in summary.figures_of_merit.values()],
        "runs": [
            {"file": run.name, "points": run.point_count, "usable": run.usable_count, "sha256": run.sha256}
            for run in runs
        ],
        "fingerprint": fingerprint,
        "code": software_version,
    }
