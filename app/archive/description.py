"""Description of a run file as text for a terminal and as a plain record for JSON."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

from app.archive.figures import figures_and_fault
from app.archive.run_reading import instruments_text
from app.archive.second_person import describe_check
from app.common import format_bytes, format_duration, format_outcome, format_point
from model import format_quantity, format_time, format_value, quantity_label
from protocols import PROTOCOLS, aspects_of, measured_points
from protocols.base import InjectedFaultChanged, Outcome, RunConditions, RunStatus, to_jsonable
from protocols.runfile import NotesError, Run, RunReadError, RunRecord, notes_path, read_notes

if TYPE_CHECKING:
    from app.archive.exporting import ExportedRun


def run_record(run: "ExportedRun") -> dict[str, Any]:
    """Return everything but raw samples and events, in SI units."""
    record = run.record
    return {
        "path": str(run.path),
        "protocol": record.protocol,
        "specimen": record.specimen,
        "state": record.state,
        "reason": record.reason,
        "start_time": record.start_time,
        "simulated": record.simulated,
        "imported": record.imported,
        "sample_rate_hz": run.trace.rate_hz,
        "samples": run.trace.sample_count,
        **({"channels": run.trace.further_channels} if run.trace.further_channels else {}),
        "broken_on_purpose": [broken._asdict() for broken in injected_faults(run)],
        "verdict": to_jsonable(record.verdict),
        **({"caution": record.caution} if record.caution else {}),
        "parameters": record.parameters,
        **({"requested": record.requested} if record.requested else {}),
        "points": run.points(),
        "units": run.units(),
        "estimates": [
            {name: getattr(e, name) for name in ("name", "value", "standard_error", "unit", "source")}
            for e in record.estimates
        ],
        "software": record.software,
        **({"mountings": [to_jsonable(each) for each in run.mountings]} if run.mountings else {}),
        **({"conditions": asdict(record.conditions)} if record.conditions != RunConditions() else {}),
    }


def run_text(run: Run) -> str:
    """Return a page about a run for a terminal."""
    record = run.record
    length = format_duration(run.trace.duration_s) if run.trace.rate_hz else "0 s"
    lines = [
        f"{record.title}" + ("   SIMULATED" if record.simulated else ""),
        _outcome_text(record),
        *([f"caution: {record.caution}"] if record.caution else []),
        _import_text(record)
        or f"begun {record.start_time}, {run.trace.sample_count} scans at {run.trace.rate_hz:g} Hz ({length}), "
        f"{format_bytes(run.path.stat().st_size)}",
        *_people_lines(run),
        *(f"channel {name}, in {unit}" for name, unit in run.trace.further_channels.items()),
        *_fault_lines(run),
        "",
        *_point_lines(run),
    ]
    for curve in run.series():
        if curve.x.size:
            unit, low, high = curve.x_axis.unit, curve.x.min(), curve.x.max()
            rows = "lines" if unit == "Hz" else "values"
            lines.append(f"{curve.title}: {curve.x.size} {rows}, {low:.4g} to {high:.4g} {unit}")
    lines += [f"{quantity_label(each.name)}: {format_value(each)}   ({each.source})" for each in record.estimates]
    return "\n".join([*lines, *_remark_lines(record)])


def _point_lines(run: Run) -> Iterator[str]:
    """Yield a line for each point."""
    points, kind = run.points(), PROTOCOLS.get(run.record.protocol)
    if not len(next(iter(points.values()), ())):
        yield "no points"
    elif kind is not None and set(kind.axes) <= points.keys():
        yield from (format_point(point) for _, point in measured_points(run, kind.point_type))
    else:
        units = run.units()
        for row in zip(*points.values(), strict=True):
            values = dict(zip(points, row, strict=True))
            yield format_point(SimpleNamespace(**values | {"quality": int(values["quality"])}), units)


def _remark_lines(record: RunRecord) -> Iterator[str]:
    """Yield the protocol's remarks, or why a laboratory's protocol has none."""
    figures, fault = figures_and_fault(record)
    if fault:
        yield fault
    try:
        for remark, figure in aspects_of(record.protocol).remarks(iter(figures)):
            value = (
                "" if figure is None else f": {format_quantity(figure.value, figure.total, figure.unit, figure.name)}"
            )
            yield remark + value
    except RunReadError as error:
        yield str(error)


def _people_lines(run: Run) -> Iterator[str]:
    """Yield who measured and checked, the air, and the instruments with the sensor's calibration."""
    record, conditions = run.record, run.record.conditions
    if conditions.operator:
        origin = "" if conditions.operator_origin == "given" else f" ({conditions.operator_origin})"
        yield f"measured by {conditions.operator}{origin}"
    if air := conditions.air_text or conditions.origin:
        yield f"air {air}"
    if run.mountings:
        yield ", ".join(f"{each.part} mounted {format_time(each.time)}" for each in run.mountings)
    with suppress(NotesError):
        yield from (describe_check(run.path, check) for check in read_notes(notes_path(run.path)).checks)
    if record.configuration.get("identities"):
        yield f"instruments {instruments_text(record)}"


def _outcome_text(record: RunRecord) -> str:
    verdict = record.verdict
    if verdict.outcome is not Outcome.NOT_JUDGED:
        return verdict.describe(record.reason)
    judged = "" if record.status is RunStatus.RUNNING else " (not judged)"
    return f"{format_outcome(record.state, record.reason)}{judged}"


class InjectedFault(NamedTuple):
    """A fault of the simulated bench that was switched on during a run; seconds since its start."""

    fault: str
    words: str
    from_s: float
    until_s: float | None
    """None if the fault was still active when the run ended."""

    @property
    def description(self) -> str:
        until = "to its end" if self.until_s is None else f"to {self.until_s:.2f} s"
        return f"FAULT INJECTED, {self.from_s:.2f} s {until}: {self.words} ({self.fault})"


def injected_faults(run: "ExportedRun") -> list[InjectedFault]:
    """Return the faults injected during a run, in order."""
    faults: list[InjectedFault] = []
    for event in () if run.record.imported else run.events(InjectedFaultChanged.kind):
        name, at_s = event.fields["fault"], event.time_s
        last = next((i for i, b in enumerate(faults) if b.fault == name and b.until_s is None), None)
        if event.fields["broken"] and last is None:
            faults.append(InjectedFault(name, event.fields["words"], at_s, None))
        elif not event.fields["broken"] and last is not None:
            faults[last] = faults[last]._replace(until_s=at_s)
    return faults


def _fault_lines(run: Run) -> list[str]:
    """Return a line for each fault, with the faults of the resumed run, as its points are carried over."""
    lines = [broken.description for broken in injected_faults(run)]
    for earlier in reversed(run.earlier_runs()):
        with Run(earlier) as before:
            lines += [f"{broken.description}, in {earlier.name}" for broken in injected_faults(before)]
    return lines


def _import_text(record: RunRecord) -> str:
    """Return source files and columns of an imported run; empty for a measured one."""
    if not (source := record.imported):
        return ""
    columns = ", ".join(f"{name} = '{of['column']}' [{of['unit']}]" for name, of in source["columns"].items())
    when = (
        f"measured {record.start_time[:10]}"
        if source["measured"]
        else f"imported {record.start_time[:10]}, measurement date not recorded"
    )
    return "\n".join([f"{when}; no raw samples; {columns}", *(f"caution: {caution}" for caution in source["cautions"])])
