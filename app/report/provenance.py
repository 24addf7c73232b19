"""Where the numbers of a report come from: values held, quality of the points, instruments, software, hashes."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from app.common.formatting import counted, shown_unit
from app.report.document import Block, Grid, Outcome
from app.report.rounding import SPACE, plain, printed_unit
from app.report.runs import Taken
from app.report.specimen import TACTOR, Specimen
from app.report.summary import Known
from model.identification.parameters import OWN


def held(known: Specimen) -> list[Block]:
    """What was not identified but taken as known."""
    told = known.told
    free = known.found.fit.parameters if known.found is not None and known.found.fit is not None else ()
    rows = tuple(
        (
            name,
            OWN[name].words,
            _value(value, OWN[name].unit),
        )
        for name, value in {**asdict(known.tactor), **asdict(known.membrane)}.items()
        if name not in told and name not in free and (name in TACTOR or known.each or "E_m" in told)
    )
    note = "Taken from the paper's Table I, as if they were exact: their errors are in none of the errors given here."
    return [Grid("Held, not identified", ("parameter", "meaning", "value"), rows, note)] if rows else []


def _value(value: float, unit: str) -> str:
    """Lengths of a specimen in millimetres."""
    factor, shown = (1e3, "mm") if unit == "m" else shown_unit(unit)
    return f"{plain(factor * value)} {printed_unit(shown)}"


def quality(runs: Sequence[Taken]) -> Grid:
    """How many points every run has, how many of them are flagged, and why."""
    rows = []
    for run in runs:
        why = ", ".join(f"{count} {flag}" for flag, count in sorted(run.flags.items()))
        kind = ", ".join(word for word, holds in (("simulated", run.simulated), ("imported", run.imported)) if holds)
        begun = run.start_time[:16].replace("T", " ")
        rows.append(
            (run.name, run.protocol, begun, run.state, kind, str(run.points), str(run.points - run.usable), why)
        )
    heads = ("run", "protocol", "begun (UTC)", "ended", "kind", "points", "not usable", "flags")
    return Grid("Runs and the quality of their points", heads, tuple(rows))


def instruments(runs: Sequence[Taken]) -> Grid:
    """Every instrument that had a part, with its calibration."""
    users: dict[tuple[str, ...], list[Taken]] = {}
    for run in runs:
        for i in run.instruments:
            users.setdefault((i.role, i.identity, i.serial, i.calibrated, i.expires, i.gain), []).append(run)
    rows, bad = [], set()
    for at, (key, used) in enumerate(users.items()):
        role, identity, serial, calibrated, expires, gain = key
        late = sum(bool(expires) and expires < run.start_time[:10] for run in used)
        if late:
            bad.add(at)
            expires += f", before {counted(late, 'run')}"
        known = role == "sensor"
        cells = (calibrated or ("unknown" if known else ""), expires or ("unknown" if known else ""), gain)
        rows.append((role, identity, serial, *cells, f"{len(used)} of {len(runs)}"))
    heads = ("role", "identity", "serial", "calibrated", "expires", "gain known to", "runs")
    return Grid("Instruments", heads, tuple(rows), bad=frozenset(bad))


def software(runs: Sequence[Taken]) -> Iterable[Grid]:
    """What the runs were measured with."""
    used = Counter(run.software for run in runs if run.software)
    if used:
        rows = tuple((words, str(count)) for words, count in sorted(used.items()))
        yield Grid("Measured with", ("software", "runs"), rows)


def hashes(runs: Sequence[Taken]) -> Grid:
    """What every run file must hash to, for who wants to know that it is still the same."""
    rows = tuple((run.name, run.sha256 or "could not be read") for run in runs)
    return Grid("Run files", ("file", "SHA-256"), rows, code=True)


def record(
    specimen: str, known: Known, runs: Sequence[Taken], outcomes: Sequence[Outcome], fingerprint: str, code: str
) -> dict[str, Any]:
    """The report's numbers for a machine, SI."""
    found = known.specimen.found
    return {
        "specimen": specimen,
        "simulated": any(run.simulated for run in runs),
        "imported": any(run.imported for run in runs),
        "passed": all(o.verdict == "pass" for o in outcomes) if outcomes else None,
        "limits": [{k: v.replace(SPACE, " ") for k, v in asdict(o).items()} for o in outcomes],
        "parameters": [] if found is None else [asdict(e) for e in found.estimates],
        "unidentified": [] if found is None else list(found.unidentified),
        "merits": [asdict(m) | {"unit": m.unit} for m in known.merits.values()],
        "runs": [{"file": run.name, "points": run.points, "usable": run.usable, "sha256": run.sha256} for run in runs],
        "fingerprint": fingerprint,
        "code": code,
    }
