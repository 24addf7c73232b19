"""Siglent driver against what real ones were seen to do: line feeds in waveforms, silence, stale selections, one session."""

import numpy as np
import pytest

from drivers.clock import WallClock
from drivers.drive_shapes import PeriodicSweep, Sine, Steps
from drivers.errors import InstrumentError, LinkError
from drivers.generators.siglent import FULL_SCALE, SiglentSdg, without_line_feeds
from drivers.generators.waveform import SINE_CYCLE
from drivers.transport.visa import VisaLink
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.generators.registry import traits_of
from sim_hardware.service.served_bench import ServedBench
from tests.drivers.test_keysight_33500 import Tapped
from tests.helpers.front_panel import press
from tests.helpers.simulated_bench import assert_safe_voltage, simulated

ARMED = 2.5, 0.0, 5.0


def opened(model: str = "SDG1032X", traits: str = "", seed: int = 1) -> tuple[SiglentSdg, SimulatedBench, Tapped]:
    config = simulated(generator={"model": model, "traits": traits}, seed=seed)
    bench = SimulatedBench(config.simulation_parameters, VirtualClock())
    link = Tapped(bench.link())
    return SiglentSdg(link, bench.clock), bench, link


def play(source: SiglentSdg, bench: SimulatedBench) -> None:
    bench.clock.sleep(0.1)
    bench.enable_hv()
    for drive in (Sine(50.0, 2.5, 2.5, 10), Steps((2.5, 3.3, 2.5), 0.05, 0.05), Sine(50.0, 1.0, 2.5, 10)):
        source.start_drive(drive)
        source.stop()
        bench.clock.sleep(0.1)
    report = bench.report()
    assert_safe_voltage(report)
    assert (report.lowest_v, report.highest_v) == (pytest.approx(0.0, abs=0.02), pytest.approx(5.0, abs=0.02))


@pytest.mark.one_in(1)
@pytest.mark.parametrize("amplitude", [0.01, 0.1, 0.2, 0.25, 0.5, 1.0])
def test_no_byte_of_a_waveform_ends_its_message(amplitude: float) -> None:
    """0.5 V of 2.5 V has the code 10 as its second point: one point arrived. 0 remains exactly 0: it is the idle level."""
    codes = np.rint(SINE_CYCLE * amplitude * FULL_SCALE).astype("<i2")
    sent = without_line_feeds(codes)
    assert b"\n" in codes.tobytes()
    assert b"\n" not in sent.tobytes()
    assert np.abs(sent.astype(int) - codes).max() <= 128
    assert not sent[codes == 0].any()


def test_every_code_has_a_neighbour_without_a_line_feed() -> None:
    codes = np.arange(-32767, 32768).astype("<i2")
    sent = without_line_feeds(codes)
    assert b"\n" not in sent.tobytes()
    assert np.abs(sent.astype(int) - codes).max() <= 129
    assert (np.diff(sent.astype(int)) >= 0).all()


@pytest.mark.parametrize("model", ["SDG1032X", "SDG2122X"])
@pytest.mark.parametrize("seed", range(4))
def test_it_arms_and_plays_whatever_is_drawn(model: str, seed: int) -> None:
    source, bench, _ = opened(model, seed=seed)
    source.initialize_at_rest(*ARMED)
    assert source.is_at_rest(*ARMED)
    play(source, bench)


@pytest.mark.deep
@pytest.mark.parametrize(
    ("model", "trait"),
    [(m, f"{t.name}={option}") for m in ("SDG1032X", "SDG2122X") for t in traits_of(m) for option in t.options],
)
@pytest.mark.parametrize("seed", range(6))
def test_it_arms_and_plays_with_each_trait(model: str, trait: str, seed: int) -> None:
    source, bench, _ = opened(model, trait, seed)
    source.initialize_at_rest(*ARMED)
    play(source, bench)


LEFT = ("C1:OUTP PLRT,INVT", "C1:INVT ON", "C1:CMBN ON", "COUP TRACE,ON", "C1:SWWV STATE,ON", "C1:MDWV STATE,ON")


@pytest.mark.parametrize(
    ("model", "setting"),
    [
        *((m, s) for m in ("SDG1032X", "SDG2122X") for s in LEFT),
        ("SDG2122X", "C1:SRATE MODE,TARB"),
        ("SDG2122X", "C1:NOISE_ADD STATE,ON"),
    ],
)
def test_what_the_previous_user_left_is_noticed_and_corrected(model: str, setting: str) -> None:
    source, bench, link = opened(model, "inversion=two-switches")
    source.initialize_at_rest(*ARMED)
    press(link, setting)
    assert not source.is_at_rest(*ARMED)
    source.initialize_at_rest(*ARMED)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.start_drive(Steps((2.5, 3.3, 2.5), 0.05, 0.05))
    source.stop()
    report = bench.report()
    assert_safe_voltage(report)
    assert (report.lowest_v, report.highest_v) == (pytest.approx(2.5, abs=0.02), pytest.approx(3.3, abs=0.02))


