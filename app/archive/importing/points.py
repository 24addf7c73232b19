"""From somebody's table to a run file: values in SI with their errors, each said to be imported, and where they came from.

A run made so has no raw samples, no instruments and no events, and pretends to none; what the table does not tell is NaN.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.archive.importing.columns import ImportingError, Matched
from app.archive.importing.table import Sheet
from app.archive.importing.values import Asked, Source, add_errors, repeated, sources, values_of
from app.common.progress import Tell, untold
from drivers.sensors.laser_sensor import LaserSensor
from protocols.base.events import Status
from protocols.base.protocol import Protocol
from protocols.base.quality import Quality
from protocols.base.records import Curve
from protocols.registry import PROTOCOLS
from protocols.runfile.schema import ENTRY, columns
from protocols.runfile.writer import Header, RunFile

Array = NDArray[np.float64]
STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, slots=True)
class Taken:
    """A table as points of a protocol, before anything is written."""

    protocol: type[Protocol]
    points: tuple[Any, ...]
    entries: tuple[int, ...]
    parameters: Mapping[str, Any]
    sources: tuple[Source, ...]
    files: tuple[tuple[str, str], ...]
    """Name and SHA-256 of every file."""
    cautions: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    curves: tuple[Curve, ...] = ()

    @property
    def simulated(self) -> bool:
        """Whether any point says so."""
        return any(Quality(point.quality) & Quality.SIMULATED for point in self.points)


def take(sheet: Sheet, matched: Matched, asked: Asked, tell: Tell = untold) -> Taken:
    """The points of a table.

    Raises:
        ImportingError, SheetError: a sentence that says which cell is wrong and what would do.
    """
    values, cautions = values_of(sheet, matched, asked, tell)
    rows = len(next(iter(values.values())))
    kind = matched.kind
    parameters = dict(asked.settings)
    protocol = PROTOCOLS[kind.protocol]
    match kind.name:
        case "sine-dwell" | "membrane-series":
            protocol = _dwell(sheet, values, asked, parameters, cautions)
        case "static-loading":
            _loads(values, parameters, cautions)
        case "voltage-steps":
            _steps(sheet, matched, values, asked, cautions)
        case "membrane-sag":
            parameters = protocol(**asked.settings).model_dump(mode="json")
            cautions.append(
                "the strip's geometry and weight are the protocol's unless --set says otherwise: see 'parameters'"
            )
    cautions += repeated(sheet, matched, values, rows)
    add_errors(kind, values, asked, cautions)
    flags = Quality.IMPORTED | (
        Quality.SIMULATED if asked.simulated or "SIMULATED" in sheet.path.name else Quality.GOOD
    )
    told = values.pop("quality", np.zeros(rows))
    entries = values.pop(ENTRY, np.arange(rows, dtype=float))
    points = tuple(_points(protocol.point_type, values, [int(q) | int(flags) for q in told]))
    return Taken(
        protocol,
        points,
        tuple(int(e) for e in entries),
        parameters,
        tuple(sources(matched, asked)),
        ((sheet.path.name, sheet.sha256),),
        tuple(cautions),
        tuple(cells.head for cells in matched.left),
    )


def store(taken: Taken, asked: Asked, folder: Path) -> Path:
    """Write the run file; its path.

    Raises:
        StoreError: it cannot be written.
    """
    names = ", ".join(name for name, _ in taken.files)
    nothing = math.nan
    header = Header(
        protocol=taken.protocol.name,
        title=taken.protocol.title,
        parameters=dict(taken.parameters),
        point_type=taken.protocol.point_type,
        axes=taken.protocol.axes,
        sensor=LaserSensor(
            asked.sensor or "not told (imported)", nothing, nothing, nothing, nothing, nothing, asked.gain_error
        ),
        bench={"amplifier": asked.amplifier.model_dump(), "identities": {}},
        simulated=taken.simulated,
        specimen=asked.specimen,
        imported={
            "files": [{"name": name, "sha256": sha256} for name, sha256 in taken.files],
            "columns": {s.name: {"column": s.head, "unit": s.unit} for s in taken.sources},
            "left_out": list(taken.left),
            "uncertainty": dict(asked.uncertainty),
            "cautions": list(taken.cautions),
            "measured": asked.begun.isoformat() if asked.begun else None,
        },
        begun=asked.begun,
    )
    file = RunFile.new(folder, header)
    for entry, point in zip(taken.entries, taken.points, strict=True):
        file.point(point, entry)
    hashes = ", ".join(f"{name} (SHA-256 {sha256[:16]}...)" for name, sha256 in taken.files)
    file.finish(Status.COMPLETED, f"from {hashes if len(taken.files) < 4 else names}", curves=taken.curves)
    return file.path


def _dwell(
    sheet: Sheet, values: dict[str, Array], asked: Asked, parameters: dict[str, Any], cautions: list[str]
) -> type[Protocol]:
    """Complete a dwell: its drive, and the membrane it stood on."""
    rows = len(values["frequency"])
    rest_v = asked.amplifier.rest_v
    if "drive_peak_to_peak" in values:
        values["drive_amplitude"] = values.pop("drive_peak_to_peak") / 2
    if "drive_amplitude" not in values:
        if "peak_to_peak_v" not in asked.settings:
            raise ImportingError(
                f"{sheet.path}: nothing tells how large the drive was; say it, max - min at the amplifier's input: "
                '--set "peak_to_peak_v=5 V", or name its column: --column drive_peak_to_peak=NAME'
            )
        values["drive_amplitude"] = np.full(rows, asked.settings["peak_to_peak_v"] / 2)
    if (beyond := np.flatnonzero(values["drive_amplitude"] > 1.05 * (asked.amplifier.high_v - rest_v))).size:
        raise ImportingError(
            f"{sheet.path}, {sheet.places[beyond[0]]}: a drive of {2 * values['drive_amplitude'][beyond[0]]:.4g} V, max - min, leaves the "
            f"amplifier's range of {asked.amplifier.low_v:g} to {asked.amplifier.high_v:g} V around {rest_v:g} V; give the volts at its input"
        )
    parameters.setdefault("peak_to_peak_v", 2 * float(np.nanmax(values["drive_amplitude"])))
    if "drive_offset" not in values:
        values["drive_offset"] = np.full(rows, rest_v)
        cautions.append(f"the drive is taken to swing around rest, {rest_v:g} V at the amplifier's input")
    if asked.elongation_m is not None:
        if "elongation" in values:
            raise ImportingError(f"{sheet.path} has a column for the elongation: leave --membrane-elongation away")
        values["elongation"] = np.full(rows, asked.elongation_m)
    if "elongation" not in values:
        return PROTOCOLS["sine-dwell"]
    if "part" not in values:
        each = values["elongation"]
        new = np.concatenate(([False], ~((each[1:] == each[:-1]) | (np.isnan(each[1:]) & np.isnan(each[:-1])))))
        values["part"] = np.cumsum(new).astype(float)
    return PROTOCOLS["membrane-series"]


def _loads(values: dict[str, Array], parameters: dict[str, Any], cautions: list[str]) -> None:
    gravity = float(parameters.get("gravity_m_per_s2", STANDARD_GRAVITY))
    if "load" not in values:
        values["load"] = gravity * values["mass"]
        if "mass_errors" in values:
            values.setdefault("load_errors", gravity * values.pop("mass_errors"))
    values.setdefault("mass", values["load"] / gravity)
    if "side" not in values:
        side = {"MFC up": 1.0, "aluminium up": -1.0}.get(str(parameters.get("sides", "")), math.nan)
        values["side"] = np.full(len(values["load"]), side)
        if math.isnan(side):
            cautions.append(
                'no column says which side was pushed: taken as the mean of both (--set "sides=MFC up" says otherwise)'
            )


def _steps(sheet: Sheet, matched: Matched, values: dict[str, Array], asked: Asked, cautions: list[str]) -> None:
    map_ = asked.amplifier.map
    if "level" not in values and "drive" in values:
        values["level"] = values["drive"]
    if "level" not in values:
        values["level"] = map_.input_v(values.pop("specimen_voltage"))
        cautions.append(
            f"volts on the specimen are turned into volts at the input by {map_.slope_below:g} and {map_.slope_above:g} V/V around {map_.rest_v:g} V"
        )
    level = values["level"]
    if (wrong := np.flatnonzero((level < map_.low_v - 0.05) | (level > map_.high_v + 0.05))).size:
        cells = next(matched.of[name] for name in ("level", "drive", "specimen_voltage") if name in matched.of)
        raise ImportingError(
            f"{sheet.at(int(wrong[0]), cells)}: {level[wrong[0]]:.4g} V leaves the amplifier's input range of {map_.low_v:g} to {map_.high_v:g} V; "
            f'volts on the specimen are named so: --column "specimen_voltage={cells.head}"'
        )
    cautions.append(f"deflections are taken as against rest, {map_.rest_v:g} V at the amplifier's input")


def _points(point_type: type, values: Mapping[str, Array], flags: Sequence[int]) -> Iterator[Any]:
    wide = {name: width for name, (_, _, width) in columns(point_type).items() if width}
    for row, quality in enumerate(flags):
        made: dict[str, Any] = {}
        for each in fields(point_type):
            if each.name in wide:
                parts = (values.get(f"{each.name}_{i}") for i in range(1, wide[each.name] + 1))
                made[each.name] = tuple(math.nan if part is None else float(part[row]) for part in parts)
            elif each.name in values:
                made[each.name] = float(values[each.name][row])
            else:
                made[each.name] = math.nan
        made["quality"] = quality
        yield point_type(**made)
