"""Commands and volts that the amplifier's drive limits let through: order, durations, currents, what the watchdog allows."""

import contextlib
import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from drivers.bench.armed_bench import longest_unmoved_s
from drivers.bench.drive_limits import DriveLimits, HvAmplifier
from drivers.bench.watchdog_interface import NoWatchdog
from drivers.drive_shapes import Drive, Hold, LevelPulse, Ramp, Sine, Steps
from drivers.errors import BenchError, DriveRejectedError, InstrumentError, LinkError
from drivers.interfaces import Identity
from model.amplifier_map import AmplifierMap
from sim_hardware.clock import VirtualClock

pytestmark = pytest.mark.one_in(1)

NARROW = AmplifierMap(rest_v=2.0, low_v=0.5, high_v=4.5)
BURST = Sine(100.0, 1.0, 2.5, 50)


class PlayedSource:
    """A source whose output and commands are recorded, together with what the watchdog knew at each of them."""

    identity = Identity("test", "source")

    def __init__(self, watched: list[str] | None = None) -> None:
        self.level_v, self.sent, self.closed = 2.5, [], False
        self._watched = watched if watched is not None else []

    def start_drive(self, drive: Drive) -> None:
        self._send(drive)

    def stop(self) -> None:
        self._send("stop")

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        self._send(Ramp(self.level_v, level_v, duration_s))
        self.level_v = level_v

    def idle_level_v(self) -> float:
        return self.level_v

    def reconnect(self) -> None:
        self._send("reconnect")

    def initialize_at_rest(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._send(("initialize", rest_v, low_v, high_v))

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        self._send(("is_at_rest", rest_v, low_v, high_v))
        return abs(self.level_v - rest_v) < 1e-3

    def close(self) -> None:
        self.closed = True

    def _send(self, command: object) -> None:
        self.sent.append(command)
        self._watched.append(f"sent {command if isinstance(command, str) else type(command).__name__}")


class CheckingSource(PlayedSource):
    """A source that can tell what it cannot play, what was left on it, and how long its way to rest takes."""

    left_live = False
    rest_s = 1.0

    def reason_unsupported(self, drive: Drive) -> str:
        return "it has no memory for steps" if isinstance(drive, Steps) else ""

    def is_left_live(self, rest_v: float, low_v: float, high_v: float) -> bool:
        self._send(("is_left_live", rest_v, low_v, high_v))
        return self.left_live

    def predict_rest_s(self, distance_v: float, ramp_v_per_s: float) -> float:
        return self.rest_s + distance_v / ramp_v_per_s


class RecordingWatchdog(NoWatchdog):
    """Notes when silence is allowed and when its state is asked for."""

    def __init__(self, watched: list[str]) -> None:
        super().__init__()
        self._watched, self.has_ended = watched, False

    @contextlib.contextmanager
    def allow_silence(self, _seconds: float | None = None, /) -> Iterator[None]:
        self._watched.append("silence allowed")
        yield
        self._watched.append("silence over")

    def raise_for_status(self) -> None:
        self._watched.append("asked")
        if self.has_ended:
            raise BenchError("the watchdog has ended")


def commanded(source: PlayedSource, clock: VirtualClock | None = None, **limits: float) -> HvAmplifier:
    return HvAmplifier(source, AmplifierMap(), DriveLimits(**limits), clock or VirtualClock())


# -- what is admitted ------------------------------------------------------------------------------------------------------


@pytest.mark.one_in(1)  # both sides of each limit
@pytest.mark.parametrize(
    ("drive", "admitted"),
    [
        (Sine(100, 2.5, 2.5, 5), True),  # the whole range of the amplifier
        (Sine(100, 2.5 + 1e-6, 2.5, 5), False),
        (Hold(5.0, 1.0), True),
        (Hold(5.0 + 1e-6, 1.0), False),
        (Hold(-1e-6, 1.0), False),
        (Sine(9_999.0 / (2 * math.pi), 1.0, 2.5, 5), True),
        (Sine(10_001.0 / (2 * math.pi), 1.0, 2.5, 5), False),
        (Ramp(2.5, 2.549, 1.0), True),
        (Ramp(2.5, 2.551, 1.0), False),
        (Ramp(2.451, 2.5, 1.0), True),
        (Ramp(2.449, 2.5, 1.0), False),
    ],
)
def test_limits_of_a_bench_without_a_file(drive: Drive, admitted: bool) -> None:
    source = PlayedSource()
    amplifier = commanded(source)
    if admitted:
        amplifier.start_drive(drive)
        assert source.sent[-1] == drive
    else:
        with pytest.raises(DriveRejectedError):
            amplifier.start_drive(drive)
        assert source.sent == []


def test_a_held_level_of_a_bench_without_a_file_is_reached_at_five_volts_per_second() -> None:
    source = PlayedSource()
    commanded(source).start_drive(Hold(4.5, 1.0))
    assert source.sent[0] == Ramp(2.5, 4.5, 0.4)


def test_even_the_smallest_ramp_takes_ten_milliseconds_and_none_is_sent_for_no_distance() -> None:
    source = PlayedSource()
    amplifier = commanded(source)
    amplifier.start_drive(Hold(2.501, 1.0))
    assert source.sent[0] == Ramp(2.5, 2.501, 0.01)
    source.sent.clear()
    source.level_v = 2.5
    amplifier.force_rest()
    assert source.sent == ["stop"]


@pytest.mark.parametrize(
    "drive",
    [
        Sine(100, 1.0, 2.5, 5),  # to both sides
        Steps((2.5, 4.0, 2.5), 0.1, 0.05),  # above rest only
        Steps((2.5, 1.0, 2.5), 0.1, 0.05),  # below rest only
        Hold(4.0, 1.0),
    ],
)
def test_the_current_of_a_drive_is_what_its_volts_charge_the_specimen_with(drive: Drive) -> None:
    capacitance_f = 3e-9
    amplifier = commanded(PlayedSource(), specimen_capacitance_f=capacitance_f)
    t = np.linspace(0, drive.duration_s, 100_001)
    charge = capacitance_f * AmplifierMap().specimen_v(drive.volts(t))
    flows = float(np.abs(np.diff(charge)).max() / (t[1] - t[0]))
    assert amplifier.peak_current_a(drive) == pytest.approx(flows, rel=0.03)


def test_a_drive_that_needs_more_current_than_the_amplifier_gives_is_refused() -> None:
    needs_a = 3e-9 * 600 * 2 * math.pi * 100
    source = PlayedSource()
    with pytest.raises(DriveRejectedError, match=r"needs 1\.13 mA into 3 nF, and the amplifier gives 1\.07 mA"):
        commanded(source, current_limit_a=0.95 * needs_a, specimen_capacitance_f=3e-9).start_drive(BURST)
    assert source.sent == []
    commanded(source, current_limit_a=1.05 * needs_a, specimen_capacitance_f=3e-9).start_drive(BURST)
    assert source.sent == [BURST]


@pytest.mark.parametrize(("limit_a", "capacitance_f"), [(0.0, 3e-9), (1e-6, 0.0), (0.0, 0.0)])
def test_without_a_capacitance_or_a_limit_no_current_is_judged(limit_a: float, capacitance_f: float) -> None:
    source = PlayedSource()
    amplifier = commanded(source, current_limit_a=limit_a, specimen_capacitance_f=capacitance_f)
    assert not amplifier.limits.has_current_limit
    amplifier.start_drive(BURST)
    assert source.sent == [BURST]


def test_a_bench_without_a_file_knows_no_capacitance() -> None:
    assert commanded(PlayedSource()).peak_current_a(BURST) == 0.0
    assert not DriveLimits(current_limit_a=1e-3).has_current_limit


def test_what_a_source_cannot_play_is_refused_and_what_it_can_is_played() -> None:
    source = CheckingSource()
    amplifier = commanded(source)
    with pytest.raises(DriveRejectedError, match="Steps refused: it has no memory for steps"):
        amplifier.start_drive(Steps((2.5, 3.0, 2.5), 0.1, 0.05))
    assert source.sent == []
    amplifier.start_drive(BURST)
    assert source.sent == [BURST]


# -- what the source says ------------------------------------------------------------------------------------------------


def test_the_source_is_asked_and_set_up_with_the_levels_of_the_amplifier() -> None:
    watched: list[str] = []
    source = CheckingSource(watched)
    amplifier = HvAmplifier(source, NARROW, DriveLimits(), VirtualClock(), RecordingWatchdog(watched))
    amplifier.initialize_at_rest()
    assert not amplifier.is_source_at_rest()
    assert not amplifier.is_left_live()
    assert source.sent == [(what, 2.0, 0.5, 4.5) for what in ("initialize", "is_at_rest", "is_left_live")]
    assert watched == ["silence allowed", "sent tuple", "silence over"] * 3


@pytest.mark.parametrize("left_live", [False, True])
@pytest.mark.parametrize("level_v", [2.5, 3.0])
def test_a_source_may_be_live_unless_it_rests_or_says_that_nothing_was_left(level_v: float, left_live: bool) -> None:
    source = CheckingSource()
    source.level_v, source.left_live = level_v, left_live
    assert commanded(source).may_be_left_live() == (level_v != 2.5 and left_live)


@pytest.mark.parametrize("level_v", [2.5, 3.0])
def test_a_source_that_cannot_say_what_was_left_may_be_live_unless_it_rests(level_v: float) -> None:
    source = PlayedSource()
    source.level_v = level_v
    amplifier = commanded(source)
    assert not amplifier.is_left_live()
    assert amplifier.may_be_left_live() == (level_v != 2.5)


def test_a_source_that_does_not_answer_may_be_live() -> None:
    source = CheckingSource()

    def silent(*_: float) -> bool:
        raise LinkError("no answer")

    source.is_at_rest = silent  # type: ignore[method-assign]
    assert commanded(source).may_be_left_live()


def test_the_way_to_rest_is_predicted_from_the_farthest_level_and_refused_if_it_is_too_long() -> None:
    source = CheckingSource()
    assert HvAmplifier(
        source, NARROW, DriveLimits(ramp_v_per_s=2.0), VirtualClock()
    ).check_way_to_rest() == pytest.approx(1.0 + 2.5 / 2.0)
    below = AmplifierMap(rest_v=3.5, low_v=1.0, high_v=4.0)
    assert HvAmplifier(source, below, DriveLimits(ramp_v_per_s=2.0), VirtualClock()).predict_rest_s() == pytest.approx(
        1.0 + 2.5 / 2.0
    )
    for measured_s, expected_s in ((0.4, 1.5), (1.6, 1.6 + 0.5)):
        amplifier = commanded(source)
        amplifier.measured_stop_s = measured_s
        assert amplifier.check_way_to_rest() == pytest.approx(expected_s)
    source.rest_s = 3.4
    assert commanded(source).check_way_to_rest() == pytest.approx(3.9)
    source.rest_s = 3.6
    with pytest.raises(DriveRejectedError, match=r"would take 4\.1 s, .* \(limit 4 s\)"):
        commanded(source).check_way_to_rest()
    assert math.isnan(commanded(PlayedSource()).check_way_to_rest())


# -- what is sent, and when ----------------------------------------------------------------------------------------------


def test_a_drive_that_ends_within_a_second_is_stopped_like_any_other() -> None:
    source, clock = PlayedSource(), VirtualClock()
    amplifier = commanded(source, clock)
    amplifier.start_drive(Sine(100.0, 1.0, 2.5, 50))
    assert amplifier.remaining_s == pytest.approx(0.5)
    clock.sleep(0.2)
    assert amplifier.remaining_s == pytest.approx(0.3)
    amplifier.return_to_rest()
    assert source.sent[1:] == ["stop"]
    assert amplifier.remaining_s == 0.0
    amplifier.return_to_rest()
    assert source.sent[1:] == ["stop"]
    clock.sleep(7.0)
    amplifier.start_drive(BURST)
    clock.sleep(9.0)
    assert amplifier.remaining_s == 0.0


class HoldingSource(PlayedSource):
    """Plays a level as a finite waveform that it triggers at once and confirms 0.2 s later."""

    hastens_levels = True

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__()
        self._clock = clock

    def level_pulse(self, level: Hold, rest_v: float, ramp_v_per_s: float) -> LevelPulse:
        return LevelPulse(rest_v, level.level_v, level.duration_s, abs(level.level_v - rest_v) / ramp_v_per_s)

    def reason_level_unsupported(self, _pulse: LevelPulse) -> str:
        return ""

    def start_level(self, _pulse: LevelPulse) -> float:
        triggered_s = self._clock.now()
        self._clock.sleep(0.2)
        return triggered_s

    def end_level(self, duration_s: float) -> None:
        self.sent.append(f"end in {duration_s:g} s")


class LevelWatchdog(NoWatchdog):
    """Keeps what it is told of levels."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[float | None] = []

    def note_level(self, pulse: LevelPulse, remaining_s: float) -> None:
        del pulse
        self.told.append(remaining_s)

    def forget_level(self) -> None:
        self.told.append(None)


def test_a_level_that_ends_by_itself_is_held_at_least_from_its_trigger_and_lasts_at_most_from_its_reply() -> None:
    clock, watchdog = VirtualClock(), LevelWatchdog()
    source = HoldingSource(clock)
    amplifier = HvAmplifier(source, AmplifierMap(), DriveLimits(), clock, watchdog)
    began_s = clock.now()
    amplifier.start_drive(Hold(4.0, 5.0))
    passed_s = clock.now() - began_s
    assert passed_s > 0.2 + 0.3  # the level is reached
    assert amplifier.level_remaining_s == pytest.approx(0.3 + 5.0 - passed_s)
    assert amplifier.remaining_s == pytest.approx(0.2 + 0.3 + 5.0 + 0.3 - passed_s)
    assert watchdog.told == [pytest.approx(0.3 + 5.0 + 0.3)]
    amplifier.return_to_rest()
    assert source.sent[-1] == "end in 0.3 s"
    assert watchdog.told[1:] == [None]
    assert (amplifier.remaining_s, amplifier.level_remaining_s) == (0.0, math.inf)


class RenewedSource(PlayedSource):
    """Holds a level for a few seconds at a time."""

    lease_s = 5.0

    def renew_hold(self) -> None:
        self._send("renewed")


def test_a_level_is_renewed_while_it_is_held_and_no_other_drive_is() -> None:
    source = RenewedSource()
    amplifier = commanded(source)
    amplifier.renew_hold()
    amplifier.start_drive(BURST)
    amplifier.renew_hold()
    amplifier.start_drive(Hold(3.0, 9.0))
    assert "renewed" not in source.sent
    amplifier.renew_hold()
    assert source.sent[-1] == "renewed"
    amplifier.return_to_rest()
    amplifier.renew_hold()
    assert source.sent.count("renewed") == 1


def test_nothing_of_a_level_is_left_when_it_is_at_rest() -> None:
    """The next drive is stopped as a drive, and no longer waited for than it lasts."""
    clock = VirtualClock()
    source = HoldingSource(clock)
    amplifier = commanded(source, clock)
    amplifier.start_drive(Hold(3.0, 5.0))
    amplifier.start_drive(BURST)
    assert amplifier.level_remaining_s == math.inf
    source.sent.clear()
    amplifier.return_to_rest()
    assert source.sent[0] == "stop"
    assert (amplifier.remaining_s, amplifier.stop_wait_s) == (0.0, 0.0)


@pytest.mark.parametrize("rest_v", [1.0, 4.0])
def test_the_time_without_a_change_is_of_the_replies_alone_whichever_side_of_rest_is_farther(rest_v: float) -> None:
    amplifier = HvAmplifier(PlayedSource(), AmplifierMap(rest_v=rest_v), DriveLimits(), VirtualClock())
    assert longest_unmoved_s(amplifier, 1.0) == pytest.approx(1.0 - 4.0 / 5.0)


def test_a_drive_whose_reply_was_lost_is_stopped() -> None:
    source = PlayedSource()
    amplifier = commanded(source)

    def lost(_: Drive) -> None:
        raise LinkError("no answer")

    source.start_drive = lost  # type: ignore[method-assign]
    with pytest.raises(LinkError):
        amplifier.start_drive(BURST)
    amplifier.return_to_rest()
    assert source.sent == ["stop"]


def test_the_watchdog_is_asked_before_a_drive_and_allows_silence_around_every_command() -> None:
    watched: list[str] = []
    watchdog = RecordingWatchdog(watched)
    source = PlayedSource(watched)
    amplifier = HvAmplifier(source, AmplifierMap(), DriveLimits(), VirtualClock(), watchdog)
    amplifier.start_drive(BURST)
    assert watched == ["silence allowed", "asked", "sent Sine", "silence over"]
    watched.clear()
    amplifier.reconnect_and_force_rest()
    assert watched == [
        *("silence allowed", "sent reconnect", "silence over"),
        *("silence allowed", "sent stop", "silence over"),
    ]
    amplifier.start_drive(BURST)
    watchdog.has_ended = True
    source.sent.clear()
    with pytest.raises(BenchError, match="the watchdog has ended"):
        amplifier.start_drive(BURST)
    assert source.sent == [], "not even the stop of the drive that plays: the watchdog commands the source"


def test_ctrl_c_at_the_stop_command_is_passed_on_at_once() -> None:
    """The caller's way out sends it again; the operator who presses it twice is not made to wait for a ramp."""
    source = PlayedSource()
    amplifier = commanded(source)
    amplifier.start_drive(Hold(4.0, 1.0))
    source.sent.clear()

    def interrupted() -> None:
        raise KeyboardInterrupt

    source.stop = interrupted  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        amplifier.force_rest()
    assert source.sent == []
    assert amplifier.remaining_s > 0


@pytest.mark.parametrize("amplifier_map", [NARROW, AmplifierMap(rest_v=3.5, low_v=1.0, high_v=4.0)])
def test_a_source_that_does_not_tell_its_level_is_ramped_as_from_the_farthest_one(amplifier_map: AmplifierMap) -> None:
    source = PlayedSource()

    def silent() -> float:
        raise LinkError("no answer")

    source.idle_level_v = silent  # type: ignore[method-assign]
    amplifier = HvAmplifier(source, amplifier_map, DriveLimits(), VirtualClock())
    told: list[tuple[str, int]] = []
    amplifier.on_failure = lambda error: told.append((str(error), len(source.sent)))
    amplifier.force_rest()
    assert told == [("no answer", 1)], "before the ramp is sent"
    rest_v = amplifier_map.rest_v
    farthest_v = max(rest_v - amplifier_map.low_v, amplifier_map.high_v - rest_v)
    assert source.sent == ["stop", Ramp(2.5, rest_v, farthest_v / 5.0)]


def test_the_first_of_two_failures_is_reported_once_and_raised() -> None:
    source = PlayedSource()
    amplifier = commanded(source)
    amplifier.start_drive(Hold(4.0, 1.0))
    reported: list[BaseException] = []
    amplifier.on_failure = reported.append
    first, second = InstrumentError("it did not stop"), InstrumentError("it did not move")

    def stop() -> None:
        raise first

    def ramp_to(*_: float) -> None:
        raise second

    source.stop, source.ramp_to = stop, ramp_to  # type: ignore[method-assign]
    with pytest.raises(InstrumentError, match="it did not stop"):
        amplifier.return_to_rest()
    assert reported == [first]


def test_an_error_within_a_way_to_rest_is_told_when_it_occurs_and_once_and_none_outside_of_it() -> None:
    class Reporting(PlayedSource):
        on_failure: Callable[[BaseException], None] = staticmethod(lambda _: None)

        def stop(self) -> None:
            self.on_failure(LinkError("late"))
            self.sent.append("remaining steps")
            raise LinkError("late once more")

    source = Reporting()
    amplifier = HvAmplifier(source, AmplifierMap(), DriveLimits(), VirtualClock())
    amplifier.on_failure = lambda error: source.sent.append(str(error))
    source.on_failure(LinkError("before"))
    with pytest.raises(LinkError):
        amplifier.force_rest()
    source.on_failure(LinkError("after"))
    assert source.sent == ["late", "remaining steps"]


def test_closing_closes_the_link_and_sends_nothing() -> None:
    source = PlayedSource()
    amplifier = commanded(source)
    assert amplifier.identity == Identity("test", "source")
    amplifier.close()
    assert source.closed
    assert source.sent == []
