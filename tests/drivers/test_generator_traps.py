"""Peculiarities of each generator that a naive driver misses, checked by the voltage at the amplifier."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from app.config.driver_registry import open_generator
from app.session.bench_connection import connect
from drivers.drive_shapes import LinearSweep, Sine, Steps
from drivers.errors import BenchError, InstrumentError, LinkError
from drivers.generators.burst import BurstGenerator
from drivers.generators.keysight import Keysight33200
from drivers.generators.rigol import RigolDg800
from drivers.generators.siglent import SiglentSdg
from drivers.generators.tektronix import TektronixAfg
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from tests.drivers.test_keysight_33500 import Tapped
from tests.helpers.generators import BOXES, truth
from tests.helpers.simulated_bench import assert_safe_voltage, laboratory, simulated


def made(model: str, **generator: object) -> tuple[BurstGenerator, SimulatedBench, Tapped]:
    bench = SimulatedBench(
        simulated(generator={"model": model, **generator}).simulation_parameters if generator else truth(model),
        VirtualClock(),
    )
    link = Tapped(bench.link())
    return BOXES[model](link, bench.clock), bench, link


def live(model: str) -> tuple[BurstGenerator, SimulatedBench, Tapped]:
    source, bench, link = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    return source, bench, link


def sent(link: Tapped, part: str) -> list[str]:
    return [message for message in link.sent if part in message]


@pytest.mark.parametrize("model", BOXES)
def test_nothing_any_driver_sends_drops_the_output(model: str) -> None:
    source, bench, link = live(model)
    ready = len(link.sent)
    for drive in (Sine(100.0, 1.0, 2.5, 5), LinearSweep(10, 20, 1.0, 0.5, 2.5), Steps((2.5, 2.6, 2.5), 0.05, 0.05)):
        source.start_drive(drive)
        bench.clock.sleep(0.02)
        source.stop()
    source.ramp_to(3.0, 0.1)
    source.ramp_to(2.5, 0.1)
    source.reconnect()
    source.close()
    texts = [m.partition(",#")[0].partition("WAVEDATA")[0].upper() for m in link.sent]
    assert not [
        t for t in texts if any(w in t for w in ("*RST", "*RCL", "OUTP OFF", "OUTP1 OFF", "STAT OFF;:OUTP", "FUNC DC"))
    ]
    assert not [t for t in texts if "APPL" in t and "APPL?" not in t]
    functions = (
        "FUNC ",
        "FUNC:SHAP ",
        "FUNC:USER ",
        "WVTP,",
        "LOAD ",
        "LOAD,",
        "IMP ",
        "RANG:",
        "LIM:",
        "OUTP:STAT",
        "VOLL:",
    )
    assert not [t for t in texts[ready:] if any(f in t for f in functions) and "?" not in t.split(";")[0]]
    assert_safe_voltage(bench.report())


@pytest.mark.parametrize("model", [m for m in BOXES if m != "AFG1022"])
def test_the_load_is_declared_before_the_output_comes_up(model: str) -> None:
    """At 50 ohm the same settings would give 5 V for 2.5 V."""
    source, bench, _ = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert max(piece.segment.volts([piece.start_s])[0] for piece in bench.history.entries()[1:]) < 2.52
    assert bench.report().end_v == pytest.approx(2.5, abs=1e-3)


def test_tektronix_1000_at_fifty_ohm_is_detected_by_measurement() -> None:
    config = simulated(generator={"model": "AFG1022", "high_z_by_hand": False})
    with laboratory(config) as lab:
        source, control = lab.bench.amplifier, lab.control
        with (
            pytest.raises(BenchError, match=r"not armed, high voltage stays disabled: .* 5\.\d+ V"),
            lab.bench.armed(5000.0, lambda _: None, Switch(control)),
        ):
            pass
        assert source.is_source_at_rest()  # by its own reply it is; the reply did not count
        assert control.report().live_s == 0


class Switch:
    def __init__(self, bench: SimulatedBench) -> None:
        self._bench = bench

    def disable(self) -> None:
        self._bench.disable_hv()

    def enable(self) -> None:
        self._bench.enable_hv()


def test_a_rigol_found_in_dc_is_read_where_it_tells_the_truth() -> None:
    """VOLT:OFFS? returns 0; a driver that trusts it would ramp to rest from 0 V, with a jump of 2.5 V."""
    source, _, link = live("DG1032Z")
    link.write(":SOUR1:FUNC DC;:SYST:ERR?")
    link.read()
    link.write(":SOUR1:VOLT:OFFS?")
    assert float(link.read()) == 0.0
    assert source.idle_level_v() == pytest.approx(2.5, abs=1e-3)
    assert not source.is_at_rest(2.5, 0.0, 5.0)


@pytest.mark.parametrize(("dwell_s", "rise_s", "packets"), [(0.5, 0.5, 1), (1.0, 0.005, 6), (3.0, 0.005, 16)])
def test_a_rigol_plays_at_the_rate_it_was_told_whatever_the_size_of_a_waveform(
    dwell_s: float, rise_s: float, packets: int
) -> None:
    """More than 8192 points put it into its sample-rate mode by itself; it is in that mode from the start."""
    source, bench, link = live("DG1032Z")
    source.start_drive(Steps((2.5, 3.5, 2.5), dwell_s, rise_s))
    bench.clock.sleep(3 * dwell_s + 2 * rise_s + 0.1)
    report = bench.report()
    assert report.outside_rest_s == pytest.approx(dwell_s + 2 * rise_s * 0.98, rel=0.01)
    assert (
        len(sent(link, "DAC16")) == 2 + packets
    )  # first the end of what might be left, and the sine of the preparation
    assert_safe_voltage(report)


@pytest.mark.parametrize("restarted", [False, True])
def test_packets_that_a_failed_download_left_in_a_rigol_are_not_played(restarted: bool) -> None:
    """Found by the search: the next drive was played after them, at a multiple of its slope."""
    source, bench, link = live("DG1032Z")
    write, packets = link.write, []

    def silent_after_two_packets(message: str) -> None:
        packets.append("DAC16" in message)
        write(message)
        if sum(packets) == 2:
            bench.inject("scpi-silent")

    link.write = silent_after_two_packets  # type: ignore[method-assign]
    with pytest.raises(LinkError):
        source.start_drive(Steps((2.5, 3.5, 2.5), 3.0, 0.005))
    bench.clear()
    link.write = write  # type: ignore[method-assign]
    link.clear()
    if restarted:
        source = BOXES["DG1032Z"](link, bench.clock)
    source.start_drive(Sine(100.0, 2.5, 2.5, 20))
    bench.clock.sleep(0.3)
    report = bench.report()
    assert report.steepest_v_per_s == pytest.approx(2 * 3.1416 * 100 * 2.5, rel=0.02)
    assert report.outside_rest_s == pytest.approx(0.2, rel=0.02)
    assert_safe_voltage(report)


def opened(model: str) -> tuple[RigolDg800, SimulatedBench, Tapped]:
    bench = SimulatedBench(simulated(generator={"model": model}).simulation_parameters, VirtualClock())
    link = Tapped(bench.link())
    return RigolDg800(link, bench.clock), bench, link


def test_a_dg4000_whose_panel_shows_channel_2_is_not_armed() -> None:
    """Its upload has no channel: it goes to the one that the front panel shows."""
    source, bench, link = opened("DG4162")
    link.write(":SYST:CHAN:CUR CH2;:SYST:ERR?")
    link.read()
    with pytest.raises(InstrumentError, match=r"into channel 2, .* it was not played\. Press CH1 on the instrument"):
        source.initialize_at_rest(2.5, 0.0, 5.0)
    assert not source.is_output_on()
    assert bench.report().outside_rest_s == 0


def test_a_dg4000_whose_channel_is_changed_between_two_drives_plays_neither_and_is_armed_again() -> None:
    source, bench, link = opened("DG4162")
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    link.write(":SYST:CHAN:CUR CH2;:SYST:ERR?")
    link.read()
    with pytest.raises(InstrumentError, match=r"Press CH1 on the instrument, and arm again"):
        source.start_drive(Steps((2.5, 3.0, 2.5), 0.05, 0.05))
    assert not source.is_at_rest(2.5, 0.0, 5.0)
    assert bench.report().outside_rest_s == 0
    bench.disable_hv()
    link.write(":SYST:CHAN:CUR CH1;:SYST:ERR?")
    link.read()
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)


@pytest.mark.parametrize(("model", "packets"), [("DG812", [8192] * 2), ("DG4162", [16_384])])
def test_a_waveform_is_sent_with_as_many_points_as_the_instrument_would_stretch_it_to(
    model: str, packets: list[int]
) -> None:
    source, _, link = opened(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    source.start_drive(Steps((2.5, 2.6, 2.5), 0.05, 0.05))
    sizes = [int(m.partition(",#5")[2][:5]) // 2 for m in sent(link, "DATA:DAC")]
    assert sum(packets) == 16_384
    assert sizes == packets * (len(sizes) // len(packets))


def test_a_siglent_clips_without_a_word_and_is_caught_reading_back() -> None:
    source, bench, link = made("SDG1032X")
    source.initialize_at_rest(2.5, 0.0, 5.0)
    with pytest.raises(
        InstrumentError, match=r"BSWV OFST was set to 7\.\d+ and reads back 7\.5 .*nothing more was sent"
    ):
        source.ramp_to(8.0, 0.01)
    link.write("SYST:ERR?")
    assert link.read().startswith("+0")  # it never complained
    assert bench.report().end_v <= 7.51


def test_a_siglent_hears_burst_settings_only_once_burst_is_on() -> None:
    _, _, link = made("SDG1032X")
    link.write("C1:BTWV TRSR,MAN,TIME,7")
    link.write("C1:BTWV STATE,ON")
    link.write("C1:BTWV?")
    assert "TRSR,INT,TIME,1," in link.read()
    source, _, _ = live("SDG1032X")
    assert source.is_at_rest(2.5, 0.0, 5.0)


def test_a_siglent_waveform_is_stored_with_the_levels_that_hold() -> None:
    """It brings its stored offset along when it is selected; one stored with 0 V would drop the output."""
    source, bench, link = live("SDG1032X")
    source.ramp_to(3.0, 0.1)
    source.start_drive(Steps((3.0, 3.2, 3.0), 0.05, 0.05))
    assert "OFST,3," in sent(link, "C1:WVDT")[-1]
    bench.clock.sleep(0.4)
    source.ramp_to(2.5, 0.1)
    assert_safe_voltage(bench.report())


@pytest.mark.parametrize("model", ["SDG1032X", "AFG3022C", "DG812"])
def test_a_box_that_cannot_freeze_its_range_keeps_one_amplitude_for_ever(model: str) -> None:
    source, bench, link = live(model)
    ready = len(link.sent)
    for amplitude in (0.05, 0.4, 1.2, 2.5, 0.1):  # crosses every attenuator range of the simulated box
        source.start_drive(Sine(100.0, amplitude, 2.5, 5))
        bench.clock.sleep(0.1)
        source.stop()
    assert_safe_voltage(bench.report())
    assert not [m for m in link.sent[ready:] if m.startswith(("SOUR1:VOLT ", ":SOUR1:VOLT ", "C1:BSWV AMP"))]


@pytest.mark.parametrize("model", ["SDG1032X", "AFG3022C"])
def test_such_a_box_refuses_what_could_not_be_stopped_in_time(model: str) -> None:
    source, bench, _ = live(model)
    with pytest.raises(InstrumentError, match=r"lasts 30 s \(limit 9 s\)"):
        source.start_drive(Sine(100.0, 1.0, 2.5, 3000))
    bench.clock.sleep(0.1)
    assert bench.report().outside_rest_s == 0


def test_a_driver_opened_in_the_middle_of_a_drive_waits_for_its_end() -> None:
    """The watchdog's: it has not begun what plays."""
    source, bench, _ = live("SDG1032X")
    source.start_drive(Sine(50.0, 1.0, 2.5, 100))
    second = SiglentSdg(bench.link(), bench.clock)
    second.stop()
    assert second.is_at_rest(2.5, 0.0, 5.0)
    assert_safe_voltage(bench.report())


