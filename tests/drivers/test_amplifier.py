"""Drive limits of the amplifier: rejects with value, limit and remedy; sends nothing; never clips."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bench.drive_limits import DriveLimits, HvAmplifier
from drivers.clock import WallClock
from drivers.drive_shapes import Drive, Hold, LinearSweep, Ramp, Sine, Steps
from drivers.errors import BenchError, DriveRejectedError, InstrumentError, LinkError
from drivers.interfaces import Identity
from model.amplifier_map import AmplifierMap
from tests.helpers.front_panel import made, press
from tests.helpers.generators import BOXES

pytestmark = pytest.mark.one_in(1)


class ScriptedSource:
    """Records commands; idles at the last commanded level."""

    identity = Identity("test", "source")

    def __init__(self) -> None:
        self.level, self.told = 2.5, []

    def start_drive(self, drive: Drive) -> None:
        self.told.append(drive)

    def stop(self) -> None:
        self.told.append("stop")

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        self.told.append(Ramp(self.level, level_v, duration_s))
        self.level = level_v

    def idle_level_v(self) -> float:
        return self.level

    def reconnect(self) -> None:
        self.told.append("reconnect")


def guard() -> tuple[HvAmplifier, ScriptedSource]:
    source = ScriptedSource()
    return HvAmplifier(source, AmplifierMap(), DriveLimits(), WallClock()), source


@pytest.mark.parametrize(
    ("drive", "says"),
    [
        (
            Sine(100, 2.6, 2.5, 5),
            "reaches -0.1 V at the amplifier's input .-500 V on the specimen is the limit, at 0 V",
        ),
        (Hold(5.1, 1), "reaches 5.1 V at the amplifier's input .1500 V on the specimen is the limit, at 5 V"),
        (Sine(100, 2.6, 2.5, 5), "lower its amplitude"),
        (Hold(-0.1, 1), "-500 V on the specimen"),
        (Sine(700, 2.5, 2.5, 5), r"slope of 1.1e\+04 V/s .* exceeds the limit of 1e\+04 V/s; lower its frequency"),
        (Sine(100, 1, 2.0, 5), "starts at 2 V, but rest is 2.5 V"),
        (Ramp(2.5, 4, 1), "ends at 4 V, but rest is 2.5 V"),
        (LinearSweep(25, 525, 4.001, 2.5, 2.5), "ends at"),
        (Steps((2.5, 5, 0), 1, 0.1), "ends at 0 V"),
        (Steps((2.5, 5.5, 2.5), 1, 0.1), "reaches 5.5 V"),
    ],
)
def test_refuses_with_value_limit_and_remedy_and_sends_nothing(drive: Drive, says: str) -> None:
    amplifier, source = guard()
    with pytest.raises(DriveRejectedError, match=says):
        amplifier.start_drive(drive)
    assert source.told == []


@given(
    st.one_of(
        st.builds(Sine, st.floats(1, 2000), st.floats(0.01, 4), st.floats(0, 5), st.integers(1, 5)),
        st.builds(Hold, st.floats(-3, 8), st.floats(0.1, 1)),
        st.builds(
            Steps, st.lists(st.floats(-1, 6), min_size=1, max_size=5).map(tuple), st.floats(0.01, 1), st.floats(1e-4, 1)
        ),
    )
)
def test_whatever_is_admitted_is_harmless_and_is_played_unchanged(drive: Drive) -> None:
    amplifier, source = guard()
    try:
        amplifier.start_drive(drive)
    except DriveRejectedError:
        return
    assert source.told[-1] == drive
    v = drive.volts(np.linspace(0, drive.duration_s, 2001))
    assert v.min() >= -1e-6
    assert v.max() <= 5 + 1e-6


def test_a_held_level_is_reached_and_left_by_a_ramp() -> None:
    amplifier, source = guard()
    amplifier.start_drive(Hold(4.0, 1.0))
    assert source.told == [Ramp(2.5, 4.0, 0.3), Hold(4.0, 1.0)]
    amplifier.return_to_rest()
    assert source.told[2:] == ["stop", Ramp(4.0, 2.5, 0.3)]
    assert source.level == 2.5


def test_a_second_drive_starts_from_rest() -> None:
    amplifier, source = guard()
    amplifier.start_drive(Sine(100, 1, 2.5, 1000))
    amplifier.start_drive(Sine(50, 1, 2.5, 1000))
    assert source.told == [Sine(100, 1, 2.5, 1000), "stop", Sine(50, 1, 2.5, 1000)]


def test_after_a_failed_wire_it_is_opened_anew_before_anything_is_told() -> None:
    amplifier, source = guard()
    source.level = 3.0  # whatever it was left at
    amplifier.reconnect_and_force_rest()
    assert source.told == ["reconnect", "stop", Ramp(3.0, 2.5, 0.1)]


def test_nobody_can_switch_anything_off() -> None:
    amplifier, _ = guard()
    assert not {"off", "zero", "reset", "output_off", "disable"} & set(dir(amplifier))


@given(st.floats(0, 5))
def test_the_map_and_its_inverse_agree(volts: float) -> None:
    amplifier = AmplifierMap()
    assert amplifier.input_v(amplifier.specimen_v(volts)) == pytest.approx(volts, abs=1e-12)


@pytest.mark.parametrize(
    ("volts", "specimen"), [(0, -500), (2.5, 0), (5, 1500), (1.5, -200), (3.5, 600), (-1, -500), (9, 1500)]
)
def test_the_map_has_two_slopes_and_clips_where_the_amplifier_does(volts: float, specimen: float) -> None:
    assert AmplifierMap().specimen_v(volts) == pytest.approx(specimen)


def test_held_level_lasts_until_stopped_and_rest_has_no_duration() -> None:
    amplifier, source = guard()
    assert amplifier.remaining_s == 0
    amplifier.start_drive(Hold(4.0, 0.01))
    assert amplifier.remaining_s == float("inf")
    amplifier.return_to_rest()
    assert amplifier.remaining_s == 0
    told = len(source.told)
    amplifier.return_to_rest()  # it is there: a staircase at every step of a protocol would cost a second each
    assert len(source.told) == told
    amplifier.start_drive(Sine(100, 1, 2.5, 1000))
    assert amplifier.remaining_s == pytest.approx(10.0, abs=1.0)


@pytest.mark.parametrize("deaf", [False, True])
def test_source_that_fails_to_stop_is_ramped_to_rest_and_error_raised(deaf: bool) -> None:
    amplifier, source = guard()
    amplifier.start_drive(Hold(4.0, 1.0))
    source.told.clear()

    def stop() -> None:
        raise InstrumentError("it did not stop")

    def idle_v() -> float:
        raise LinkError("no answer")

    source.stop = stop  # type: ignore[method-assign]
    if deaf:
        source.idle_level_v = idle_v  # type: ignore[method-assign]
    with pytest.raises(InstrumentError, match="it did not stop"):
        amplifier.return_to_rest()
    # Its idle level cannot be queried: as slow as for the largest distance.
    assert source.told == [Ramp(4.0, 2.5, 0.5 if deaf else 0.3)]
    assert amplifier.remaining_s > 0  # the command was not confirmed


def test_what_is_no_failure_of_the_instrument_breaks_the_way_off() -> None:
    """The watchdog took over the source: a ramp that continues now would be a second controller."""
    amplifier, source = guard()
    amplifier.start_drive(Hold(4.0, 1.0))
    source.told.clear()

    def stop() -> None:
        raise BenchError("the watchdog took the source over")

    source.stop = stop  # type: ignore[method-assign]
    with pytest.raises(BenchError, match="watchdog"):
        amplifier.return_to_rest()
    assert source.told == []


@pytest.mark.parametrize("nothing_v", [float("nan"), float("inf"), 9.91e37])
def test_an_idle_level_that_is_no_number_is_refused_and_the_way_to_rest_is_taken_as_the_longest(
    nothing_v: float,
) -> None:
    amplifier, source = guard()
    source.idle_level_v = lambda: nothing_v  # type: ignore[method-assign]
    with pytest.raises(InstrumentError, match="which is not a level"):
        amplifier.start_drive(Hold(4.0, 1.0))
    assert source.told == []
    with pytest.raises(InstrumentError, match="which is not a level"):
        amplifier.return_to_rest()
    assert source.told == ["stop", Ramp(2.5, 2.5, 0.5)]


@pytest.mark.parametrize("error", [ValueError("a driver's own"), SystemExit(3), InstrumentError("it did not stop")])
def test_no_error_in_stopping_prevents_the_ramp_and_it_is_told_before_the_ramp(error: BaseException) -> None:
    amplifier, source = guard()
    amplifier.start_drive(Hold(4.0, 1.0))
    source.told.clear()
    amplifier.on_failure = source.told.append

    def stop() -> None:
        raise error

    source.stop = stop  # type: ignore[method-assign]
    with pytest.raises(type(error)):
        amplifier.return_to_rest()
    assert source.told == [error, Ramp(4.0, 2.5, 0.3)]


@pytest.mark.one_in(4)
@pytest.mark.parametrize("model", BOXES)
def test_an_output_that_was_switched_off_during_a_drive_is_named_when_the_drive_is_over(model: str) -> None:
    source, bench, panel = made(model)
    amplifier = HvAmplifier(source, AmplifierMap(), DriveLimits(), bench.clock)
    amplifier.initialize_at_rest()
    amplifier.start_drive(Sine(100, 1.0, 2.5, 20))
    bench.clock.sleep(0.5)
    amplifier.return_to_rest()  # it is on
    amplifier.start_drive(Sine(100, 1.0, 2.5, 20))
    bench.clock.sleep(0.1)
    press(panel, {"SDG": "C1:OUTP OFF", "DG1": ":OUTP1 OFF", "AFG": "OUTP1:STAT OFF"}.get(model[:3], "OUTP OFF"))
    bench.clock.sleep(0.5)
    with pytest.raises(
        InstrumentError, match=r"is off after a drive: .* -500 V on the specimen\. Switch high voltage off"
    ):
        amplifier.return_to_rest()
    source.close()
