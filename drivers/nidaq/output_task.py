"""NI output task: a finite buffer of samples, written completely, started, and rewritten during play.

Samples on their way to the converter cannot be rewritten: the ones in the card's FIFO (8191 on X Series, user manual ch. 5) and,
on USB, in the pending transfer requests of NI's driver (NI-DAQmx properties AO.UsbXferReqSize and AO.UsbXferReqCount; 4 requests
of 32 768 bytes on a USB-6281, README of NIDAQ.jl).
"""

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from nidaqmx.constants import AcquisitionType, BusType, WriteRelativeTo
from nidaqmx.errors import DaqError, RpcError
from nidaqmx.stream_writers import AnalogSingleChannelWriter

from drivers.clock import Clock
from drivers.deadlines import Deadline
from drivers.errors import BenchError, InstrumentError
from drivers.nidaq.analog_input import OUTPUT, NiConnection
from drivers.nidaq.errors import translate_errors
from drivers.nidaq.rendering import Array

FIFO_SAMPLES = 8191
BYTES_PER_SAMPLE = 2
USB_REQUESTS, USB_REQUEST_BYTES = 4, 32_768
"""Assumed values for a card that does not report them."""

USB_QUEUE_S = 0.15
"""Requested duration of samples in USB requests: long enough for a busy computer, short for a stop."""

USB_PACKET_BYTES = 512
WRITE_PAUSE_S = 1e-4
"""Pause after each message of a long drive, in which the clock sends its heartbeat."""

SAMPLES_PER_WRITE = 200_000
"""Number of samples in one message: below gRPC's default of 4 MB, which NI's server lifts (grpc-device at c1ddf51), but a proxy
may not."""

REWRITE_TIMEOUT_S = 0.1
"""Longest wait of NI's driver for a write during the task: a copy to memory need not wait."""

WRITE_MESSAGES = 3
"""Number of messages of one write: offset, number of channels, which `nidaqmx` queries, and samples."""

_UNSUPPORTED = DaqError, RpcError
_WITHOUT_USB = (BusType.PCI, BusType.PCIE, BusType.PXI, BusType.PXIE)


@dataclass(frozen=True, slots=True)
class OutputQueue:
    """Queue between NI's buffer and the converter, and whether its USB part can be shortened."""

    fifo: int = FIFO_SAMPLES
    requests: int = USB_REQUESTS
    request_bytes: int = USB_REQUEST_BYTES
    adjustable: bool = False

    def samples_at(self, rate_hz: float) -> int:
        """Return the number of samples on their way at a sample rate, after a request of `adjusted_request_bytes`."""
        return self.samples_in_requests_of(
            self.adjusted_request_bytes(rate_hz) if self.adjustable else self.request_bytes
        )

    def samples_in_requests_of(self, request_bytes: int) -> int:
        """Return the number of samples on their way with USB requests of this size."""
        return self.fifo + math.ceil(self.requests * request_bytes / BYTES_PER_SAMPLE)

    def adjusted_request_bytes(self, rate_hz: float) -> int:
        """Return the size of a request for a total of USB_QUEUE_S of samples; at most the present size."""
        needed_bytes = USB_QUEUE_S * rate_hz * BYTES_PER_SAMPLE / max(self.requests, 1)
        return min(max(math.ceil(needed_bytes / USB_PACKET_BYTES), 1) * USB_PACKET_BYTES, self.request_bytes)


