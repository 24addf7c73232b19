"""Simulated queue between NI's buffer and the converter of an analogue output: USB requests and the card's FIFO.

NI-DAQmx keeps several USB transfer requests under way (properties AO.UsbXferReqSize, AO.UsbXferReqCount; README of NIDAQ.jl: 4
requests of 32 768 bytes on a USB-6281). The values of a card, and whether they are adjustable, are not documented: both are drawn
from the run's seed, so that no driver can rely on them.
"""

from dataclasses import dataclass

import numpy as np

from sim_hardware.nidaq.errors import NiError

FIFO_SAMPLES = 8191
"""Number of samples in the memory of the card, which cannot be changed (X Series manual; USB-6341)."""

BYTES_PER_SAMPLE = 2
PACKET_BYTES = 512
_SIZES, _COUNTS = (8192, 16_384, 32_768, 65_536), (1, 2, 4, 8)
REQUEST_SIZE, REQUEST_COUNT, ONBOARD_BUFFER = 0x2A8F, 0x3001, 0x230B
"""NI's numbers of the properties."""


@dataclass(slots=True)
class SimulatedOutputQueue:
    """Samples that have left the computer's buffer and cannot be overwritten any more.

    Attributes:
        requests, request_bytes: number and size of the USB transfers.
        adjustable: whether the size of its requests can be set.
        unreported_s: unreported seconds of samples on their way.
    """

    requests: int
    request_bytes: int
    adjustable: bool
    unreported_s: float = 0.0

    @classmethod
    def drawn(cls, seed: int) -> "SimulatedOutputQueue":
        """Return a possible queue of a card."""
        random = np.random.default_rng((seed, 6341))
        return cls(int(random.choice(_COUNTS)), int(random.choice(_SIZES)), bool(random.integers(2)))

    def samples(self, rate_hz: float) -> int:
        """Return the number of samples on their way at a sample rate."""
        return (
            FIFO_SAMPLES + self.requests * self.request_bytes // BYTES_PER_SAMPLE + round(self.unreported_s * rate_hz)
        )

    def set_request_bytes(self, size: int) -> None:
        """Set the size of a request, in whole USB packets. Raises NiError for a card that does not permit it."""
        if not self.adjustable:
            raise NiError(-200452, f"Property: {REQUEST_SIZE:#x}")
        self.request_bytes = max(-(-size // PACKET_BYTES), 1) * PACKET_BYTES
