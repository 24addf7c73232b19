"""Simulated digitizer in this process: a read advances the bench clock as far as needed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivers import AcquisitionError, Block, Clock, Closeable, Identity, Scale, ScansLostError
from sim_hardware.nidaq.card import DRIVE_CHANNEL, SENSOR_CHANNEL, Acquisition, Counts, SampleRateError, SimulatedCard
from sim_hardware.plant import FaultState

AHEAD_S = 0.8
"""Longest span computed together: arrays of longer spans exceed the processor's cache."""

AHEAD_SCANS = 20_000
"""Longest span in scans, for high sample rates."""


class ReadAhead:
    """Reads the blocks of an acquisition in order; several are computed together, to reduce the overhead of calls on short blocks.

    Blocks computed ahead are provisional: a change of drive, set-up, laser view or faults discards them.

    Args:
        acquisition: acquisition of the simulated card.
        block_scans: scans of each block.
    """

    def __init__(self, acquisition: Acquisition, block_scans: int) -> None:
        self._acquisition, self._block_scans = acquisition, block_scans
        self._most_blocks = int(min(AHEAD_S * acquisition.rate_hz, AHEAD_SCANS) / block_scans)
        self._computed: Counts = np.empty((len(acquisition.channels), 0), np.int16)
        self._first_scan = 0
        """First scan of `_computed`."""
        self._change_count = -1
        self._unchanged_blocks = 0
        """Number of blocks read since the last change: the next change is equally likely after as many."""

    def read(self, first: int, now_s: float) -> Counts:
        """Return the counts of the block from scan `first`, (channels, block_scans); it must lie before `now_s`."""
        acquisition, count = self._acquisition, self._block_scans
        if self._change_count != acquisition.change_count:
            self._unchanged_blocks, self._change_count = 0, acquisition.change_count
            self._computed = self._computed[:, :0]
        begin = first - self._first_scan
        if not 0 <= begin <= self._computed.shape[1] - count:
            blocks = max(min(self._unchanged_blocks, self._most_blocks), 1)
            self._computed = (
                acquisition.read_ahead(first, blocks * count, now_s)
                if blocks > 1
                else acquisition.read_raw(first, count)
            )
            self._first_scan, begin = first, 0
        acquisition.confirm(now_s)
        self._unchanged_blocks += 1
        return self._computed[:, begin : begin + count].copy()

    def close(self) -> None:
        """Discard the unread blocks computed ahead."""
        self._acquisition.discard_ahead()


class SimulatedDigitizer:
    """Drive, displacement and further inputs from the simulated card.

    Args:
        inputs: numbers of the inputs, in order.
        buffer_s: seconds of samples that the card buffers for a late reader.
    """

    def __init__(
        self,
        card: SimulatedCard,
        clock: Clock,
        faults: FaultState,
        buffer_s: float = 10.0,
        inputs: Sequence[int] = (DRIVE_CHANNEL, SENSOR_CHANNEL),
    ) -> None:
        given = card.parameters
        self.identity = Identity(given.maker, given.product, format(given.serial, "X" if given.maker == "NI" else "d"))
        self.card, self.clock, self.faults = card, clock, faults
        self._buffer_s, self._inputs = buffer_s, tuple(inputs)
        self._stream: SimulatedStream | None = None

    def stream(self, rate_hz: float, block_scans: int) -> "SimulatedStream":
        """Begin a continuous acquisition.

        Raises:
            AcquisitionError: the card is unplugged, in use, or cannot do this rate.
        """
        return self._start(self._inputs, rate_hz, block_scans)

    def scan(self, order: Sequence[int], rate_hz: float, block_scans: int) -> "SimulatedStream":
        """Begin a continuous acquisition of channels in this order (see drivers.interfaces.ScanLister)."""
        return self._start([self._inputs[k] for k in order], rate_hz, block_scans)

    def _start(self, inputs: Sequence[int], rate_hz: float, block_scans: int) -> "SimulatedStream":
        if self.faults.is_active("card-unplugged"):
            raise AcquisitionError(f"{self.identity} does not answer; check its USB cable")
        if self._stream is not None and self._stream.is_open:
            raise AcquisitionError(f"{self.identity} is already acquiring; stop that first")
        if block_scans < 1:
            raise AcquisitionError(f"{self.identity}: a block needs at least one scan, not {block_scans}")
        try:
            acquisition = self.card.start_acquisition(rate_hz, inputs, self.clock.now())
        except SampleRateError as error:
            raise AcquisitionError(f"{self.identity}: {error}; lower the sample rate") from error
        buffer_scans = max(int(self._buffer_s * rate_hz), 2 * block_scans)
        self._stream = SimulatedStream(self, acquisition, block_scans, buffer_scans)
        return self._stream

    def close(self) -> None:
        """Stop a running acquisition."""
        if self._stream is not None:
            self._stream.close()


class SimulatedStream(Closeable):
    """A running acquisition (drivers.interfaces.Stream)."""

    def __init__(
        self, digitizer: SimulatedDigitizer, acquisition: Acquisition, block_scans: int, buffer_scans: int
    ) -> None:
        self.rate_hz = acquisition.rate_hz
        self.scales: tuple[Scale, ...] = tuple(
            replace(digitizer.card.scale, skew_s=slot * acquisition.reported_convert_s)
            for slot in range(len(acquisition.channels))
        )
        self.start_time_s = acquisition.start_time_s
        self.is_open = True
        self._digitizer, self._acquisition = digitizer, acquisition
        self._block_scans, self._buffer_scans = block_scans, buffer_scans
        self._ahead = ReadAhead(acquisition, block_scans)
        self._next_scan = self._first_scan = 0

    def read(self) -> Block:
        """Return the next block; advances the clock to the end of its last scan.

        Raises:
            AcquisitionError: scans were lost, the card is unplugged, or the stream is closed.
        """
        card, clock, faults = self._digitizer.identity, self._digitizer.clock, self._digitizer.faults
        if not self.is_open:
            raise AcquisitionError(f"{card}: the acquisition has been stopped")
        position = self._next_scan - self._first_scan
        late = self._acquisition.available_scans(clock.now()) - position
        if faults.is_active("card-overrun") or late > self._buffer_scans:
            raise ScansLostError(
                f"{card} lost samples: they were read too late and its buffer of {self._buffer_scans} scans was overwritten; "
                "lower the sample rate or close other programs"
            )
        clock.sleep(self._acquisition.available_at(position + self._block_scans) - clock.now())
        if faults.is_active("card-unplugged"):
            raise AcquisitionError(f"{card} does not answer any more; check its USB cable")
        block = Block(self._next_scan, self._ahead.read(position, clock.now()))
        self._next_scan = block.stop
        return block

    def skip(self, seconds: float) -> float:
        """Let whole blocks pass unread (see drivers.interfaces.SkippingStream)."""
        scans = max(int(seconds * self.rate_hz / self._block_scans), 0) * self._block_scans
        self._digitizer.clock.sleep(scans / self.rate_hz)
        self._next_scan += scans
        return scans / self.rate_hz

    def restart(self) -> None:
        """Acquire again after scans were lost (see drivers.interfaces.RestartableStream)."""
        now = self._digitizer.clock.now()
        self._acquisition = self._digitizer.card.start_acquisition(self.rate_hz, self._acquisition.channels, now)
        self._ahead.close()
        self._ahead = ReadAhead(self._acquisition, self._block_scans)
        self._first_scan = self._next_scan = max(round((now - self.start_time_s) * self.rate_hz), self._next_scan)

    def close(self) -> None:
        """Stop the card."""
        self.is_open = False
        self._ahead.close()
