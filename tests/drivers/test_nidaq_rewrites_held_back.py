"""Analogue output of a card whose driver holds rewritten samples back: Stop and held levels without a rewrite."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

import numpy as np
import pytest

from drivers.bench.drive_limits import DriveLimits, HvAmplifier
from drivers.drive_shapes import Drive, Hold, LinearSweep, Sine, SquareWave, Steps
from drivers.errors import AcquisitionError, InstrumentError
from drivers.nidaq.analog_input import NiDigitizer
from drivers.nidaq.analog_output import NiAnalogOutput
from drivers.nidaq.output_task import OutputTask
from model.amplifier_map import AmplifierMap
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.nidaq.task import SimulatedNiDevice
from sim_hardware.plant.parameters import CardParameters, SimulationParameters
from tests.helpers.simulated_bench import assert_safe_voltage, installed
from tests.wires.ni_library import NiLibrary

DRIVES = [
    (Sine(40.0, 2.5, 2.5, 400), 0.77),
    (Sine(400.0, 2.0, 2.5, 4000), 0.31),
    (Sine(0.5, 2.5, 2.5, 5), 0.31),
    (LinearSweep(25.0, 525.0, 20.0, 2.5, 2.5), 0.31),
    (SquareWave(60.0, 2.0, 2.5, 0.5, 1e-3, 600), 0.31),
    (Steps((2.5, 4.5, 0.5, 2.5), 2.0, 0.5), 3.123),
]
"""Drives, and when each is stopped."""

AT_REST_WITHIN_S = 1.0
"""Of Stop, of which 0.5 s are a ramp from the farthest level."""


@contextmanager
def live(rewrite: str, **options) -> Iterator[tuple[HvAmplifier, NiAnalogOutput, SimulatedBench]]:
    card = CardParameters(traits=f"rewrite={rewrite} start-route=present")
    bench = SimulatedBench(SimulationParameters(source="ao0", card=card), VirtualClock())
    with installed(NiLibrary(SimulatedNiDevice(bench.card, bench.clock, bench.faults))):
        source = NiAnalogOutput("Dev1", "ao0", bench.clock, **options)
        source.initialize_at_rest(2.5, 0.0, 5.0)
        bench.enable_hv()
        limits = DriveLimits(slew_v_per_s=1e6)
        yield HvAmplifier(source, AmplifierMap(), limits, bench.clock), source, bench
        assert_safe_voltage(bench.report())
        source.close()


def measured_stop(amplifier: HvAmplifier, bench: SimulatedBench) -> tuple[float, float]:
    """Stop; return when the input is at rest for good, and the largest jump of the whole history."""
    begin_s = bench.clock.now()
    amplifier.return_to_rest()
    t = np.arange(begin_s, bench.clock.now() + 0.5, 1e-4)
    bench.clock.sleep(0.5)
    away = np.flatnonzero(np.abs(bench.history.volts(t) - 2.5) > 0.01)
    return float(t[away[-1]] - begin_s) if away.size else 0.0, bench.report().largest_jump_v


CASES = [(drive, played_s, "waits", True) for drive, played_s in DRIVES] + [
    (DRIVES[0][0], 0.77, "waits", False),
    (DRIVES[0][0], 0.77, "prompt", True),
    (DRIVES[5][0], 3.123, "prompt", True),
]


@pytest.mark.deep
@pytest.mark.parametrize(
    ("drive", "played_s", "rewrite", "acquires"), CASES, ids=lambda each: getattr(each, "kind", str(each))
)
def test_a_drive_is_stopped_within_the_same_time_without_a_jump(
    drive: Drive, played_s: float, rewrite: str, acquires: bool
) -> None:
    with live(rewrite) as (amplifier, source, bench):
        digitizer = NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock)
        with digitizer.stream(5000.0, 250) if acquires else nullcontext():
            amplifier.start_drive(drive)
            bench.clock.sleep(played_s)
            predicted_s = amplifier.predict_rest_s()
            rest_s, jump_v = measured_stop(amplifier, bench)
            assert source.holds_rewrites_back == (rewrite == "waits")
            assert rest_s < min(AT_REST_WITHIN_S, predicted_s)
            assert jump_v < 0.01


def test_a_sine_that_cannot_be_rewritten_keeps_the_sample_reached_and_is_left_in_a_line() -> None:
    with live("waits") as (amplifier, _, bench), NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(5000.0, 250):
        amplifier.start_drive(Sine(10.0, 2.0, 2.5, 100))
        bench.clock.sleep(0.31)
        rest_s, jump_v = measured_stop(amplifier, bench)
        assert rest_s < AT_REST_WITHIN_S
        assert jump_v < 0.01


def test_a_block_that_began_before_the_release_is_not_taken_for_the_level() -> None:
    """On a busy computer the time of the first scan is late: the block that counts as new still shows the drive."""
    with (
        live("waits") as (amplifier, _, bench),
        NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(5000, 250) as s,
    ):
        s.start_time_s += 0.015
        for played_s in (0.31, 0.32, 0.33, 0.34):
            amplifier.start_drive(Sine(10.0, 2.0, 2.5, 100))
            bench.clock.sleep(played_s)
            rest_s, jump_v = measured_stop(amplifier, bench)
            assert rest_s < AT_REST_WITHIN_S
            assert jump_v < 0.01


def test_a_level_is_held_by_one_task_after_the_other_and_returns_to_rest_by_itself() -> None:
    with live("waits", lease_s=2.0) as (amplifier, source, bench):
        amplifier.start_drive(Hold(4.5, 60.0))
        begin_s = bench.clock.now()
        while bench.clock.now() - begin_s < 10.0:
            bench.clock.sleep(0.2)
            amplifier.renew_hold()
        assert source.holds_rewrites_back
        held = bench.history.volts(np.arange(begin_s, bench.clock.now(), 1e-3))
        assert np.abs(held - 4.5).max() < 1e-3
        bench.clock.sleep(2.0 + 2.0 / 5.0 + 0.1)
        report = bench.report()
        assert report.end_v == pytest.approx(2.5, abs=1e-3)
        assert report.largest_jump_v < 0.01
        amplifier.return_to_rest()


def test_a_level_that_began_to_return_while_its_renewal_was_refused_is_not_brought_back_by_a_jump(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with live("prompt", lease_s=2.0) as (amplifier, _, bench):
        amplifier.start_drive(Hold(4.5, 60.0))
        bench.clock.sleep(0.6)

        def refused(*_: object) -> bool:
            bench.clock.sleep(1.5)
            raise AcquisitionError("no rewrite")

        monkeypatch.setattr(OutputTask, "rewrite", refused)
        with pytest.raises(InstrumentError, match=r"\b4\.5 V\b.*\b2 s\b"):
            amplifier.renew_hold()
        monkeypatch.undo()
        amplifier.return_to_rest()
        report = bench.report()
        assert report.largest_jump_v < 0.01
        assert report.end_v == pytest.approx(2.5, abs=1e-3)


def test_a_drive_whose_cable_to_the_card_is_off_plays_on_to_its_end_and_says_so() -> None:
    """A level may be taken from the cable only where it has shown the drive."""
    with (
        live("waits") as (amplifier, source, bench),
        NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(5000, 250),
    ):
        amplifier.start_drive(Sine(40.0, 2.0, 2.5, 160))
        bench.clock.sleep(0.5)
        cable = bench.card._history.volts
        bench.card._history.volts = lambda t: np.full(np.shape(t), 3.0)  # type: ignore[method-assign]
        try:
            with pytest.raises(
                InstrumentError, match=r"plays on to the end of its drive, in 3\.4 s: .*holds rewritten samples"
            ):
                source.stop()
        finally:
            bench.card._history.volts = cable  # type: ignore[method-assign]
        bench.clock.sleep(4.0)
        assert source.is_at_rest(2.5, 0.0, 5.0)
        assert bench.report().largest_jump_v < 0.01


def test_a_drive_whose_trigger_never_came_is_released_where_it_would_have_begun() -> None:
    with live("waits", start_trigger="ai/SampleClock") as (amplifier, source, bench):
        amplifier.start_drive(Sine(40.0, 2.0, 2.5, 160))
        bench.clock.sleep(0.5)
        amplifier.return_to_rest()
        assert source.is_at_rest(2.5, 0.0, 5.0)
        assert bench.report().outside_rest_s == 0.0
