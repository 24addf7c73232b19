"""Simulation parameters: ground truth of a simulated bench, read from its bench file."""

import math
import tomllib
import types
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from functools import cache, lru_cache
from importlib import resources
from typing import Any, Self, Union, get_args, get_origin, get_type_hints

import numpy as np

from drivers import generator_families
from model import AmplifierMap, Array, Membrane, Skin, Tactor

HUM_HARMONICS = {1: 1.0, 2: 0.3, 3: 0.5, 5: 0.2}
"""Amplitude of each order of the mains hum divided by the first's."""


@dataclass(frozen=True, slots=True)
class Nonidealities:
    """Effects outside the model, to test their detection by a measurement; the defaults omit all of them.

    Attributes:
        creep_per_decade: gain of a step of voltage or weight per decade of time, as a share of the step; zero at the time
            constant of 100 Hz, to which stiffness and moment per volt of the tactor refer.
        hysteresis_width: width of the displacement's loop against the voltage in the middle of the whole stroke, as a
            share of the stroke without hysteresis.
        drift_m_per_s: drift rate of the sensor's reading.
        clamp_gives_m_per_n: permanent yield of the clamps under the largest weight so far.
        side_difference: bending stiffness of plate and MFC under a load, MFC up against aluminium up, as a share of their mean.
            Without a load it is the mean: a vibration bends the plate in both directions.
        weight_error: relative standard deviation of the weights' masses about their nominal ones.
        mass_share: moving share of a mass in the cylinder.
        membrane_slip: share of an elongation lost in the membrane's clamps.
        hum_m: peak amplitude of the mains hum on the laser's signal; its harmonics follow `HUM_HARMONICS`.
        mains_hz: frequency of the mains.
        tone_m, tone_hz: amplitude and frequency of another disturbance, e.g. of a switching supply.
    """

    creep_per_decade: float = 0.0
    hysteresis_width: float = 0.0
    drift_m_per_s: float = 0.0
    clamp_gives_m_per_n: float = 0.0
    side_difference: float = 0.0
    weight_error: float = 0.0
    mass_share: float = 1.0
    membrane_slip: float = 0.0
    hum_m: float = 0.0
    mains_hz: float = 50.02
    tone_m: float = 0.0
    tone_hz: float = 4900.0

    def __post_init__(self) -> None:
        for name, most in (
            ("creep_per_decade", 1.0),
            ("hysteresis_width", 0.2),
            ("weight_error", 0.5),
            ("mass_share", 1.0),
            ("membrane_slip", 1.0),
        ):
            if not 0 <= getattr(self, name) <= most:
                raise ValueError(f"beyond.{name} must lie between 0 and {most:g}, not {getattr(self, name):g}")
        _not_negative("beyond", self, "hum_m", "mains_hz", "tone_m", "tone_hz")
        if not -1 < self.side_difference < 1:
            raise ValueError(f"beyond.side_difference must lie between -1 and 1, not {self.side_difference:g}")

    def interference_m(self, t: Array) -> Array:
        """Hum and tone on the laser's signal at bench times `t`, (n,)."""
        out = np.zeros_like(t)
        for order, share in HUM_HARMONICS.items() if self.hum_m else ():
            out += share * self.hum_m * np.sin(2 * np.pi * order * self.mains_hz * t + order)
        return out + self.tone_m * np.sin(2 * np.pi * self.tone_hz * t) if self.tone_m else out

    def actual_mass_kg(self, nominal_kg: float, seed: int) -> float:
        """Return the true mass of a weight of nominal mass."""
        if not self.weight_error:
            return nominal_kg
        by = float(np.random.default_rng((seed, round(1e9 * nominal_kg))).normal())
        return nominal_kg * (1 + self.weight_error * by)


SCATTERED_PARTS = ("mass", "plate", "laser")
"""Parts whose mountings differ; of each the numbers of a mounting are the same in every session."""