class OutputTask:
    """One NI task on one output, with a buffer for all of its samples.

    Args:
        connection: the card.
        physical_channel: e.g. `Dev1/ao0`.
        description: of the output, for messages.
        rate_hz: samples per second.
        total: number of samples; 0: a task that only reports its queue.
        trigger: terminal whose edge starts it; empty: immediate start.
    """

    def __init__(
        self,
        connection: NiConnection,
        physical_channel: str,
        description: str,
        rate_hz: float,
        total: int,
        trigger: str = "",
    ) -> None:
        self._connection, self._description = connection, description
        self.trigger, self.total = trigger, total
        self.write_s = 0.0
        """Longest duration of a message with samples: over a network longer than other messages."""
        self._task: Any = connection.new_task(OUTPUT)
        try:
            with translate_errors(description):
                channel = self._task.ao_channels.add_ao_voltage_chan(physical_channel, min_val=-10.0, max_val=10.0)
                self._task.timing.cfg_samp_clk_timing(
                    rate_hz, sample_mode=AcquisitionType.FINITE, samps_per_chan=max(total, 2)
                )
                if trigger:
                    self._task.triggers.start_trigger.cfg_dig_edge_start_trig(trigger)
                if total:
                    self._task.out_stream.output_buf_size = total
                self.rate_hz = float(self._task.timing.samp_clk_rate)
            self.queue = self._find_queue(channel)
            self.queue_samples = self._shorten_queue(channel)
            """Number of samples on their way to the converter, as reported by the card."""
        except BaseException:
            self.release()
            raise

    def write(self, render: Callable[[int, int], Array], clock: Clock) -> None:
        """Write all samples, `render(first, count)` at a time, with a pause after each message; time the messages."""
        with translate_errors(self._description):
            for first in range(0, self.total, SAMPLES_PER_WRITE):
                samples = render(first, min(SAMPLES_PER_WRITE, self.total - first))
                begin_s = clock.now()
                self._write(samples)
                self.write_s = max(self.write_s, clock.now() - begin_s)
                clock.sleep(WRITE_PAUSE_S)

    def start(self) -> None:
        with translate_errors(self._description):
            self._task.start()

    def rewrite(self, first: int, wave: Array, progress: "PlaybackProgress | None" = None) -> bool:
        """Replace samples from `first`; return False, without a replacement, if they may be on their way by `progress`.

        The last message is written first: on a slow connection later samples are in place when the first sample changes.

        Raises:
            AcquisitionError: NI's driver delays or refuses the samples, or does not answer.
        """
        with translate_errors(self._description):
            self._task.out_stream.relative_to = WriteRelativeTo.FIRST_SAMPLE
            pieces = range(0, wave.size, SAMPLES_PER_WRITE)
            for k in reversed(pieces):
                self._task.out_stream.offset = first + k
                if (
                    progress is not None
                    and k == pieces[-1]
                    and not progress.reaches(first, WRITE_MESSAGES * len(pieces) - 1, len(pieces))
                ):
                    return False
                self._write(wave[k : k + SAMPLES_PER_WRITE], REWRITE_TIMEOUT_S)
        return True

    def generated(self) -> int:
        """Return the number of converted samples."""
        with translate_errors(self._description):
            return int(self._task.out_stream.total_samp_per_chan_generated)

    def is_done(self) -> bool:
        with translate_errors(self._description):
            return bool(self._task.is_task_done())

    def release(self) -> None:
        """Clear the task; the output stays at the last converted sample."""
        self._connection.close_task(self._task, OUTPUT)

    def _write(self, samples: Array, timeout_s: float = Deadline.CARD_OUTPUT.seconds) -> None:
        writer = AnalogSingleChannelWriter(self._task.out_stream, auto_start=False)
        written = writer.write_many_sample(np.ascontiguousarray(samples), timeout_s)
        if written != samples.size:
            raise InstrumentError(
                f"{self._description} took {written} of {samples.size} samples; restart the program, and NI's driver if it recurs"
            )

    def _find_queue(self, channel: Any) -> OutputQueue:
        """Return the queue reported by the card, or the assumed one."""
        fifo, requests, request_bytes, adjustable = FIFO_SAMPLES, USB_REQUESTS, USB_REQUEST_BYTES, False
        with contextlib.suppress(*_UNSUPPORTED):
            fifo = max(int(self._task.out_stream.output_onbrd_buf_size), fifo)
        with contextlib.suppress(*_UNSUPPORTED):
            if all(device.bus_type in _WITHOUT_USB for device in self._task.devices):
                requests = 0
            else:
                requests, request_bytes = int(channel.ao_usb_xfer_req_count), int(channel.ao_usb_xfer_req_size)
                channel.ao_usb_xfer_req_size = request_bytes
                adjustable = True
        return OutputQueue(fifo, requests, request_bytes, adjustable)

    def _shorten_queue(self, channel: Any) -> int:
        """Request short USB requests; return the largest number of samples then on their way."""
        request_bytes = self.queue.request_bytes
        if self.queue.adjustable:
            with contextlib.suppress(*_UNSUPPORTED):
                channel.ao_usb_xfer_req_size = self.queue.adjusted_request_bytes(self.rate_hz)
            with contextlib.suppress(*_UNSUPPORTED):
                request_bytes = int(channel.ao_usb_xfer_req_size)
        return self.queue.samples_in_requests_of(request_bytes)


class PlaybackProgress:
    """Number of converted samples, and the samples that a message can still reach on a slow connection or after a pause.

    Args:
        task: task, queried now.
        clock: bench time.
        margin_s: allowance for computer and bus.
    """

    def __init__(self, task: OutputTask, clock: Clock, margin_s: float) -> None:
        self._clock, self._margin_s, self._rate_hz = clock, margin_s, task.rate_hz
        self._queried_s = clock.now()
        self.generated = task.generated()
        self.reply_s = clock.now() - self._queried_s
        self._queue, self._write_s = task.queue_samples, task.write_s

    def first_changeable(self, samples: int = 1) -> int:
        """Return the first sample that a rewrite with this number of samples reaches if it begins now."""
        writes = math.ceil(samples / SAMPLES_PER_WRITE)
        messages_s = (2 + WRITE_MESSAGES * writes) * self.reply_s + writes * self._write_s
        return self.generated + self._queue + math.ceil((self._margin_s + messages_s) * self._rate_hz)

    def reaches(self, sample: int, messages: int, writes: int = 0) -> bool:
        """Return whether the last of these messages, sent now, arrives before a sample is on its way to the converter.

        `writes` is the number of messages with samples.
        """
        return self._at_arrival(messages, self._margin_s / 2 + writes * self._write_s) + self._queue <= sample

    def is_released_before(self, sample: int) -> bool:
        """Return whether a task released now has not yet converted a sample."""
        return self._at_arrival(1, self._margin_s) < sample

    def _at_arrival(self, messages: int, margin_s: float) -> int:
        elapsed_s = self._clock.now() - self._queried_s + messages * self.reply_s + margin_s
        return self.generated + math.ceil(elapsed_s * self._rate_hz)


def write_level(connection: NiConnection, physical_channel: str, description: str, level_v: float) -> None:
    """Write one level immediately, without a clock."""
    task = connection.new_task(OUTPUT)
    try:
        with translate_errors(description):
            task.ao_channels.add_ao_voltage_chan(physical_channel, min_val=-10.0, max_val=10.0)
            task.write(level_v, auto_start=True)
    finally:
        connection.close_task(task, OUTPUT)


def find_queue(connection: NiConnection, physical_channel: str, description: str, rate_hz: float) -> OutputQueue | None:
    """Return the queue of an output, by a task that is not started; None if the card does not answer or is in use."""
    try:
        probe = OutputTask(connection, physical_channel, description, rate_hz, 0)
    except BenchError:
        return None
    with contextlib.suppress(BenchError):
        probe.release()
    return probe.queue
