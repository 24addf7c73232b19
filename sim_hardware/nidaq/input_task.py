"""What NI-DAQmx does with analogue input tasks, without its wire: states, reservation, buffer, reading."""

import math
import re
import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from sim_hardware.nidaq.card import (
    FIRST_OUTPUT_READBACK_CHANNEL,
    TIMEBASE_HZ,
    Acquisition,
    SampleRateError,
    SimulatedCard,
    actual_rate,
)
from sim_hardware.nidaq.errors import NiError
from sim_hardware.plant.faults import FaultState

FINITE, CONTINUOUS = 10178, 10123
ALL_AVAILABLE = -1


def default_buffer_size(rate_hz: float) -> int:
    """Scans NI buffers for a continuous task when nothing larger is asked for (NI-DAQmx help, buffer size)."""
    for limit, size in ((100.0, 1000), (10e3, 10_000), (1e6, 100_000)):
        if rate_hz <= limit:
            return size
    return 1_000_000


@dataclass(frozen=True, slots=True)
class TaskChannel:
    """One analogue input channel of a task."""

    name: str
    number: int
    low_v: float
    high_v: float


class SimulatedNiDevice:
    """The card as NI-DAQmx sees it: a name, and at most one task that runs its analogue input."""

    def __init__(self, card: SimulatedCard, clock: Clock, faults: FaultState, name: str = "Dev1") -> None:
        self.card = card
        self.clock = clock
        self.faults = faults
        self.name = name
        self.server_stopping = threading.Event()
        self._lock = threading.Lock()
        self._input_owner: NiInputTask | None = None

    def check_present(self, code: int = -201003) -> None:
        """Raise NiError if the card is not there."""
        if self.faults.is_active("card-unplugged"):
            raise NiError(code, f"Device Specified: {self.name}")

    def reserve(self, task: "NiInputTask") -> None:
        """Give the analogue input to `task`. Raises NiError if another has it."""
        with self._lock:
            if self._input_owner not in (None, task):
                raise NiError(-50103, f"Task Name: {task.name}")
            self._input_owner = task

    def release(self, task: "NiInputTask") -> None:
        """Take the analogue input back."""
        with self._lock:
            if self._input_owner is task:
                self._input_owner = None

    def reset(self) -> None:
        """DAQmx reset: every output goes to 0 V, whatever hangs on it (NI help: states after a device reset)."""
        self.check_present()
        for output in self.card.outputs:
            output.owner = None
            output.reset()

    def physical_channel_name(self, number: int) -> str:
        """The name of a channel number."""
        line = (
            f"_ao{number - FIRST_OUTPUT_READBACK_CHANNEL}_vs_aognd"
            if number >= FIRST_OUTPUT_READBACK_CHANNEL
            else f"ai{number}"
        )
        return f"{self.name}/{line}"

    @property
    def speed(self) -> float:
        """Bench seconds per second of the caller's own time."""
        return float(getattr(self.clock, "speed", 1.0))

    def next_scan_time(self, t: float) -> float:
        """When the running acquisition takes its next scan after `t`; infinity if none runs."""
        with self._lock:
            run = self._input_owner.acquisition if self._input_owner is not None else None
        if run is None:
            return math.inf
        return run.start_time_s + max(math.ceil((t - run.start_time_s) * run.rate_hz - 1e-9), 0) / run.rate_hz

    def parse_physical_channels(self, text: str) -> list[int]:
        """Channel numbers of `Dev1/ai0:1, Dev1/_ao0_vs_aognd`. Raises NiError for what does not exist."""
        numbers: list[int] = []
        for part in text.split(","):
            device, _, line = part.strip().partition("/")
            if device.lower() != self.name.lower():
                raise NiError(-200220, f"Device Specified: {device}")
            inside = re.fullmatch(r"_ao(\d+)_vs_aognd", line.strip(), re.IGNORECASE)
            if inside and int(inside[1]) < len(self.card.outputs):
                numbers.append(FIRST_OUTPUT_READBACK_CHANNEL + int(inside[1]))
                continue
            found = re.fullmatch(r"ai(\d+)(?::(?:ai)?(\d+))?", line.strip(), re.IGNORECASE)
            first, last = (int(found[1]), int(found[2] or found[1])) if found else (0, self.card.parameters.channels)
            if max(first, last) >= self.card.parameters.channels:
                raise NiError(-200170, f"Physical Channel Name: {part.strip()}")
            numbers += range(first, last + 1)
        return numbers


