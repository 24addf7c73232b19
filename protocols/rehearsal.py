"""Rehearsal: adapts a protocol to the source, and checks it against bench and disk before arming; duration, prompts, warnings.

A protocol that cannot be run is rejected; a problem that the model predicts is a caution.
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers import BenchError, Drive, DriveRejectedError, Hold, HvAmplifier, InputChannel, LaserSensor, Meter
from model import Tactor
from protocols.base import PlanEntry, Protocol, recording_too_long_message
from protocols.registry import PROTOCOLS
from protocols.runfile import RESERVE_BYTES


@dataclass(frozen=True, slots=True)
class AdaptedProtocol:
    """A protocol that the source can play, or the requested one if no change helps.

    Attributes:
        protocol: the protocol to run.
        requested: the requested values of changed parameters; empty without changes.
        message: changes and their reason; empty without changes.
    """

    protocol: Protocol
    requested: Mapping[str, Any] = field(default_factory=dict)
    message: str = ""


def adapt_to_source(protocol: Protocol, amplifier: HvAmplifier) -> AdaptedProtocol:
    """Return the protocol with the parameters that the source can play, nearest to the requested ones. Sends nothing."""
    rest_v = amplifier.map.rest_v
    adapted = protocol.adapted(rest_v, amplifier.reason_unsupported)
    requested, played = protocol.model_dump(mode="json"), adapted.model_dump(mode="json")
    changed = {name: value for name, value in requested.items() if played[name] != value}
    if not changed:
        return AdaptedProtocol(protocol)
    reasons = (amplifier.reason_unsupported(drive) for entry in protocol.plan(rest_v) for drive in entry.drives)
    reason = next((why for why in reasons if why), "").partition(";")[0]
    values = ", ".join(f"{name} {_text(played[name])} instead of {_text(value)}" for name, value in changed.items())
    return AdaptedProtocol(adapted, changed, f"{protocol.title} is adapted to the source: {values} ({reason})")


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


BYTES_PER_SCAN = 4
"""Bytes per scan of drive and displacement, 16 bits each; further channels are not counted."""
FILE_OVERHEAD_BYTES = 200_000


class CannotRunError(BenchError):
    """A protocol's demand exceeds this bench or disk."""


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """Demands of a run, known before arming."""

    duration_s: float
    entries: int
    prompts: int
    highest_specimen_v: float
    lowest_specimen_v: float
    file_bytes: int
    worst: str
    """The moment nearest to a limit."""
    cautions: tuple[str, ...] = ()
    """Impossible checks, and problems predicted by the model."""


def rehearse(
    protocol: Protocol,
    amplifier: HvAmplifier,
    *,
    sensor: LaserSensor | None = None,
    tactor: Tactor | None = None,
    meters: Mapping[str, Meter] | None = None,
    channels: Sequence[InputChannel] | None = None,
    folder: Path | None = None,
    adapt: bool = True,
) -> Rehearsal:
    """Check every drive of a protocol against the guard and the source; return the run's requirements.

    Args:
        protocol: the protocol to run.
        amplifier: the guard, with the limits of its source.
        sensor: sensor whose range limits the stroke predicted for `tactor`.
        tactor: model of the specimen.
        meters: meters of the bench; None if unknown.
        channels: further inputs of the bench; None if unknown.
        folder: folder of the run file; None if unknown.
        adapt: whether to adapt the protocol to the source first, as for a new run.

    Raises:
        DriveRefused: a drive is not admissible, or the bench's source cannot play it.
        CannotRun: a meter or an input is missing, the sensor measures a velocity, the disk is too full, or an entry is too long for the computer's memory.
    """
    rest_v = amplifier.map.rest_v
    adapted = adapt_to_source(protocol, amplifier) if adapt else AdaptedProtocol(protocol)
    protocol = adapted.protocol
    plan = protocol.plan(rest_v)
    drives = [(entry, drive) for entry in plan for drive in entry.drives]
    _check_drives(protocol, drives, amplifier)
    if meters is not None:
        _check_meters(protocol, meters)
    if sensor is not None:
        _check_sensor(protocol, sensor)
    if channels is not None:
        _check_inputs(protocol, channels)
    _check_recordings(protocol, plan)
    duration_s = protocol.rest_record_s + sum(_entry_duration_s(entry, amplifier) for entry in plan)
    unstored_s = sum(entry.expected_s - entry.stored_s for entry in plan if entry.stored_s is not None)
    file_bytes = round((duration_s - unstored_s) * protocol.sample_rate_hz * BYTES_PER_SCAN) + FILE_OVERHEAD_BYTES
    if folder is not None:
        check_disk_space(file_bytes, folder)
    travel = None
    if drives and sensor is not None and tactor is not None and not sensor.measures_velocity:
        travel = _largest_travel(drives, amplifier, sensor, tactor)
    moments = [_highest_slew(drives, amplifier), *_highest_current(drives, amplifier), *([travel] if travel else [])]
    volts = amplifier.map.specimen_v
    return Rehearsal(
        duration_s=duration_s + (protocol.air_target.steady_s if protocol.air_target else 0.0),
        entries=len(plan),
        prompts=_count_prompts(plan, protocol.high_voltage),
        highest_specimen_v=float(volts(max((drive.high_v for _, drive in drives), default=rest_v))),
        lowest_specimen_v=float(volts(min((drive.low_v for _, drive in drives), default=rest_v))),
        file_bytes=file_bytes,
        worst=max(moments)[1] if drives else "nothing is driven",
        cautions=tuple(filter(None, (adapted.message, *(_cautions(amplifier, travel, sensor) if drives else ())))),
    )


