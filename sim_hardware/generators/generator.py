"""Output stage of all simulated function generators: turns settings into output segments.

A model of a family adds commands, error messages and limits. Bursts start and idle at their phase, a free-running sine has an
unknown phase, relays drop the output to 0 V. Voltages are open-circuit voltages (electromotive force): the *displayed* values
depend on the declared load, the output does not.
"""

import hashlib
import math
import random
from bisect import bisect_left
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal
from weakref import WeakValueDictionary

from sim_hardware import plant

SegmentFactory = Callable[[float], plant.Segment]
"""Function from the instant of the change to the segment that begins there."""

RANGES_VPP = (0.32, 1.0, 3.2, 10.0, 20.0)
"""Attenuator ranges, peak to peak at the open output; a relay switches between two of them."""

COMBINED_V = 0.7
"""Volts of another channel that cannot be switched off."""

SAG_TAU_S = 10.0
SURGE_S, SURGE_V = 0.5e-3, 0.6
"""A pulse at the start of a burst."""


@dataclass(frozen=True, slots=True)
class InstrumentUnit:
    """One unit of a model.

    Args:
        identity: the reply to `*IDN?`.
        traits: its traits and deviations by name (sim_hardware.generators.traits).
        seed: seed of its random behaviour.
        high_z_by_hand: whether High Z was set on the front panel of a model without remote access to it.
    """

    identity: str
    traits: Mapping[str, str]
    seed: int = 0
    high_z_by_hand: bool = True

    @property
    def model(self) -> str:
        """Name of the model in capitals."""
        return self.identity.split(",")[1].strip().upper()


@dataclass(frozen=True, slots=True)
class GeneratorSettings:
    """Settings that shape the output; the defaults are those after a reset.

    `frequency_hz` of an arbitrary waveform is the rate of its whole period. `idle` is the waiting level of a burst in parts of
    the amplitude; None: its start phase. `inverted` flips the output about its offset, which is unchanged. `gated` leaves 0 V
    between bursts. `added_v` is the volts added by another channel. `delay_s` passes from a trigger to its burst;
    `advances_by_trigger` plays one point of the waveform at each trigger, which moves the output by less than its noise.
    """

    on: bool = False
    function: Literal["SIN", "DC", "ARB"] = "SIN"
    wave: plant.ArbitraryWaveform | None = None
    frequency_hz: float = 1e3
    emf_vpp: float = 0.2
    emf_offset_v: float = 0.0
    auto_range: bool = True
    burst: bool = False
    cycles: float = 1.0
    phase_deg: float = 0.0
    idle: float | None = None
    period_s: float = 10e-3
    trigger: Literal["IMM", "BUS", "EXT"] = "IMM"
    delay_s: float = 0.0
    advances_by_trigger: bool = False
    sweep: bool = False
    start_hz: float = 100.0
    stop_hz: float = 1e3
    sweep_s: float = 1.0
    inverted: bool = False
    gated: bool = False
    added_v: float = 0.0

    scale: float = 1.0
    """Factor of the amplitude hidden from queries; negative for an inverted output."""
    offset_scale: float = 1.0
    """Factor of the offset hidden from queries."""
    hidden_v: float = 0.0
    """Volts of another channel hidden from queries."""

    @property
    def emf_peak_v(self) -> float:
        """Volts of a full-scale point above the offset."""
        return self.scale * (-self.emf_vpp / 2 if self.inverted else self.emf_vpp / 2)

    @property
    def level_v(self) -> float:
        """Volts of a point of 0: the offset, and the volts of another channel."""
        return self.offset_scale * self.emf_offset_v + self.added_v + self.hidden_v