@dataclass(frozen=True, slots=True)
class MountingScatter:
    """Differences between mountings, as standard deviations; the defaults omit all of them.

    Attributes:
        mass_kg: of the moving mass, each time it is glued.
        plate_share: of the bending inside the clamp, as a share of the bare plate's length, each time the plate is clamped.
        laser_share: of the sensor's gain, each time the laser is moved: its spot and its angle.
    """

    mass_kg: float = 0.0
    plate_share: float = 0.0
    laser_share: float = 0.0

    def __post_init__(self) -> None:
        _not_negative("mounting", self, "mass_kg", "plate_share", "laser_share")

    def difference(self, part: str, number: int, seed: int) -> float:
        """Return the difference of the mounting `number` of a part, from 1; none before the first."""
        size = {"mass": self.mass_kg, "plate": self.plate_share, "laser": self.laser_share}[part]
        return size * _drawn(SCATTERED_PARTS.index(part), number, seed) if size and number else 0.0


@lru_cache(maxsize=64)
def _drawn(part: int, number: int, seed: int) -> float:
    return float(np.random.default_rng((seed, part, number)).normal())


SHEET_CHOICES = ("", "realistic.specimen.toml")
"""Specimen sheets of the simulated benches."""
SOURCE_CHOICES = ("generator", "ao0", "ao1", "supply", "DAC0", "DAC1")
"""Outputs that can drive the cable to the amplifier."""


@dataclass(frozen=True, slots=True)
class GeneratorParameters:
    """The function generator.

    Attributes:
        clock_ppm: excess rate of its clock over the card's.
        command_s: processing time of a message; real instruments need milliseconds.
        relay_s: duration of 0 V at the output during a switching of an attenuator relay.
        high_z_by_hand: whether High Z was set on the front panel of a model without remote access to it.
        traits: chosen traits, e.g. `silence=long stale=often` (sim_hardware.generators.traits); others are drawn from the seed.
        outside: entry point of a generator that another package simulates, in place of this one; empty: none.
    """

    model: str = "33511B"
    serial: str = "MY00000001"
    firmware: str = "5.02-3.02-2.15-52-00"
    clock_ppm: float = 0.0
    command_s: float = 1e-3
    relay_s: float = 5e-3
    high_z_by_hand: bool = True
    traits: str = ""
    outside: str = ""

    def __post_init__(self) -> None:
        beginnings = [begin for family in generator_families().values() for begin in family.makers]
        if not self.model.upper().startswith(tuple(beginnings)):
            raise ValueError(f"generator.model is {self.model!r}: choose one that begins with {', '.join(beginnings)}")
        _not_negative("generator", self, "command_s", "relay_s")


@dataclass(frozen=True, slots=True)
class SupplyParameters:
    """The programmable DC supply.

    Attributes:
        fall_tau_s: time constant of its falling output without a load.
        off_v: level of its output when it is off; an E3631A may show 0.6 V of the other sign.
        ovp, ovp_v: its over-voltage protection at power-on.
        ocp: whether its over-current protection is on.
        tracking: whether its outputs are in series.
        traits: deviations from its driver's assumptions, e.g. `level=low` (sim_hardware.supplies.supply).
    """

    model: str = "E36312A"
    serial: str = "MY00000002"
    fall_tau_s: float = 0.05
    off_v: float = 0.0
    ovp: bool = False
    ovp_v: float = 6.0
    ocp: bool = False
    tracking: bool = False
    traits: str = ""

    def __post_init__(self) -> None:
        _positive("supply", self, "fall_tau_s")


