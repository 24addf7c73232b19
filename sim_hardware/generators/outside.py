"""A generator that another package simulates: messages go in, replies and the volts of its output come out."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Protocol

import numpy as np

from model import Array
from sim_hardware import plant
from sim_hardware.generators.generator import SegmentFactory
from sim_hardware.wires import ScpiResponse

GROUP = "tactor_bench.simulated_generators"
"""Group of the entry points; each makes an `OutsideGenerator` without arguments."""

Volts = Callable[[Array], Array]
"""Function from bench times, (N,), s, to the volts of the open output, (N,)."""

log = logging.getLogger(__name__)


class OutsideGenerator(Protocol):
    """A simulated generator of another package."""

    def message(self, data: bytes, now_s: float) -> bytes:
        """Execute one message without its end of line, received at `now_s`; return the reply without its end of line, empty: none."""

    def output(self) -> Volts:
        """Return the volts of the output over time, as they will be without a further message.

        The same function is returned until a message changes the output. It may have the attribute `constant_from_s`: the bench
        time after which the output is constant.
        """


@dataclass(frozen=True, slots=True, eq=False)
class OutsideSegment:
    """Output of an outside generator (sim_hardware.plant.Segment)."""

    function: Volts

    @property
    def constant_from_s(self) -> float:
        return float(getattr(self.function, "constant_from_s", math.inf))

    @property
    def breakpoints_s(self) -> tuple[float, ...]:
        return ()

    def volts(self, t: Array) -> Array:
        volts = np.asarray(self.function(t), float)
        if volts.shape != np.shape(t) or not np.isfinite(volts).all():
            raise ValueError(
                f"the outside generator yields {volts.shape} volts for {np.shape(t)} times, or not finite ones"
            )
        return volts


class OutsideEngine:
    """Runs the messages of an outside generator (sim_hardware.wires.ScpiEngine).

    Args:
        generator: the generator.
        emit: sink of its segments, the cable to the amplifier.
        now: bench time.
    """

    single_session = False

    def __init__(
        self, generator: OutsideGenerator, emit: Callable[[SegmentFactory], None], now: Callable[[], float]
    ) -> None:
        self._generator, self._emit, self._now = generator, emit, now
        self._output: Volts | None = None
        self.hung, self.silent = False, False
        self.process_command: Callable[[], None] = lambda: None
        self._emit_output()

    def execute(self, message: str) -> ScpiResponse | None:
        """Run one message; return its reply, or None. A generator that raises is hung from then on."""
        try:
            reply = self._generator.message(message.encode("latin-1"), self._now())
            self._emit_output()
        except Exception:
            self.hung = True
            log.exception("The outside generator failed at %r; it does not answer any more", message[:80])
            return None
        return ScpiResponse(reply.decode("latin-1")) if reply else None

    def set_power(self, on: bool) -> None:
        """Switch it off and on; off, its output is 0 V."""
        if not on:
            self._emit(lambda _: plant.ConstantSegment(0.0))
        else:
            self.hung, self._output = False, None
            self._emit_output()

    def _emit_output(self) -> None:
        output = self._generator.output()
        if output is not self._output:
            self._output = output
            self._emit(lambda _: OutsideSegment(output))


def load_outside_generator(name: str) -> OutsideGenerator:
    """Return the generator of an entry point.

    Raises:
        ValueError: there is no such entry point, or it fails.
    """
    points = {point.name: point for point in entry_points(group=GROUP)}
    if name not in points:
        known = ", ".join(sorted(points)) or "none is installed"
        raise ValueError(f"generator.outside is {name!r}, but no package has this entry point of {GROUP}: {known}")
    try:
        generator: OutsideGenerator = points[name].load()()
    except Exception as error:
        raise ValueError(f"generator.outside: {name!r} cannot be made: {type(error).__name__}: {error}") from error
    return generator
