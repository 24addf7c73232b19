"""Run files of a report, found in the catalogue: observations, instruments, quality flags, hash."""

import hashlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from app.archive import Catalogue, RunFilter
from app.identification.observations import run_observations, shape_count_of_run
from model import AmplifierMap, ParameterError
from model.identification import FitOptions, Observation
from protocols.base import Quality
from protocols.runfile.reader import Run, RunReadError, translate_read_errors

ORIGIN_FLAGS = Quality.SIMULATED | Quality.IMPORTED
"""Flags that are reported elsewhere and are not faults."""

ReportProgress = Callable[[str, int, int], None]
"""Progress callback: activity, steps done, steps in all."""


@dataclass(frozen=True, slots=True)
class InstrumentRecord:
    """One instrument of a run."""

    role: str
    identity: str
    serial: str = ""
    calibrated: str = ""
    expires: str = ""
    gain: str = ""


@dataclass(frozen=True, slots=True)
class ReportRun:
    """One run of a report. `problem` says why its file could not be used."""

    path: Path
    name: str
    """Path relative to the folder."""
    protocol: str = ""
    start_time: str = ""
    state: str = ""
    simulated: bool = False
    imported: bool = False
    shape_count: int = FitOptions.n
    """Number of shape functions for its identification."""
    point_count: int = 0
    usable_count: int = 0
    flag_counts: Mapping[str, int] = field(default_factory=dict)
    instruments: tuple[InstrumentRecord, ...] = ()
    software: str = ""
    amplifier: AmplifierMap = field(default_factory=AmplifierMap)
    observations: tuple[Observation, ...] = ()
    continues: Path | None = None
    sha256: str = ""
    problem: str = ""
    exclusion_reason: str = ""
    """Why its points are excluded from the identification."""

    @property
    def expired(self) -> bool:
        """Whether the calibration of an instrument had expired when the run was made."""
        return any(each.expires and each.expires < self.start_time[:10] for each in self.instruments)


def read_report_runs(folder: Path, specimen: str, progress: ReportProgress = lambda *_: None) -> tuple[ReportRun, ...]:
    """Read every run of a specimen in a folder and below, in order of start time.

    Raises:
        OSError: the folder cannot be read.
    """
    catalogue = Catalogue(folder)
    catalogue.scan(lambda done, of: progress("looking for runs", done, of))
    entries = sorted(RunFilter(specimen=specimen).apply(catalogue.entries()), key=lambda e: (e.start_time, e.path))
    found = []
    for i, entry in enumerate(entries):
        progress("reading runs", i, len(entries))
        file = folder / entry.path
        if entry.readable:
            found.append(_read_report_run(file, entry.path))
        else:
            found.append(
                ReportRun(file, entry.path, entry.protocol, entry.start_time, entry.state, problem=entry.reason)
            )
    return _mark_exclusions(found)


def _mark_exclusions(runs: list[ReportRun]) -> tuple[ReportRun, ...]:
    """Set the exclusion reason of runs that must not be part of the identification."""
    carried = {run.continues: run.name for run in runs if run.continues is not None}
    first: dict[str, str] = {}
    for run in runs:
        first.setdefault(run.sha256, run.name)
    real = any(run.observations and not run.simulated for run in runs)
    maps = [run.amplifier for run in runs if run.observations and not (real and run.simulated)]

    def why(run: ReportRun) -> str:
        if (later := carried.get(run.path.resolve())) is not None:
            return f"its points are carried on in {later}"
        if first[run.sha256] != run.name:
            return f"it is a copy of {first[run.sha256]}"
        if real and run.simulated:
            return "it is simulated, and there are real runs"
        if run.amplifier != maps[-1]:
            return "its amplifier was configured differently from that of the newest run"
        return ""

    return tuple(replace(run, exclusion_reason=why(run)) if run.observations else run for run in runs)


def _read_report_run(file: Path, name: str) -> ReportRun:
    try:
        sha256 = _file_sha256(file)
        with Run(file) as run, translate_read_errors(file):
            found = _report_run_of(run, name)
        return replace(found, sha256=sha256)
    except RunReadError as error:
        return ReportRun(file, name, problem=str(error))
    except OSError as error:
        return ReportRun(file, name, problem=f"{file} cannot be read: {error.strerror or error}")


def _report_run_of(run: Run, name: str) -> ReportRun:
    flags = [Quality(int(each)) for each in run.points().get("quality", ())]
    counts = Counter(flag.description for each in flags for flag in each & ~ORIGIN_FLAGS)
    left_out = ""
    observations: tuple[Observation, ...] = ()
    try:
        observations = tuple(each for each in run_observations(run) if each.usable.any())
    except ParameterError as error:
        left_out = str(error)
    continues = run.resumed_from
    return ReportRun(
        path=run.path,
        name=name,
        protocol=run.protocol,
        start_time=run.start_time,
        state=run.state,
        simulated=run.simulated,
        imported=bool(run.imported),
        shape_count=shape_count_of_run(run),
        point_count=len(flags),
        usable_count=sum(each.usable for each in flags),
        flag_counts=dict(counts),
        instruments=tuple(_instrument_records(run)),
        software=", ".join(f"{name} {version}" for name, version in run.software.items()),
        amplifier=run.amplifier_map,
        observations=observations,
        continues=continues.resolve() if continues else None,
        exclusion_reason=left_out,
    )


def _instrument_records(run: Run) -> list[InstrumentRecord]:
    configuration, sensor = run.configuration, run.sensor
    found = []
    for role, identity in configuration.get("identities", {}).items():
        if role == "sensor":
            continue
        table: Mapping[str, Any] = configuration.get(role) or {}
        found.append(InstrumentRecord(role, str(identity), str(table.get("serial", "") or "")))
    expires = str((configuration.get("sensor") or {}).get("expires", "") or "")
    gain = f"{100 * sensor.gain_relative_uncertainty:.2g} %" if sensor.gain_relative_uncertainty else ""
    found.append(InstrumentRecord("sensor", sensor.name, sensor.serial, sensor.calibrated, expires, gain))
    return found


def _file_sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
