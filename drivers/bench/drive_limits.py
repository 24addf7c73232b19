"""Amplifier drive limits: checks every drive; the only object that commands a source.

Rejects a drive that leaves the amplifier's input range, is too steep, or does not start and end at rest. A drive is never
clipped into an admissible one, and nothing can be switched off: rest is 2.5 V, and 0 V is -500 V on the specimen.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from drivers.bench.watchdog_interface import NoWatchdog, Watchdog
from drivers.clock import Clock
from drivers.deadlines import Deadline, in_progress
from drivers.drive_shapes import Drive, Hold, LevelPulse
from drivers.errors import BenchError, DriveRejectedError, InstrumentError, LinkError
from drivers.interfaces import (
    ByteOrderSwapper,
    DriveChecker,
    FailureReporter,
    FiniteHolder,
    HoldRenewer,
    Identity,
    LiveChecker,
    OutputReporter,
    RestTimer,
    Source,
    UnattendedEnd,
)
from model import AmplifierMap

LEVEL_ROUNDING_V = 1e-9

LEVEL_REACHED_S = 0.01
"""Time after the rise of a level played as a waveform: the duration of a point, and the delay of the instrument."""

NOT_A_LEVEL_V = 1e6
"""Largest valid number: SCPI's "not a number" and infinity are 9.91e37 and 9.9e37."""


class UnreadableLevelError(LinkError):
    """A source reports an idle level that is not a number."""


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """Drive limits at the amplifier's input.

    Args:
        slew_v_per_s: steepest admissible slope of a drive.
        step_v: largest step of a source that moves in steps.
        ramp_v_per_s: slope at which `HvAmplifier` moves between levels.
        current_limit_a: output current limit of the amplifier; 0 if unknown.
        specimen_capacitance_f: capacitance of the specimen and its cable; 0 if unknown.
        way_to_rest_s: longest way to rest from the farthest level, predicted from the source's reply time at arming.
    """

    slew_v_per_s: float = 10_000.0
    step_v: float = 0.05
    ramp_v_per_s: float = 5.0
    current_limit_a: float = 0.0
    specimen_capacitance_f: float = 0.0
    way_to_rest_s: float = 4.0

    @property
    def has_current_limit(self) -> bool:
        """Whether current limit and capacitance are given, so that a drive's current can be checked."""
        return self.current_limit_a > 0 and self.specimen_capacitance_f > 0


