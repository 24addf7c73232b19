"""Simulated queue between NI's buffer and the converter of an analogue output: USB requests and the card's FIFO.

NI-DAQmx keeps several USB transfer requests under way (properties AO.UsbXferReqSize, AO.UsbXferReqCount; README of
NIDAQ.jl: 4 requests of 32 768 bytes on a USB-6281). Which values a card has, and whether it lets them be changed, is
not documented: both are drawn from the run's seed, so that no driver can rely on them.
"""

from dataclasses import dataclass

import numpy as np

from sim_hardware.nidaq.errors import NiError

FIFO_SAMPLES = 8191
"""Samples in the memory of the card, which cannot be changed any more (X Series manual; USB-6341)."""

BYTES_PER_SAMPLE = 2
PACKET_BYTES = 512
_SIZES, _COUNTS = (8192, 16_384, 32_768, 65_536), (1, 2, 4, 8)
REQUEST_SIZE, REQUEST_COUNT, ONBOARD_BUFFER = 0x2A8F, 0x3001, 0x230B
"""NI's numbers of the properties."""


@dataclass(slots=True)
class SimulatedOutputQueue:
    """Samples that have left the computer's buffer and will be played whatever is written over them.

    Attributes:
        requests, request_bytes: of the USB transfers.
        adjustable: whether the card takes another size of its requests.
        unreported_s: seconds of samples on their way that no property reports.
    """

    requests: int
    request_bytes: int
    adjustable: bool
    unreported_s: float = 0.0

    @classmethod
    def drawn(cls, seed: int) -> "SimulatedOutputQueue":
        """Return a queue as some card may have it."""
        random = np.random.default_rng((seed, 6341))
        return cls(int(random.choice(_COUNTS)), int(random.choice(_SIZES)), bool(random.integers(2)))

    def samples(self, rate_hz: float) -> int:
        """Return how many samples are on their way at a sample rate."""
        return (
            FIFO_SAMPLES + self.requests * self.request_bytes // BYTES_PER_SAMPLE + round(self.unreported_s * rate_hz)
        )

    def set_request_bytes(self, size: int) -> None:
        """Set the size of a request, in whole USB packets. Raises NiError where the card does not permit it."""
        if not self.adjustable:
            raise NiError(-200452, f"Property: {REQUEST_SIZE:#x}")
        self.request_bytes = max(-(-size // PACKET_BYTES), 1) * PACKET_BYTES
