"""Opens whatever a bench file puts at the amplifier's input: a generator, an output of the card, or a DC supply."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from app.config import BenchConfig
from app.drivers import open_generator
from drivers.clock import Clock
from drivers.ports import Source
from drivers.scpi import Link

MARGIN_S = 0.1
"""Wall time for the computer and the bus to rewrite a drive of the card that is to be stopped."""

SERVED_OUTPUT = (
    "No watchdog: the drive is played by the card behind a gRPC server, which keeps it from anybody else. If this program "
    "dies while the bench is live, a drive ends by itself at rest, but a held level stays on the specimen"
)


def open_source(
    config: BenchConfig, clock: Clock, link: Callable[[float], Link], server: str, stack: ExitStack
) -> Source:
    """The source, on its wire; it is let go with `stack`. `link` opens a wire, given how long an answer may take.

    Raises:
        InstrumentError: it is not there, or something else is.
    """
    match config.source.kind:
        case "card-output":
            from drivers.nidaq_output import NiOutput

            output = NiOutput(clock=clock, **{**options(config, _speed(clock)), "server": server or None})
            stack.callback(output.close)
            return output
        case "dc-supply":
            from drivers.dc_supply import DcSupply

            wire = link(config.supply.timeout_s)
            stack.callback(wire.close)
            return DcSupply(wire, clock, **options(config, _speed(clock)))
        case "generator":
            wire = link(config.generator.timeout_s)
            stack.callback(wire.close)
            return open_generator(config.generator.driver, wire, clock, config.amplifier.step_v)


def options(config: BenchConfig, speed: float) -> dict[str, Any]:
    """What the driver of the source is told beyond its wire and its clock; plain values, the watchdog needs them too."""
    match config.source.kind:
        case "card-output":
            return {
                "device": config.card.device,
                "channel": config.source.channel,
                "start_trigger": config.source.start_trigger,
                "margin_s": MARGIN_S * speed,
            }
        case "dc-supply":
            return {
                "channel": config.supply.channel,
                "current_limit_a": config.supply.current_limit_a,
                "fall_time_s": config.supply.fall_time_s,
                "step_v": config.amplifier.step_v,
            }
        case "generator":
            return {"step_v": config.amplifier.step_v}


def _speed(clock: Clock) -> float:
    return float(getattr(clock, "speed", 1.0))
