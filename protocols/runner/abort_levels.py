"""Abort levels: stroke, rate, laser, drive and amplifier monitors, evaluated in every block of the acquisition."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers import (
    DISPLACEMENT_CHANNEL,
    DRIVE_CHANNEL,
    LATE_PER_SPEED_S,
    BenchError,
    Block,
    Clock,
    Drive,
    InputChannel,
    LaserSensor,
    LevelAction,
    LevelSettings,
    Scale,
)
from protocols.base import Array, DriveReadbackChanged, LevelExceeded, Prompt, Quality
from protocols.runner.readback import DriveReadback, drive_text

RATE_WINDOW_S = 2e-4
"""Time over which the displacement rate is computed: long against the sensor's noise, short against a cycle."""

REST_TOLERANCE_V = 0.05
"""Largest distance of the drive from rest in a block that gives the displacement at rest."""

MIN_LATENCY_S = 0.05
"""Time after a command in which older scans may still be in transfer; on a simulated bench at raised speed, times the speed."""

CONFIRMED_LATENCIES = 5
"""Number of latencies after a command in which, at raised speed, a deviation of the drive counts only after one latency: pauses
of a busy computer are multiplied in bench time."""

MONITOR_LEVELS = {"voltage-monitor": ("voltage", "voltage_v"), "current-monitor": ("current", "current_a")}
"""Level and limit of `LevelSettings`, by the kind of an input."""

RANGE_LEVELS = {kind: level for kind, (level, _) in MONITOR_LEVELS.items()} | {"charge": "current"}
"""Level that counts as exceeded when an input reaches the end of the card's range, by its kind: the true value is unknown."""

LEVEL_ANSWERS = ("stop", "again", "ignore")
"""Answers to the question after an exceeded level. An unattended simulated operator gives the first answer."""


def level_prompt(event: LevelExceeded) -> Prompt:
    """Return the question to the operator after an exceeded level."""
    return Prompt(
        "abort-level",
        f"{event.words}. The source is at rest. Stop the run, measure this entry again, or ignore this level for the "
        "remainder of the run (its points are flagged)?",
        choices=LEVEL_ANSWERS,
    )


def limit_prompt(event: LevelExceeded) -> Prompt:
    """Return the question to the operator after an exceeded limit of a protocol's figure."""
    text = f"{event.words}. The source is at rest. Stop the run, or go on without this limit?"
    return Prompt("abort-level", text, choices=(LEVEL_ANSWERS[0], "go on"))


class LevelExceededError(BenchError):
    """The run ends because of an exceeded abort level."""


class LevelQuestion(Exception):
    """An abort level was exceeded, and the operator decides how to proceed."""

    def __init__(self, event: LevelExceeded) -> None:
        super().__init__(event.words)
        self.event = event


