"""What a report takes from run files: each is looked up in the catalogue and read once."""

import hashlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from app.archive.catalogue import Catalogue
from app.archive.run_summary import Wanted
from app.config.tables import AmplifierTable
from app.identification.observations import observations, shapes_in
from model.amplifier_map import AmplifierMap
from model.identification.fit_options import Setting
from model.identification.observations import Observation
from model.parameter_spec import ParameterError
from protocols.base.quality import Quality
from protocols.runfile.reader import Run, RunError, intact

FACTS = Quality.SIMULATED | Quality.IMPORTED
"""Flags that are said elsewhere, and are no faults."""

Told = Callable[[str, int, int], None]
"""Hears what is being done, and how far it is: how many of how many."""


@dataclass(frozen=True, slots=True)
class Instrument:
    """One instrument as a run names it."""

    role: str
    identity: str
    serial: str = ""
    calibrated: str = ""
    expires: str = ""
    gain: str = ""


@dataclass(frozen=True, slots=True)
class Taken:
    """One run as the report has it. `trouble` says why nothing could be taken from its file."""

    path: Path
    name: str
    """Within the folder of runs."""
    protocol: str = ""
    start_time: str = ""
    state: str = ""
    simulated: bool = False
    imported: bool = False
    shapes: int = Setting.n
    """Shape functions it is identified with."""
    points: int = 0
    usable: int = 0
    flags: Mapping[str, int] = field(default_factory=dict)
    instruments: tuple[Instrument, ...] = ()
    software: str = ""
    amplifier: AmplifierMap = field(default_factory=AmplifierMap)
    observations: tuple[Observation, ...] = ()
    continues: Path | None = None
    sha256: str = ""
    trouble: str = ""
    left_out: str = ""
    """Why its points take no part in the identification."""

    @property
    def expired(self) -> bool:
        """Whether an instrument's calibration did not hold any more when the run was made."""
        return any(each.expires and each.expires < self.start_time[:10] for each in self.instruments)


def take(folder: Path, specimen: str, told: Told = lambda *_: None) -> tuple[Taken, ...]:
    """Every run of a specimen in a folder and below, in the order in which they were begun.

    Raises:
        OSError: the folder cannot be looked into.
    """
    catalogue = Catalogue(folder)
    catalogue.scan(lambda done, of: told("looking for runs", done, of))
    entries = sorted(Wanted(specimen=specimen).among(catalogue.entries()), key=lambda e: (e.start_time, e.path))
    found = []
    for i, entry in enumerate(entries):
        told("reading runs", i, len(entries))
        file = folder / entry.path
        if entry.readable:
            found.append(_taken(file, entry.path))
        else:
            found.append(Taken(file, entry.path, entry.protocol, entry.start_time, entry.state, trouble=entry.reason))
    return _counting(found)


def _counting(runs: list[Taken]) -> tuple[Taken, ...]:
    """Says of the runs that are better left out of the identification why."""
    carried = {run.continues: run.name for run in runs if run.continues is not None}
    first: dict[str, str] = {}
    for run in runs:
        first.setdefault(run.sha256, run.name)
    real = any(run.observations and not run.simulated for run in runs)
    maps = [run.amplifier for run in runs if run.observations and not (real and run.simulated)]

    def why(run: Taken) -> str:
        if (later := carried.get(run.path.resolve())) is not None:
            return f"its points are carried on in {later}"
        if first[run.sha256] != run.name:
            return f"it is a copy of {first[run.sha256]}"
        if real and run.simulated:
            return "it is simulated, and there are real runs"
        if run.amplifier != maps[-1]:
            return "its amplifier was configured differently from that of the newest run"
        return ""

    return tuple(replace(run, left_out=why(run)) if run.observations else run for run in runs)


def _taken(file: Path, name: str) -> Taken:
    try:
        sha256 = _hash(file)
        with Run(file) as run, intact(file):
            found = _read(run, name)
        return replace(found, sha256=sha256)
    except RunError as error:
        return Taken(file, name, trouble=str(error))
    except OSError as error:
        return Taken(file, name, trouble=f"{file} cannot be read: {error.strerror or error}")


def _read(run: Run, name: str) -> Taken:
    flags = [Quality(int(each)) for each in run.points().get("quality", ())]
    counts = Counter(flag.words for each in flags for flag in each & ~FACTS)
    left_out = ""
    told: tuple[Observation, ...] = ()
    try:
        told = tuple(each for each in observations(run) if each.use.any())
    except ParameterError as error:
        left_out = str(error)
    continues = run.continues
    return Taken(
        path=run.path,
        name=name,
        protocol=run.protocol,
        start_time=run.start_time,
        state=run.state,
        simulated=run.simulated,
        imported=bool(run.imported),
        shapes=shapes_in(run),
        points=len(flags),
        usable=sum(each.usable for each in flags),
        flags=dict(counts),
        instruments=tuple(_instruments(run)),
        software=", ".join(f"{name} {version}" for name, version in run.software.items()),
        amplifier=AmplifierTable.of(run.configuration).map,
        observations=told,
        continues=continues.resolve() if continues else None,
        left_out=left_out,
    )


def _instruments(run: Run) -> list[Instrument]:
    configuration, sensor = run.configuration, run.sensor
    found = []
    for role, identity in configuration.get("identities", {}).items():
        if role == "sensor":
            continue
        table: Mapping[str, Any] = configuration.get(role) or {}
        found.append(Instrument(role, str(identity), str(table.get("serial", "") or "")))
    expires = str((configuration.get("sensor") or {}).get("expires", "") or "")
    gain = f"{100 * sensor.gain_relative_uncertainty:.2g} %" if sensor.gain_relative_uncertainty else ""
    found.append(Instrument("sensor", sensor.name, sensor.serial, sensor.calibrated, expires, gain))
    return found


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
