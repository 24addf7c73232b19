"""Simulated SCPI function generators: common commands, modes that exclude each other, waveforms.

A family lists its headers and adds its own commands; `SimulatedGenerator` applies the settings to the output.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import partial
from typing import Any, ClassVar

import numpy as np

from model import Array
from sim_hardware import wires
from sim_hardware.generators.generator import GeneratorSettings, InstrumentUnit, SimulatedGenerator
from sim_hardware.generators.scpi_levels import MAX_EMF_V, MIN_EMF_VPP, OutputLevels
from sim_hardware.plant import ArbitraryWaveform

SOURCE = "[SOURce[1]:]"
"""Prefix of the patterns of the source subsystem."""
OUTPUT_SETTINGS = {field.name for field in fields(GeneratorSettings)}
OTHER_CHANNEL_V = 0.7
"""Volts of the other channel of a two-channel instrument."""


class SimulatedScpiGenerator:
    """SCPI model of one channel over a `SimulatedGenerator` (sim_hardware.wires.scpi_engine.ScpiInstrument).

    Args:
        generator: the output stage.
        now: function that returns bench time, for the end of a burst.
        unit: its identity and traits.

    Attributes:
        identity: the reply to `*IDN?`.
        queue_error: function that queues an error for an executed command.
    """

    @property
    def UNKNOWN_HEADER_ENDS_MESSAGE(self) -> bool:
        return self.traits.get("unknown-header") == "whole-message"

    BLOCK_ENDS_MESSAGE: ClassVar[bool] = False
    """Whether commands after a binary block in its message are lost."""
    MAX_FREQUENCY_HZ: ClassVar[float] = 20e6
    MAX_BURST_CYCLES: ClassVar[float] = 1e8
    AMPLITUDE_IS_WAVEFORM_SPAN: ClassVar[bool] = False
    """Whether the amplitude setting is the span of the points, or of the converter."""
    ARBITRARY_KEYWORD: ClassVar[str] = "USER"
    """Name of the function that plays the waveform."""
    TRIGGER_KEYWORDS: ClassVar[Mapping[str, str]]
    """Names of the trigger sources, each with its setting of `SimulatedGenerator`."""
    FREQUENCY_HEADER: ClassVar[str] = "FREQuency[:FIXed]"
    BURST_HEADER: ClassVar[str] = "BURSt:STATe"
    TRIGGER_HEADER: ClassVar[str]

    def __init__(self, generator: SimulatedGenerator, now: Callable[[], float], unit: InstrumentUnit) -> None:
        self.identity, self.traits = unit.identity, unit.traits
        self._model = unit.model
        self.queue_error: Callable[[wires.ScpiError], None] = lambda _: None
        self._generator = generator
        self._now = now
        self._keyword_settings: dict[str, str] = {}
        self._levels = OutputLevels(generator, self._queue_error, self.format_number, self._min_emf_vpp)

    @property
    def _min_emf_vpp(self) -> float:
        """Smallest amplitude of the model at the open output: twice that into 50 ohm."""
        return MIN_EMF_VPP

    def format_number(self, value: float) -> str:
        """Return a number in this family's format."""
        return wires.format_real(value)

    def format_switch(self, on: bool) -> str:
        """Return a switch in this family's format."""
        return str(int(on))

    def format_polarity(self, inverted: bool) -> str:
        """Return the output polarity in this family's format."""
        return "INV" if inverted else "NORM"

    @property
    def commands(self) -> Sequence[wires.ScpiCommand]:
        """The common commands of all families, with their own headers; a family adds others."""
        core, number = self._generator, self.format_number
        return [
            wires.ScpiCommand(SOURCE + "FUNCtion[:SHAPe]", self._set_function, lambda _: self._function_keyword()),
            self._number(SOURCE + self.FREQUENCY_HEADER, "frequency_hz", "HZ", 1e-6, self.MAX_FREQUENCY_HZ, 1e3),
            self._setting("OUTPut[1][:STATe]", "on", wires.parse_boolean, self.format_switch),
            self._mode_command(SOURCE + self.BURST_HEADER, "burst", "sweep"),
            self._keyword_command(SOURCE + "BURSt:MODE", "TRIGgered", "GATed"),
            wires.ScpiCommand(SOURCE + "BURSt:NCYCles", self._set_cycles, lambda _: number(core.settings.cycles)),
            *self._polarity_commands(),
            wires.ScpiCommand(self.TRIGGER_HEADER + ":SOURce", self._set_trigger, lambda _: self._trigger_keyword()),
            wires.ScpiCommand(self.TRIGGER_HEADER + "[:IMMediate]", lambda _: self.trigger()),
        ]

    def reset(self) -> None:
        self._keyword_settings.clear()
        self._levels.reset()
        self._generator.reset()

    def trigger(self) -> None:
        if not self._generator.ready_for_trigger(self._now()):
            raise wires.ScpiError(-211)
        self._generator.trigger()

    def busy_s(self) -> float:
        return self._generator.busy_s(self._now())

    def _queue_error(self, error: wires.ScpiError) -> None:
        self.queue_error(error)

    def _setting(
        self,
        pattern: str,
        name: str,
        parse: Callable[[str], Any],
        show: Callable[[Any], str],
        then: Callable[[], None] = lambda: None,
    ) -> wires.ScpiCommand:
        """Make the command of a setting of the output, or of an attribute of this model; `then` is called after a change."""
        of_output = name in OUTPUT_SETTINGS

        def setter(a: wires.Arguments) -> None:
            value = parse(wires.single_argument(a))
            if of_output:
                self._generator.apply_settings(**{name: value})
            else:
                setattr(self, name, value)
            then()

        return wires.ScpiCommand(
            pattern, setter, lambda _: show(getattr(self._generator.settings if of_output else self, name))
        )

    def _number(
        self,
        pattern: str,
        name: str,
        unit: str,
        low: float,
        high: float,
        default: float,
        then: Callable[[], None] = lambda: None,
    ) -> wires.ScpiCommand:
        """Make the command of a number, which is clipped to its limits."""

        def parse(text: str) -> float:
            return self._levels.clip(wires.parse_number(text, unit, low, high, default), low, high)

        return self._setting(pattern, name, parse, self.format_number, then)

    def _choice(
        self, pattern: str, name: str, values: Mapping[str, Any], then: Callable[[], None] = lambda: None
    ) -> wires.ScpiCommand:
        """Make the command of a setting by its keywords; of two keywords for one value the first is replied."""
        shorts = {wires.short_form(keyword): value for keyword, value in values.items()}
        replies = {value: short for short, value in reversed(shorts.items())}
        return self._setting(
            pattern, name, lambda text: shorts[wires.match_keyword(text, *values)], replies.__getitem__, then
        )

    def _mode_command(self, pattern: str, mode: str, other: str) -> wires.ScpiCommand:
        return wires.ScpiCommand(
            pattern,
            partial(self._set_mode, mode=mode, other=other),
            lambda _: self.format_switch(getattr(self._generator.settings, mode)),
        )

    def _keyword_command(self, pattern: str, *names: str) -> wires.ScpiCommand:
        """Make a stored setting without effect on an idle output; the first name is the factory value."""

        def setter(a: wires.Arguments) -> None:
            self._keyword_settings[pattern] = wires.match_keyword(wires.single_argument(a), *names)

        return wires.ScpiCommand(
            pattern, setter, lambda _: self._keyword_settings.get(pattern, wires.short_form(names[0]))
        )

    def _polarity_commands(self) -> list[wires.ScpiCommand]:
        if self.traits.get("polarity") == "absent":
            return []

        def is_inverted(text: str) -> bool:
            return wires.match_keyword(text, "NORMal", "INVerted") == "INV"

        return [self._setting("OUTPut[1]:POLarity", "inverted", is_inverted, self.format_polarity)]

    def _gate_command(self) -> wires.ScpiCommand:
        """Make the setting that gates the output with the sync signal: between bursts there is no output."""
        return self._choice("OUTPut[1]:MODE", "gated", {"NORMal": False, "GATed": True})

    def _sum_command(self, pattern: str) -> wires.ScpiCommand:
        """Make the switch that adds another channel to the output."""
        return self._setting(
            pattern,
            "added_v",
            lambda text: OTHER_CHANNEL_V if wires.parse_boolean(text) else 0.0,
            lambda volts: self.format_switch(bool(volts)),
        )

    def _stored_switch(self, pattern: str) -> wires.ScpiCommand:
        """Make a stored switch without effect on an idle output."""

        def setter(a: wires.Arguments) -> None:
            self._keyword_settings[pattern] = self.format_switch(wires.parse_boolean(wires.single_argument(a)))

        return wires.ScpiCommand(
            pattern, setter, lambda _: self._keyword_settings.get(pattern, self.format_switch(False))
        )

    def _function_keyword(self) -> str:
        function = self._generator.settings.function
        return wires.short_form(self.ARBITRARY_KEYWORD) if function == "ARB" else function

    def _set_function(self, a: wires.Arguments) -> None:
        function = wires.match_keyword(wires.single_argument(a), "SINusoid", "DC", self.ARBITRARY_KEYWORD)
        self._select_function("ARB" if function == wires.short_form(self.ARBITRARY_KEYWORD) else function)

    def _trigger_keyword(self) -> str:
        source = self._generator.settings.trigger
        return next(wires.short_form(name) for name, setting in self.TRIGGER_KEYWORDS.items() if setting == source)

    def _set_trigger(self, a: wires.Arguments) -> None:
        keyword = wires.match_keyword(wires.single_argument(a), *self.TRIGGER_KEYWORDS)
        self._select_trigger(
            next(self.TRIGGER_KEYWORDS[n] for n in self.TRIGGER_KEYWORDS if wires.short_form(n) == keyword)
        )

    def _select_trigger(self, source: str) -> None:
        self._generator.apply_settings(trigger=source)

    def _select_function(self, function: str) -> None:
        """Select a function; conflicting settings change, with an error in the queue."""
        s = self._generator.settings
        self._levels.check_limits(s.emf_vpp, s.emf_offset_v, function)
        if function == "DC":
            if s.burst or s.sweep:
                mode = "burst" if s.burst else "sweep"
                self.queue_error(wires.ScpiError(-221, f"not able to {mode} dc, {mode} turned off"))
            self._generator.apply_settings(function="DC", burst=False, sweep=False)
            return
        # DC allows an offset at which a wave would exceed the range.
        room = MAX_EMF_V - s.emf_vpp / 2
        if abs(s.emf_offset_v) > room:
            self.queue_error(wires.ScpiError(-221, "offset changed on exit from dc function"))
        self._generator.apply_settings(function=function, emf_offset_v=min(max(s.emf_offset_v, -room), room))

    def _set_mode(self, a: wires.Arguments, mode: str, other: str) -> None:
        on, s = wires.parse_boolean(wires.single_argument(a)), self._generator.settings
        if on and s.function == "DC":
            raise wires.ScpiError(-221, f"not able to {mode} dc, {mode} turned off")
        changed: dict[str, Any] = {mode: on}
        if on and getattr(s, other):
            self.queue_error(wires.ScpiError(-221, f"{other} turned off by selection of other mode or modulation"))
            changed[other] = False
        self._generator.apply_settings(**changed)

    def _set_cycles(self, a: wires.Arguments) -> None:
        cycles = wires.parse_number(wires.single_argument(a), "", 1.0, self.MAX_BURST_CYCLES, 1.0)
        if not math.isinf(cycles):
            self._generator.apply_settings(cycles=float(round(self._levels.clip(cycles, 1.0, self.MAX_BURST_CYCLES))))
            return
        if self._generator.settings.trigger == "IMM":
            self.queue_error(wires.ScpiError(-221, "infinite burst changed trigger source to BUS"))
            self._generator.apply_settings(trigger="BUS")
        self._generator.apply_settings(cycles=cycles)

    def _load_waveform(self, points: Array, interpolated: bool = False, **settings: Any) -> None:
        """Play these points, 1 being half of the amplitude."""
        if (self.traits.get("uneven") == "otherwise") != self.AMPLITUDE_IS_WAVEFORM_SPAN:
            points = points * (2 / max(float(np.ptp(points)), 1e-9))
        points = self._filtered(points)
        # Single precision is finer than any converter, and the history keeps many waveforms.
        self._generator.apply_settings(wave=ArbitraryWaveform(points.astype(np.float32), interpolated), **settings)

    def _filtered(self, points: Array) -> Array:
        """Return the points after the filter."""
        return points


def decode_block(argument: str, dtype: str, low: float, high: float) -> Array:
    """Return the points of a binary block.

    Raises:
        ScpiError: no whole number of values, or one outside the limits: the byte order is wrong, for example.
    """
    raw = argument.encode("latin-1")
    width = np.dtype(dtype).itemsize
    if not raw or len(raw) % width:
        raise wires.ScpiError(-161)
    points = np.frombuffer(raw, dtype).astype(np.float64)
    if not np.all((points >= low) & (points <= high)):
        raise wires.ScpiError(-222, "a point lies outside the converter's range")
    return points


def accept_keywords(*names: str) -> Callable[[wires.Arguments], None]:
    """Return the setter of a setting that accepts these values without effect."""

    def setter(a: wires.Arguments) -> None:
        wires.match_keyword(wires.single_argument(a), *names)

    return setter