@dataclass(frozen=True, slots=True)
class AmplifierParameters:
    """The high-voltage amplifier: static map, slew limit, and behaviour of its open input.

    Attributes:
        slew_v_per_s: fastest change on the high-voltage side, volts per second.
        open_v: volts of the input with an open generator output or a removed cable.
        enabled: whether high voltage is on at the start.
        voltage_monitor_v_per_v: output of its voltage monitor, at the card's ai2.
        current_monitor_v_per_a: output of its current monitor, at the card's ai3.
        current_monitor_zero_v: output of its current monitor without current.
        current_monitor_noise_v: rms noise of its current monitor per sample, beside the card's.
        current_monitor_delay_s: delay of its current monitor, half a step of the plant's grid at least.
        current_monitor_hz: corner frequency of its current monitor, first order.
    """

    map: AmplifierMap = field(default_factory=AmplifierMap)
    slew_v_per_s: float = 2e7
    open_v: float = 0.0
    enabled: bool = False
    voltage_monitor_v_per_v: float = 1e-3
    current_monitor_v_per_a: float = 100.0
    current_monitor_zero_v: float = 0.0
    current_monitor_noise_v: float = 0.0
    current_monitor_delay_s: float = 5e-6
    current_monitor_hz: float = 20e3

    def __post_init__(self) -> None:
        _positive("amplifier", self, "slew_v_per_s", "current_monitor_hz")
        _not_negative("amplifier", self, "current_monitor_noise_v", "current_monitor_delay_s")


@dataclass(frozen=True, slots=True)
class RoomParameters:
    """The air of the laboratory, and what its temperature does to the tactor.

    Attributes:
        temperature_c: at bench time 0.
        drift_k_per_h: change of the temperature.
        humidity: relative humidity.
        reference_c: temperature of the tactor's parameters.
        k2_per_kelvin, mu_per_kelvin, c0_per_kelvin, capacitance_per_kelvin: relative change of each.
        chamber_lag_s: time constant with which a climate chamber approaches the temperature that is set.
        sensor_v_per_k: of the thermometer at the card's ai4, 0 V at 0 °C; a humidity sensor at ai6 has 1 V at 100 %.
        sensor_noise_k: rms noise of the thermometer.
    """

    temperature_c: float = 23.0
    drift_k_per_h: float = 0.0
    humidity: float = 0.45
    reference_c: float = 23.0
    k2_per_kelvin: float = 0.0
    mu_per_kelvin: float = 0.0
    c0_per_kelvin: float = 0.0
    capacitance_per_kelvin: float = 0.0
    chamber_lag_s: float = 120.0
    sensor_v_per_k: float = 0.01
    sensor_noise_k: float = 0.02

    def __post_init__(self) -> None:
        _within("room.temperature_c", self.temperature_c, -40, 85)
        _within("room.humidity", self.humidity, 0, 1)

    def tactor_at(self, tactor: Tactor, temperature_c: float) -> Tactor:
        """Return the tactor at a temperature."""
        warmer = temperature_c - self.reference_c
        names = [name for name in ("k2", "mu", "c0") if getattr(self, f"{name}_per_kelvin")]
        changed = {name: getattr(tactor, name) * (1 + getattr(self, f"{name}_per_kelvin") * warmer) for name in names}
        return replace(tactor, **changed) if changed else tactor


ELECTRODES = ("connected", "reversed", "open", "damaged", "broken")
"""States of the specimen's connection: to the amplifier, with its wires exchanged, not at all, short-circuited by a breakdown, or in part
only."""