class LevelMonitor:
    """Evaluates the abort levels in every block, before it is stored or shown (see drivers.bench.armed_bench.BlockMonitor).

    Stroke, rate, laser and drive are evaluated only during a drive, because hands on the specimen also move the laser. Each level
    is reported once per entry of the plan. Loss and return of the commanded drive at the card are reported at every change, for
    any action of the level `drive`.

    Args:
        settings: levels and actions of the bench.
        sensor: displacement sensor.
        rest_v: rest at the amplifier's input.
        clock: bench time.
        channels: further inputs, in the order of a block's rows from the third.
    """

    def __init__(
        self,
        settings: LevelSettings,
        sensor: LaserSensor,
        rest_v: float,
        clock: Clock,
        channels: Sequence[InputChannel] = (),
    ) -> None:
        self._settings, self._sensor, self._rest_v, self._clock = settings, sensor, rest_v, clock
        self._monitors = [
            (row, channel)
            for row, channel in enumerate(channels, DISPLACEMENT_CHANNEL + 1)
            if channel.kind in RANGE_LEVELS
        ]
        speed = float(getattr(clock, "speed", 1.0))
        self._latency_s = max(MIN_LATENCY_S, LATE_PER_SPEED_S * speed)
        self._confirmed_s = CONFIRMED_LATENCIES * self._latency_s if speed > 1 else 0.0
        self._starting_s = math.nan
        """Time of the command of the present drive at raised speed, whose replies may have been late; otherwise NaN."""
        self._muted: set[str] = set()
        self._reported: set[str] = set()
        self._events: list[LevelExceeded | DriveReadbackChanged] = []
        self.drive_lost = False
        """Whether the card sees a drive other than the commanded one."""
        self._first_lost_block = False
        """Whether the last block was the first one of a loss, which may contain the moment of the loss."""
        self._drive: Drive | None = None
        self._readback: DriveReadback | None = None
        self._fresh_scan = 0
        self._deviating_since: int | None = None
        """First scan of the latest successive blocks that deviate from the drive."""
        self._rest_m = math.nan
        """Displacement at rest; NaN before its measurement."""
        self._silent_points = 0
        """Number of latest points without response."""
        self._block_stop = 0
        self._lost_scans = 0
        """Number of latest scans with the sensor out of range."""

    @property
    def entry_flagged(self) -> bool:
        """Whether a level was exceeded in the present entry."""
        return bool(self._reported)

    def attach(self, scales: Sequence[Scale], rate_hz: float, start_time_s: float) -> None:
        """Adopt the scaling, rate and start of the acquisition."""
        self._scales, self._rate_hz, self._start_time_s = tuple(scales), rate_hz, start_time_s
        self._lag = max(round(RATE_WINDOW_S * rate_hz), 1)

    def begin_entry(self) -> None:
        """Report levels anew from now on."""
        self._reported.clear()

    def mute(self, level: str) -> None:
        """Treat a level as a warning for the remainder of the run."""
        self._muted.add(level)

    def take_events(self) -> list[LevelExceeded | DriveReadbackChanged]:
        """Return the changes of the recorded drive and the exceeded levels (each once per entry) since the last call."""
        events, self._events = self._events, []
        return events

    def drive_commanded(self) -> None:
        """Note that a drive will be started."""
        if self._confirmed_s:
            self._starting_s = self._clock.now()

    def drive_changed(self, drive: Drive | None, level_remaining_s: float = math.inf) -> None:
        """Note the start of a drive, or the return of the source to rest (None)."""
        now_s = self._clock.now()
        scan = round((now_s - self._start_time_s) * self._rate_hz)
        early_s = 0.0 if math.isnan(self._starting_s) else now_s - self._starting_s
        self._starting_s = math.nan
        self._fresh_scan = scan + math.ceil(self._latency_s * self._rate_hz)
        previous, self._drive, self._readback = self._drive, drive, None
        self._lost_scans = 0
        self._deviating_since = None
        if drive is not None:
            self._readback = DriveReadback(
                drive,
                scan,
                self._fresh_scan,
                self._rate_hz,
                self._rest_v,
                self._settings.drive_tolerance,
                previous,
                early_s,
                level_remaining_s,
            )

    def block_read(self, block: Block) -> None:
        """Evaluate a block."""
        self._block_stop = block.stop
        self._check_monitors(block)
        if self._drive is None or self._readback is None:
            self._set_drive_lost(False, block)
            self._take_rest(block)
            return
        self._check_drive(block, self._readback)
        self._check_displacement(block)

    def point_measured(self, quality: Quality) -> None:
        """Count consecutive points without response."""
        self._silent_points = self._silent_points + 1 if Quality.NO_RESPONSE in quality else 0
        limit = self._settings.no_response_points
        if self._silent_points >= limit:
            self._report(
                "no_response",
                ("displacement", float(self._silent_points), float(limit), "1"),
                f"{self._silent_points} points in succession are without response (limit {limit}); check that the tactor is under "
                "the laser sensor, that no membrane or weight holds it, and that high voltage is on",
            )
            self._silent_points = 0

    def _take_rest(self, block: Block) -> None:
        """Read the displacement at rest from a block at rest."""
        if block.start < self._fresh_scan:
            return
        volts = self._extremes(DRIVE_CHANNEL, block.raw[DRIVE_CHANNEL])
        seen = self._scales[DISPLACEMENT_CHANNEL].to_volts(block.raw[DISPLACEMENT_CHANNEL])
        if np.abs(volts - self._rest_v).max() <= REST_TOLERANCE_V and self._sensor.is_valid(seen).all():
            self._rest_m = float(self._sensor.displacement_m(seen).mean())

    def _check_drive(self, block: Block, readback: DriveReadback) -> None:
        scale = self._scales[DRIVE_CHANNEL]
        deviation = readback.check(block.start, block.raw[DRIVE_CHANNEL], scale.to_volts)
        if deviation is None:
            self._deviating_since = None
            if readback.compared:
                self._set_drive_lost(False, block)
            return
        if self._deviating_since is None:
            self._deviating_since = max(block.start, self._fresh_scan)
        to_confirm = self._deviating_since < self._fresh_scan + self._confirmed_s * self._rate_hz
        if not to_confirm or block.stop - self._deviating_since >= self._latency_s * self._rate_hz:
            self._set_drive_lost(True, block)
            self._report(
                "drive",
                ("drive", deviation.value_v, deviation.limit_v, "V"),
                f"the card sees {deviation.seen} at the amplifier's input where {drive_text(readback.drive)} (largest deviation "
                f"{deviation.value_v:.3f} V, limit {deviation.limit_v:.3f} V); {deviation.remedy}",
            )

    def _set_drive_lost(self, lost: bool, block: Block) -> None:
        if lost is self.drive_lost and not self._first_lost_block:
            return
        self._first_lost_block = lost and not self.drive_lost
        self.drive_lost = lost
        low_v, high_v = self._extremes(DRIVE_CHANNEL, block.raw[DRIVE_CHANNEL])
        self._events.append(DriveReadbackChanged(lost, float(low_v), float(high_v)))

    def _check_displacement(self, block: Block) -> None:
        raw, settings = block.raw[DISPLACEMENT_CHANNEL], self._settings
        ends = self._extremes(DISPLACEMENT_CHANNEL, raw)
        valid: NDArray[np.bool_] | None = None
        if not self._sensor.is_valid(ends).all():
            valid = self._sensor.is_valid(self._scales[DISPLACEMENT_CHANNEL].to_volts(raw))
            if valid.any():
                ends = self._extremes(DISPLACEMENT_CHANNEL, raw[valid])
        self._check_laser(block, valid)
        if valid is not None and not valid.any():
            return
        largest = float(np.abs(self._sensor.displacement_m(ends) - self._rest_m).max())
        stroke_m = math.nan if self._sensor.measures_velocity else largest
        if stroke_m > settings.stroke_limit_m:  # not without a displacement at rest
            self._report(
                "stroke",
                ("displacement", stroke_m, settings.stroke_limit_m, "m"),
                f"the specimen moved {1e3 * stroke_m:.3f} mm from rest (limit {1e3 * settings.stroke_limit_m:.3g} mm, its gap or "
                "the bench's abort level 'stroke'); lower the drive, or enter the specimen's true gap",
            )
        rate = largest if self._sensor.measures_velocity else self._displacement_rate(raw, valid)
        if rate > settings.rate_m_per_s:
            self._report(
                "rate",
                ("displacement", rate, settings.rate_m_per_s, "m/s"),
                f"the specimen moved at {rate:.2f} m/s (limit {settings.rate_m_per_s:.3g} m/s, levels.rate_m_per_s in the bench "
                "file); lower the drive, or raise the level",
            )

    def _check_monitors(self, block: Block) -> None:
        for row, channel in self._monitors:
            counts = block.raw[row]
            largest = float(np.abs(channel.values(self._extremes(row, counts))).max())
            if self._scales[row].is_clipped(np.array([counts.min(), counts.max()], np.int16)).any():
                self._report(
                    RANGE_LEVELS[channel.kind],
                    (channel.name, largest, largest, channel.unit),
                    f"the channel {channel.name} is at the end of the card's range, {largest:.4g} {channel.unit}: what it measures is unknown; "
                    "check the specimen, its cable and the input's circuit, lower the drive, or choose a less sensitive monitor",
                )
            if channel.kind not in MONITOR_LEVELS:
                continue
            level, key = MONITOR_LEVELS[channel.kind]
            if largest > (limit := float(getattr(self._settings, key))):
                self._report(
                    level,
                    (channel.name, largest, limit, channel.unit),
                    f"the channel {channel.name} reads {largest:.4g} {channel.unit} (limit {limit:.4g} {channel.unit}, levels.{key} in the bench "
                    "file); check the specimen, its cable and the amplifier, lower the drive, or raise the level",
                )

    def _check_laser(self, block: Block, valid: NDArray[np.bool_] | None) -> None:
        """Count the scans with the sensor out of range without interruption."""
        count = block.raw.shape[1]
        if valid is None:
            self._lost_scans = 0
            return
        at = np.flatnonzero(valid)
        if at.size:
            longest = max(self._lost_scans + int(at[0]), int(np.diff(at, append=count).max()) - 1)
            self._lost_scans = count - 1 - int(at[-1])
        else:
            longest = self._lost_scans = self._lost_scans + count
        lost_s = longest / self._rate_hz
        if lost_s > self._settings.laser_lost_s:
            volts = float(self._scales[DISPLACEMENT_CHANNEL].to_volts(block.raw[DISPLACEMENT_CHANNEL, -1:])[0])
            self._report(
                "laser_lost",
                ("displacement", lost_s, self._settings.laser_lost_s, "s"),
                f"the laser sensor has been out of range for {lost_s:.2f} s under a drive (limit {self._settings.laser_lost_s:g} s; "
                f"its output is at {volts:.2f} V, valid are {self._sensor.valid_low_v:g} to {self._sensor.valid_high_v:g} V); bring "
                "the target into the sensor's range",
            )

    def _displacement_rate(self, raw: NDArray[np.int16], valid: NDArray[np.bool_] | None) -> float:
        """Return the largest displacement rate in metres per second, by the straight line through the card's polynomial."""
        lag = self._lag
        if raw.size <= lag:
            return 0.0
        change = np.subtract(raw[lag:], raw[:-lag], dtype=np.int32)
        if valid is not None:
            change = change[valid[lag:] & valid[:-lag]]
        counts = max(int(change.max()), -int(change.min())) if change.size else 0
        per_count = self._scales[DISPLACEMENT_CHANNEL].coefficients[1] * self._sensor.gain_m_per_v
        return abs(counts * per_count) * self._rate_hz / lag

    def _extremes(self, channel: int, raw: NDArray[np.int16]) -> Array:
        """Return lowest and highest volts, (2,)."""
        return np.sort(self._scales[channel].to_volts(np.array([raw.min(), raw.max()], np.int16)))

    def _report(self, level: str, figure: tuple[str, float, float, str], words: str) -> None:
        action: LevelAction = getattr(self._settings, level)
        if action is LevelAction.OFF or level in self._reported:
            return
        self._reported.add(level)
        action = LevelAction.WARNING if level in self._muted else action
        time_s = self._block_stop / self._rate_hz
        self._events.append(LevelExceeded(level, time_s, *figure, str(action), words[:1].upper() + words[1:]))