class NiInputTask:
    """One analogue input task."""

    def __init__(self, device: SimulatedNiDevice, name: str) -> None:
        self.name = name
        self.device = device
        self.channels: list[TaskChannel] = []
        self.rate_hz: float | None = None
        self.mode = CONTINUOUS
        self.samples_per_channel = 1000
        self._buffer: int | None = None
        self.read_position = 0
        self._acquisition: Acquisition | None = None
        self._lock = threading.Lock()

    @property
    def running(self) -> bool:
        return self._acquisition is not None

    @property
    def acquisition(self) -> Acquisition | None:
        """What runs, if anything does."""
        return self._acquisition

    def add_voltage_channels(self, text: str, name: str, low_v: float, high_v: float) -> None:
        """Add voltage channels. Raises NiError for what the card does not have or cannot do."""
        most = self.device.card.parameters.range_v
        if not (-most * 1.06 <= low_v < high_v <= most * 1.06):
            raise NiError(-200077, f"Property: AI.Max\nRequested Value: {high_v}\nMaximum Value: {most}")
        for terminal in self.device.parse_physical_channels(text):
            label = name or self.device.physical_channel_name(terminal)
            if any(channel.name == label for channel in self.channels):
                raise NiError(-200489, f"Channel Name: {label}")
            self.channels.append(TaskChannel(label, terminal, low_v, high_v))

    def configure_clock(self, rate_hz: float, mode: int, scans: int) -> None:
        """Set the sample clock. Raises NiError for a rate that the converter can never do."""
        limit = self.device.card.parameters.max_rate_hz
        if not 0 < rate_hz <= limit * (1 + 1e-9):
            raise NiError(
                -200077,
                f"Property: SampClk.Rate\nRequested Value: {rate_hz}\nMaximum Value: {limit}\nTask Name: {self.name}",
            )
        self.rate_hz, self.mode, self.samples_per_channel = rate_hz, mode, scans

    def actual_rate(self) -> float:
        """The rate the divider makes. Raises NiError if it is too fast for this many channels."""
        if self.rate_hz is None:
            raise NiError(-200452, "Property: SampClk.Rate")
        if not self.channels:
            raise NiError(-200478)
        try:
            return actual_rate(self.device.card.parameters, self.rate_hz, len(self.channels))
        except SampleRateError as error:
            raise NiError(
                -200081, f"Property: SampClk.Rate\nRequested Value: {self.rate_hz}\nMaximum Value: {error.limit_hz}"
            ) from error

    def max_rate(self) -> float:
        """What the converter can do with this many channels."""
        return self.device.card.parameters.max_rate_hz / max(1, len(self.channels))

    def buffer_size(self) -> int:
        """Scans the driver keeps for a late reader."""
        if self._buffer is not None:
            return self._buffer
        return (
            max(default_buffer_size(self.rate_hz or 0.0), self.samples_per_channel)
            if self.mode == CONTINUOUS
            else self.samples_per_channel
        )

    def set_buffer(self, scans: int) -> None:
        """Keep this many scans, whatever NI would choose."""
        self._buffer = scans

    def start(self) -> None:
        """Begin to acquire. Raises NiError: no channels, too fast, in use, or unplugged."""
        with self._lock:
            if self._acquisition is not None:
                return
            if not self.channels:
                raise NiError(-200478)
            rate = TIMEBASE_HZ / 200 if self.rate_hz is None else self.actual_rate()
            self.device.check_present()
            self.device.reserve(self)
            numbers = [channel.number for channel in self.channels]
            if self.rate_hz is None:
                rate /= len(numbers)
            self._acquisition = self.device.card.start_acquisition(rate, numbers, self.device.clock.now())
            self.read_position = 0

    def stop(self) -> None:
        """Stop acquiring; what was not read is gone."""
        self._acquisition = None
        self.device.release(self)

    def acquired(self) -> int:
        """Scans acquired since the start."""
        run = self._acquisition
        if run is None:
            return 0
        ready = run.available_scans(self.device.clock.now())
        return min(ready, self.samples_per_channel) if self.mode == FINITE else ready

    def available(self) -> int:
        """Scans that could be read now. Raises NiError if some were overwritten."""
        late = self.acquired() - self.read_position
        if self.mode == CONTINUOUS and (late > self.buffer_size() or self.device.faults.is_active("card-overrun")):
            raise NiError(-200279, f"Task Name: {self.name}", samples_read=0)
        return late

    def read(self, count: int, timeout_s: float) -> tuple[NDArray[np.int16], int]:
        """Counts (channels, n) and a status: 0, or -200284 with what was there when the time was up.

        Raises:
            NiError: overrun, beyond the end of a finite task, or unplugged.
        """
        if self.rate_hz is None:
            return self._read_on_demand(), 0
        self.start()
        if self.mode == FINITE and count == ALL_AVAILABLE:
            count = self.samples_per_channel - self.read_position
        elif count == ALL_AVAILABLE:
            count = self.available()
        if self.mode == FINITE and self.read_position + count > self.samples_per_channel:
            raise NiError(-200278, f"Task Name: {self.name}", samples_read=0)
        status = 0 if self._wait_for_scans(count, timeout_s) else -200284
        run = self._acquisition
        if run is None:
            raise NiError(-200088, samples_read=0)
        count = min(count, self.available())
        raw = run.read_raw(self.read_position, count)
        self.read_position += count
        return raw, status

    def wait_until_done(self, timeout_s: float) -> bool:
        """Wait until a finite task has all its scans; whether it has."""
        return (
            self._wait_for_scans(self.samples_per_channel - self.read_position, timeout_s)
            if self.mode == FINITE
            else not self.running
        )

    def _wait_for_scans(self, count: int, timeout_s: float) -> bool:
        """Wait until `count` more scans are there; whether they are. The time-out is the reader's own, real time."""
        clock, run = self.device.clock, self._acquisition
        given_up = clock.now() + (math.inf if timeout_s < 0 else timeout_s * self.device.speed)
        while run is not None:
            self.device.check_present(-88705)
            if self.available() >= count:
                return True
            now = clock.now()
            if now >= given_up or self.device.server_stopping.is_set():
                return False
            until = min(run.available_at(self.read_position + count), given_up)
            # In short pieces, so that a pulled cable or a closing server is noticed while waiting.
            clock.sleep(min(max(until - now, 1e-4 * self.device.speed), 0.02 * self.device.speed))
        return False

    def _read_on_demand(self) -> NDArray[np.int16]:
        """One scan now, paced by software."""
        self.start()
        try:
            run = self._acquisition
            if run is None:
                raise NiError(-200088, samples_read=0)
            self.device.clock.sleep(run.available_at(1) - self.device.clock.now())
            self.device.check_present(-88705)
            return run.read_raw(0, 1)
        finally:
            self.stop()