def test_a_truncated_waveform_is_never_played(monkeypatch: pytest.MonkeyPatch) -> None:
    source, bench, _ = opened()
    source.initialize_at_rest(*ARMED)
    monkeypatch.setattr("drivers.generators.siglent.without_line_feeds", lambda codes: codes)
    with pytest.raises(InstrumentError, match=r"reads back with \d+ bytes in place of the \d+ .* it was not played"):
        source.start_drive(Sine(50.0, 1.0, 2.5, 10))
    assert bench.report().outside_rest_s == 0


def test_uploads_stay_below_the_size_that_hangs_it_and_repeated_drives_need_none() -> None:
    source, bench, link = opened("SDG2122X")
    source.initialize_at_rest(*ARMED)
    for _ in range(5):
        for amplitude in (0.5, 1.0):
            source.start_drive(Sine(50.0, amplitude, 2.5, 5))
            source.stop()
    sweep = PeriodicSweep(20.0, 40.0, 1.0, 2, 2.0, 2.5)
    source.start_drive(sweep)
    source.stop()
    uploads = [message for message in link.sent if message.startswith("C1:WVDT")]
    assert len(uploads) == 4  # the sine of the set-up, two amplitudes, a sweep
    assert max(len(message) for message in uploads) < 65_536
    assert not bench._generator_model.hung  # type: ignore[attr-defined]


def test_a_waveform_that_is_never_selected_is_not_played(monkeypatch: pytest.MonkeyPatch) -> None:
    source, bench, _ = opened("SDG2122X", "stale=never")
    source.initialize_at_rest(*ARMED)
    for amplitude in (0.5, 1.0):
        source.start_drive(Sine(50.0, amplitude, 2.5, 5))
        source.stop()
    outside_s = bench.report().outside_rest_s
    handle = bench.message_port.handle
    monkeypatch.setattr(
        bench.message_port, "handle", lambda message: None if message.startswith("C1:ARWV NAME") else handle(message)
    )
    with pytest.raises(InstrumentError, match=r"was selected 6 times and is not"):
        source.start_drive(Sine(50.0, 0.5, 2.5, 5))
    assert bench.report().outside_rest_s == outside_s


def test_usb_is_refused_with_the_remedy() -> None:
    class UsbLink(Tapped):
        name = "USB0::0xF4EC::0x1103::SDG1::INSTR"

    _, bench, _ = opened()
    link = UsbLink(bench.link())
    link.name = UsbLink.name
    with pytest.raises(InstrumentError, match=r"loses uploaded waveforms on USB .* Connect its LAN port"):
        SiglentSdg(link, bench.clock)


@pytest.mark.deep
def test_over_a_socket_a_second_session_is_not_answered_and_the_first_plays() -> None:
    bench = SimulatedBench(simulated(generator={"model": "SDG2122X"}).simulation_parameters, WallClock(20.0))
    with ServedBench(bench) as served:
        source = SiglentSdg(VisaLink(served.scpi.resource, timeout_s=2.0), bench.clock)
        second = VisaLink(served.scpi.resource, timeout_s=0.3)
        second.write("*IDN?")
        with pytest.raises(LinkError, match=rf"{served.scpi.port}.*\b0\.3 s\b"):
            second.read()
        second.close()
        source.initialize_at_rest(*ARMED)
        play(source, bench)
        source.close()
        third = VisaLink(served.scpi.resource, timeout_s=2.0)
        third.write("*IDN?")
        assert "SDG2122X" in third.read()
        third.close()


@pytest.mark.deep
@pytest.mark.parametrize(("recall", "uploads"), [("works", 3), ("ignored", 4)])
def test_an_sdg6000x_that_ignores_a_selection_by_name_takes_the_waveform_again(recall: str, uploads: int) -> None:
    """Firmware 6.01.01.37R6 of an SDG6022X does, 38R3 does not."""
    source, bench, link = opened("SDG6022X", f"recall={recall} stale=never silence=brief")
    source.initialize_at_rest(*ARMED)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    for amplitude in (0.5, 1.0, 0.5):
        source.start_drive(Sine(50.0, amplitude, 2.5, 5))
        bench.clock.sleep(0.2)
        source.stop()
    assert sum("WVDT WVNM" in message for message in link.sent) == uploads
    assert bench.report().outside_rest_s == pytest.approx(0.3, rel=0.05)
