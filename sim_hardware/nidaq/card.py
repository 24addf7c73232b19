"""Simulated 16-bit multifunction card: amplifier's input, laser sensor, and the amplifier's two monitors.

Every sample is a pure function of the simulation parameters, the history, the seed and the sample's index, independent of the
portions and times of reading.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers import Scale
from model import Array
from sim_hardware.generators import Trait, draw_options
from sim_hardware.nidaq.analog_output import SimulatedAnalogOutput
from sim_hardware.nidaq.interlock import SimulatedInterlock
from sim_hardware.nidaq.output_queue import SimulatedOutputQueue
from sim_hardware.plant import (
    CardParameters,
    ElectricalQuantity,
    FaultState,
    LaserView,
    Plant,
    SimulationParameters,
    VoltageHistory,
)

SETTLING_SHARE = 0.02
"""Share of the previously converted volts in an input that settles too slowly."""

CARD_TRAITS = (
    Trait(
        "start-route",
        ("present", "absent"),
        "whether ai/SampleClock can be routed to the start of the output: NI's tables of routes differ by model (MAX, Device Routes)",
    ),
)

CARD_DEVIATIONS = (
    Trait(
        "skew",
        ("as-reported", "together", "double"),
        "time between two conversions of a scan: NI-DAQmx reports AI.ConvRate, 10 us above the fastest by default (X Series manual ch. 4)",
    ),
    Trait(
        "settling",
        ("settled", "slow"),
        "share of the channel converted before it: NI asks for sources below 1 kohm (USB-6001 guide, Multichannel Scanning Considerations)",
    ),
    Trait("start-edge", ("on-scan", "at-once"), "whether an output that is to start at a scan does"),
    Trait(
        "rewrite",
        ("prompt", "waits", "blocks"),
        "whether NI's protection against glitches holds a rewrite back until the caller's time-out (NI-DAQmx help, Glitching: in "
        "continuous tasks), or whatever that is for 10 s",
    ),
    Trait(
        "queue",
        ("as-reported", "longer"),
        "samples on their way to the converter, beyond those that the card reports (README of NIDAQ.jl: 4 requests of 32 768 bytes)",
    ),
)
"""Possible deviations of a card from the drivers' assumptions. Never drawn: `card.traits` chooses it, to try a commissioning."""


def draw_card_traits(seed: int, chosen: str = "") -> dict[str, str]:
    """Return the option of each trait of the card: chosen (`skew=double`), otherwise drawn from the seed.

    Raises:
        ValueError: an unknown trait or option is chosen.
    """
    return draw_options("card.traits", "card", f"card {seed}", CARD_TRAITS, CARD_DEVIATIONS, chosen)


Counts = NDArray[np.int16]

DRIVE_CHANNEL, SENSOR_CHANNEL, VOLTAGE_MONITOR_CHANNEL, CURRENT_MONITOR_CHANNEL = 0, 1, 2, 3
TEMPERATURE_CHANNEL, HUMIDITY_CHANNEL, CHARGE_CHANNEL = 4, 6, 7
FIRST_OUTPUT_READBACK_CHANNEL = 1000
"""First number of the channels that are analogue outputs measured inside the card (`_ao0_vs_aognd`)."""
GROUND_CHANNEL = 2000
"""Number of the channel of the card's analogue ground (`_aignd_vs_aignd`)."""

CONNECTED_CHANNELS = {*range(TEMPERATURE_CHANNEL + 1), HUMIDITY_CHANNEL, CHARGE_CHANNEL}
GHOST_SHARE = 0.98
"""Share of the previously converted volts in an open input: the multiplexer's capacitance keeps its charge."""

UNREPORTED_QUEUE_S = 0.25
"""Unreported seconds of samples on their way in a card with a longer queue."""

TIMEBASE_HZ = 100e6
_NOISE_PAGE_SAMPLES = 8192


class SampleRateError(ValueError):
    """The card cannot sample that fast. `limit_hz` is its limit per channel; `single` if it applies even to one channel."""

    def __init__(self, rate_hz: float, channels: int, limit_hz: float, single: bool) -> None:
        super().__init__(f"{rate_hz:g} S/s on {channels} channels is too fast, the card can do {limit_hz:g} S/s")
        self.limit_hz = limit_hz
        self.single = single


