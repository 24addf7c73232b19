"""Recalibration of runs: raw samples are reduced again with corrected sensor and amplifier tables."""

import hashlib
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from app.config import AmplifierTable, ConfigError, load_bench
from drivers import LaserSensor
from model import Array
from protocols import protocol_of_run
from protocols.base import EntryStarted, PointMeasured, Recording, to_jsonable
from protocols.runfile import AIR_COLUMNS, ENTRY_COLUMN, Run, RunReadError, RunRecord, point_columns, reads_run


@dataclass(frozen=True, slots=True)
class Correction:
    """Corrected sensor and amplifier of a bench file; None where the file has no such table."""

    path: Path
    sha256: str
    sensor: LaserSensor | None
    amplifier: AmplifierTable | None

    @classmethod
    def from_bench_file(cls, path: Path) -> Self:
        """Read the correction from a bench file.

        Raises:
            ConfigError: it is not a bench file, or has neither table.
        """
        config = load_bench(str(path))
        given = config.model_fields_set
        if not given & {"sensor", "amplifier"}:
            raise ConfigError(
                f"{path} has neither [sensor] nor [amplifier]: there is nothing in it to correct a run with"
            )
        sensor = config.sensor.laser_sensor if "sensor" in given else None
        amplifier = config.amplifier if "amplifier" in given else None
        return cls(path, hashlib.sha256(path.read_bytes()).hexdigest(), sensor, amplifier)

    def open(self, path: Path) -> Run:
        """Open a run with this correction; imported runs are opened uncorrected.

        Raises:
            RunReadError: the run was made with another sensor or amplifier, or cannot be reduced again.
        """
        with Run(path) as run:
            stored = run.record
        if stored.imported:
            return Run(path)
        recorded_amplifier = dict(stored.configuration.get("amplifier", {}))
        for role, was, now in (
            ("sensor", stored.sensor.serial, self.sensor and self.sensor.serial),
            ("amplifier", str(recorded_amplifier.get("serial", "")), self.amplifier and self.amplifier.serial),
        ):
            if was and now is not None and was != now:
                serial = f"serial number {now}" if now else "no serial number"
                raise RunReadError(
                    f"{path.name} was measured with the {role} of serial number {was}, and {self.path} has {serial}: give the "
                    "bench file of that instrument, or leave the run out"
                )
        return RecalibratedRun(path, self)

    def describe_changes(self, path: Path) -> str:
        """Return the changes by the correction in one run as text; empty without changes."""
        with Run(path) as run:
            if run.record.imported:
                return f"{path.name} was imported and has no raw samples: it is used unchanged"
            was, map_ = run.record.sensor, run.record.amplifier_map
        changed = [
            f"{name} {_format_value(old)} -> {_format_value(new)}"
            for before, after in ((was, self.sensor), (map_, self.amplifier and self.amplifier.amplifier_map))
            if after is not None
            for name in (f.name for f in fields(before))
            if (old := getattr(before, name)) != (new := getattr(after, name)) and name not in ("expires", "name")
        ]
        return f"{path.name} reduced again from its raw samples: {', '.join(changed)}" if changed else ""

    def as_record(self) -> dict[str, Any]:
        """Return the record that is stored in a calibration based on this correction."""
        return {
            "bench": self.path.name,
            "sha256": self.sha256,
            "sensor": to_jsonable(self.sensor),
            "amplifier": self.amplifier.model_dump() if self.amplifier else None,
        }


@reads_run
class RecalibratedRun(Run):
    """Run file read with another calibration: card volts as recorded, metres and specimen volts as corrected."""

    def __init__(self, path: Path, correction: Correction) -> None:
        super().__init__(path)
        self._correction = correction

    def stored_setup(self) -> RunRecord:
        """Return the record without results with the corrected sensor and amplifier."""
        stored, now = super().stored_setup(), self._correction.amplifier
        configuration = {**stored.configuration, **({"amplifier": now.model_dump()} if now else {})}
        return replace(stored, sensor=self._correction.sensor or stored.sensor, configuration=configuration)

    def points(self) -> dict[str, Array]:
        """Return the points reduced again, one per entry, from its latest recordings."""
        return self._reduced_points

    @cached_property
    def _reduced_points(self) -> dict[str, Array]:
        protocol = protocol_of_run(self, self.path.name)
        begun, measured = self.entries(), set(super().points()[ENTRY_COLUMN].astype(int).tolist())
        made = []
        for entry, recordings in sorted(self._latest_recordings().items()):
            if not recordings or entry not in measured or entry not in begun:
                continue
            try:
                made.append((entry, protocol.point(begun[entry].key, recordings, self.record.simulated)))
            except ValueError as error:
                raise RunReadError(f"{self.path.name}, {begun[entry].label}: {error}") from error
        if missing := measured - {entry for entry, _ in made}:
            raise RunReadError(
                f"{self.path.name}: the raw samples of {len(missing)} of its points are missing; also give the run that it continues"
            )
        names = list(point_columns(protocol.point_type))
        table = {name: np.array([getattr(point, name) for _, point in made], float) for name in names}
        stored = super().points()
        rows = {entry: row for row, entry in enumerate(stored[ENTRY_COLUMN].astype(int).tolist())}
        at = [rows[entry] for entry, _ in made]
        table |= {name: stored[name][at] for name in AIR_COLUMNS if name in stored}
        return table | {ENTRY_COLUMN: np.array([entry for entry, _ in made])}

    def _latest_recordings(self) -> dict[int, list[Recording]]:
        """Return the recordings of each point: since the last start of its entry, in the file that last measured it."""
        recordings: dict[int, list[Recording]] = {}
        for earlier in self.earlier_runs():
            with RecalibratedRun(earlier, self._correction) as before:
                before._add_recordings(recordings)
        self._add_recordings(recordings)
        return recordings

    def _add_recordings(self, recordings: dict[int, list[Recording]]) -> None:
        own, begun = list(self.trace.recordings()), dict[int, int]()
        for event in self.events(EntryStarted.kind, PointMeasured.kind):
            if event.kind == EntryStarted.kind:
                begun[int(event.fields["index"])] = event.row
            elif event.kind == PointMeasured.kind:
                entry = int(event.fields.get("entry", event.fields["index"]))
                since = begun.get(entry, 0)
                mine = [r for r in own if r.entry == entry and since <= r.rows[0] and r.rows[1] <= event.row]
                # A point carried over has no recordings in this file.
                recordings[entry] = mine or recordings.get(entry, [])


def _format_value(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value) or "none"
