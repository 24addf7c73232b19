"""The card read in this process: drivers.interfaces.Digitizer on the bench's clock, which a read moves as far as it must."""

from dataclasses import replace

from drivers.clock import Clock
from drivers.closing import Closing
from drivers.errors import AcquisitionError
from drivers.interfaces import Block, Identity, Scale
from sim_hardware.nidaq.card import DRIVE, SENSOR, Acquisition, Card, RateRefusedError
from sim_hardware.plant.faults import Faults


class SimDigitizer:
    """Drive and displacement from the simulated card.

    Args:
        buffer_s: seconds of samples the card keeps for a reader who is late.
    """

    def __init__(self, card: Card, clock: Clock, faults: Faults, buffer_s: float = 10.0) -> None:
        self.identity = Identity("NI", card.truth.product, f"{card.truth.serial:X}")
        self._card = card
        self._clock = clock
        self._faults = faults
        self._buffer_s = buffer_s
        self._running: SimStream | None = None

    def stream(self, rate_hz: float, block_scans: int) -> "SimStream":
        """Begin a continuous acquisition of drive and displacement.

        Raises:
            AcquisitionError: the card is unplugged, in use, or cannot do this rate.
        """
        if self._faults.active("card-unplugged"):
            raise AcquisitionError(f"{self.identity} does not answer; check its USB cable")
        if self._running is not None and self._running.open:
            raise AcquisitionError(f"{self.identity} is already acquiring; stop that first")
        if block_scans < 1:
            raise AcquisitionError(f"{self.identity}: a block needs at least one scan, not {block_scans}")
        try:
            acquisition = self._card.start(rate_hz, (DRIVE, SENSOR), self._clock.now())
        except RateRefusedError as error:
            raise AcquisitionError(f"{self.identity}: {error}; lower the sample rate") from error
        self._running = SimStream(
            str(self.identity),
            self._clock,
            self._faults,
            self._card.scale,
            acquisition,
            block_scans,
            max(int(self._buffer_s * rate_hz), 2 * block_scans),
        )
        return self._running

    def close(self) -> None:
        """Stop what runs."""
        if self._running is not None:
            self._running.close()


class SimStream(Closing):
    """A running acquisition (drivers.interfaces.Stream)."""

    def __init__(
        self,
        name: str,
        clock: Clock,
        faults: Faults,
        scale: Scale,
        acquisition: Acquisition,
        block_scans: int,
        buffer_scans: int,
    ) -> None:
        self.rate_hz = acquisition.rate_hz
        self.scales: tuple[Scale, ...] = tuple(
            replace(scale, skew_s=slot * acquisition.convert_s) for slot in range(len(acquisition.channels))
        )
        self.started_s = acquisition.start_s
        self.open = True
        self._name = name
        self._clock = clock
        self._faults = faults
        self._acquisition = acquisition
        self._block = block_scans
        self._buffer = buffer_scans
        self._next = 0

    def read(self) -> Block:
        """The next block; moves the clock to when its last scan has been taken.

        Raises:
            AcquisitionError: scans were lost, the card is unplugged, or the stream is closed.
        """
        card, clock, faults = self._name, self._clock, self._faults
        if not self.open:
            raise AcquisitionError(f"{card}: the acquisition has been stopped")
        late = self._acquisition.ready(clock.now()) - self._next
        if faults.active("card-overrun") or late > self._buffer:
            raise AcquisitionError(
                f"{card} lost samples: they were read too late and its buffer of {self._buffer} scans was overwritten; "
                "lower the sample rate or close other programs"
            )
        clock.sleep(self._acquisition.ready_at(self._next + self._block) - clock.now())
        if faults.active("card-unplugged"):
            raise AcquisitionError(f"{card} does not answer any more; check its USB cable")
        block = Block(self._next, self._acquisition.raw(self._next, self._block))
        self._next = block.stop
        return block

    def close(self) -> None:
        """Stop the card."""
        self.open = False
