"""Generators in which another program left a burst or a level: it is ended gently."""

import numpy as np
import pytest

from drivers import ConfirmedCommand, InstrumentError
from drivers.drive_shapes import Hold, Sine
from tests.helpers.front_panel import made, press
from tests.helpers.generators import BOXES
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import assert_safe_voltage


@pytest.mark.parametrize("model", BOXES)
def test_errors_that_others_left_do_not_keep_a_box_from_being_prepared(model: str) -> None:
    source, _, panel = made(model)
    for _ in range(3):
        press(panel, "NONSENSE 1")
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)


def test_initialize_with_changed_load_setting_never_exceeds_rest() -> None:
    """At 50 ohm its 2.5 V read as 1.25 V: brought 'gently' to 2.5 V it would put 5 V, 1500 V on the specimen."""
    source, bench, panel = made("33220A")
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    press(panel, "OUTP:LOAD 50")
    found = len(bench.history.entries())
    source.initialize_at_rest(2.5, 0.0, 5.0)
    pieces = bench.history.entries()[found:]
    assert pieces
    assert max(float(piece.segment.volts(np.array([piece.start_s + 1e-6]))[0]) for piece in pieces) < 2.6


@pytest.mark.parametrize("model", BOXES)
def test_a_restart_during_a_burst_ends_it_before_anything_is_set_up(model: str) -> None:
    source, bench, _ = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.start_drive(Sine(50.0, 2.5, 2.5, 400))  # 8 s, and then the program is killed
    bench.clock.sleep(0.333)
    second = BOXES[model](
        bench.link(), bench.clock
    )  # high voltage is still on: the person switched the wrong amplifier
    second.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.05)
    assert_safe_voltage(bench.report())  # all the way
    begin = bench.report().outside_rest_s
    bench.clock.sleep(9.0)
    assert bench.report().outside_rest_s == begin, "the old burst played on"
    assert second.is_at_rest(2.5, 0.0, 5.0)
    second.start_drive(Sine(100.0, 1.0, 2.5, 50))
    bench.clock.sleep(0.7)
    assert bench.report().outside_rest_s - begin == pytest.approx(0.5, rel=0.05)
    second.stop()
    assert_safe_voltage(bench.report())


@pytest.mark.parametrize("model", BOXES)
def test_a_restart_finds_a_held_level_and_brings_it_to_rest_gently(model: str) -> None:
    source, bench, _ = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.ramp_to(4.0, 0.2)
    source.start_drive(Hold(4.0, 100.0))
    second = BOXES[model](bench.link(), bench.clock)
    assert not second.is_at_rest(2.5, 0.0, 5.0)
    second.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.05)
    assert_safe_voltage(bench.report())


@pytest.mark.parametrize("model", ["SDG1032X", "AFG3022C"])
def test_idle_generator_after_restart_needs_no_wait_for_the_burst(model: str) -> None:
    source, bench, _ = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    source.start_drive(Sine(50.0, 1.0, 2.5, 400))
    source.stop()
    second = BOXES[model](bench.link(), bench.clock)
    begin_s = bench.clock.now()
    assert second.is_at_rest(2.5, 0.0, 5.0)
    assert bench.clock.now() - begin_s < 0.5


