"""Stream of a simulated LabJack T7: its buffer, auto-recovery and packets."""

import struct

import numpy as np
from numpy.typing import NDArray

from drivers import Clock
from sim_hardware.nidaq import Acquisition
from sim_hardware.plant import FaultState

MOST_PACKETS = 64
"""Largest number of packets computed together."""

RECOVERING, RECOVERED, OVERFLOWN = 2940, 2941, 2943
_HEADER = struct.Struct(">HHHBBBBHHH")


class T7StreamSource:
    """Packets of one stream, in the order in which the device sends them.

    Args:
        run: acquisition of the simulated card.
        packet_scans: scans of a packet.
        buffer_scans: size of the device's buffer.
    """

    def __init__(
        self, run: Acquisition, packet_scans: int, buffer_scans: int, clock: Clock, faults: FaultState
    ) -> None:
        self.run, self._packet_scans, self._buffer_scans = run, packet_scans, buffer_scans
        self._clock, self._faults = clock, faults
        self._packets = self._sent = self._taken = 0
        """Packets made; next scan to send; and the scan after the last one in the buffer."""
        self._recovering, self.ended = False, False

    @property
    def read_until_s(self) -> float:
        """Bench time of the last scan of the next packet."""
        return self.run.available_at(self._sent + self._packet_scans)

    def advance(self, blocked: bool) -> None:
        """Take the new scans into the buffer, or discard them while it recovers.

        Args:
            blocked: whether the connection has not taken all earlier packets; otherwise a delay is one of this process, in which a
                device would have sent.
        """
        ready = self.run.available_scans(self._clock.now())
        full = blocked and ready - self._sent > self._buffer_scans
        if not self._recovering:
            self._taken = min(ready, self._sent + self._buffer_scans) if blocked else ready
            self._recovering = full or self._faults.is_active("card-overrun")

    def packets(self) -> bytes:
        """Return the packets that can be sent; empty if there is no whole one."""
        whole = min((self._taken - self._sent) // self._packet_scans, MOST_PACKETS)
        if whole:
            raw = self.run.read_raw(self._sent, whole * self._packet_scans)
            self._sent += whole * self._packet_scans
            status = RECOVERING if self._recovering else 0
            return b"".join(
                self._packet(raw[:, k * self._packet_scans : (k + 1) * self._packet_scans], status, 0)
                for k in range(whole)
            )
        return self._end_recovery() if self._recovering else b""

    def _end_recovery(self) -> bytes:
        """Continue with the present scan: a packet with the number of discarded scans, a dummy scan and new ones."""
        ready = self.run.available_scans(self._clock.now())
        lost = ready - self._sent - self._packet_scans
        if lost < 0:
            return b""
        self._recovering, self.ended = False, lost >= 0xFFFF
        first = ready - (self._packet_scans - 1)
        raw = self.run.read_raw(first, self._packet_scans - 1)
        self._sent = self._taken = ready
        marked = np.concatenate([np.full((raw.shape[0], 1), 0x7FFF, np.int16), raw], axis=1)
        return self._packet(marked, OVERFLOWN if self.ended else RECOVERED, min(lost + 1, 0xFFFF))

    def _packet(self, raw: NDArray[np.int16], status: int, information: int) -> bytes:
        data = (raw.T.astype(np.int32) + 32768).astype(">u2").tobytes()
        backlog = min(2 * raw.shape[0] * (self._taken - self._sent), 0xFFFF)
        header = _HEADER.pack(self._packets & 0xFFFF, 0, 10 + len(data), 1, 76, 16, 0, backlog, status, information)
        self._packets += 1
        return header + data
