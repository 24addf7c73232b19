"""What the models of SCPI function generators share: settings by header, modes that exclude each other, waveforms.

A dialect's model lists its headers and adds what is its own; what a setting does to the output is `Generator`'s.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sim_hardware.generators.generator import Generator
from sim_hardware.generators.scpi_levels import MAX_EMF_V, Levels
from sim_hardware.plant.segments import Wave
from sim_hardware.wires.scpi_engine import Arguments, Command, ScpiError, boolean, choice, number, one, real


class ScpiBox:
    """SCPI model of one channel over a `Generator` (sim_hardware.wires.scpi_engine.Instrument).

    Args:
        now: bench time, for what depends on whether a burst is still running.

    Attributes:
        report: puts an error into the queue although the command is carried out; the engine's, once there is one.
    """

    TOP_HZ: ClassVar[float] = 20e6
    MOST_CYCLES: ClassVar[float] = 1e8
    SPAN_IS_THE_WAVES_OWN: ClassVar[bool] = False
    """Whether the amplitude setting means the span of the points as they are, or of the converter."""

    def __init__(self, core: Generator, now: Callable[[], float], identity: str) -> None:
        self.identity = identity
        self.report: Callable[[ScpiError], None] = lambda _: None
        self._core = core
        self._now = now
        self._choices: dict[str, str] = {}
        self._levels = Levels(core, self._report, self.real)

    def real(self, value: float) -> str:
        """How this box writes a number."""
        return real(value)

    def switch(self, on: bool) -> str:
        """How this box writes a switch."""
        return str(int(on))

    @property
    def commands(self) -> Sequence[Command]:
        raise AttributeError(f"{type(self).__name__} lists no commands")

    def reset(self) -> None:
        self._choices.clear()
        self._levels.reset()
        self._core.reset()

    def trigger(self) -> None:
        if not self._core.ready_for_trigger(self._now()):
            raise ScpiError(-211)
        self._core.trigger()

    def busy_s(self) -> float:
        return self._core.busy_s(self._now())

    def _report(self, error: ScpiError) -> None:
        self.report(error)

    def _numeric(self, pattern: str, name: str, unit: str, low: float, high: float, default: float) -> Command:
        def setter(a: Arguments) -> None:
            self._core.change(**{name: self._levels.clip(number(one(a), unit, low, high, default), low, high)})

        return Command(pattern, setter, lambda _: self.real(getattr(self._core.settings, name)))

    def _mode(self, pattern: str, mode: str, other: str) -> Command:
        return Command(pattern, self._set_mode(mode, other), lambda _: self.switch(getattr(self._core.settings, mode)))

    def _switch(self, pattern: str, name: str) -> Command:
        def setter(a: Arguments) -> None:
            self._core.change(**{name: boolean(one(a))})

        return Command(pattern, setter, lambda _: self.switch(getattr(self._core.settings, name)))

    def _kept(self, pattern: str, *names: str) -> Command:
        """A setting that is kept and answered, and that makes no difference to an output at idle; the first is factory."""

        def setter(a: Arguments) -> None:
            self._choices[pattern] = choice(one(a), *names)

        factory = "".join(c for c in names[0] if not c.islower())
        return Command(pattern, setter, lambda _: self._choices.get(pattern, factory))

    def _enter(self, function: str) -> None:
        """Another function: what does not go with it gives way, with an error in the queue."""
        s = self._core.settings
        self._levels.check(s.emf_vpp, s.emf_offset_v, function)
        if function == "DC":
            if s.burst or s.sweep:
                mode = "burst" if s.burst else "sweep"
                self.report(ScpiError(-221, f"not able to {mode} dc, {mode} turned off"))
            self._core.change(function="DC", burst=False, sweep=False)
            return
        # DC allows an offset that leaves no room for a wave.
        room = MAX_EMF_V - s.emf_vpp / 2
        if abs(s.emf_offset_v) > room:
            self.report(ScpiError(-221, "offset changed on exit from dc function"))
        self._core.change(function=function, emf_offset_v=min(max(s.emf_offset_v, -room), room))

    def _set_mode(self, mode: str, other: str) -> Callable[[Arguments], None]:
        def setter(a: Arguments) -> None:
            on, s = boolean(one(a)), self._core.settings
            if on and s.function == "DC":
                raise ScpiError(-221, f"not able to {mode} dc, {mode} turned off")
            changed: dict[str, Any] = {mode: on}
            if on and getattr(s, other):
                self.report(ScpiError(-221, f"{other} turned off by selection of other mode or modulation"))
                changed[other] = False
            self._core.change(**changed)

        return setter

    def _set_cycles(self, a: Arguments) -> None:
        cycles = number(one(a), "", 1.0, self.MOST_CYCLES, 1.0)
        if not math.isinf(cycles):
            self._core.change(cycles=float(round(self._levels.clip(cycles, 1.0, self.MOST_CYCLES))))
            return
        if self._core.settings.trigger == "IMM":
            self.report(ScpiError(-221, "infinite burst changed trigger source to BUS"))
            self._core.change(trigger="BUS")
        self._core.change(cycles=cycles)

    def _set_wave(self, points: NDArray[np.float64], smooth: bool = False, **settings: Any) -> None:
        """Play these points from now on, 1 being half of what the amplitude says."""
        if self.SPAN_IS_THE_WAVES_OWN:
            points = points * (2 / max(float(np.ptp(points)), 1e-9))
        # Single precision is finer than any box's converter, and the history keeps every waveform for ever.
        self._core.change(wave=Wave(points.astype(np.float32), smooth), **settings)


def data_of(argument: str, kind: str, low: float, high: float) -> NDArray[np.float64]:
    """The points in a binary block.

    Raises:
        ScpiError: no whole number of values, or one outside the limits: the byte order is wrong, for example.
    """
    raw = argument.encode("latin-1")
    width = np.dtype(kind).itemsize
    if not raw or len(raw) % width:
        raise ScpiError(-161)
    points = np.frombuffer(raw, kind).astype(np.float64)
    if not np.all((points >= low) & (points <= high)):
        raise ScpiError(-222, "a point lies outside the converter's range")
    return points


def only(*names: str) -> Callable[[Arguments], None]:
    """A setting of which a model knows these values, and to which none of them makes a difference."""

    def setter(a: Arguments) -> None:
        choice(one(a), *names)

    return setter