@dataclass(frozen=True, slots=True)
class ElectricalParameters:
    """The specimen as the amplifier's load: capacitance with loss, leakage and the charge of its bending.

    Attributes:
        capacitance_f: capacitance of the clamped specimen with its cable at 100 Hz.
        loss_per_decade: share of the charge gained per decade of time: a loss factor of 0.68 times this, the same at all frequencies.
        leakage_ohm: resistance between the electrodes.
        coupling: charge per displacement, as a share of the reciprocal of the tactor's bending by voltage.
        cable_f: capacitance of the cable alone, of an open specimen.
        breakdown_ohm: resistance of damaged electrodes.
        polarisation: share of the poling that is left: of the bending, and of the charge that belongs to it.
        broken_share: share of the electrodes that is left when they are broken.
        sense_f: sense capacitor in the return of the specimen, whose volts are at the card's ai7.
        sense_ohm: its bleed resistor.
        electrodes: `connected`, `reversed`, `open`, `damaged` or `broken`.
    """

    capacitance_f: float = 1.2e-9
    loss_per_decade: float = 0.025
    leakage_ohm: float = 2e10
    coupling: float = 1.0
    cable_f: float = 3e-11
    breakdown_ohm: float = 2e5
    polarisation: float = 1.0
    broken_share: float = 0.5
    sense_f: float = 1e-6
    sense_ohm: float = 1e7
    electrodes: str = "connected"

    def __post_init__(self) -> None:
        _positive("electrical", self, "capacitance_f", "leakage_ohm", "breakdown_ohm", "sense_f", "sense_ohm")
        _not_negative("electrical", self, "loss_per_decade", "coupling", "cable_f")
        _within("electrical.polarisation", self.polarisation, 0, 1)
        _within("electrical.broken_share", self.broken_share, 0, 1)
        if self.electrodes not in ELECTRODES:
            raise ValueError(f"electrical.electrodes is {self.electrodes!r}: choose from {', '.join(ELECTRODES)}")

    @property
    def bending(self) -> float:
        """Share of the volts at the amplifier's output that bends the specimen."""
        share = {"connected": 1.0, "reversed": -1.0, "broken": self.broken_share}.get(self.electrodes, 0.0)
        return share * self.polarisation

    @property
    def connected_f(self) -> float:
        """Capacitance of the clamped specimen, with its cable, as far as it is connected."""
        whole = self.capacitance_f - self.cable_f
        share = {"open": 0.0, "broken": self.broken_share}.get(self.electrodes, 1.0)
        return self.cable_f + share * whole


@dataclass(frozen=True, slots=True)
class AgeingParameters:
    """Ageing of the specimen by the cycles of bursts of a generator; the defaults omit it.

    Attributes:
        from_v: smallest amplitude at the amplifier's input that is counted.
        wear_per_decade: share of the bending by voltage that is lost per decade of cycles beyond a thousand: depolarisation.
        crack_cycles: cycles at which a crack opens; 0: never.
        crack_stiffness: share of the bending stiffness of plate and MFC that the crack takes.
        crack_damping: share of the damping that it adds.
        crack_capacitance: share of the capacitance that is behind it.
        crack_harmonics: excess of the displacement in one direction, in which the crack opens.
    """

    from_v: float = 0.75
    wear_per_decade: float = 0.0
    crack_cycles: float = 0.0
    crack_stiffness: float = 0.06
    crack_damping: float = 0.2
    crack_capacitance: float = 0.1
    crack_harmonics: float = 0.05

    def __post_init__(self) -> None:
        _not_negative("ageing", self, *(each.name for each in fields(self)))
        for name in ("wear_per_decade", "crack_stiffness", "crack_capacitance"):
            if getattr(self, name) >= 0.2:
                raise ValueError(f"ageing.{name} must be below 0.2, not {getattr(self, name):g}")

    def age(self, cycles: float) -> tuple[bool, float]:
        """Return whether the crack is open after these cycles, and the remaining share of the bending by voltage, in small steps."""
        worn = self.wear_per_decade * round(20 * math.log10(1 + cycles / 1000)) / 20
        return 0 < self.crack_cycles <= cycles, 1 - worn

    def aged(self, tactor: Tactor, age: tuple[bool, float]) -> Tactor:
        """Return the tactor at an age."""
        cracked, left = age
        k2, c0 = (1 - self.crack_stiffness, 1 + self.crack_damping) if cracked else (1.0, 1.0)
        return replace(tactor, k2=k2 * tactor.k2, c0=c0 * tactor.c0, mu=left * tactor.mu)


NEW = (False, 1.0)
"""Age of a new specimen."""


