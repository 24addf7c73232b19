"""Stream of a LabJack T7: packets of samples that the device sends by itself on a second port."""

import contextlib
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.deadlines import Deadline
from drivers.errors import AcquisitionError, ScansLostError
from drivers.interfaces import Block, Closeable, Scale
from drivers.labjack.modbus import HEADER, HEADER_REST, ModbusConnection
from drivers.labjack.t7_registers import ENABLE, MARK, USER_RAM, T7Registers

MOST_PACKET_SAMPLES = 512
"""Largest packet on Ethernet."""

RECEIVE_BYTES, SIMULATED_RECEIVE_BYTES = 4_194_304, 65_536
"""Receive buffer: 20 s of samples at the highest rate, where the operating system permits it; and for a simulated bench at raised
speed, whose time waits for a late reader."""

CORE_HZ = 40e6
"""Frequency of CORE_TIMER, half of the core's 80 MHz."""

START_UNCERTAINTY_S, START_QUERIES = 0.005, 5
"""Accuracy of the time of the first scan, in real time; otherwise the best of this number of queries of the timer."""

STREAM_FUNCTION, STREAM_TYPE = 76, 16
PACKET = struct.Struct(">BBHHH")
"""After the Modbus header: type, reserved, backlog in bytes, status, and additional information."""

LOST_MARK = 0x7FFF
"""Sample of a dummy scan that marks lost ones: 0xFFFF on the wire."""

RECOVERING, RECOVERED = 2940, 2941
"""States of a packet while the device discards new scans because its buffer was full, and of the first one with new scans."""

LOSSES = {
    2942: "a scan began before the previous one had ended",
    2943: "more than 65535 scans were discarded in its full buffer",
    2945: "its buffer was full",
}
"""States of a packet after which no further ones come."""


@dataclass(frozen=True, slots=True)
class ScanList:
    """Channels of a scan, their scaling, and rate.

    Args:
        numbers: of the inputs, in their order.
        scales: of the inputs.
        grounded: number of inputs at the begin that are not delivered.
        rate_hz: actual scans per second.
    """

    numbers: tuple[int, ...]
    scales: tuple[Scale, ...]
    grounded: int
    rate_hz: float


class T7Stream(Closeable):
    """A running acquisition as a `RestartableStream` (see drivers.interfaces). The registers have its scan list and its rate."""

    def __init__(self, registers: T7Registers, scans: ScanList, block_scans: int, clock: Clock) -> None:
        self._registers, self._scans, self._block_scans, self._clock = registers, scans, block_scans, clock
        self.rate_hz, self.scales = scans.rate_hz, scans.scales[scans.grounded :]
        self._link: ModbusConnection | None = None
        self._next_scan = 0
        self.is_open = True
        self.start_time_s = self._start() + scans.grounded * (self.scales[0].skew_s - scans.scales[0].skew_s)

    def _start(self) -> float:
        """Begin to stream; return the bench time of the first scan, by the device's timer."""
        speed = float(getattr(self._clock, "speed", 1.0))  # speed of a simulated bench; 1 for a real one
        self._link = ModbusConnection(
            self._registers.host,
            self._registers.stream_port,
            self._registers.description,
            Deadline.CARD_BLOCK.seconds + self._block_scans / self.rate_hz,
            SIMULATED_RECEIVE_BYTES if speed > 1 else RECEIVE_BYTES,
        )
        self._samples, self._packets = bytearray(), 0
        self._registers.write_integers(USER_RAM, MARK)
        begin_s = self._clock.now()
        self._registers.write_integers(ENABLE, 1)
        self._clock.sleep(1 / self.rate_hz)  # the first scan comes one interval after the start
        stamp = self._registers.read_integer(4026)
        start_s, shortest_s, limit_s = begin_s, float("inf"), START_UNCERTAINTY_S * speed
        for _ in range(START_QUERIES):
            asked_s = self._clock.now()
            ticks = (self._registers.read_integer(61520) - stamp) & 0xFFFFFFFF
            answered_s = self._clock.now()
            if answered_s - asked_s < shortest_s:
                shortest_s = answered_s - asked_s
                start_s = (asked_s + answered_s) / 2 - ticks / CORE_HZ
            if shortest_s <= limit_s:
                break
        return max(start_s, begin_s)

    def read(self) -> Block:
        wanted = 2 * self._block_scans * len(self._scans.numbers)
        while len(self._samples) < wanted:
            self._samples += self._read_packet()
        words = np.frombuffer(bytes(self._samples[:wanted]), ">u2")
        del self._samples[:wanted]
        raw = (words ^ 0x8000).astype(np.uint16).view(np.int16).reshape(-1, len(self._scans.numbers))
        if (lost := np.flatnonzero((raw == LOST_MARK).all(axis=1))).size:
            self._samples.clear()
            raise ScansLostError(
                f"{self._registers.description} marks scans as lost after scan {self._next_scan + lost[0]}"
            )
        block = Block(self._next_scan, self._delivered(raw))
        self._next_scan = block.stop
        return block

    def _delivered(self, raw: NDArray[np.int16]) -> NDArray[np.int16]:
        return np.ascontiguousarray(raw.T[self._scans.grounded :])

    def _read_packet(self) -> bytes:
        """Return the samples of the next packet as they were sent."""
        where, link = self._registers.description, self._link
        if link is None:
            raise AcquisitionError(f"{where}: the acquisition is closed")
        begin = link.receive(HEADER.size + PACKET.size)
        transaction, _, length, _, function = HEADER.unpack_from(begin)
        kind, _, _, status, information = PACKET.unpack_from(begin, HEADER.size)
        expected, size = self._packets & 0xFFFF, length - HEADER_REST - PACKET.size
        if (function, kind, transaction) != (STREAM_FUNCTION, STREAM_TYPE, expected) or size < 0 or size % 2:
            link.close()
            raise AcquisitionError(
                f"{where} sent packet {transaction} (function {function}) instead of packet {expected} of the stream; check its network "
                "and its cable, and measure again"
            )
        data = link.receive(size)
        self._packets += 1
        if status == RECOVERED:
            raise ScansLostError(
                f"{where} lost {information} scans after scan {self._next_scan}: they were read too late and its buffer was full; lower "
                "the sample rate or check the network"
            )
        if status and status != RECOVERING:
            reason = LOSSES.get(status, f"it ended the stream with state {status}")
            raise ScansLostError(f"{where} lost scans after scan {self._next_scan}: {reason}; lower the sample rate")
        return data

    def restart(self) -> None:
        """Acquire again after scans were lost (see drivers.interfaces.RestartableStream)."""
        self._stop()
        start_s = self._start()
        self._next_scan = max(round((start_s - self.start_time_s) * self.rate_hz), self._next_scan)

    def close(self) -> None:
        """Stop the device. One that does not answer cannot and need not be stopped."""
        self.is_open = False
        with contextlib.suppress(AcquisitionError):
            self._stop()

    def _stop(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            try:
                self._registers.end_stream()
                self._registers.write_integers(USER_RAM, 0)
            finally:
                link.close()


def packet_samples(channels: int, block_scans: int) -> int:
    """Return the size of a packet: whole scans, at most a block."""
    return channels * max(min(MOST_PACKET_SAMPLES // channels, block_scans), 1)
