"""A held level as a finite waveform: reached, held, left by Stop or by itself, and refused where the instrument cannot."""

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.session.bench_connection import BenchConnection, connect
from app.session.commissioning_gate import commissioning_state
from drivers import Identity, Sine
from drivers.bench.armed_bench import safety_statement
from drivers.bench.drive_limits import HvAmplifier
from drivers.drive_shapes import Hold, LevelPulse
from drivers.errors import DriveRejectedError, InstrumentError
from drivers.generators.output import HASTENED_END_S
from protocols.base import LevelExceeded, RunStatus
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runner.readback import DriveReadback
from sim_hardware.testing.safe_volts import STEP_V
from tests.helpers.commissioning import LateLink
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run, simulated
from tests.helpers.sources import GENERATORS, source_bench

WAITING = ("DG812", "DG4162", "SDG1032X", "SDG2042X", "AFG3022C", "AFG1022")
"""Generators whose drives can only be waited for."""


@contextmanager
def at_rest(model: str) -> Iterator[BenchConnection]:
    with laboratory(simulated(generator={"model": model})) as lab:
        lab.bench.amplifier.initialize_at_rest()
        yield lab


def volts(lab: BenchConnection, begin_s: float) -> tuple[np.ndarray, np.ndarray]:
    assert lab.control is not None
    t = np.arange(begin_s, lab.bench.clock.now(), 1e-3)
    return t, lab.control.history.volts(t)


@pytest.mark.one_in(5)
@pytest.mark.parametrize("model", GENERATORS)
@pytest.mark.parametrize("level_v", [5.0, 0.5])
def test_a_level_is_reached_held_for_longer_than_planned_and_left_by_itself(model: str, level_v: float) -> None:
    with at_rest(model) as lab:
        amplifier, clock = lab.bench.amplifier, lab.bench.clock
        begin_s = clock.now()
        amplifier.start_drive(Hold(level_v, 3.0))
        reached_s, left_s = clock.now(), amplifier.level_remaining_s
        stated_s = amplifier.unattended_rest_s(Hold(level_v, 3.0))
        assert 3.9 < left_s < 5.1
        clock.sleep(stated_s)
        t, seen = volts(lab, begin_s)
        held = seen[(t >= reached_s) & (t < reached_s + left_s)]
        assert np.abs(held - level_v).max() < 2e-3  # the smallest step of a converter of 12 bits is 1.2 mV
        moving = t[np.abs(seen - 2.5) > 0.02]  # more than a point, and than an idle amplitude
        assert moving[-1] - moving[0] < stated_s
        assert np.abs(np.diff(seen)).max() <= STEP_V
        assert amplifier.level_remaining_s == 0.0
        assert amplifier.is_source_at_rest() is (model in WAITING)  # others have the amplitude of the level still set
        amplifier.return_to_rest()
        assert amplifier.is_source_at_rest()
        assert math.isinf(amplifier.level_remaining_s)


@pytest.mark.parametrize("model", ["DG1032Z", "SDG1032X"])
def test_stop_leaves_a_level_at_the_slope_of_the_bench_or_waits_for_its_end(model: str) -> None:
    with at_rest(model) as lab:
        amplifier, clock = lab.bench.amplifier, lab.bench.clock
        amplifier.start_drive(Hold(5.0, 3.0))
        clock.sleep(1.0)
        stop_s = clock.now()
        amplifier.return_to_rest()
        took_s = clock.now() - stop_s
        t, seen = volts(lab, stop_s)
        assert seen[-1] == pytest.approx(2.5, abs=1e-3)
        assert np.abs(np.diff(seen)).max() <= STEP_V + 1e-6
        falling = t[(seen < 4.99) & (seen > 2.52)]
        assert falling[-1] - falling[0] == pytest.approx(0.5, abs=0.06)
        assert (took_s < 0.7) is (model not in WAITING)
        amplifier.start_drive(Sine(100.0, 1.0, 2.5, 100))  # a sine is stopped as before
        assert math.isinf(amplifier.level_remaining_s)


def test_the_end_of_a_level_is_hastened_only_once() -> None:
    """A second time, the end would be expected before the slope allows it."""
    with at_rest("DG812") as lab:
        amplifier, output = lab.bench.amplifier, lab.bench.amplifier._source._output
        amplifier.hastens_levels, amplifier.limits = True, replace(amplifier.limits, ramp_v_per_s=20.0)
        amplifier.start_drive(Hold(5.0, 6.5))
        output.hasten_end()
        end_s = output.burst_end_s
        assert end_s - lab.bench.clock.now() > HASTENED_END_S  # limited by the slope
        output.hasten_end()
        assert output.burst_end_s == end_s