@dataclass(frozen=True, slots=True)
class SensorParameters:
    """The laser displacement sensor's analogue output: volts = zero_v + displacement / gain_m_per_v, delayed.

    A vibrometer has a gain in (m/s)/V, and noise_m and range_m in m/s.

    Attributes:
        quantity: `displacement`, or `velocity` of a vibrometer.
        curve_per_m: bend of a capacitive probe: volts = zero_v + u (1 + curve_per_m w) with u the straight line's at w; 0: none.
        noise_m: rms noise per sample in metres.
        delay_s: delay from the motion to the voltage.
        range_m: half the measuring range; beyond it the output shows `invalid_v`.
    """

    gain_m_per_v: float = 1e-4
    zero_v: float = 0.0
    noise_m: float = 1e-7
    delay_s: float = 1e-4
    range_m: float = 1e-3
    invalid_v: float = 10.3
    quantity: str = "displacement"
    curve_per_m: float = 0.0

    def __post_init__(self) -> None:
        if self.quantity not in ("displacement", "velocity"):
            raise ValueError(f"sensor.quantity must be displacement or velocity, not {self.quantity!r}")
        if self.gain_m_per_v == 0:
            raise ValueError("sensor.gain_m_per_v must not be 0")
        _positive("sensor", self, "range_m")
        _not_negative("sensor", self, "noise_m", "delay_s")


@dataclass(frozen=True, slots=True)
class CardParameters:
    """The multifunction card: one 16-bit converter, multiplexed.

    Attributes:
        maker, product: `cards.toml` has the values of each product.
        range_v: half the input range; NI's rails lie 5 % outside it.
        noise_v: rms noise per sample at the card's input.
        max_rate_hz: samples per second of all channels together.
        convert_s: time between the conversions of two channels of one scan, if the rate permits it; 0: simultaneous sampling.
            NI's default is the converter's fastest time plus 10 us for the settling of the inputs.
        fast_sample_hz, fast_convert_s: the same above this sample rate of all channels together.
        timebase_hz: clock whose integer divisions are the possible rates.
        latency_s: time from the start of a task to its first sample.
        coefficients: counts to volts, c0 + c1 n + c2 n^2 + c3 n^3.
        ao_channels, ao_clocked, ao_max_rate_hz: number of its analogue outputs, whether they have a sample clock, and its largest rate.
        usb_requests, usb_request_bytes: pending transfers to its analogue output; 0: drawn from the seed.
        usb_adjustable: whether their size can be changed; None: drawn from the seed.
        drive_open: whether the cable from the drive to ai0 is off: an open input shows the previously converted voltage (NI
            knowledge base kA03q000000YHy6CAG, "How do I eliminate ghosting").
        unsettled_share: share of the previously converted volts in the inputs after the drive, for sources with an impedance too
            high to settle. The drive's source has 50 ohms.
        power_up_v: level of the outputs of a LabJack that plays the drives after it has started, stored in its flash; 0 in a new one.
        traits: chosen traits, e.g. `skew=double` (sim_hardware.nidaq.card); others are drawn from the seed.
    """

    maker: str = "NI"
    product: str = "USB-6341"
    serial: int = 0x01A2B3C4
    channels: int = 16
    range_v: float = 10.0
    noise_v: float = 2.7e-4
    max_rate_hz: float = 500e3
    convert_s: float = 12e-6
    fast_sample_hz: float = 1e9
    fast_convert_s: float = 12e-6
    timebase_hz: float = 100e6
    latency_s: float = 0.0
    coefficients: tuple[float, ...] = (-1.7e-4, 3.2054e-4, 2.0e-14, -3.1e-19)
    ao_channels: int = 2
    ao_clocked: bool = True
    ao_max_rate_hz: float = 900e3
    usb_requests: int = 0
    usb_request_bytes: int = 0
    usb_adjustable: bool | None = None
    drive_open: bool = False
    unsettled_share: float = 0.0
    power_up_v: float = 2.5
    traits: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.unsettled_share < 1:
            raise ValueError(f"card.unsettled_share must lie between 0 and 1, not {self.unsettled_share:g}")
        _positive("card", self, "range_v", "max_rate_hz", "channels")
        _not_negative("card", self, "noise_v", "convert_s", "latency_s")
        _not_negative("card", self, "usb_requests", "usb_request_bytes")
        if len(self.coefficients) < 2 or self.coefficients[1] == 0:
            raise ValueError("card.coefficients must hold at least an offset and a gain that is not 0")