@pytest.mark.parametrize(
    ("model", "commands"),
    [
        ("33511B", ("FUNC SIN", "VOLT 4", "FREQ 20", "BURS:NCYC 1E6", "TRIG:SOUR BUS", "BURS:STAT ON", "OUTP ON", "*TRG")),
        ("33220A", ("FUNC SIN", "VOLT 4", "FREQ 20", "BURS:NCYC 5E4", "TRIG:SOUR BUS", "BURS:STAT ON", "OUTP ON", "*TRG")),
        ("33220A", ("FUNC SIN", "VOLT 4", "FREQ 20", "BURS:STAT ON", "OUTP ON")),  # again and again, by its own timer
        ("DG1032Z", (":SOUR1:VOLT 4", ":SOUR1:BURS:NCYC 1E6", ":SOUR1:BURS:TRIG:SOUR MAN", ":SOUR1:BURS:STAT ON", ":OUTP1 ON", ":SOUR1:BURS:TRIG")),
        ("SDG1032X", ("C1:BTWV STATE,ON", "C1:BTWV TRSR,MAN,TIME,1000000", "C1:OUTP ON", "C1:BTWV MTRIG")),
        ("AFG3022C", ("SOUR1:VOLT 4", "TRIG:SOUR EXT", "SOUR1:BURS:NCYC 1E6", "SOUR1:BURS:STAT ON", "OUTP1:STAT ON", "*TRG")),
    ],
)  # fmt: skip
def test_a_burst_of_anybody_elses_is_over_when_the_box_has_been_prepared(model: str, commands: tuple[str, ...]) -> None:
    """Another program's sine, for hours: high voltage is off, and it is cut."""
    source, bench, panel = made(model)
    for command in commands:
        press(panel, command)
    bench.clock.sleep(0.37)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.05)
    bench.enable_hv()
    bench.clock.sleep(3.0)
    report = bench.report()
    assert_safe_voltage(report)
    assert report.outside_rest_s == 0
    assert bench.generator.busy_s(bench.clock.now()) == 0


@pytest.mark.one_in(1)
@pytest.mark.parametrize("model", [m for m in BOXES if BOXES[m].dialect_type.capabilities.holds_range])
def test_an_amplitude_that_an_instrument_does_not_take_starts_no_drive(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, bench, _ = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    begin_s = bench.report().outside_rest_s
    monkeypatch.setattr(source.dialect, "amplitude_command", lambda _: ConfirmedCommand("", lambda: None))
    with pytest.raises(InstrumentError):
        source.start_drive(Sine(50.0, 1.0, 2.5, 10))
    bench.clock.sleep(0.5)
    assert bench.report().outside_rest_s == begin_s


@pytest.mark.parametrize("model", [m for m in BOXES if BOXES[m].dialect_type.capabilities.holds_range])
def test_a_burst_at_the_idle_amplitude_is_over_when_a_source_was_found_at_rest(model: str) -> None:
    """A program was killed between the last step of a way to rest and the abort: the next trigger would be ignored."""
    source, bench, _ = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    source.start_drive(Sine(50.0, 1.0, 2.5, 400))
    source.dialect.amplitude_command(source.capabilities.idle_amplitude_vpp).send()
    second = BOXES[model](bench.link(), bench.clock)
    assert second.is_at_rest(2.5, 0.0, 5.0)
    assert bench.generator.busy_s(bench.clock.now()) == 0
    second.start_drive(Sine(100.0, 1.0, 2.5, 5))


@pytest.mark.parametrize("model", [m for m in BOXES if BOXES[m].dialect_type.capabilities.holds_range])
def test_a_range_that_another_program_made_too_small_is_not_held(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    source, _, panel = made(model)
    write = source.dialect.write_checked

    def disturbed(*commands: str) -> None:
        for command in commands:
            if command.endswith("RANG:AUTO OFF"):
                press(panel, f"{source.dialect.SOURCE_PREFIX}VOLT 2")
            write(command)

    with monkeypatch.context() as at_once:
        at_once.setattr(source.dialect, "write_checked", disturbed)
        with pytest.raises(InstrumentError) as refused:
            source.initialize_at_rest(2.5, 0.0, 5.0)
    assert_names(str(refused.value), "5", "2", "V")
    source.initialize_at_rest(2.5, 0.0, 5.0)
    source.start_drive(Sine(100.0, 2.5, 2.5, 5))


@pytest.mark.parametrize("model", [m for m in BOXES if not BOXES[m].dialect_type.capabilities.holds_range])
@pytest.mark.parametrize("rate_hz", [500.0, 1000.0])
def test_the_burst_that_is_left_moves_on_the_card_when_burst_mode_is_switched_off(model: str, rate_hz: float) -> None:
    source, bench, panel = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    source.start_drive(Sine(50.0, 0.1, 2.5, 5))
    source.stop()
    off = "C1:BTWV STATE,OFF" if model.startswith("SDG") else ":SOUR1:BURS:STAT OFF"
    press(panel, off)
    begin_s = bench.clock.now()
    bench.clock.sleep(0.5)
    assert np.ptp(bench.history.volts(begin_s + np.arange(1, 0.5 * rate_hz) / rate_hz)) > 0.15