@pytest.mark.one_in(5)
@pytest.mark.parametrize("model", WAITING)
@pytest.mark.parametrize("level_v", [5.0, 0.0])
@pytest.mark.parametrize("late", [(0.0, 0.0), (0.3, 0.2)], ids=["prompt wire", "late wire"])
def test_stop_hastens_the_end_of_a_level_where_commissioning_has_measured_that_it_may(
    model: str, level_v: float, late: tuple[float, float]
) -> None:
    config = simulated(generator={"model": model, "traits": "retime=continues"})
    with connect(config, None, 0.1, lambda link, clock: LateLink(link, clock, *late)) as lab:
        amplifier, clock = lab.bench.amplifier, lab.bench.clock
        amplifier.initialize_at_rest()
        amplifier.hastens_levels = True
        amplifier.start_drive(Hold(level_v, 6.5))
        clock.sleep(0.7)
        stop_s, left_s = clock.now(), amplifier.remaining_s
        assert amplifier.stop_wait_s == pytest.approx(1.2)
        amplifier.return_to_rest()
        took_s = clock.now() - stop_s
        clock.sleep(left_s + 0.5)  # and the burst does not go on after it
        t, seen = volts(lab, stop_s - 0.1)
        assert left_s > 6.5
        moving = t[np.abs(seen - 2.5) > 0.01]
        assert moving[-1] - stop_s < 2.0
        assert took_s < 2.0 or late[0]  # the instrument's replies come after it
        assert np.abs(np.diff(seen)).max() <= STEP_V
        assert amplifier.is_source_at_rest()


