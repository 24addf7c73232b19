"""Simulated Keysight 33500: replies, output, and every documented peculiarity."""

import numpy as np
import pytest

from drivers.drive_shapes import Sine
from drivers.generators.keysight import Keysight33500
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.plant.parameters import GeneratorParameters, SimulationParameters
from sim_hardware.wires.in_process_link import InProcessLink

CAREFUL = (
    "OUTP:LOAD INF",
    "VOLT 5",
    "VOLT:OFFS 2.5",
    "VOLT:RANG:AUTO OFF",
    "BURS:NCYC 10",
    "TRIG:SOUR BUS",
    "BURS:STAT ON",
    "OUTP ON",
)


def send(link: InProcessLink, *messages: str) -> list[str]:
    """Send each with a query of the error queue; the error codes that came back."""
    codes = []
    for message in messages:
        link.write(f"{message};:SYST:ERR?")
        codes.append(link.read().split(",")[0])
    return [code for code in codes if code != "+0"]


def ask(link: InProcessLink, query: str) -> str:
    link.write(query)
    return link.read()


def volts(bench: SimulatedBench, *later_s: float) -> list[float]:
    """Volts at the amplifier's input that much after now; the clock moves along."""
    start = bench.clock.now()
    bench.clock.sleep(max(later_s))
    return [float(v) for v in bench.history.volts(start + np.array(later_s))]


@pytest.fixture
def idle(bench, link):
    """A bench whose generator idles at rest in an armed burst, high voltage on."""
    assert send(link, *CAREFUL) == []
    bench.clock.sleep(0.1)
    bench.enable_hv()
    return bench


def test_it_wakes_up_with_the_output_off_and_fifty_ohm(bench, link):
    assert ask(link, "OUTP?") == "0"
    assert float(ask(link, "OUTP:LOAD?")) == 50
    assert float(ask(link, "VOLT?")) == pytest.approx(0.1)
    assert float(ask(link, "FREQ?")) == 1000
    for query, reply in (("VOLT:RANG:AUTO?", "1"), ("TRIG:SOUR?", "IMM")):
        assert ask(link, query) == reply
    assert volts(bench, 0.1) == [0.0]


def test_an_armed_burst_idles_at_its_offset_plays_and_comes_back(idle, link):
    assert volts(idle, 0.01) == [2.5]
    assert send(link, "FREQ 100", "*TRG") == []
    quarter = volts(idle, 0.0015)  # the message that asked for errors took a millisecond
    assert quarter[0] > 4.5
    assert volts(idle, 0.2) == [2.5]
    report = idle.report()
    assert report.largest_jump_v < 1e-6
    assert (report.lowest_v, report.highest_v) == (pytest.approx(0.0, abs=1e-6), pytest.approx(5.0))
    assert report.ends_at_rest
    assert report.switched_at_rest


def test_a_change_of_amplitude_or_frequency_keeps_the_phase_of_a_running_burst(idle, link):
    send(link, "BURS:NCYC INF", "FREQ 50", "*TRG")
    idle.clock.sleep(0.0333)
    before = volts(idle, 0.0)[0] - 2.5
    link.write("VOLT 2.5")
    now = idle.clock.now()
    assert send(link, "FREQ 100") == []
    after = float(idle.history.volts([now])[0]) - 2.5
    assert after == pytest.approx(before / 2, rel=0.3)
    report = idle.report()
    assert report.steepest_v_per_s < 2.5 * 2 * np.pi * 51
    send(link, "VOLT 0.01", "ABOR")
    assert idle.report().ends_at_rest


def test_frequency_change_is_phase_continuous(idle, link):
    send(link, "BURS:NCYC 1000", "FREQ 50", "*TRG")
    for f in (70, 90, 110):
        idle.clock.sleep(0.0123)
        send(link, f"FREQ {f}")
    assert idle.report().largest_jump_v < 1e-6


def test_fifty_ohm_declared_gives_twice_the_volts(bench, link):
    send(link, "VOLT 2", "VOLT:OFFS 2.5", "BURS:NCYC 10", "TRIG:SOUR BUS", "BURS:STAT ON", "OUTP ON")
    bench.clock.sleep(0.1)
    assert volts(bench, 0.0) == [5.0]
    assert bench.card.channel_voltage(0, np.array([bench.clock.now()]))[0][0] == 5.0
    # Telling it the truth afterwards changes the display, not the output.
    send(link, "OUTP:LOAD INF")
    assert float(ask(link, "VOLT:OFFS?")) == 5.0
    assert float(ask(link, "VOLT?")) == 4.0
    assert volts(bench, 0.0) == [5.0]