def _check_drives(protocol: Protocol, drives: "PlannedDrives", amplifier: HvAmplifier) -> None:
    for entry, drive in drives:
        try:
            amplifier.check_drive_limits(drive)
        except DriveRejectedError as refusal:
            instead = _substitutes_text(protocol, amplifier) if amplifier.reason_unsupported(drive) else ""
            raise DriveRejectedError(f"{entry.label}: {refusal}{instead}") from None


def _check_recordings(protocol: Protocol, plan: Sequence[PlanEntry]) -> None:
    longest = max(plan, key=lambda entry: entry.expected_s, default=None)
    scans = 0.0 if longest is None else longest.expected_s * protocol.sample_rate_hz
    if longest is not None and scans > protocol.max_recording_scans:
        raise CannotRunError(f"{longest.label}: {recording_too_long_message(scans)}")


def _cautions(amplifier: HvAmplifier, travel: tuple[float, str] | None, sensor: LaserSensor | None) -> Iterator[str]:
    if sensor is not None and sensor.measures_velocity:
        yield "the abort level 'stroke' is not evaluated: the sensor measures a velocity. Check the specimen's gap by hand"
    if not amplifier.limits.has_current_limit:
        yield "the amplifier's current is not checked: the bench states no current limit of the amplifier and no capacitance of the specimen"
    if travel is not None and travel[0] > 1:
        yield (
            f"the model expects the displacement to leave the sensor's range ({travel[1]}); points there will be flagged. "
            "Lower the drive, or move the sensor so that rest is nearer to the middle of its range"
        )


def check_disk_space(file_bytes: int, folder: Path) -> None:
    """Reject a file that does not fit on the disk.

    Raises:
        CannotRun: it would leave less than the reserve for closing a run in order.
    """
    there = next(path for path in (folder, *folder.absolute().parents) if path.is_dir())
    free = shutil.disk_usage(there).free
    if file_bytes + RESERVE_BYTES > free:
        raise CannotRunError(
            f"the disk of {folder} has {free / 1e6:.0f} MB left; this takes about {file_bytes / 1e6:.0f} MB, and "
            f"{RESERVE_BYTES / 1e6:.0f} MB are kept to close a run in order. Free some space or choose another folder"
        )


def _check_meters(protocol: Protocol, meters: Mapping[str, Meter]) -> None:
    if missing := [name for name in protocol.meters if name not in meters]:
        have = ", ".join(meters) or "none"
        raise CannotRunError(
            f"{protocol.title} reads the meter '{missing[0]}', and this bench has no such meter (it has: {have}); add "
            f"[meters.{missing[0]}] to the bench file"
        )


def _check_sensor(protocol: Protocol, sensor: LaserSensor) -> None:
    if sensor.measures_velocity and not protocol.integrates_velocity:
        usable = ", ".join(name for name, each in PROTOCOLS.items() if each.integrates_velocity)
        raise CannotRunError(
            f"{protocol.title} needs the displacement with its mean, and {sensor.name} measures a velocity, of which only vibrations can be "
            f"integrated; connect a displacement sensor, or run {usable}"
        )