class HvAmplifier:
    """Checks drives against the limits, plays them on its source, and returns the source to rest."""

    def __init__(
        self,
        source: Source,
        amplifier_map: AmplifierMap,
        limits: DriveLimits,
        clock: Clock,
        watchdog: Watchdog | None = None,
    ) -> None:
        self._source = source
        self._watchdog = watchdog or NoWatchdog()
        self.map = amplifier_map
        self.limits = limits
        self._clock = clock
        self.commanded: Drive | None = None
        """The drive that was commanded last, from before its first command on; read in any thread."""
        self._drive_end_s = 0.0
        self._pulse: LevelPulse | None = None
        """The waveform of the present level, if the source plays it as one."""
        self._level_end_s = math.inf
        """Earliest bench time at which this level ends by itself."""
        self.holds_by_offset = False
        """Whether a level is held at the idle level even by a source that can play it as a finite waveform: without a measurement
        that such waveforms have the volts assumed by its driver."""
        self.measured_stop_s = 0.0
        """Duration of Stop from the commissioning of the source; 0 without commissioning."""
        self.byte_order: Callable[..., str] = (
            source.byte_order if isinstance(source, ByteOrderSwapper) else lambda _new="": ""
        )
        """Returns the byte order of the source's waveforms, a given one from now on; empty if it has no other."""
        self.on_failure: Callable[[BaseException], None] = lambda _: None
        """Callback at the first failed command of a way to rest, before its remaining commands are sent."""

    @property
    def identity(self) -> Identity:
        """Identity of the source."""
        return self._source.identity

    def check_drive_limits(self, drive: Drive) -> None:
        """Reject an inadmissible drive.

        Raises:
            DriveRejectedError: with the value, the limit and the remedy.
        """
        rest, name = self.map.rest_v, drive.kind
        for value, edge, beyond in (
            (drive.low_v, self.map.low_v, drive.low_v < self.map.low_v - LEVEL_ROUNDING_V),
            (drive.high_v, self.map.high_v, drive.high_v > self.map.high_v + LEVEL_ROUNDING_V),
        ):
            if beyond:
                raise DriveRejectedError(
                    f"{name} refused: it reaches {value:g} V at the amplifier's input "
                    f"({float(self.map.specimen_v(edge)):g} V on the specimen is the limit, at {edge:g} V); "
                    "lower its amplitude or move its offset"
                )
        if drive.slew_v_per_s > self.limits.slew_v_per_s:
            raise DriveRejectedError(
                f"{name} refused: its slope of {drive.slew_v_per_s:.4g} V/s at the amplifier's input exceeds the limit of "
                f"{self.limits.slew_v_per_s:.4g} V/s; lower its frequency or amplitude, or lengthen its rise"
            )
        current_a = self.peak_current_a(drive)
        if self.limits.has_current_limit and current_a > self.limits.current_limit_a:
            raise DriveRejectedError(
                f"{name} refused: it needs {1e3 * current_a:.3g} mA into {1e9 * self.limits.specimen_capacitance_f:.3g} nF, "
                f"and the amplifier gives {1e3 * self.limits.current_limit_a:.3g} mA; lower its frequency or amplitude"
            )
        if why := self.reason_unsupported(drive):
            raise DriveRejectedError(f"{name} refused: {why}")
        if not isinstance(drive, Hold):  # start_drive ramps to a held level and back
            for end, volts in zip(("starts", "ends"), drive.end_levels_v, strict=True):
                if abs(volts - rest) > self.limits.step_v:
                    raise DriveRejectedError(
                        f"{name} refused: it {end} at {volts:g} V, but rest is {rest:g} V (limit {self.limits.step_v:g} V); "
                        f"make it start and end at {rest:g} V"
                    )

    def reason_unsupported(self, drive: Drive) -> str:
        """Return the reason why the source cannot play a drive, with the remedy; empty if it can."""
        if isinstance(self._source, FiniteHolder) and (pulse := self._level_pulse(drive)) is not None:
            return self._source.reason_level_unsupported(pulse)
        return self._source.reason_unsupported(drive) if isinstance(self._source, DriveChecker) else ""

    @property
    def unattended_end(self) -> str:
        """Behaviour of the source at the death of program and watchdog; empty if its driver does not state it."""
        if not isinstance(self._source, UnattendedEnd):
            return ""
        if not isinstance(self._source, FiniteHolder):
            return self._source.unattended_end
        level = "stays" if self.holds_by_offset else "returns to rest by itself soon after its planned end"
        return f"{self._source.unattended_end}; a held level {level}"

    def unattended_rest_s(self, drive: Drive) -> float:
        """Return the longest time from the death of program and watchdog to rest; infinite if the drive does not end."""
        if isinstance(drive, Hold) and abs(drive.level_v - self.map.rest_v) <= LEVEL_ROUNDING_V:
            return 0.0
        if (pulse := self._level_pulse(drive)) is not None:
            return pulse.duration_s
        if not isinstance(self._source, UnattendedEnd):
            return math.inf
        return self._source.unattended_rest_s(drive, self.map.rest_v)

    @property
    def plays_to_the_end(self) -> bool:
        """Whether a drive of the source can only be stopped by waiting for its end."""
        return bool(getattr(self._source, "plays_to_the_end", False))

    @property
    def stop_wait_s(self) -> float:
        """Time for which Stop must wait for the end of the drive; 0 for a source that can abort it."""
        if not self.plays_to_the_end or math.isinf(self.remaining_s):
            return 0.0
        if self._pulse is not None and self.hastens_levels:
            return min(self.remaining_s, float(getattr(self._source, "hastened_end_s", math.inf)))
        return self.remaining_s

    @property
    def hastens_levels(self) -> bool:
        """Whether Stop plays the remainder of a level faster, for a source that cannot abort it.

        Only after a commissioning that measured that a change of frequency continues a running burst.
        """
        return bool(getattr(self._source, "hastens_levels", False))

    @hastens_levels.setter
    def hastens_levels(self, hastens: bool) -> None:
        if hasattr(self._source, "hastens_levels"):
            self._source.hastens_levels = hastens

    @property
    def holds_rewrites_back(self) -> bool:
        """Whether the driver of the card's output has refused to rewrite samples, so that Stop keeps the present sample."""
        return bool(getattr(self._source, "holds_rewrites_back", False))

    @property
    def upload_longest(self) -> Callable[[], object] | None:
        """Function that uploads the driver's longest waveform without playing it; None for a source without a memory for waveforms."""
        upload = getattr(self._source, "upload_longest", None)
        if upload is None:
            return None

        def upload_watched() -> None:
            with self._watchdog.allow_silence():
                upload()

        return upload_watched

    @property
    def starts_on_scan(self) -> bool:
        """Whether the source starts a drive on a scan of the card's input."""
        return bool(getattr(self._source, "starts_on_scan", False))

    def peak_current_a(self, drive: Drive) -> float:
        """Return the peak charging current of a drive in amperes: capacitance times slope at the electrodes."""
        gains = [self.map.slope_above] * (drive.high_v > self.map.rest_v)
        gains += [self.map.slope_below] * (drive.low_v < self.map.rest_v)
        return self.limits.specimen_capacitance_f * drive.slew_v_per_s * max(gains, default=0.0)

    def is_source_at_rest(self) -> bool:
        """Whether the source reports that it idles at rest with its output on."""
        with self._watchdog.allow_silence(), in_progress(Deadline.SOURCE_SETUP):
            return self._source.is_at_rest(self.map.rest_v, self.map.low_v, self.map.high_v)

    def is_left_live(self) -> bool:
        """Whether the source reports a drive or a level of an earlier program."""
        if not isinstance(self._source, LiveChecker):
            return False
        with self._watchdog.allow_silence(), in_progress(Deadline.SOURCE_SETUP):
            return self._source.is_left_live(self.map.rest_v, self.map.low_v, self.map.high_v)

    def may_be_left_live(self) -> bool:
        """Whether a drive or a level of an earlier program cannot be excluded."""
        try:
            return not self.is_source_at_rest() and (not isinstance(self._source, LiveChecker) or self.is_left_live())
        except InstrumentError:
            return True

    def initialize_at_rest(self) -> None:
        """Bring the source up at rest. High voltage must be disabled."""
        with self._watchdog.allow_silence(), in_progress(Deadline.SOURCE_SETUP):
            self._source.initialize_at_rest(self.map.rest_v, self.map.low_v, self.map.high_v)

    def predict_rest_s(self) -> float:
        """Return the duration of the way to rest from the farthest level; NaN if the source cannot predict it."""
        if not isinstance(self._source, RestTimer):
            return math.nan
        furthest_v = max(self.map.high_v - self.map.rest_v, self.map.rest_v - self.map.low_v)
        predicted_s = self._source.predict_rest_s(furthest_v, self.limits.ramp_v_per_s)
        return max(predicted_s, self.measured_stop_s + furthest_v / self.limits.ramp_v_per_s)

    def check_way_to_rest(self) -> float:
        """Return the predicted duration of the way to rest in seconds, NaN if unknown.

        Raises:
            DriveRejectedError: it exceeds the limit.
        """
        predicted_s = self.predict_rest_s()
        if predicted_s > self.limits.way_to_rest_s:
            raise DriveRejectedError(
                f"not armed: the way to rest would take {predicted_s:.1f} s, because {self.identity} answers slowly "
                f"(limit {self.limits.way_to_rest_s:g} s). Connect it by a faster wire (a LAN cable in the place of Wi-Fi or VPN, "
                "a higher baud rate), or raise the bench's 'way to rest' of the amplifier"
            )
        return predicted_s

    def start_drive(self, drive: Drive) -> None:
        """Check a drive and start it; a playing drive comes to rest first. A level is reached on return.

        Raises:
            DriveRejectedError: nothing was sent to the source.
            InstrumentError: the source rejected it or does not answer.
            BenchError: the watchdog has taken over the source, or has ended.
        """
        self.check_drive_limits(drive)
        with self._watchdog.allow_silence():
            self._watchdog.raise_for_status()
            self.commanded = drive
            self.return_to_rest()
            # Set before the command is sent: if the reply is lost, a playing drive must be assumed.
            self._drive_end_s = self._clock.now() + drive.duration_s
            if isinstance(self._source, FiniteHolder) and (pulse := self._level_pulse(drive)) is not None:
                self._start_level(self._source, pulse)
                return
            if isinstance(drive, Hold):
                self._drive_end_s = float("inf")
                self._ramp(drive.level_v)
            self._source.start_drive(drive)

    def _level_pulse(self, drive: Drive) -> LevelPulse | None:
        """Return the finite waveform of a level; None for another drive, for rest, or for a level held in another way."""
        rest_v = self.map.rest_v
        if (
            self.holds_by_offset
            or not isinstance(drive, Hold)
            or abs(drive.level_v - rest_v) <= LEVEL_ROUNDING_V
            or not isinstance(self._source, FiniteHolder)
        ):
            return None
        return self._source.level_pulse(drive, rest_v, self.limits.ramp_v_per_s)

    def _start_level(self, source: FiniteHolder, pulse: LevelPulse) -> None:
        self._pulse = pulse
        self._drive_end_s = self._clock.now() + pulse.duration_s
        triggered_s = source.start_level(pulse)
        self._drive_end_s = self._clock.now() + pulse.duration_s
        self._level_end_s = triggered_s + pulse.rise_s + pulse.hold_s
        if self.hastens_levels:
            self._watchdog.note_level(pulse, self.remaining_s)
        self._clock.sleep(pulse.rise_s + LEVEL_REACHED_S)

    def adopt_level(self, pulse: LevelPulse, end_s: float) -> None:
        """Adopt a level started by another process on this source, whose end may be hastened.

        Args:
            pulse: waveform of the level.
            end_s: bench time of its natural end.
        """
        adopt = getattr(self._source, "adopt_level", None)
        if adopt is not None:
            adopt(pulse, end_s)
            self._pulse, self.hastens_levels = pulse, True

    def renew_hold(self) -> None:
        """Renew a held level of a source that would return to rest by itself.

        Raises:
            InstrumentError: it was renewed too late, or the source does not answer.
        """
        if self._drive_end_s == math.inf and isinstance(self._source, HoldRenewer):
            self._source.renew_hold()

    @property
    def remaining_s(self) -> float:
        """Remaining duration of the present drive (0 at rest, infinite for a held level)."""
        return max(self._drive_end_s - self._clock.now(), 0.0)

    @property
    def level_remaining_s(self) -> float:
        """Shortest time until the present level returns to rest by itself; infinite if it does not."""
        return max(self._level_end_s - self._clock.now(), 0.0)

    def return_to_rest(self) -> None:
        """Stop the drive and ramp to rest; return when the source reports the idle level.

        Raises:
            InstrumentError: the source does not answer, or its output is off. Rest must then be established by measurement.
        """
        if self._drive_end_s > 0:
            self.force_rest()
            if isinstance(self._source, OutputReporter) and not self._source.is_output_on():
                raise InstrumentError(
                    f"the output of {self.identity} is off after a drive: the amplifier's input is open or at 0 V, up to "
                    f"{float(self.map.specimen_v(0.0)):+.0f} V on the specimen. Switch high voltage off at the amplifier; then see "
                    "at the instrument's front panel which protection or who switched it off"
                )

    def force_rest(self) -> None:
        """Stop and ramp to rest unconditionally, even if no drive was started by this object.

        Raises:
            InstrumentError: a step failed; all other steps were sent.
            BenchError: the watchdog took over the source; nothing more was sent.
        """
        with self._watchdog.allow_silence():
            failure: BaseException | None = None
            reported: list[BaseException] = []

            def report(error: BaseException) -> None:
                if not reported:
                    reported.append(error)
                    self.on_failure(error)

            if isinstance(self._source, FailureReporter):
                self._source.on_failure = report
            for way in (self._stop, partial(self._ramp_to_rest, report)):
                try:
                    way()
                except BaseException as error:
                    if isinstance(error, KeyboardInterrupt) or (
                        isinstance(error, BenchError) and not isinstance(error, InstrumentError)
                    ):
                        raise
                    failure = failure or error  # an error in a driver's code must not prevent the ramp
                    report(error)
            if isinstance(self._source, FailureReporter):
                self._source.on_failure = lambda _: None  # outside a way to rest the caller has the error
            if failure is not None:
                raise failure
            self._drive_end_s = 0.0
            if self._pulse is not None and self.hastens_levels:
                self._watchdog.forget_level()
            self._pulse, self._level_end_s = None, math.inf

    def _stop(self) -> None:
        if self._pulse is not None and isinstance(self._source, FiniteHolder):
            self._source.end_level(self._pulse.rise_s)
        else:
            self._source.stop()

    def reconnect(self) -> None:
        """Reconnect to the source; changes no output setting. Raises InstrumentError if it does not answer."""
        with self._watchdog.allow_silence():
            self._source.reconnect()

    def reconnect_and_force_rest(self) -> None:
        """Reconnect a failed link and force rest over it."""
        self.reconnect()
        self.force_rest()

    def close(self) -> None:
        """Close the link to the source; its output stays on, at rest."""
        self._source.close()

    def _ramp_to_rest(self, report: Callable[[BaseException], None]) -> None:
        try:
            self._ramp(self.map.rest_v)
        except LinkError as unread:  # unknown idle level: assume the largest distance
            report(unread)
            furthest_v = max(self.map.high_v - self.map.rest_v, self.map.rest_v - self.map.low_v)
            self._source.ramp_to(self.map.rest_v, furthest_v / self.limits.ramp_v_per_s)
            if isinstance(unread, UnreadableLevelError):
                raise

    def _ramp(self, level_v: float) -> None:
        idle_v = self._source.idle_level_v()
        if not abs(idle_v) < NOT_A_LEVEL_V:
            raise UnreadableLevelError(
                f"{self.identity} reports an idle level of {idle_v:g} V, which is not a level; the largest distance to rest is "
                "assumed. Look at the instrument's front panel"
            )
        distance = abs(idle_v - level_v)
        if distance > LEVEL_ROUNDING_V:
            self._source.ramp_to(level_v, max(distance / self.limits.ramp_v_per_s, 0.01))