class SimulatedGenerator:
    """The output of one function generator.

    Args:
        emit: callback with the function that makes the next segment.
        seed: seed of the phases that are random on a real instrument.
    """

    def __init__(
        self,
        emit: Callable[[SegmentFactory], None],
        seed: int = 0,
        clock_ppm: float = 0.0,
        relay_s: float = 5e-3,
        open_circuit_v: float = 0.0,
    ) -> None:
        self._emit = emit
        self._random = random.Random(seed)
        self._clock = self._next_clock = 1 + clock_ppm * 1e-6
        self._relay_s = relay_s
        self._open = plant.ConstantSegment(open_circuit_v)
        self._powered = True
        self._glitch_until = -math.inf
        self._burst: plant.PeriodicSegment | None = None
        self._carrier: plant.PeriodicSegment | plant.ChirpSegment | None = None
        self.settings = GeneratorSettings()
        self._waveform_cache = WeakValueDictionary[tuple[bytes, bool], plant.ArbitraryWaveform]()
        self._deviations: Mapping[str, str] = {}
        self._triggers = 0

    def deviate(self, deviations: Mapping[str, str]) -> None:
        """Deviate from the documentation: options of `sim_hardware.generators.traits.DEVIATIONS` by name."""
        self._deviations = deviations
        self.apply_settings(**self._hidden_settings())

    def _hidden_settings(self) -> dict[str, Any]:
        """Return the hidden settings, without commands and queries."""
        scale = {"quarter": 0.25, "fourfold": 4.0}.get(self._deviations.get("scale", ""), 1.0)
        return {
            "scale": -scale if self._deviates("output-polarity", "inverted") else scale,
            "offset_scale": 0.94 if self._deviates("offset", "low") else 1.0,
            "hidden_v": COMBINED_V if self._deviates("combining", "stays") else 0.0,
        }

    def _deviates(self, name: str, option: str) -> bool:
        return self._deviations.get(name) == option

    def apply_settings(self, **settings: Any) -> None:
        """Apply new settings at one instant."""
        if (wave := settings.get("wave")) is not None:  # the history has many segments: store equal waveforms once
            key = hashlib.sha256(wave.points.tobytes()).digest(), wave.interpolated
            settings["wave"] = self._waveform_cache.setdefault(key, wave)

        def make(t: float) -> plant.Segment:
            old, self.settings = self.settings, replace(self.settings, **settings)
            self._carry_over_phase(old, t)
            return self._segment(t)

        self._emit(make)

    def reset(self) -> None:
        """Factory state: output off, independent of its connection."""

        def make(t: float) -> plant.Segment:
            self.settings = GeneratorSettings(**self._hidden_settings())
            self._burst, self._carrier, self._glitch_until = None, None, -math.inf
            return self._segment(t)

        self._emit(make)

    def set_power(self, on: bool) -> None:
        """The mains plug. Power comes back with the factory state."""
        self._powered = on
        self.reset()

    def detune_clock(self, ppm: float) -> None:
        """Detune the clock from the next trigger; a running output is unchanged."""
        self._next_clock *= 1 + ppm * 1e-6

    def ready_for_trigger(self, now: float) -> bool:
        """Whether a bus trigger would start a burst or sweep."""
        s = self.settings
        return s.trigger == "BUS" and (s.burst or s.sweep) and self.busy_s(now) == 0

    def busy_s(self, now: float) -> float:
        """Seconds until the end of the running burst or sweep."""
        if self._burst is not None:
            return max(0.0, self._burst.end_s - now)
        if isinstance(self._carrier, plant.ChirpSegment):
            return max(0.0, self._carrier.origin_s + self._carrier.duration_s - now)
        return 0.0

    def trigger(self) -> None:
        """Start the armed burst or sweep."""
        self._triggers += 1
        if self.settings.advances_by_trigger or (self._triggers % 2 == 0 and self._deviates("start", "sometimes-lost")):
            return

        def make(t: float) -> plant.Segment:
            self._clock = self._next_clock
            s = self.settings
            if s.burst:
                self._burst = self._tone(t + s.delay_s, math.radians(s.phase_deg), s.cycles)
                if self._deviates("after", "zero"):
                    self._burst = replace(self._burst, idle_v=0.0)
                if self._deviates("surge", "at-start"):
                    return plant.RelayGlitchSegment(t + SURGE_S, s.level_v + SURGE_V, self._segment(t))
            elif s.sweep:
                phase = self._carrier.phase_at(t) if self._carrier else 0.0
                self._carrier = plant.ChirpSegment(
                    t, s.start_hz * self._clock, s.stop_hz * self._clock, s.sweep_s, s.emf_peak_v, s.level_v, phase
                )
            return self._segment(t)

        self._emit(make)

    def abort(self) -> None:
        """End a running burst or sweep immediately."""

        def make(t: float) -> plant.Segment:
            self._burst = None
            if self._deviates("abort", "drops"):
                self._glitch_until = t + self._relay_s
            if isinstance(self._carrier, plant.ChirpSegment):
                self._carrier = self._tone(t, self._carrier.phase_at(t), math.inf)
            return self._segment(t)

        self._emit(make)

    def _tone(
        self, origin_s: float, phase_rad: float, cycles: float, period_s: float = math.inf
    ) -> plant.PeriodicSegment:
        s = self.settings
        f = (s.start_hz if s.sweep else s.frequency_hz) * self._clock
        wave = s.wave if s.function == "ARB" else None
        start = math.sin(math.radians(s.phase_deg))
        if wave:  # its first point, independent of the interpolation
            start = float(wave.points[round(s.phase_deg / 360 * wave.points.size) % wave.points.size])
        offset_v = s.level_v
        start = -1.0 if self._deviates("idle", "bottom") else start if s.idle is None else s.idle
        idle = 0.0 if s.gated else offset_v + s.emf_peak_v * start
        return plant.PeriodicSegment(origin_s, f, s.emf_peak_v, offset_v, phase_rad, idle, cycles, period_s, wave)

    def _switches_relay(self, previous: GeneratorSettings) -> bool:
        """Return whether the change from the previous settings switches a relay."""
        s = self.settings
        auto_range = s.auto_range or self._deviates("range", "switches")
        return (
            (auto_range and _range_index(s.emf_vpp) != _range_index(previous.emf_vpp))
            # Sines and waveforms leave through different filters (33120A guide, theory of operation).
            or {s.function, previous.function} == {"SIN", "ARB"}
            or (s.wave is not previous.wave and self._deviates("upload", "drops"))
            or (previous.burst and not s.burst and self._deviates("abort", "drops"))
        )

    def _burst_after_change(
        self, run: plant.PeriodicSegment, previous: GeneratorSettings, t: float
    ) -> plant.PeriodicSegment | None:
        """Return a running burst with the present settings; None if it has ended."""
        s = self.settings
        if t >= run.end_s:
            return None
        if self._deviates("retime", "at-next-burst"):
            return replace(self._tone(run.origin_s, run.phase_rad, run.cycles), frequency_hz=run.frequency_hz)
        if s.frequency_hz == previous.frequency_hz:
            return self._tone(run.origin_s, run.phase_rad, run.cycles)
        if self._deviates("retime", "restarts"):
            return self._tone(t, math.radians(s.phase_deg), s.cycles)
        return self._tone(t, run.phase_at(t), run.cycles - (t - run.origin_s) * run.frequency_hz)

    def _carry_over_phase(self, previous: GeneratorSettings, t: float) -> None:
        """Carry phase and remaining cycles through a change of settings."""
        s = self.settings
        if self._switches_relay(previous):
            self._glitch_until = t + self._relay_s
        if s.burst != previous.burst:
            self._burst = None
        if self._burst is not None:
            self._burst = self._burst_after_change(self._burst, previous, t)
        continuous = s.function != "DC" and not s.burst
        if not continuous:
            self._carrier = None
        elif self._carrier is None:
            # The oscillator runs permanently; its phase is unknown.
            self._carrier = self._tone(t, self._random.uniform(-math.pi, math.pi), math.inf)
        elif isinstance(self._carrier, plant.ChirpSegment) and s.sweep:
            self._carrier = replace(self._carrier, amplitude_v=s.emf_peak_v, offset_v=s.level_v)
        else:
            self._carrier = self._tone(t, self._carrier.phase_at(t), math.inf)

    def _segment(self, t: float) -> plant.Segment:
        segment = self._nominal_segment(t)
        return plant.RelayGlitchSegment(self._glitch_until, 0.0, segment) if t < self._glitch_until else segment

    def _nominal_segment(self, t: float) -> plant.Segment:
        s = self.settings
        if not (self._powered and s.on):
            return self._open
        if s.function == "DC":
            return plant.ConstantSegment(s.level_v)
        if s.burst and s.trigger == "IMM":
            return self._tone(t, math.radians(s.phase_deg), s.cycles, max(s.period_s, s.cycles / s.frequency_hz))
        if s.burst:
            if self._burst is not None and self._deviates("droop", "sags"):
                return plant.SaggingSegment(self._burst, s.level_v, SAG_TAU_S)
            return self._burst or plant.ConstantSegment(self._tone(t, 0.0, 1.0).idle_v)
        return self._carrier or self._tone(t, 0.0, math.inf)


def _range_index(vpp: float) -> int:
    return bisect_left(RANGES_VPP, vpp * (1 - 1e-9))