def test_reset_and_output_off_drop_the_input_to_zero(idle, link):
    send(link, "*RST")
    idle.clock.sleep(0.5)
    report = idle.report()
    assert report.lowest_v == 0.0
    assert report.largest_jump_v == 2.5
    assert report.outside_rest_s > 0.4
    assert not report.ends_at_rest
    assert ask(link, "OUTP:LOAD?;:OUTP?").startswith("+5.0")


def test_output_off_is_seen(idle, link):
    send(link, "OUTP OFF")
    idle.clock.sleep(0.01)
    send(link, "OUTP ON")
    assert idle.report().lowest_v == 0.0


def test_apply_turns_the_output_on_and_ends_the_burst(bench, link):
    send(link, "OUTP:LOAD INF", "BURS:STAT ON", "APPL:SIN 100,5,2.5")
    assert ask(link, "OUTP?;:BURS:STAT?;:VOLT:RANG:AUTO?") == "1;0;1"
    bench.clock.sleep(0.1)
    bench.enable_hv()
    bench.clock.sleep(0.1)
    report = bench.report()
    assert report.highest_v > 4.9
    assert not report.switched_at_rest


def test_another_range_drops_the_output_for_the_relay(idle, link):
    send(link, "VOLT 0.5")
    assert idle.report().lowest_v == 2.5  # frozen range: no relay
    send(link, "VOLT 5", "VOLT:RANG:AUTO ON", "VOLT 3")
    idle.clock.sleep(0.1)
    report = idle.report()
    assert report.lowest_v == 0.0
    assert report.outside_rest_s == pytest.approx(5e-3, rel=0.1)
    assert report.ends_at_rest


def test_frozen_range_limits_the_amplitude(idle, link):
    assert send(link, "VOLT 12") == ["-222"]
    assert float(ask(link, "VOLT?")) == 10.0


def test_leaving_dc_starts_the_sine_anywhere():
    jumps = []
    for seed in range(6):
        bench = SimulatedBench(SimulationParameters(seed=seed), VirtualClock())
        link = bench.link()
        send(link, "OUTP:LOAD INF", "VOLT 5", "VOLT:OFFS 2.5", "FREQ 10", "VOLT:RANG:AUTO OFF", "FUNC DC", "OUTP ON")
        bench.clock.sleep(0.1)
        bench.enable_hv()
        assert volts(bench, 0.1) == [2.5]
        send(link, "FUNC SIN")
        jumps.append(bench.report().largest_jump_v)
    assert max(jumps) > 1.0
    assert len(set(jumps)) == 6


def test_dc_and_burst_exclude_each_other(idle, link):
    assert send(link, "FUNC DC") == ["-221"]
    assert ask(link, "FUNC?;:BURS:STAT?") == "DC;0"
    assert send(link, "BURS:STAT ON") == ["-221"]


@pytest.mark.parametrize(
    ("before", "message", "code"),
    [
        ((), "*TRG", None),
        (("TRIG:SOUR IMM",), "*TRG", "-211"),
        (("BURS:STAT OFF",), "*TRG", "-211"),
        (("FREQ 1", "*TRG"), "*TRG", "-211"),
        ((), "VOLT:OFFS 8", "-222"),
        ((), "VOLT 0.001", "-222"),
        ((), "FREQ 1 GHZ", "-131"),
        ((), "FREQ 1E9", "-222"),
        ((), "VOLT:UNIT DBM", "-221"),
        (("VOLT:LIM:LOW 0", "VOLT:LIM:HIGH 5", "VOLT:LIM:STAT ON"), "VOLT:OFFS 2.6", "-221"),
        (("VOLT:LIM:LOW 0", "VOLT:LIM:HIGH 5", "VOLT:LIM:STAT ON"), "OUTP:LOAD 50", "-221"),
        (("VOLT:LIM:LOW 0", "VOLT:LIM:HIGH 5", "VOLT:LIM:STAT ON"), "VOLT:LIM:HIGH 4", "-221"),
        (("VOLT:LIM:LOW 1", "VOLT:LIM:HIGH 5"), "VOLT:LIM:STAT ON", "-221"),
        ((), "VOLT:LOW 6", "-221"),
        ((), "SWE:STAT ON", "-221"),
        ((), "BURS:MODE SOMETIMES", "-224"),
    ],
)
def test_refusals_and_clippings(idle, link, before, message, code):
    assert send(link, *before) == []
    assert send(link, message) == ([] if code is None else [code])


def test_limits_refuse_and_leave_the_output_alone(idle, link):
    send(link, "VOLT:LIM:LOW 0", "VOLT:LIM:HIGH 5", "VOLT:LIM:STAT ON", "VOLT:OFFS 3", "VOLT 6", "VOLT:HIGH 7")
    assert float(ask(link, "VOLT:OFFS?")) == 2.5
    assert float(ask(link, "VOLT?")) == 5.0
    assert volts(idle, 0.01) == [2.5]


