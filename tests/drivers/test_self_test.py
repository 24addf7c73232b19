"""Self-test at arming: instruments that do not play as commanded are refused before high voltage; healthy ones arm in a second."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from app.session.bench_connection import BenchConnection
from drivers.bench.armed_bench import ArmedBench
from drivers.bench.self_test import SelfTest
from drivers.clock import Clock
from drivers.drive_shapes import Sine
from drivers.errors import BenchError
from drivers.interfaces import Block, Scale
from model import AmplifierMap
from sim_hardware.clock import VirtualClock
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, simulated

RATE_HZ = 5000.0


class Switch:
    """The operator's switch of the simulated bench, with the number of times that it was switched on."""

    def __init__(self, world: Any) -> None:
        self._world, self.on = world, 0

    def disable(self) -> None:
        self._world.disable_hv()

    def enable(self) -> None:
        self.on += 1
        self._world.enable_hv()


def refusal(lab: Any, switch: Switch, rate_hz: float = RATE_HZ) -> str:
    """Arm; return the reason of a refusal, empty if the bench was armed."""
    try:
        with lab.bench.armed(rate_hz, lambda _: None, switch):
            assert switch.on == 1
    except BenchError as refused:
        assert switch.on == 0, "high voltage was switched on for a source that does not play as commanded"
        return str(refused)
    return ""


DEVIATIONS = [
    ("33511B", "output-polarity=inverted", "is inverted"),
    ("33511B", "scale=quarter", "load (high impedance)"),
    ("33220A", "scale=fourfold", "load (high impedance)"),
    ("DG1032Z", "start=sometimes-lost", "did not start"),
    ("DG1032Z", "after=zero", "does not end at rest"),
    ("33511B", "surge=at-start", "begins with a pulse"),
    ("SDG1032X", "surge=at-start", "begins with a pulse"),
    ("SDG1032X", "output-polarity=inverted", "is inverted"),
    ("SDG6022X", "scale=quarter", "load (high impedance)"),
    ("SDG1032X", "scale=fourfold", "load (high impedance)"),
    ("AFG3022C", "after=zero", "does not end at rest"),
    ("DG812", "output-polarity=inverted", "is inverted"),
]


@pytest.mark.parametrize(("model", "trait", "words"), DEVIATIONS)
def test_an_instrument_that_does_not_play_as_commanded_is_refused_before_high_voltage(
    model: str, trait: str, words: str
) -> None:
    with laboratory(simulated(generator={"model": model, "traits": trait})) as lab:
        assert words in refusal(lab, Switch(lab.control))
        assert lab.control.report().live_s == 0


@pytest.mark.parametrize("order", ["big", "little"])
def test_a_source_arms_with_either_byte_order_where_its_documents_disagree(order: str) -> None:
    """A public driver of two SDG6022X names one, Siglent's application note the other."""
    with laboratory(simulated(generator={"model": "SDG6022X", "traits": f"byte-order={order}"})) as lab:
        assert refusal(lab, Switch(lab.control)) == ""
        live_s = lab.control.report().live_s
        assert refusal(lab, Switch(lab.control)) == ""
        report = lab.control.report()
        assert report.live_s >= live_s
        assert_safe_voltage(report)


