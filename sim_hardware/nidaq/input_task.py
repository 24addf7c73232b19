"""NI-DAQmx analogue input tasks on the simulated card: states, reservation, buffer, reading."""

import threading

import numpy as np
from numpy.typing import NDArray

from drivers import SharedTime
from sim_hardware.nidaq.card import TIMEBASE_HZ, SampleRateError, actual_rate
from sim_hardware.nidaq.errors import NiError
from sim_hardware.nidaq.task import CONTINUOUS, FINITE, NiTask, SimulatedNiDevice, TaskChannel

ALL_AVAILABLE = -1

LATE_S = 1.0
"""Longest delay of a reader, bench seconds, before bench time waits for it, if possible: longer than a ramp, during which the
program does not read."""


def default_buffer_size(rate_hz: float) -> int:
    """Return NI's default buffer of a continuous task in scans (NI-DAQmx help, buffer size)."""
    sizes = ((100.0, 1000), (10e3, 10_000), (1e6, 100_000))
    return next((size for limit, size in sizes if rate_hz <= limit), 1_000_000)


class NiInputTask(NiTask):
    """One analogue input task."""

    def __init__(self, device: SimulatedNiDevice, name: str) -> None:
        super().__init__(device, name, CONTINUOUS, 1000)
        self.max_rate_hz = device.card.parameters.max_rate_hz
        self._buffer: int | None = None
        self.read_position = 0
        self._lock = threading.Lock()

    def add_voltage_channels(self, text: str, name: str, low_v: float, high_v: float) -> None:
        most = self.device.card.parameters.range_v
        if not (-most * 1.06 <= low_v < high_v <= most * 1.06):
            raise NiError(-200077, f"Property: AI.Max\nRequested Value: {high_v}\nMaximum Value: {most}")
        for terminal in self.device.parse_physical_channels(text):
            label = name or self.device.physical_channel_name(terminal)
            if any(channel.name == label for channel in self.channels):
                raise NiError(-200489, f"Channel Name: {label}")
            self.channels.append(TaskChannel(label, terminal, low_v, high_v))

    def _divided_rate(self, rate_hz: float) -> float:
        try:
            return actual_rate(self.device.card.parameters, rate_hz, len(self.channels))
        except SampleRateError as error:
            raise NiError(
                -200081, f"Property: SampClk.Rate\nRequested Value: {rate_hz}\nMaximum Value: {error.limit_hz}"
            ) from error

    def buffer_size(self) -> int:
        """Number of scans that the driver stores for a late reader."""
        if self._buffer is not None:
            return self._buffer
        return (
            max(default_buffer_size(self.rate_hz or 0.0), self.samples_per_channel)
            if self.mode == CONTINUOUS
            else self.samples_per_channel
        )

    def set_buffer(self, scans: int) -> None:
        self._buffer = scans

    def start(self) -> None:
        with self._lock:
            if self.acquisition is not None:
                return
            if not self.channels:
                raise NiError(-200478)
            rate = TIMEBASE_HZ / 200 if self.rate_hz is None else self.actual_rate()
            self.device.check_present()
            self.device.reserve(self)
            numbers = [channel.number for channel in self.channels]
            if self.rate_hz is None:
                rate /= len(numbers)
            self.acquisition = self.device.card.start_acquisition(rate, numbers, self.device.clock.now())
            self.read_position = 0

    def stop(self) -> None:
        """Stop acquiring; unread scans are lost."""
        self.acquisition = None
        self.device.release(self)

    def acquired(self) -> int:
        """Scans acquired since the start."""
        run = self.acquisition
        if run is None:
            return 0
        ready = run.available_scans(self.device.clock.now())
        return min(ready, self.samples_per_channel) if self.mode == FINITE else ready

    def available(self) -> int:
        """Return the number of readable scans. Raises NiError if some were overwritten."""
        late = self.acquired() - self.read_position
        if self.mode == CONTINUOUS and (late > self.buffer_size() or self.device.faults.is_active("card-overrun")):
            raise NiError(-200279, f"Task Name: {self.name}", samples_read=0)
        return late

    def read(self, count: int, timeout_s: float) -> tuple[NDArray[np.int16], int]:
        """Return counts (channels, n) and a status: 0, or -200284 with the samples available at the timeout.

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
        self._let_time_run(count)
        status = 0 if self._wait_for_scans(count, timeout_s) else -200284
        run = self.acquisition
        if run is None:
            raise NiError(-200088, samples_read=0)
        requested, count = count, min(count, self.available())
        raw = run.read_raw(self.read_position, count)
        self.read_position += count
        self._let_time_run(requested)
        return raw, status

    def _let_time_run(self, count: int) -> None:
        """At raised speed, let bench time run slightly beyond the next read of this number of scans."""
        shared: SharedTime | None = getattr(self.device.clock, "shared", None)
        run = self.acquisition
        if shared is not None and run is not None and self.mode == CONTINUOUS:
            shared.wait_at(run.available_at(self.read_position + count) + LATE_S)

    def is_done(self) -> bool:
        return self.acquisition is None or (self.mode == FINITE and self.acquired() >= self.samples_per_channel)

    def wait_until_done(self, timeout_s: float) -> bool:
        return (
            self._wait_for_scans(self.samples_per_channel - self.read_position, timeout_s)
            if self.mode == FINITE
            else self.acquisition is None
        )

    def _wait_for_scans(self, count: int, timeout_s: float) -> bool:
        """Wait for `count` more scans; return whether they are available."""
        run = self.acquisition
        if run is None:
            return False

        def is_over() -> bool:
            if self.acquisition is None:
                return True
            self.device.check_present(-88705)
            return self.available() >= count

        return self._wait(is_over, lambda: run.available_at(self.read_position + count), timeout_s)

    def _read_on_demand(self) -> NDArray[np.int16]:
        """One scan now, paced by software."""
        self.start()
        try:
            run = self.acquisition
            if run is None:
                raise NiError(-200088, samples_read=0)
            self.device.clock.sleep(run.available_at(1) - self.device.clock.now())
            self.device.check_present(-88705)
            return run.read_raw(0, 1)
        finally:
            self.stop()