def _check_inputs(protocol: Protocol, channels: Sequence[InputChannel]) -> None:
    kinds = protocol.input_kinds
    if kinds and not any(channel.kind in kinds for channel in channels):
        have = ", ".join(f"{channel.name} ({channel.kind})" for channel in channels) or "none"
        raise CannotRunError(
            f"{protocol.title} needs a further input of the kind {' or '.join(kinds)}, and this bench has none (its further inputs: "
            f"{have}); wire one to the card and add [[channels]] with its kind, gain and delay to the bench file"
        )


def _entry_duration_s(entry: PlanEntry, amplifier: HvAmplifier) -> float:
    """Return the duration of an entry; a source that cannot stop plays its drives to their ends."""
    if not amplifier.plays_to_the_end:
        return entry.expected_s
    return max(entry.expected_s, sum(drive.duration_s for drive in entry.drives if not isinstance(drive, Hold)))


def _substitutes_text(protocol: Protocol, amplifier: HvAmplifier) -> str:
    """Return a sentence that names the alternative protocols on this source; empty without one."""
    rest_v, playable = amplifier.map.rest_v, []
    for name in protocol.substitutes:
        adapted = adapt_to_source(PROTOCOLS[name].model_validate({}), amplifier).protocol
        drives = [drive for entry in adapted.plan(rest_v) for drive in entry.drives]
        if not any(map(amplifier.reason_unsupported, drives)):
            playable.append(name)
    return f". On this source, run {' or '.join(playable)} instead" if playable else ""


PlannedDrives = Sequence[tuple[PlanEntry, Drive]]


def _highest_slew(drives: PlannedDrives, amplifier: HvAmplifier) -> tuple[float, str]:
    if not drives:
        return 0.0, ""
    entry, drive = max(drives, key=lambda pair: pair[1].slew_v_per_s)
    share = drive.slew_v_per_s / amplifier.limits.slew_v_per_s
    return share, f"slope {100 * share:.0f} % of its limit, at {entry.label}"


def _highest_current(drives: PlannedDrives, amplifier: HvAmplifier) -> list[tuple[float, str]]:
    """Return the drive with the largest current, if the amplifier has a stated current limit."""
    if not drives or not amplifier.limits.has_current_limit:
        return []
    entry, drive = max(drives, key=lambda pair: amplifier.peak_current_a(pair[1]))
    current_a = amplifier.peak_current_a(drive)
    share = current_a / amplifier.limits.current_limit_a
    return [(share, f"{1e3 * current_a:.2g} mA into the specimen, {100 * share:.0f} % of its limit, at {entry.label}")]


def _largest_travel(
    drives: PlannedDrives, amplifier: HvAmplifier, sensor: LaserSensor, tactor: Tactor
) -> tuple[float, str]:
    """Return the moment at which the modelled tactor is nearest to the end of the sensor's range."""
    from protocols.predicted_travel import predict_travel  # the model's numerics take a quarter of a second to import

    ends = sensor.displacement_m([sensor.valid_low_v, sensor.valid_high_v])
    low_m, high_m = float(min(ends)), float(max(ends))
    worst = (0.0, "")
    for reach in predict_travel(drives, tactor, amplifier.map):
        for at_m, end_m in ((reach.low_m, low_m), (reach.high_m, high_m)):
            share = at_m / end_m if at_m * end_m > 0 else 0.0
            if share > worst[0]:
                where = f"{1e6 * at_m:+.0f} µm predicted, {100 * share:.0f} % of the sensor's range"
                worst = (share, f"{reach.label}: {where}")
    return worst


def _count_prompts(plan: Sequence[PlanEntry], high_voltage: bool) -> int:
    """Return the number of prompts: high voltage off and on, every set-up (with both around it), and the prompts of entries."""
    prompts, current_setup = (2 if high_voltage else 1), None
    for entry in plan:
        if entry.setup is not None and entry.setup != current_setup:
            current_setup = entry.setup
            prompts += 3 if high_voltage and current_setup.hands_on else 1
        prompts += entry.prompts
    return prompts
