"""Commissioning of simulated benches: deviations drawn blind, and the checks that must find them."""

import random
from typing import Any

from app.config.bench_file import BenchConfig
from app.session.bench_connection import connect
from drivers.evidence.assumption import OutputCheck
from drivers.evidence.evidence_files import assumptions_about
from drivers.transport.observed_link import ObservedLink
from protocols.commissioning.messages import MessageLog
from protocols.commissioning.sequence import Commissioned, commission_bench
from sim_hardware.generators.registry import deviations_of
from tests.helpers.simulated_bench import simulated

FREEZING = ("33", "EDU", "FG", "G51", "DG10")
"""Instruments that idle at a small amplitude."""

MOVING = {"scale", "offset", "combining", "output-polarity"}
"""Deviations that move the bottom of the largest amplitude from 0 V."""

PROPERTIES = {
    "idle": "level between bursts",
    "after": "level after a burst",
    "output-polarity": "polarity",
    "upload": "output while a waveform is uploaded and selected",
    "range": "relay at a change of amplitude",
    "abort": "abort in mid-burst",
    "scale": "volts of an even waveform",
    "uneven": "amplitude of an uneven waveform",
    "offset": "volts of the offset",
    "filter": "filter STEP",
    "surge": "start of a burst",
    "droop": "a level held as one waveform",
    "start": "trigger",
    "combining": "level between bursts",
    "byte-order": "header and size of an upload",
}
"""What each deviation of a simulated instrument contradicts in the table of assumptions."""


class LateLink:
    """A link on a busy computer: some messages and replies are passed on late, drawn from a seed."""

    def __init__(self, link: Any, clock: Any, share: float, most_s: float) -> None:
        self._link, self._clock, self._draw = link, clock, random.Random(f"{share} {most_s}")
        self._share, self._most_s, self.name = share, most_s, link.name

    def write(self, message: str) -> None:
        self._wait()
        self._link.write(message)

    def read(self) -> str:
        reply: str = self._link.read()
        self._wait()
        return reply

    def _wait(self) -> None:
        if self._draw.random() < self._share:
            self._clock.sleep(self._draw.uniform(0, self._most_s))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)


class OffSwitch:
    """High voltage is off on the simulated bench, and may not come on."""

    def __init__(self, control: Any) -> None:
        self._control = control

    def disable(self) -> None:
        self._control.disable_hv()

    def enable(self) -> None:
        raise AssertionError("high voltage was switched on")


def commissioned(model: str, traits: str = "", seed: int = 1) -> Commissioned:
    return commissioned_bench(simulated(generator={"model": model, "traits": traits}, seed=seed))


def commissioned_bench(
    config: BenchConfig, late: tuple[float, float] = (0.0, 0.0), rate_hz: float = 50e3
) -> Commissioned:
    messages = MessageLog()

    def observe(link: Any, clock: Any) -> ObservedLink:
        return messages.observe(LateLink(link, clock, *late) if late[0] else link, clock)

    with connect(config, None, 0.1, observe) as lab:
        assert lab.control is not None
        return commission_bench(lab.bench, OffSwitch(lab.control), rate_hz, messages)


def deviating(found: Commissioned) -> set[OutputCheck]:
    return {check.check for check in found.checks if not check.passed}


def contradicted(model: str, chosen: dict[str, str]) -> set[OutputCheck]:
    """Return the checks that measure what the chosen deviations contradict."""
    table = {each.quantity: each.checks for each in assumptions_about(model)}
    shown = {check for name in chosen if name != "byte-order" for check in table[PROPERTIES[name]]}  # it is tried out
    at_zero = "idle" in chosen and not model.startswith(FREEZING) and not chosen.keys() & MOVING
    if at_zero:  # it idles at 0 V, where nothing that drops to 0 V shows
        shown -= {OutputCheck.AFTER, OutputCheck.SETTINGS}
    return shown


def draw_deviations(model: str, seed: int) -> dict[str, str]:
    """Return one to four deviations of a model, drawn from the seed."""
    draw = random.Random(f"{model} {seed}")
    some = draw.sample(deviations_of(model), draw.randint(1, 4))
    return {trait.name: draw.choice(trait.options[1:]) for trait in some}
