"""Run files of a report, from the catalogue: observations, instruments, quality flags, hash."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import date as Day  # noqa: N812 - as in certificates
from pathlib import Path

from app.archive import Catalogue, RunFilter, RunState, RunSummary, run_result
from app.common import NO_PROGRESS, Progress, ResultSummary
from app.config import Certificate, calibration_state, certificates_of_bench, read_certificates
from app.fleet import FleetError, SensorDrift, read_fleet, sensor_drifts
from app.identification import points_of_run, run_observations, shape_count_of_run
from model import ParameterError, format_time
from model.identification import FitOptions, Observation
from protocols import Quality, aspects_of
from protocols.base import Figure, Outcome, file_hash
from protocols.runfile import Run, RunReadError, RunRecord, translate_read_errors

REPORTED_STATES = {"valid": "in date", "due soon": "in date, due soon", "expired": "overdue"}
ORIGIN_FLAGS = Quality.SIMULATED | Quality.IMPORTED
"""Flags that are reported elsewhere and are not faults."""


@dataclass(frozen=True, slots=True)
class InstrumentRecord:
    """One instrument of a run."""

    role: str
    identity: str
    serial: str = ""
    calibrated: str = ""
    expires: str = ""
    gain: str = ""
    certificate: str = ""
    """Number of the newest certificate before the run."""
    drift: str = ""
    """Statement that a control chart found it drifting."""

    def state(self, day: str) -> str:
        """Return the state of its calibration on a day, ISO 8601."""
        if not self.expires:
            return "due date not stated" if self.calibrated else "not stated"
        try:
            return REPORTED_STATES[calibration_state(self.expires, Day.fromisoformat(day))]
        except ValueError:
            return f"due date '{self.expires}' is no day"


@dataclass(frozen=True, slots=True)
class ReportRun:
    """One run of a report: its summary in the catalogue, and further contents of its file."""

    path: Path
    summary: RunSummary
    shape_count: int = FitOptions.n
    """Number of shape functions for its identification."""
    usable_count: int = 0
    flag_counts: Mapping[str, int] = field(default_factory=dict)
    instruments: tuple[InstrumentRecord, ...] = ()
    record: RunRecord = field(default_factory=RunRecord)
    observations: tuple[Observation, ...] = ()
    figures: tuple[Figure, ...] = ()
    """Of its protocol, with a title."""
    result: ResultSummary | None = None
    """Contents of its result card; None if its file could not be used."""
    sha256: str = ""
    problem: str = ""
    """Why its file could not be used."""
    exclusion_reason: str = ""
    """Why its points are excluded from the identification."""

    @property
    def name(self) -> str:
        """Path relative to the folder."""
        return self.summary.path

    @property
    def imported(self) -> bool:
        """Whether its points come from a table."""
        return self.summary.state == RunState.IMPORTED

    @property
    def without_result(self) -> bool:
        """Whether the verdict on it is that nothing usable was measured, or that a check failed."""
        return self.summary.outcome in (Outcome.NO_RESULT, Outcome.DID_NOT_PASS)

    @property
    def identifiable(self) -> bool:
        """Whether its points are part of the identification."""
        return bool(self.observations) and not self.exclusion_reason

    def uses_expired(self, instrument: InstrumentRecord) -> bool:
        """Return whether the calibration of an instrument had expired when the run was made."""
        return bool(instrument.expires) and instrument.expires < self.summary.start_time[:10]


def read_report_runs(
    folder: Path, specimen: str, progress: Progress = NO_PROGRESS, golden: str = ""
) -> tuple[ReportRun, ...]:
    """Read every run of a specimen in a folder and below, in order of start time; `golden` is the specimen whose charts find drifting sensors.

    Raises:
        OSError: the folder cannot be read.
    """
    catalogue = Catalogue(folder)
    catalogue.scan(progress)
    entries = sorted(RunFilter(specimen=specimen).apply(catalogue.entries()), key=lambda e: (e.start_time, e.path))
    certificates, _ = read_certificates(folder)
    drifts: Mapping[str, SensorDrift] = {}
    if golden:
        with suppress(FleetError):  # no run has a result
            drifts = sensor_drifts(read_fleet(folder, catalogue), golden)
    runs = []
    for i, entry in enumerate(entries):
        progress.update(i / len(entries), "reading runs")
        run = _read_report_run(folder / entry.path, entry, certificates)
        runs.append(_mark_drift(run, drifts.get(entry.sensor)))
    return _mark_exclusions(runs)


def _mark_drift(run: ReportRun, drift: SensorDrift | None) -> ReportRun:
    """Return a run whose sensor states its drift, if the run was made after the begin of it."""
    if drift is None or run.summary.start_time < drift.since:
        return run
    marked = (replace(each, drift=drift.text) if each.role == "sensor" else each for each in run.instruments)
    return replace(run, instruments=tuple(marked))


def _repetitions(runs: Sequence[ReportRun]) -> dict[str, str]:
    """Return the reason for leaving out a repeated run, by name."""
    continued_in = {
        (run.path.parent / run.record.continues).resolve(): run.name for run in runs if run.record.continues
    }
    first = {run.sha256: run.name for run in reversed(runs)}
    copies = {run.name: f"it is a copy of {first[run.sha256]}" for run in runs if first[run.sha256] != run.name}
    later = {run.name: continued_in.get(run.path.resolve()) for run in runs}
    return copies | {name: f"its points are continued in {other}" for name, other in later.items() if other}


def _mark_exclusions(runs: list[ReportRun]) -> tuple[ReportRun, ...]:
    """Set the exclusion reason of runs that must not be part of the identification."""
    repeated = _repetitions(runs)
    real = any(run.observations and not run.summary.simulated for run in runs)
    used = [run for run in runs if run.observations and not ((real and run.summary.simulated) or run.without_result)]
    maps = [run.record.amplifier_map for run in used or runs]

    def exclusion_reason(run: ReportRun) -> str:
        if run.name in repeated:
            return repeated[run.name]
        if real and run.summary.simulated:
            return "it is simulated, and there are real runs"
        if run.without_result:
            return f"{run.summary.verdict_text}: {run.summary.explanation}"
        if run.record.amplifier_map != maps[-1]:
            return "its amplifier was configured differently from the amplifier of the newest run"
        return ""

    reasons = [exclusion_reason(run) for run in runs]
    return tuple(
        replace(
            run,
            exclusion_reason=reason if run.observations else run.exclusion_reason,
            figures=() if reason else run.figures,
        )
        for run, reason in zip(runs, reasons, strict=True)
    )


def _read_report_run(file: Path, summary: RunSummary, certificates: Sequence[Certificate]) -> ReportRun:
    problem = "" if summary.readable else summary.record.reason
    try:
        if not problem:
            with Run(file) as run, translate_read_errors(file):
                return replace(_report_run_of(run, summary, certificates), sha256=file_hash(file))
    except RunReadError as error:
        problem = str(error)
    except OSError as error:
        problem = f"{file} cannot be read: {error.strerror or error}"
    return ReportRun(file, summary, problem=problem)


def _report_run_of(run: Run, summary: RunSummary, certificates: Sequence[Certificate]) -> ReportRun:
    flags = [Quality(int(each)) for each in run.points().get("quality", ())]
    exclusion_reason = ""
    observations: tuple[Observation, ...] = ()
    try:
        observations = tuple(each for each in run_observations(run) if each.usable.any())
    except ParameterError as error:
        exclusion_reason = str(error)
    figures = () if exclusion_reason else aspects_of(run.record.protocol).figures(points_of_run(run))
    return ReportRun(
        path=run.path,
        summary=summary,
        shape_count=shape_count_of_run(run),
        usable_count=sum(each.usable for each in flags),
        flag_counts=Counter(flag.description for each in flags for flag in each & ~ORIGIN_FLAGS),
        instruments=_instrument_records(run, certificates),
        record=run.record,
        observations=observations,
        figures=tuple(figure for figure in figures if figure.title and figure.has_usable_points),
        result=run_result(run),
        exclusion_reason=exclusion_reason,
    )


def _instrument_records(run: Run, certificates: Sequence[Certificate]) -> tuple[InstrumentRecord, ...]:
    """Return the instruments of a run; a certificate takes precedence over the dates of the bench file."""
    configuration, sensor = run.record.configuration, run.record.sensor
    records = []
    for role, answer in configuration.get("identities", {}).items():
        identity = str(answer)
        serial = str((configuration.get(role) or {}).get("serial") or identity.rpartition("#")[2] * ("#" in identity))
        if role != "sensor":
            records.append(InstrumentRecord(role, identity, serial))
    expires = str((configuration.get("sensor") or {}).get("expires") or "")
    gain = f"{100 * sensor.gain_relative_uncertainty:.2g} %" if sensor.gain_relative_uncertainty else ""
    records.append(InstrumentRecord("sensor", sensor.name, sensor.serial, sensor.calibrated, expires, gain))
    earlier = [each for each in certificates if each.date <= run.record.start_time[:10]]
    valid = certificates_of_bench(earlier, (r.serial for r in records), run.record.protocol)
    newest = {each.serial.casefold(): each for each in valid if each.role != "weights"}
    named = [
        each if (own := newest.get(each.serial.casefold())) is None or own.date < each.calibrated
        else replace(each, calibrated=own.date, expires=own.due, certificate=own.number)
        for each in records
    ]  # fmt: skip
    weights = (
        InstrumentRecord("weights", each.item, each.serial, each.date, each.due, certificate=each.number)
        for each in valid
        if each.role == "weights"
    )
    return (*named, *weights)


def run_label(run: ReportRun) -> str:
    """Return a short name of a run: `dwell 2026-11-28 07:04`."""
    protocol = run.summary.protocol
    return f"{aspects_of(protocol).short_name or protocol} {format_time(run.summary.start_time)}"