@contextlib.contextmanager
def hidden(lab: BenchConnection, **settings: Any) -> Iterator[None]:
    """Give the generator settings that act at each trigger, and that no query tells."""
    generator = lab.control.generator
    trigger = generator.trigger

    def with_settings() -> None:
        own = {name: getattr(generator.settings, name) for name in settings}
        generator.settings = replace(generator.settings, **settings)
        trigger()
        generator.settings = replace(generator.settings, **own)

    generator.trigger = with_settings
    yield
    generator.trigger = trigger


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"delay_s": 0.03}, ""),  # no more than a busy computer takes for the reply
        ({"delay_s": 0.06}, "ms late. Look at the generator's trigger delay"),
        ({"delay_s": 2.0}, "did not start. Look at the generator's trigger source and delay"),
        ({"advances_by_trigger": True}, "did not start"),
        ({"cycles": 60.0}, "does not end at rest"),
        ({"frequency_hz": 160.0}, "has another form"),
        ({"phase_deg": 180.0}, "is inverted"),
    ],
)
def test_a_hidden_setting_is_found_also_on_a_source_that_was_armed_before(settings: dict[str, Any], words: str) -> None:
    with laboratory(simulated(generator={"model": "33511B"})) as lab:
        assert refusal(lab, Switch(lab.control)) == ""
        live_s = lab.control.report().live_s
        with hidden(lab, **settings):
            assert words in (reason := refusal(lab, Switch(lab.control)))
            assert bool(reason) == bool(words)
        report = lab.control.report()
        assert_safe_voltage(report)
        assert (
            max(report.highest_v - 2.5, 2.5 - report.lowest_v) < 0.06
        )  # the test moves it no further than rest may be off
        assert report.ends_at_rest
        assert report.live_s > live_s  # high voltage was on from the first run


@pytest.mark.parametrize("model", ["SDG1032X", "DG812", "AFG3022C"])
def test_a_source_of_one_amplitude_is_tested_with_high_voltage_off_once_in_a_session(model: str) -> None:
    """Its wrong waveform would be as large as a drive: another program may have left it at rest, with high voltage on."""
    with laboratory(simulated(generator={"model": model})) as lab:
        switched: list[str] = []

        def refuses(*_: object) -> None:
            raise BenchError("refused")

        class Noted(Switch):
            def disable(self) -> None:
                switched.append("off")
                super().disable()

        assert refusal(lab, Noted(lab.control)) == ""
        assert refusal(lab, Noted(lab.control)) == ""
        assert switched == ["off"]
        lab.bench._source_tested = False  # as in a program that was started anew
        assert refusal(lab, Noted(lab.control)) == ""
        assert switched == ["off", "off"]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ArmedBench, "test_source", refuses)
            assert refusal(lab, Noted(lab.control)) == "refused"
        assert refusal(lab, Noted(lab.control)) == ""
        assert switched == ["off"] * 3, "a test that failed is none"


@pytest.mark.parametrize("rate_hz", [1000.0, 5000.0, 100_000.0])
@pytest.mark.parametrize("source", ["33511B", "33220A", "DG1032Z", "DG812", "SDG1032X", "AFG3022C", "AFG1022"])
@pytest.mark.deep
def test_a_healthy_source_arms_within_a_second(source: str, rate_hz: float) -> None:
    with laboratory(simulated(generator={"model": source})) as lab:
        took_s: list[float] = []
        test = ArmedBench.test_source

        def timed(armed: ArmedBench, clock: Clock) -> None:
            begin_s = clock.now()
            test(armed, clock)
            took_s.append(clock.now() - begin_s)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ArmedBench, "test_source", timed)
            for _ in range(2):
                assert refusal(lab, Switch(lab.control), rate_hz) == ""
        assert max(took_s) < 1.0


# -- every limit from both sides, with bursts as the card sees them ---------------------------------------------------------


@dataclass(frozen=True)
class Burst:
    """A burst at the amplifier's input: what differs from the command."""

    gain: float = 1.0
    offset_v: float = 0.0
    delay_s: float = 0.001
    after_v: float = 0.0
    harmonic: float = 0.0
    """Amplitude of a second harmonic, relative."""