def test_out_of_range_is_clipped_not_refused(bench, link):
    send(link, "OUTP:LOAD INF")
    assert send(link, "VOLT:OFFS 100") == ["-222"]
    assert float(ask(link, "VOLT:OFFS?")) == pytest.approx(9.9)


@pytest.mark.parametrize(
    ("set_", "query", "value"),
    [
        ("VOLT 20 MVPP", "VOLT?", 0.02),
        ("VOLT 1 VRMS", "VOLT?", 2 * np.sqrt(2)),
        ("VOLT:UNIT VRMS;:VOLT 1", "VOLT?", 1.0),
        ("VOLT:HIGH 4;LOW 1", "VOLT?", 3.0),
        ("VOLT:HIGH 4;LOW 1", "VOLT:OFFS?", 2.5),
        ("FREQ 1.25 KHZ", "FREQ?", 1250.0),
        ("SOUR1:BURS:PHAS 90", "BURS:PHAS?", 90.0),
        ("BURS:NCYC INF", "BURS:NCYC?", 9.9e37),
        ("SWE:TIME 20", "SWE:TIME?", 20.0),
    ],
)
def test_settings_read_back(bench, link, set_, query, value):
    send(link, "OUTP:LOAD INF", "TRIG:SOUR BUS")
    assert send(link, set_) == []
    assert float(ask(link, query)) == pytest.approx(value)


def test_dbm_into_fifty_ohm(bench, link):
    send(link, "VOLT 10 DBM")
    assert float(ask(link, "VOLT?")) == pytest.approx(2.0, rel=1e-3)  # 10 dBm is 2 Vpp at 50 ohm
    send(link, "VOLT:UNIT DBM")
    assert float(ask(link, "VOLT?")) == pytest.approx(10.0)
    assert send(link, "OUTP:LOAD INF") == ["-221"]
    assert ask(link, "VOLT:UNIT?") == "VPP"


def test_a_bus_triggered_sweep_is_a_sine_before_and_after(bench, link):
    send(link, "OUTP:LOAD INF", "VOLT 4", "VOLT:OFFS 2.5", "FREQ:STAR 50", "FREQ:STOP 150", "SWE:TIME 1")
    send(link, "TRIG:SOUR BUS", "SWE:STAT ON", "OUTP ON")
    bench.clock.sleep(0.1)
    bench.enable_hv()
    assert not bench.report().switched_at_rest  # it sings at its start frequency all the time
    assert send(link, "*TRG") == []
    start = bench.clock.now()
    bench.clock.sleep(2.0)
    t = start + np.arange(0, 2.0, 1e-4)
    rising = t[1:][np.diff(np.signbit(bench.history.volts(t) - 2.5).astype(int)) == -1]
    assert np.count_nonzero(rising < start + 1) in (99, 100, 101)
    assert np.count_nonzero(rising > start + 1) in (49, 50, 51)
    assert bench.report().largest_jump_v < 1e-6


def test_opc_waits_for_the_burst(idle, link):
    send(link, "FREQ 20", "*TRG")
    start = idle.clock.now()
    assert ask(link, "*OPC?") == "1"
    assert idle.clock.now() - start == pytest.approx(0.5, abs=0.01)


def test_a_fast_clock_plays_a_higher_frequency():
    bench = SimulatedBench(SimulationParameters(generator=GeneratorParameters(clock_ppm=1000.0)), VirtualClock())
    send(bench.link(), *CAREFUL, "FREQ 100", "BURS:NCYC 100")
    bench.clock.sleep(0.1)
    bench.enable_hv()
    send(bench.link(), "*TRG")
    bench.clock.sleep(2.0)
    assert bench.report().outside_rest_s == pytest.approx(0.999, rel=2e-2)


def test_the_real_driver_plays_a_dwell_without_a_single_jump(bench):
    source = Keysight33500(bench.link(), bench.clock)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.start_drive(Sine(150.0, 2.5, 2.5, 30))
    bench.clock.sleep(0.5)
    source.start_drive(Sine(50.0, 1.0, 2.5, 1000))
    bench.clock.sleep(0.3)
    source.stop()
    source.ramp_to(3.0, 0.2)
    source.ramp_to(2.5, 0.2)
    bench.clock.sleep(0.1)
    bench.disable_hv()
    report = bench.report()
    assert report.ends_at_rest
    assert report.switched_at_rest
    assert report.largest_jump_v <= 0.0501
    assert report.lowest_v > -1e-9
    assert report.highest_v < 5 + 1e-9
