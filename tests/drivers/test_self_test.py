"""Self-test at arming: instruments that do not play as commanded are refused before high voltage; healthy ones arm in a second."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from app.session.bench_connection import BenchConnection
from drivers.bench.armed_bench import ArmedBench
from drivers.clock import Clock
from drivers.errors import BenchError
from sim_hardware.testing.safe_volts import assert_safe_voltage
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
