"""The composition root: the one place that decides between real and simulated instruments."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from app.config import BenchConfig
from drivers.amplifier import HvAmplifier
from drivers.bench import Bench
from drivers.clock import Clock, WallClock
from drivers.keysight_33500 import Keysight33500
from drivers.ports import Digitizer
from drivers.scpi import Link
from protocols.operator import Operator
from sim_hardware.operator import SimulatedOperator

BLOCK_S = 0.05
"""A block on a bench at real speed; at raised speed blocks grow, so that they stay worth their round trip."""


@dataclass(frozen=True, slots=True)
class Laboratory:
    """A connected bench. `operator` answers prompts on a simulated one; `control` reaches its hidden hands: faults."""

    bench: Bench
    operator: Operator | None = None
    control: Any = None


@contextmanager
def connect(config: BenchConfig, speed: float | None = None) -> Iterator[Laboratory]:
    """Open the instruments of a bench; they are let go at the end, the source staying at rest.

    Args:
        config: the bench file.
        speed: of a simulated bench, times real; None is the virtual clock, in this process.

    Raises:
        BenchError: an instrument is not there.
    """
    with ExitStack() as stack:
        if not config.simulated:
            yield _assemble(config, stack, WallClock(), config.generator.resource, config.card.server)
        elif speed is None:
            from sim_hardware.bench import VirtualBench
            from sim_hardware.clock import VirtualClock

            virtual = VirtualBench(config.truth, VirtualClock())
            bench = _bench(config, virtual.clock, virtual.link(config.generator.timeout_s), virtual.digitizer(), stack)
            yield Laboratory(bench, SimulatedOperator(virtual), virtual)
        else:
            from sim_hardware.process import BenchProcess

            process = stack.enter_context(BenchProcess(config.truth, speed))
            laboratory = _assemble(config, stack, WallClock(speed), process.resource, process.server)
            yield Laboratory(laboratory.bench, SimulatedOperator(process), process)


def _assemble(config: BenchConfig, stack: ExitStack, clock: WallClock, resource: str, server: str) -> Laboratory:
    """Instruments on their wires: the same code for a real bench and a served simulated one."""
    from drivers.nidaq import NiDigitizer
    from drivers.visa import VisaLink

    card = config.card
    digitizer = NiDigitizer(
        card.device,
        (card.drive_channel, card.displacement_channel),
        clock,
        server=server or None,
        range_v=card.range_v,
        terminal=card.terminal,
    )
    stack.callback(digitizer.close)
    link = VisaLink(resource, config.generator.timeout_s)
    return Laboratory(_bench(config, clock, link, digitizer, stack, clock.speed))


def _bench(
    config: BenchConfig, clock: Clock, link: Link, digitizer: Digitizer, stack: ExitStack, speed: float = 1.0
) -> Bench:
    stack.callback(link.close)
    source = Keysight33500(link, clock, step_v=config.amplifier.step_v)
    identities = {
        "generator": str(source.identity),
        "amplifier": config.amplifier.name,
        "card": str(digitizer.identity),
        "sensor": config.sensor.name,
    }
    return Bench(
        amplifier=HvAmplifier(source, config.amplifier.map, config.amplifier.limits, clock),
        digitizer=digitizer,
        sensor=config.sensor.sensor,
        clock=clock,
        block_s=BLOCK_S if speed <= 1 else max(BLOCK_S, 0.02 * speed),
        simulated=config.simulated,
        record={**config.model_dump(mode="json"), "identities": identities, "speed": speed},
        name=config.name,
    )