def actual_rate(parameters: CardParameters, rate_hz: float, channels: int) -> float:
    """Return the rate of the card's divider for `rate_hz`: the next higher one.

    Raises:
        SampleRateError: above the limit of the converter, which all channels share unless each has its own, or not positive.
    """
    limit = parameters.max_rate_hz / (channels if parameters.convert_s else 1)
    if not 0 < rate_hz <= limit * (1 + 1e-9):
        raise SampleRateError(rate_hz, channels, limit, not 0 < rate_hz <= parameters.max_rate_hz)
    return parameters.timebase_hz / max(1, math.floor(parameters.timebase_hz / rate_hz * (1 + 1e-12)))


def convert_interval_s(parameters: CardParameters, rate_hz: float, channels: int) -> float:
    """Seconds between the conversions of two channels of one scan: the card's default, or the largest that fits into a scan."""
    fast = rate_hz * channels > parameters.fast_sample_hz
    return min(parameters.fast_convert_s if fast else parameters.convert_s, 1 / (rate_hz * channels))


class _Noise:
    """Unit normal noise of one channel: page `p` always comes from its own generator."""

    def __init__(self, *key: int) -> None:
        self._key = key
        self._pages: dict[int, NDArray[np.float32]] = {}

    def __call__(self, first: int, count: int) -> Array:
        pages = range(first // _NOISE_PAGE_SAMPLES, (first + count - 1) // _NOISE_PAGE_SAMPLES + 1)
        drawn = {p: self._pages[p] if p in self._pages else self._draw(p) for p in pages}
        self._pages = {pages[-1]: drawn[pages[-1]]}
        begin = first - pages[0] * _NOISE_PAGE_SAMPLES
        return np.concatenate([drawn[p] for p in pages])[begin : begin + count].astype(np.float64)

    def _draw(self, page: int) -> NDArray[np.float32]:
        return np.random.default_rng((*self._key, page)).standard_normal(_NOISE_PAGE_SAMPLES, np.float32)


class Acquisition:
    """One continuous acquisition: scans of `channels` from `start_s` on."""

    def __init__(
        self, card: "SimulatedCard", rate_hz: float, channels: Sequence[int], start_s: float, number: int
    ) -> None:
        self.rate_hz = rate_hz
        self.channels = tuple(channels)
        self.start_time_s = start_s
        self._card = card
        self.reported_convert_s = convert_interval_s(card.parameters, rate_hz, len(channels))
        self.convert_s = self.reported_convert_s * card.skew_ratio
        self._noise = [_Noise(card.noise_seed, channel, number) for channel in channels]

    def available_at(self, scans: int) -> float:
        """Return the bench time of the end of the first `scans` scans."""
        skew = (len(self.channels) - 1) * self.convert_s
        return self._card.plant.available_at(self.start_time_s + max(0, scans - 1) / self.rate_hz + skew)

    def available_scans(self, now: float) -> int:
        """Return the number of scans until `now`."""
        skew = (len(self.channels) - 1) * self.convert_s
        until = self._card.plant.available_until(now) - self.start_time_s - skew
        return max(0, math.floor(until * self.rate_hz + 1e-6) + 1)

    def read_raw(self, first: int, count: int) -> Counts:
        """Return the scans first..first + count as counts, shape (channels, count); they must lie in the past."""
        out = np.empty((len(self.channels), count), np.int16)
        if not count:
            return out
        t = self.start_time_s + np.arange(first, first + count) / self.rate_hz
        for slot, noise in enumerate(self._noise):
            clean, sigma = self._slot_voltage(slot, t)
            out[slot] = self._card.quantize(clean + sigma * noise(first, count))
        return out

    @property
    def change_count(self) -> int:
        """Number of changes of the samples' inputs."""
        return self._card.plant.change_count + self._card.laser_view.change_count

    def read_ahead(self, first: int, count: int, now_s: float) -> Counts:
        """Return scans as `read_raw`, partly in the future of `now_s`, valid until the next change."""
        with self._card.plant.reading_ahead(now_s):
            return self.read_raw(first, count)

    def confirm(self, now_s: float) -> None:
        """Keep the samples computed ahead until `now_s`."""
        self._card.plant.confirm(now_s)

    def discard_ahead(self) -> None:
        """Discard the samples computed ahead."""
        self._card.plant.discard_ahead()

    def _slot_voltage(self, slot: int, t: Array) -> tuple[Array, Array | float]:
        """Return the volts at a place of the scans at times `t`, and their noise; an open input shows the previous place.

        A connected input, other than the drive, shows a share of the previous place if it settles too slowly.
        """
        unsettled = self._card.unsettled_share
        if unsettled and self.channels[slot] != DRIVE_CHANNEL and not self._card.is_open(self.channels[slot]):
            own, sigma = self._place_voltage(slot, t)
            previous, _ = self._place_voltage(slot - 1, t)
            return own + unsettled * (previous - own), sigma
        share = 1.0
        for before in range(len(self.channels)):
            place = slot - before
            if not self._card.is_open(self.channels[place]):
                clean, sigma = self._place_voltage(place, t)
                return share * clean, sigma
            share *= GHOST_SHARE
        return np.zeros(t.size), self._card.parameters.noise_v

    def _place_voltage(self, place: int, t: Array) -> tuple[Array, Array | float]:
        """Return the volts at the terminal of a place of the scans, and their noise; before the first place, of the previous scan."""
        when = t + place * self.convert_s if place >= 0 else t - 1 / self.rate_hz
        return self._card.channel_voltage(self.channels[place], np.maximum(when, 0.0))


class SimulatedCard:
    """The card of one bench."""

    def __init__(
        self,
        parameters: SimulationParameters,
        history: VoltageHistory,
        plant: Plant,
        laser_view: LaserView,
        faults: FaultState,
        outputs: Sequence[SimulatedAnalogOutput],
        interlock: SimulatedInterlock,
    ) -> None:
        self.parameters = parameters.card
        self.outputs, self.interlock = tuple(outputs), interlock
        self.plant = plant
        self.seed = parameters.seed
        self.noise_seed = parameters.seed if parameters.noise_seed is None else parameters.noise_seed
        self.traits = draw_card_traits(parameters.seed, parameters.card.traits)
        self.skew_ratio = {"together": 0.0, "double": 2.0}.get(self.traits.get("skew", ""), 1.0)
        slow = SETTLING_SHARE if self.traits.get("settling") == "slow" else 0.0
        self.unsettled_share = max(parameters.card.unsettled_share, slow)
        self.scale = Scale(parameters.card.coefficients)
        self._sensor, self._amplifier, self._room = parameters.sensor, parameters.amplifier, plant.room
        self._sense_f = parameters.electrical.sense_f
        self.laser_view = laser_view
        self._step_s = 1 / parameters.plant_rate_hz
        self._history = history
        self._faults = faults
        self._acquisition_count = 0
        self._stuck_v: dict[float, float] = {}
        higher = self.scale.coefficients[2:]
        self._nonlinearity = np.array([0.0, 0.0, *higher]) / self.scale.coefficients[1] if any(higher) else None

    def start_acquisition(self, rate_hz: float, channels: Sequence[int], now: float) -> Acquisition:
        """Begin an acquisition at bench time `now`. Raises RateRefusedError as `actual_rate`."""
        rate = actual_rate(self.parameters, rate_hz, len(channels))
        if {VOLTAGE_MONITOR_CHANNEL, CURRENT_MONITOR_CHANNEL, CHARGE_CHANNEL} & set(channels):
            self.plant.keep_electrical()
        self._acquisition_count += 1
        return Acquisition(self, rate, channels, now + self.parameters.latency_s, self._acquisition_count)

    def new_output_queue(self) -> SimulatedOutputQueue:
        """Return the queue of a new output task, from the parameters or drawn from the seed."""
        queue, given = SimulatedOutputQueue.drawn(self.seed), self.parameters
        if given.usb_requests:
            queue.requests = given.usb_requests
        if given.usb_request_bytes:
            queue.request_bytes = given.usb_request_bytes
        if given.usb_adjustable is not None:
            queue.adjustable = given.usb_adjustable
        queue.unreported_s = UNREPORTED_QUEUE_S if self.traits.get("queue") == "longer" else 0.0
        return queue

    def is_open(self, channel: int) -> bool:
        """Whether nothing is connected to a channel's terminal."""
        if channel == DRIVE_CHANNEL:
            return self.parameters.drive_open
        return channel not in CONNECTED_CHANNELS and channel < FIRST_OUTPUT_READBACK_CHANNEL

    def channel_voltage(self, channel: int, t: Array) -> tuple[Array, Array | float]:
        """Return the volts at the channel's terminal without noise, and the rms noise; a stuck sensor has none of its own."""
        if channel == DRIVE_CHANNEL:
            return self._history.volts(t), self.parameters.noise_v
        if channel == SENSOR_CHANNEL:
            s = self._sensor
            w = self._seen(t)
            invalid = (np.abs(w) > s.range_m) | self._faults.was_active("sensor-out-of-range", t)
            seen_v = s.zero_v + w / s.gain_m_per_v * (1 + s.curve_per_m * w)
            volts = self._with_stuck_sensor(np.where(invalid, s.invalid_v, seen_v), t)
            noise_v = np.where(self._faults.was_active("sensor-stuck", t), 0.0, s.noise_m / abs(s.gain_m_per_v))
            return volts, np.hypot(self.parameters.noise_v, noise_v)
        if channel == VOLTAGE_MONITOR_CHANNEL:
            volts = self.plant.electrical(ElectricalQuantity.VOLTAGE, t)
            return self._amplifier.voltage_monitor_v_per_v * volts, self.parameters.noise_v
        if channel == CURRENT_MONITOR_CHANNEL:
            a = self._amplifier
            amps = self.plant.electrical(ElectricalQuantity.CURRENT, t)
            volts = a.current_monitor_zero_v + a.current_monitor_v_per_a * amps
            return volts, math.hypot(self.parameters.noise_v, a.current_monitor_noise_v)
        if channel == CHARGE_CHANNEL:
            return self.plant.electrical(ElectricalQuantity.CHARGE, t) / self._sense_f, self.parameters.noise_v
        if channel == TEMPERATURE_CHANNEL:
            v_per_k = self._room.parameters.sensor_v_per_k
            volts = v_per_k * self._room.temperature_at(t)
            thermal_v = self._room.parameters.sensor_noise_k * v_per_k
            return volts, math.hypot(self.parameters.noise_v, thermal_v)
        if channel == HUMIDITY_CHANNEL:
            return np.full(t.size, self._room.parameters.humidity), self.parameters.noise_v
        if FIRST_OUTPUT_READBACK_CHANNEL <= channel < GROUND_CHANNEL:
            return self.outputs[channel - FIRST_OUTPUT_READBACK_CHANNEL].volts(t), self.parameters.noise_v
        return np.zeros(t.size), self.parameters.noise_v

    def _seen(self, t: Array) -> Array:
        """Return the displacement at the sensor, or for a vibrometer its change over a step of the plant, m/s."""
        if self._sensor.quantity == "displacement":
            return self.laser_view.displacement(t)
        until = t + min(0.5 * self._step_s, self._sensor.delay_s)  # the delay of the sensor precedes it
        return (self.laser_view.displacement(until) - self.laser_view.displacement(until - self._step_s)) / self._step_s

    def _with_stuck_sensor(self, volts: Array, t: Array) -> Array:
        """Return the sensor's volts, constant after the begin of the fault."""
        if not self._faults.was_ever_active("sensor-stuck"):
            return volts
        onsets = self._faults.active_since("sensor-stuck", t)
        for begin in np.unique(onsets[~np.isnan(onsets)]).tolist():
            stuck = onsets == begin
            held_v = self._stuck_v.setdefault(begin, float(volts[stuck][0]))
            volts = np.where(stuck, held_v, volts)
        return volts

    def quantize(self, volts: Array) -> Counts:
        """Return the counts of the converter, the inverse of its scaling, at a rail for voltages beyond it."""
        c0, c1, *_ = self.parameters.coefficients
        counts = (volts - c0) / c1
        if self._nonlinearity is not None:
            # The higher terms are corrections of less than a count; one step suffices.
            counts -= np.polynomial.polynomial.polyval(counts, self._nonlinearity, tensor=False)
        return np.rint(counts).clip(-32768, 32767).astype(np.int16)