class Scripted(VirtualClock):
    """Clock, source and card of a self-test; the card sees `bursts`, one after the other, and the last one again."""

    identity, rate_hz, start_time_s, map = "source", RATE_HZ, 0.0, AmplifierMap()
    scales = (Scale((0.0, 1e-4)),)

    def __init__(self, *bursts: Burst, idle_v: float = 2.5, other_order: Burst | None = None) -> None:
        super().__init__()
        self.bursts, self.idle_v, self.other_order = bursts, idle_v, other_order
        self.played: list[tuple[float, Sine, Burst]] = []
        self.next_scan = self.rests = 0
        self.orders = ["big-endian"]

    def reason_unsupported(self, _: Sine) -> str:
        return ""

    def byte_order(self, new: str = "") -> str:
        self.orders += [new] if new else []
        return self.orders[-1] if self.other_order else ""

    def start_drive(self, sine: Sine) -> None:
        burst = self.bursts[min(len(self.played), len(self.bursts) - 1)]
        self.played.append(
            (self.now(), sine, self.other_order if self.orders[-1] == "little-endian" and self.other_order else burst)
        )

    def return_to_rest(self) -> None:
        self.rests += 1

    def read_block(self) -> Block:
        start, self.next_scan = self.next_scan, self.next_scan + 50
        self.sleep(50 / RATE_HZ)
        times = np.arange(start, self.next_scan) / RATE_HZ
        volts = np.full(times.size, self.idle_v)
        for called_s, sine, burst in self.played:
            t = times - called_s - burst.delay_s
            phase = 2 * np.pi * sine.frequency_hz * t
            form = np.sin(phase) + burst.harmonic * np.sin(2 * phase)
            during = (t >= 0) & (t < sine.duration_s)
            volts += np.where(during, burst.gain * sine.amplitude_v * form + burst.offset_v, 0.0)
            volts += np.where((t >= sine.duration_s) & (t < 0.3), burst.after_v, 0.0)
        return Block(start, np.round(volts[None] / 1e-4).astype(np.int16))


def judged(scripted: Scripted) -> str:
    """Return the reason of a refusal, empty without one."""
    try:
        SelfTest(scripted, scripted, scripted.read_block, scripted).run()  # type: ignore[arg-type]
    except BenchError as refused:
        return str(refused)
    assert scripted.rests == len(scripted.played)
    return ""


LIMITS = [
    ({"gain": 0.82}, {"gain": 0.78}, "39 mV"),
    ({"gain": 1.18}, {"gain": 1.22}, "61 mV"),
    ({"gain": 0.82}, {"gain": -1.0}, "inverted"),
    ({"offset_v": 0.013}, {"offset_v": 0.017}, "17 mV off"),
    ({"offset_v": -0.013}, {"offset_v": -0.017}, "-17 mV off"),
    ({"after_v": 0.013}, {"after_v": 0.017}, "end at rest"),
    ({"after_v": -0.013}, {"after_v": -0.017}, "end at rest"),
    ({"harmonic": 0.38}, {"harmonic": 0.48}, "form"),
    ({"delay_s": 0.036}, {"delay_s": 0.046}, "46 ms late"),
    ({"gain": 0.9}, {"gain": 0.05}, "start"),
]


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("inside", "outside", "words"), LIMITS)
def test_each_burst_is_compared_on_both_sides_of_each_limit(
    inside: dict[str, float], outside: dict[str, float], words: str
) -> None:
    good, bad = Burst(**inside), Burst(**outside)
    assert judged(Scripted(good)) == ""
    for bursts, which in ([(bad,), "a burst"], [(good, bad), "a second burst"]):
        refused = judged(Scripted(*bursts))
        assert words in refused
        assert f"plays {which}" in refused


def test_two_bursts_differ_by_less_than_a_seventh() -> None:
    assert judged(Scripted(Burst(gain=1.1), Burst(gain=0.97))) == ""
    assert judged(Scripted(Burst(gain=0.97), Burst(gain=1.1))) == ""
    assert_names(judged(Scripted(Burst(gain=1.1), Burst(gain=0.92))), "55", "46")
    assert_names(judged(Scripted(Burst(gain=0.92), Burst(gain=1.1))), "46", "55")


def test_a_burst_is_compared_with_the_level_before_it() -> None:
    assert judged(Scripted(Burst(), idle_v=2.53)) == ""
    assert judged(Scripted(Burst(), idle_v=2.47)) == ""


def test_the_other_byte_order_is_kept_where_it_is_the_order_only() -> None:
    other = Scripted(Burst(harmonic=2.0), other_order=Burst())
    assert judged(other) == ""
    assert other.orders == ["big-endian", "little-endian"]
    neither = Scripted(Burst(harmonic=2.0), other_order=Burst(harmonic=1.0))
    assert "form" in judged(neither)
    assert neither.orders == ["big-endian", "little-endian", "big-endian"]
