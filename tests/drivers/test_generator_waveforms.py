"""Generator waveforms: the last commanded drive is played, whatever happened to memory, clock or connection."""

import numpy as np
import pytest

from drivers.drive_shapes import Sine, Steps
from drivers.errors import InstrumentError, LinkError
from tests.helpers.front_panel import made, press
from tests.helpers.simulated_bench import assert_safe_voltage


def test_another_waveform_at_the_front_panel_is_never_played() -> None:
    """What the driver remembers of the waveform memory holds no longer than until the next run asks for rest."""
    source, bench, panel = made("33511B")
    source.initialize_at_rest(2.5, 0.0, 5.0)
    source.start_drive(Sine(100.0, 1.0, 2.5, 5))
    bench.clock.sleep(0.2)
    source.stop()
    press(panel, "FUNC:ARB EXP_RISE")
    assert source.is_at_rest(2.5, 0.0, 5.0)
    bench.enable_hv()
    source.start_drive(Sine(100.0, 1.0, 2.5, 5))
    bench.clock.sleep(0.2)
    source.stop()
    report = bench.report()
    assert_safe_voltage(report)  # EXP_RISE at this amplitude would begin with a jump of a volt
    assert (report.lowest_v, report.highest_v) == (pytest.approx(1.5, abs=0.01), pytest.approx(3.5, abs=0.01))


def test_a_memory_that_is_full_is_cleared_with_next_to_nothing_on_the_output(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clearing it selects EXP_RISE, whose first point is the lowest: half of the amplitude below the idle level."""
    monkeypatch.setattr("sim_hardware.generators.keysight.MEMORY_POINTS", 4500)
    source, bench, _ = made("33511B")
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.start_drive(Sine(100.0, 2.5, 2.5, 5))
    bench.clock.sleep(0.2)  # it has ended by itself, its amplitude is unchanged
    source.start_drive(Steps((2.5, 2.6, 2.5), 0.05, 0.05))
    bench.clock.sleep(0.4)
    report = bench.report()
    assert_safe_voltage(report)
    assert report.highest_v == pytest.approx(5.0, abs=0.01)


@pytest.mark.parametrize("model", ["SDG1032X", "AFG3022C"])
def test_a_drive_beyond_the_one_amplitude_of_such_a_box_is_refused(model: str) -> None:
    source, bench, _ = made(model)
    source.initialize_at_rest(2.5, 1.5, 3.5)
    with pytest.raises(InstrumentError, match=r"was set up for 1 V at most .* not 1\.5 V; .*Nothing was sent"):
        source.start_drive(Sine(50.0, 1.5, 2.5, 10))
    assert bench.report().outside_rest_s == 0


@pytest.mark.parametrize("model", ["33511B", "33220A", "DG1032Z", "AFG3022C"])
def test_generator_with_wrong_sample_rate_is_reported_and_not_played(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, bench, _ = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    handle = bench.message_port.handle

    def steps_of_a_percent(message: str):
        command, space, rate = message.partition(" ")
        if command.endswith(("FREQ", "SRAT")) and space:
            rate, rest = rate.partition(";")[::2]
            message = f"{command} {float(rate) * 1.01:.10g};{rest}"
        return handle(message)

    monkeypatch.setattr(bench.message_port, "handle", steps_of_a_percent)
    with pytest.raises(InstrumentError, match=r"was set to .* and reads back .* nothing more was sent"):
        source.start_drive(Sine(100.0, 1.0, 2.5, 5))
    assert bench.report().outside_rest_s == 0


def test_unconfirmed_waveform_upload_is_not_taken_for_the_previous_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The generator has accepted the steps without confirmation: the next sine must be uploaded again, or the steps would be played."""
    source, bench, _ = made("33511B")
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.enable_hv()
    source.start_drive(Sine(100.0, 1.0, 2.5, 5))
    bench.clock.sleep(0.2)
    source.stop()
    handle = bench.message_port.handle

    def answers_nothing_to_it(message: str):
        reply = handle(message)
        return None if "FUNC:ARB TB" in message else reply

    monkeypatch.setattr(bench.message_port, "handle", answers_nothing_to_it)
    with pytest.raises(LinkError):
        source.start_drive(Steps((2.5, 3.5, 2.5), 0.1, 0.05))
    monkeypatch.setattr(bench.message_port, "handle", handle)
    before_s = bench.clock.now()
    source.start_drive(Sine(100.0, 0.5, 2.5, 5))
    bench.clock.sleep(0.2)
    report = bench.report()
    assert_safe_voltage(report)
    played = bench.history.volts(before_s + np.arange(2000) / 1e4)
    assert (played.min(), played.max()) == (pytest.approx(2.0, abs=0.01), pytest.approx(3.0, abs=0.01))
