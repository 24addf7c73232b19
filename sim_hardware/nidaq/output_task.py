"""NI-DAQmx analogue output tasks on the simulated card: buffer, start trigger, rewriting, stopping.

Stopping a task within a wave leaves the output at the present sample, and samples on their way to the converter cannot be
overwritten (NI-DAQmx help: regeneration; X Series manual, AO; sim_hardware.nidaq.output_queue).
"""

import math
import re

import numpy as np
from numpy.typing import NDArray

from model import Array
from sim_hardware.nidaq.analog_output import RANGE_V, SimulatedAnalogOutput, to_counts
from sim_hardware.nidaq.card import TIMEBASE_HZ
from sim_hardware.nidaq.errors import NiError
from sim_hardware.nidaq.output_queue import REQUEST_SIZE, SimulatedOutputQueue
from sim_hardware.nidaq.task import FINITE, NiTask, SimulatedNiDevice, TaskChannel

FIRST_SAMPLE, CURRENT_WRITE_POSITION = 10424, 10430
NOT_TRIGGERED = math.inf
WRITE_TIMEOUT_S = 10.0
"""Default timeout of nidaqmx, in real seconds, for calls without one."""


class NiOutputTask(NiTask):
    """One analogue output task on one channel."""

    max_rate_hz = 900e3

    def __init__(self, device: SimulatedNiDevice, name: str) -> None:
        super().__init__(device, name, FINITE, 0)
        self.relative_to = CURRENT_WRITE_POSITION
        self.offset = 0
        self.trigger = ""
        self._counts = np.zeros(0, np.int16)
        self._written = 0
        self._start_time_s: float | None = None
        self.queue: SimulatedOutputQueue = device.card.new_output_queue()

    def add_voltage_channels(self, text: str, name: str, low_v: float, high_v: float) -> None:
        device, _, line = text.partition("/")
        match = re.fullmatch(r"ao(\d+)", line.strip(), re.IGNORECASE)
        if device.lower() != self.device.name.lower():
            raise NiError(-200220, f"Device Specified: {device}")
        if not match or int(match[1]) >= self.device.card.parameters.ao_channels:
            raise NiError(-200170, f"Physical Channel Name: {text}")
        if not -RANGE_V <= low_v < high_v <= RANGE_V:
            raise NiError(-200077, f"Property: AO.Max\nRequested Value: {high_v}\nMaximum Value: {RANGE_V}")
        self.channels = [TaskChannel(name or text, int(match[1]), low_v, high_v)]

    def configure_clock(self, rate_hz: float, mode: int, scans: int) -> None:
        super().configure_clock(rate_hz, mode, scans)
        self.set_buffer(scans)

    def configure_trigger(self, source: str) -> None:
        """Start at an edge of the input's sample clock. Raises NiError for a terminal without a route."""
        if source.lower() != f"/{self.device.name}/ai/SampleClock".lower():
            raise NiError(-89136, f"Source Terminal: {source}")
        if self.device.card.traits["start-route"] == "absent":
            raise NiError(-89136, f"Source Terminal: {source}")
        self.trigger = source

    def set_property(self, number: int, value: int) -> None:
        """Set the begin of the next write, or the size of a USB request. Raises NiError for any other property."""
        match number:
            case _ if number == REQUEST_SIZE and self._start_time_s is None:
                self.queue.set_request_bytes(value)
            case 0x190C:
                self.relative_to = value
            case 0x190D:
                self.offset = value
            case _:
                raise NiError(-200452, f"Property: {number:#x}")

    def _divided_rate(self, rate_hz: float) -> float:
        card = self.device.card.parameters
        if not card.ao_clocked:
            raise NiError(-200077, "Property: SampTimingType\nRequested Value: Sample Clock")
        if rate_hz > card.ao_max_rate_hz:
            raise NiError(
                -200081, f"Property: SampClk.Rate\nRequested Value: {rate_hz}\nMaximum Value: {card.ao_max_rate_hz}"
            )
        return TIMEBASE_HZ / max(1, math.floor(TIMEBASE_HZ / rate_hz * (1 + 1e-12)))

    def set_buffer(self, scans: int) -> None:
        self._counts = np.zeros(scans, np.int16)

    def write(self, volts: Array, auto_start: bool, timeout_s: float = WRITE_TIMEOUT_S) -> int:
        """Write samples, or one level immediately without a clock; return the number of written samples.

        `timeout_s` is in real seconds, like NI's.

        Raises:
            NiError: out of range, in use, beyond the last sample, or already played.
        """
        output, channel = self._output(), self._channel()
        if volts.size and not channel.low_v <= float(volts.min()) <= float(volts.max()) <= channel.high_v:
            raise NiError(-200561, f"Task Name: {self.name}")
        if self.rate_hz is None:
            self.device.check_present()
            if output.owner not in (None, self):
                raise NiError(-50103, f"Task Name: {self.name}")
            output.hold(float(volts[-1]))
            return volts.size
        first = self.offset + (0 if self.relative_to == FIRST_SAMPLE else self._written)
        if first + volts.size > self._counts.size:
            raise NiError(-201132, f"Task Name: {self.name}")
        counts = to_counts(volts)
        if self._start_time_s is not None:
            self._rewrite(first, counts, timeout_s)
        else:
            self._counts[first : first + counts.size] = counts
        self._written = first + counts.size
        if auto_start:
            self.start()
        return volts.size

    def _rewrite(self, first: int, counts: NDArray[np.int16], timeout_s: float) -> None:
        """Change samples of a running generation, except samples on their way to the converter."""
        if (held_back := self.device.card.traits.get("rewrite")) in ("waits", "blocks"):
            timeout_s = WRITE_TIMEOUT_S if held_back == "blocks" else timeout_s
            deadline_s = self.device.clock.now() + timeout_s * self.device.speed
            self._wait(lambda: False, lambda: deadline_s, timeout_s)
            raise NiError(-200292, f"Task Name: {self.name}")
        done = self.samples_generated()
        if first < done:
            raise NiError(-200289, f"Task Name: {self.name}")
        late = max(done + self.queue.samples(self.actual_rate()) - first, 0)
        # In place: no reader has seen future volts, and 80 million samples must not be copied for each message.
        self._counts[first + late : first + counts.size] = counts[late:]

    def start(self) -> None:
        if self._start_time_s is not None or self.rate_hz is None:
            return
        output = self._output()
        if self._written < self._counts.size:
            raise NiError(-200462, f"Task Name: {self.name}")
        self.device.check_present()
        if output.owner not in (None, self):
            raise NiError(-50103, f"Task Name: {self.name}")
        output.owner = self
        on_scan = self.trigger and self.device.card.traits.get("start-edge") != "at-once"
        edge = self.device.next_scan_time if on_scan else lambda t: t
        self._start_time_s = output.play(self._counts, self.actual_rate(), edge)

    def stop(self) -> None:
        """Stop: the output stays at the present sample."""
        if self._start_time_s is None:
            return
        output = self._output()
        if self._samples_output() < self._counts.size:
            output.freeze()
        self._start_time_s = None
        self._written = 0
        if output.owner is self:
            output.owner = None

    def samples_generated(self) -> int:
        """Number of samples played since the start."""
        self.device.check_present(-88705)
        return self._samples_output()

    def _samples_output(self) -> int:
        if self._start_time_s is None or self._start_time_s == NOT_TRIGGERED:
            return 0
        played = math.floor((self.device.clock.now() - self._start_time_s) * self.actual_rate() + 1e-6) + 1
        return min(max(played, 0), self._counts.size)

    def is_done(self) -> bool:
        return self._start_time_s is None or self.samples_generated() >= self._counts.size

    def wait_until_done(self, timeout_s: float) -> bool:
        duration_s = self._counts.size / self.actual_rate() if self.rate_hz is not None else 0.0
        return self._wait(self.is_done, lambda: (self._start_time_s or 0.0) + duration_s, timeout_s)

    def _channel(self) -> TaskChannel:
        if not self.channels:
            raise NiError(-200478)
        return self.channels[0]

    def _output(self) -> SimulatedAnalogOutput:
        return self.device.card.outputs[self._channel().number]