@pytest.mark.parametrize("model", ["SDG1032X", "AFG3022C"])
def test_a_second_driver_hastens_the_end_of_a_level_that_the_program_has_stated(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the watchdog does after the program's death; the program states a level only where its end may be hastened."""
    with laboratory(simulated(generator={"model": model, "traits": "retime=continues"})) as lab:
        amplifier, clock, noted = lab.bench.amplifier, lab.bench.clock, []
        monkeypatch.setattr(amplifier._watchdog, "note_level", lambda *level: noted.append(level))
        monkeypatch.setattr(amplifier._watchdog, "forget_level", lambda: noted.append(()))
        amplifier.initialize_at_rest()
        amplifier.start_drive(Hold(3.0, 1.0))
        amplifier.return_to_rest()
        assert noted == []
        amplifier.hastens_levels = True
        amplifier.start_drive(Hold(5.0, 6.5))
        pulse, remaining_s = noted.pop()
        assert pulse.level_v == 5.0
        assert remaining_s == pytest.approx(pulse.duration_s, abs=0.1)
        clock.sleep(0.7)
        assert lab.control is not None
        begin_s, left_s = clock.now(), amplifier.remaining_s
        link = lab.control.link()  # type: ignore[attr-defined]
        second = HvAmplifier(type(amplifier._source)(link, clock), amplifier.map, amplifier.limits, clock)  # type: ignore[call-arg]
        second.adopt_level(pulse, begin_s + left_s)
        second.force_rest()
        assert clock.now() - begin_s < 2.0
        clock.sleep(left_s + 0.5)  # and the burst does not go on after it
        t, seen = volts(lab, begin_s - 0.1)
        assert t[np.abs(seen - 2.5) > 0.01][-1] - begin_s < 2.0
        assert np.abs(np.diff(seen)).max() <= STEP_V
        amplifier.return_to_rest()
        assert noted == [()]


@pytest.mark.one_in(1)
@pytest.mark.parametrize("model", ["SDG1032X", "AFG3022C", "DG812"])
def test_a_level_whose_end_cannot_be_hastened_is_waited_for(model: str) -> None:
    """The wire is cut: the level returns to rest by itself, and Stop does not report rest before."""
    with at_rest(model) as lab:
        amplifier, clock = lab.bench.amplifier, lab.bench.clock
        amplifier.hastens_levels = True
        amplifier.start_drive(Hold(4.0, 4.0))
        clock.sleep(0.5)
        begin_s, left_s = clock.now(), amplifier.remaining_s
        lab.control.inject("scpi-silent")  # type: ignore[union-attr]
        with suppress(InstrumentError):
            amplifier.return_to_rest()
        assert clock.now() - begin_s >= left_s
        _, seen = volts(lab, begin_s - 0.1)
        assert seen[-1] == pytest.approx(2.5, abs=0.02)
        assert np.abs(np.diff(seen)).max() <= STEP_V


@pytest.mark.parametrize(
    ("model", "hold_s", "words"),
    [
        ("SDG1032X", 60.0, "5 V can be held for 7 s at most, not 60 s"),
        ("33210A", 200.0, "a level of 5 V held for 202 s is a waveform of 20716 points"),
    ],
)
def test_a_level_that_does_not_fit_is_refused_with_the_alternative_before_anything_is_sent(
    model: str, hold_s: float, words: str
) -> None:
    with at_rest(model) as lab:
        sent = lab.control.history.entries()
        with pytest.raises(DriveRejectedError) as refused:
            lab.bench.amplifier.start_drive(Hold(5.0, hold_s))
        assert words in str(refused.value)
        assert_names(str(refused.value), "card's", "output")
        assert lab.control.history.entries() == sent
        assert lab.bench.amplifier.is_source_at_rest()


def test_without_a_commissioning_record_a_level_is_held_by_the_offset_and_the_statement_says_so() -> None:
    real = Identity("Keysight Technologies", "33511B", "MY1", "5.02")
    assert commissioning_state(real, simulated=False, reason="first look").holds_by_offset
    assert not commissioning_state(real, simulated=True).holds_by_offset
    with at_rest("33511B") as lab:
        amplifier = lab.bench.amplifier
        assert "a held level returns to rest by itself" in safety_statement(
            amplifier, lab.bench.watchdog, lab.bench.interlock, 1.0
        )
        amplifier.holds_by_offset = True
        amplifier.start_drive(Hold(3.0, 1.0))
        assert amplifier._source.idle_level_v() == pytest.approx(3.0)
        assert math.isinf(amplifier.level_remaining_s)
        assert math.isinf(amplifier.unattended_rest_s(Hold(3.0, 1.0)))
        assert "a held level stays" in safety_statement(amplifier, lab.bench.watchdog, lab.bench.interlock, 1.0)
        amplifier.return_to_rest()
        assert amplifier.is_source_at_rest()


def test_a_pulse_begins_and_ends_at_rest() -> None:
    pulse = LevelPulse(2.5, 1.0, 2.0, 0.3)
    assert pulse.duration_s == pytest.approx(2.6)
    assert (pulse.low_v, pulse.high_v, pulse.end_levels_v) == (1.0, 2.5, (2.5, 2.5))
    assert pulse.slew_v_per_s == pytest.approx(5.0)
    assert pulse.volts([0.0, 0.15, 0.3, 2.3, 2.45, 2.6, 9.0]) == pytest.approx([2.5, 1.75, 1.0, 1.0, 1.75, 2.5, 2.5])


def test_a_level_that_has_ended_by_itself_is_no_lost_drive_and_one_that_ended_early_is() -> None:
    counts = np.zeros(1000, np.int16)

    def found(held_s: float) -> bool:
        readback = DriveReadback(Hold(4.0, 5.0), 0, 100, 1000.0, 2.5, 0.1, held_s=held_s)
        return readback.check(6000, counts, lambda raw: np.full(raw.shape, 2.5)) is not None

    assert not found(5.9)
    assert found(7.5)
    assert found(math.inf)


@pytest.mark.deep
@pytest.mark.parametrize("source", ["33220A", "DG1032Z", "SDG1032X"])
def test_voltage_steps_are_measured_as_on_the_card_and_no_level_is_exceeded(source: str, tmp_path: Path) -> None:
    found = []
    for name in (source, "card's analogue output"):
        with laboratory(source_bench(name)) as lab:
            ran = run(VoltageSteps(levels_v=(1.5, 2.5, 4.0), repeats=1), tmp_path, lab)
        assert ran.status is RunStatus.COMPLETED, ran.reason
        assert not [event for event in ran.events if isinstance(event, LevelExceeded)]
        found.append(ran.points)
    for point, other in zip(*found, strict=True):
        assert point.drive == pytest.approx(point.level, abs=5e-3)
        assert point.deflection == pytest.approx(
            other.deflection, abs=4 * (point.deflection_errors + other.deflection_errors)
        )
        assert point.ramp_time == pytest.approx(other.ramp_time, abs=0.03)