@dataclass(frozen=True, slots=True)
class InterlockParameters:
    """The interlock between the card and the amplifier; `line` empty: there is none.

    Attributes:
        line: digital line of the card with the heartbeat, e.g. `port0/line0`.
        state_line: digital line of the card at the relay's second contact; empty: not wired.
        monostable_s: time of its monostable, wall time.
        release_s: from the monostable's end until the volts on the specimen are gone: relay and amplifier, wall time.
    """

    line: str = ""
    state_line: str = ""
    monostable_s: float = 0.5
    release_s: float = 0.1

    def __post_init__(self) -> None:
        _positive("interlock", self, "monostable_s")
        _not_negative("interlock", self, "release_s")


@dataclass(frozen=True, slots=True)
class OperatorTiming:
    """Timing and accuracy of the operator's actions.

    Attributes:
        reach_s: time from the prompt for a weight until it touches the tactor.
        release_s: time from the first touch until the full weight rests on the tactor; equal for lifting.
        landing_m_per_s: speed of a weight at the first touch.
        patience_s: time from placing or lifting a weight until the operator presses the key.
        reference_m: excess depth of the reference for the membrane's sag over the nominal depth.
    """

    reach_s: float = 1.0
    release_s: float = 0.3
    landing_m_per_s: float = 5e-3
    patience_s: float = 10.0
    reference_m: float = 0.0

    def __post_init__(self) -> None:
        _not_negative("hands", self, "reach_s", "release_s", "landing_m_per_s", "patience_s")


@dataclass(frozen=True, slots=True)
class SimulationParameters:
    """One simulated bench.

    Attributes:
        source: source connected to the amplifier, one of `SOURCE_CHOICES`.
        skin: initial skin under the tactor; None: free.
        membrane: the membrane that the operator may put on it.
        seed: seed of all random properties: traits of instruments, errors of weights, noise.
        fresh_noise: whether a bench file without a seed has new noise in every session, by a seed drawn at loading.
        noise_seed: seed of the noise alone; None: `seed`.
        sheet: file in `sim_hardware` with the simulated laboratory's measurements of the specimen; empty for none.
        modes: number of shapes in the Galerkin model of the plant.
        plant_rate_hz: the plant's fixed time grid.
        window_s: remembered time of the plant.
        speed: bench seconds per wall second with a wall clock.
    """

    tactor: Tactor = field(default_factory=Tactor)
    skin: Skin | None = None
    membrane: Membrane = field(default_factory=Membrane)
    hands: OperatorTiming = field(default_factory=OperatorTiming)
    beyond: Nonidealities = field(default_factory=Nonidealities)
    mounting: MountingScatter = field(default_factory=MountingScatter)
    electrical: ElectricalParameters = field(default_factory=ElectricalParameters)
    room: RoomParameters = field(default_factory=RoomParameters)
    ageing: AgeingParameters = field(default_factory=AgeingParameters)
    modes: int = 7
    generator: GeneratorParameters = field(default_factory=GeneratorParameters)
    amplifier: AmplifierParameters = field(default_factory=AmplifierParameters)
    source: str = "generator"
    supply: SupplyParameters = field(default_factory=SupplyParameters)
    sensor: SensorParameters = field(default_factory=SensorParameters)
    card: CardParameters = field(default_factory=CardParameters)
    interlock: InterlockParameters = field(default_factory=InterlockParameters)
    seed: int = 1
    fresh_noise: bool = False
    noise_seed: int | None = None
    sheet: str = ""
    plant_rate_hz: float = 100e3
    window_s: float = 30.0
    speed: float = 1.0

    def __post_init__(self) -> None:
        if self.source not in SOURCE_CHOICES:
            raise ValueError(f"simulation.source is {self.source!r}: choose from {', '.join(SOURCE_CHOICES)}")
        if self.sheet not in SHEET_CHOICES:
            raise ValueError(f"simulation.sheet is {self.sheet!r}: it can only be {SHEET_CHOICES[1]!r}, or be left out")
        _positive("simulation", self, "speed")
        _not_negative("simulation", self, "seed", "noise_seed")
        _within("simulation.modes", self.modes, 3, 40)
        _within("simulation.plant_rate_hz", self.plant_rate_hz, 1e4, 1e6)
        _within("simulation.window_s", self.window_s, 0.1, 60)

    def as_record(self) -> dict[str, Any]:
        """Plain nested values, ready for JSON."""
        return asdict(self)

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> Self:
        """Return the parameters of a record made by `as_record`; missing ones keep their defaults.

        Raises:
            ValueError: a key is unknown or a value does not fit.
        """
        parameters: Self = _build(cls, _with_product(record), "simulation")
        return parameters


