"""Runs as a corrected calibration would have had them: their raw samples are reduced anew, their files stay as they are."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from app.config.bench_file import ConfigError, load_bench
from app.config.tables import AmplifierTable
from drivers.sensors.laser_sensor import LaserSensor
from protocols.base.events import EntryBegan, PointMeasured
from protocols.base.jsonable import plain
from protocols.base.records import Recording
from protocols.resume import protocol_of
from protocols.runfile.reader import Run, RunError
from protocols.runfile.schema import ENTRY, columns


@dataclass(frozen=True, slots=True)
class Correction:
    """The sensor and the amplifier as a bench file says now that they were; None where it says nothing of one."""

    path: Path
    sha256: str
    sensor: LaserSensor | None
    amplifier: AmplifierTable | None

    @classmethod
    def of(cls, path: Path) -> Self:
        """What a bench file says.

        Raises:
            ConfigError: it is none, or says nothing of either.
        """
        config = load_bench(str(path))
        told = config.model_fields_set
        if not told & {"sensor", "amplifier"}:
            raise ConfigError(
                f"{path} has neither [sensor] nor [amplifier]: there is nothing in it to correct a run with"
            )
        sensor = config.sensor.sensor if "sensor" in told else None
        amplifier = config.amplifier if "amplifier" in told else None
        return cls(path, hashlib.sha256(path.read_bytes()).hexdigest(), sensor, amplifier)

    def opened(self, path: Path) -> Run:
        """A run with this correction; one that was imported has nothing to correct, and is as it was.

        Raises:
            RunError: the run was made with another sensor or amplifier, or cannot be reduced anew.
        """
        run = CorrectedRun(path, self)
        if run.imported:
            run.close()
            return Run(path)
        try:
            for role, was, now in (
                ("sensor", run.measured_with.serial, self.sensor and self.sensor.serial),
                ("amplifier", str(run.amplifier_then.get("serial", "")), self.amplifier and self.amplifier.serial),
            ):
                if was and now is not None and was != now:
                    told = f"serial number {now}" if now else "no serial number"
                    raise RunError(
                        f"{path.name} was measured with the {role} of serial number {was}, and {self.path} has {told}: give the "
                        "bench file of that instrument, or leave the run out"
                    )
        except RunError:
            run.close()
            raise
        return run

    def words(self, path: Path) -> str:
        """What it changes in one run, in a sentence; empty where nothing."""
        with Run(path) as run:
            if run.imported:
                return f"{path.name} was imported and has no raw samples: it stays as it is"
            was, map_ = run.sensor, AmplifierTable.of(run.configuration).map
        changed = [
            f"{name} {_short(old)} -> {_short(new)}"
            for before, after in ((was, self.sensor), (map_, self.amplifier and self.amplifier.map))
            if after is not None
            for name in (f.name for f in fields(before))
            if (old := getattr(before, name)) != (new := getattr(after, name)) and name not in ("expires", "name")
        ]
        return f"{path.name} reduced anew from its raw samples: {', '.join(changed)}" if changed else ""

    def as_record(self) -> dict[str, Any]:
        """What goes into a calibration that rests on it."""
        return {
            "bench": self.path.name,
            "sha256": self.sha256,
            "sensor": plain(self.sensor),
            "amplifier": self.amplifier.model_dump() if self.amplifier else None,
        }


class CorrectedRun(Run):
    """A run file read with another calibration: volts are the card's, metres and volts on the specimen the correction's."""

    def __init__(self, path: Path, correction: Correction) -> None:
        super().__init__(path)
        self._correction = correction

    @property
    def sensor(self) -> LaserSensor:
        return self._correction.sensor or self.measured_with

    @property
    def measured_with(self) -> LaserSensor:
        """The sensor as the file has it."""
        return super().sensor

    @property
    def amplifier_then(self) -> Mapping[str, Any]:
        """The amplifier's table as the file has it."""
        return dict(super().configuration.get("amplifier", {}))

    @property
    def configuration(self) -> dict[str, Any]:
        now = self._correction.amplifier
        return super().configuration | ({"amplifier": now.model_dump()} if now else {})

    def points(self) -> dict[str, NDArray[np.float64]]:
        """The points reduced anew, one an entry: the latest recordings of it count."""
        return self._again

    @cached_property
    def _again(self) -> dict[str, NDArray[np.float64]]:
        protocol = protocol_of(self, self.path.name)
        begun, measured = self.entries(), set(super().points()[ENTRY].astype(int).tolist())
        made = []
        for entry, recordings in sorted(self._latest().items()):
            if not recordings or entry not in measured or entry not in begun:
                continue
            try:
                made.append((entry, protocol.point(begun[entry].key, recordings, self.simulated)))
            except ValueError as error:
                raise RunError(f"{self.path.name}, {begun[entry].label}: {error}") from error
        if missing := measured - {entry for entry, _ in made}:
            raise RunError(
                f"{self.path.name}: the raw samples of {len(missing)} of its points are not there; bring the run it goes on with"
            )
        names = list(columns(protocol.point_type))
        table = {name: np.array([getattr(point, name) for _, point in made], float) for name in names}
        return table | {ENTRY: np.array([entry for entry, _ in made])}

    def _latest(self) -> dict[int, list[Recording]]:
        """The recordings each point was made of: since its entry was last begun, in the file that last measured it."""
        found: dict[int, list[Recording]] = {}
        if (earlier := self.continues) is not None and earlier.exists():
            with CorrectedRun(earlier, self._correction) as before:
                found = before._latest()
        own, begun = list(self.trace.recordings()), dict[int, int]()
        for event in self.events():
            if event.kind == EntryBegan.kind:
                begun[int(event.fields["index"])] = event.row
            elif event.kind == PointMeasured.kind:
                entry = int(event.fields.get("entry", event.fields["index"]))
                since = begun.get(entry, 0)
                mine = [r for r in own if r.entry == entry and since <= r.rows[0] and r.rows[1] <= event.row]
                found[entry] = mine or found.get(entry, [])  # a point that was carried over has none here
        return found


def _short(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value) or "none"


Open = Callable[[Path], Run]
"""How a run file is opened: as it is, or corrected."""