def test_a_tektronix_burst_is_not_repeated_by_the_internal_timer() -> None:
    source, bench, link = live("AFG3022C")
    source.start_drive(Sine(100.0, 1.0, 2.5, 5))
    bench.clock.sleep(2.0)
    assert bench.report().outside_rest_s == pytest.approx(0.05, rel=0.1)
    assert "TRIG:SOUR EXT;:SYST:ERR?" in link.sent


def test_a_33220a_counts_to_fifty_thousand() -> None:
    source, bench, _ = live("33220A")
    with pytest.raises(InstrumentError, match=r"plays 50000 cycles at most, not 60000; shorten the drive"):
        source.start_drive(Sine(1000.0, 0.5, 2.5, 60_000))
    assert bench.report().outside_rest_s == 0


def test_the_keysight_memory_is_cleared_when_it_is_full_without_a_jump() -> None:
    source, bench, link = live("33511B")
    for k in range(8):
        source.start_drive(LinearSweep(20.0, 120.0 + 20 * k, 60.0, 0.5, 2.5))
        bench.clock.sleep(0.02)
        source.stop()
    assert len(sent(link, "DATA:VOL:CLE")) > 1
    assert_safe_voltage(bench.report())


@pytest.mark.parametrize(
    ("model", "driver"),
    [("33220A", Keysight33200), ("DG812", RigolDg800), ("SDG2042X", SiglentSdg), ("AFG1022", TektronixAfg)],
)
def test_auto_asks_the_box_who_it_is(model: str, driver: Callable[..., BurstGenerator]) -> None:
    bench = SimulatedBench(simulated(generator={"model": model}).simulation_parameters, VirtualClock())
    source = open_generator("auto", bench.link(), bench.clock, 0.05)
    assert type(source) is driver
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)


def test_the_wrong_driver_by_name_is_a_sentence() -> None:
    config = simulated(generator={"model": "DG1032Z"})
    config = config.model_copy(update={"generator": config.generator.model_copy(update={"driver": "siglent-sdg"})})
    with pytest.raises(InstrumentError, match=r"answered as .*DG1032Z.*; this driver is for Siglent"), connect(config):
        pass


@pytest.mark.parametrize("field", ["model", "serial"])
@pytest.mark.parametrize("model", BOXES)
def test_another_box_behind_a_connection_that_is_opened_again_is_refused(model: str, field: str) -> None:
    source, _, _ = live(model)
    source.identity = replace(source.identity, **{field: "another"})
    with pytest.raises(LinkError, match="another"):
        source.reconnect()