@cache
def card_products() -> dict[str, dict[str, Any]]:
    """Return the parameters of the known cards, by product, that differ from the default."""
    text = resources.files("sim_hardware.plant").joinpath("cards.toml").read_text("utf-8")
    return {name: {"product": name, **table} for name, table in tomllib.loads(text).items()}


def _with_product(record: dict[str, Any]) -> dict[str, Any]:
    """Return the record with the values of the card's product, which its own values replace."""
    card = record.get("card")
    known = card_products().get(str(card.get("product"))) if isinstance(card, dict) else None
    return {**record, "card": {**known, **card}} if known and isinstance(card, dict) else record


def _build(target_type: Any, value: Any, key: str) -> Any:
    """Return a value of type `kind` from JSON: dataclasses from tables, tuples from lists."""
    if get_origin(target_type) in (Union, types.UnionType):
        if value is None:
            return None
        (target_type,) = (k for k in get_args(target_type) if k is not type(None))
    if get_origin(target_type) is tuple:
        if not isinstance(value, list | tuple):
            raise ValueError(f"{key}: expected a list, not {value!r}")
        return tuple(_scalar(float, item, key) for item in value)
    if not is_dataclass(target_type):
        return _scalar(target_type, value, key)
    if not isinstance(value, dict):
        raise ValueError(f"{key}: expected a table, not {value!r}")
    hints = get_type_hints(target_type)
    names = {f.name for f in fields(target_type)}
    if unknown := sorted(set(value) - names):
        raise ValueError(f"{key}: unknown {', '.join(unknown)}; valid are {', '.join(sorted(names))}")
    built: dict[str, Any] = {name: _build(hints[name], item, f"{key}.{name}") for name, item in value.items()}
    try:
        return target_type(**built)  # type: ignore[operator]
    except TypeError as error:  # a field without a default is missing
        raise ValueError(f"{key}: {error}") from None


def _scalar(target_type: Any, value: Any, key: str) -> Any:
    """Return a bool, int, float or str of the declared type; a whole number is valid for a float."""
    if target_type is float and isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    if target_type is not float and type(value) is target_type:
        return value
    names = {float: "a finite number", int: "a whole number", bool: "true or false", str: "a text"}
    raise ValueError(f"{key}: expected {names.get(target_type, target_type)}, not {value!r}")


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ValueError(f"{name} must be from {low:g} to {high:g}, not {value:g}")


def _positive(table: str, parameters: object, *names: str) -> None:
    for name in names:
        if not (value := getattr(parameters, name)) > 0:
            raise ValueError(f"{table}.{name} must be positive, not {value:g}")


def _not_negative(table: str, parameters: object, *names: str) -> None:
    for name in names:
        if (value := getattr(parameters, name)) is not None and not value >= 0:
            raise ValueError(f"{table}.{name} must not be negative, not {value:g}")
