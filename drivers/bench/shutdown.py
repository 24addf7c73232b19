"""The way out of a live bench: the source goes to rest, the card sees that it did, and what is not known is said."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.bench.amplifier import HvAmplifier
from drivers.bench.rest import Rest, see_rest
from drivers.bench.watchdog_interface import Watchdog
from drivers.clock import Clock
from drivers.interfaces import Block, Scale, Stream

DRIVE, DISPLACEMENT = 0, 1
"""Rows of a block."""

PATIENCE_S = 2.0
LONGEST_WAIT_S = 10.0
"""How long a drive that no longer obeys is given to end by itself, at most."""

SILENCE_S = 8.0
"""How long the way to rest may be silent before the watchdog takes over: wires opened anew, a second stream."""

BY_HAND = (
    "UNSAFE: rest could not be confirmed. The specimen may carry high voltage. By hand, now: switch the high voltage OFF "
    "at the amplifier itself; do not touch the specimen or the generator's cable before the amplifier's display reads 0 V"
)

Sink = Callable[[Block], None]


@dataclass(frozen=True, slots=True)
class WayOut:
    """How a bench comes to rest.

    Args:
        open_stream: opens a second stream of that rate where the first one is broken.
    """

    amplifier: HvAmplifier
    clock: Clock
    watchdog: Watchdog
    open_stream: Callable[[float], Stream]

    def take(self, stream: Stream, sink: Sink, before: Rest | None) -> tuple[Rest, BaseException | None]:
        """Go to rest and measure it; what the sink raised on the way. Never raises, and no sink stops it."""
        with self.watchdog.allow(SILENCE_S):
            trouble = self.command(self.amplifier.to_rest)
            left_s = min(self.amplifier.seconds_left, LONGEST_WAIT_S) if trouble else 0.0
            rest, lost = self._measure(stream, sink, left_s + PATIENCE_S, before)
            if not rest.confirmed and not trouble and not math.isnan(rest.measured_v):
                # It obeyed, or had nothing to do as far as we know; the card sees otherwise. So what we know is wrong.
                trouble = self.command(self.amplifier.force_rest)
                rest, again = self._measure(stream, sink, PATIENCE_S, before)
                lost = lost or again
        if trouble or not rest.confirmed:
            rest = replace(rest, words=f"{rest.words}.{trouble}")
        if not rest.confirmed:
            self.watchdog.note(f"the program could not confirm rest: {rest.words}")
        return rest, lost

    def command(self, first: Callable[[], None]) -> str:
        """Tell the source to rest, over its wire, over a new one, and by the watchdog's; what failed, empty if it obeyed."""
        trouble = ""
        for attempt in (first, self.amplifier.recover):
            try:
                attempt()
            except Exception as error:  # noqa: BLE001 - make-safe: whatever fails, measuring rest comes next
                trouble = f" The source did not obey: {error}."
            else:
                return ""
        told = self.watchdog.rescue(trouble.strip(" ."))
        return f"{trouble} The watchdog says: {told}." if told else trouble

    def watch(self, read: Callable[[], Block], stream: Stream, patience_s: float, before: Rest | None = None) -> Rest:
        """What the card sees of the drive (see drivers.bench.rest)."""

        def next_volts() -> tuple[int, NDArray[np.float64]]:
            block = read()
            self.watchdog.beat()
            return block.start, drive_volts(block, stream.scales)

        return see_rest(
            next_volts, self.clock, stream.started_s, stream.rate_hz, self.amplifier.map.rest_v, patience_s, before
        )

    def _measure(
        self, stream: Stream, sink: Sink, patience_s: float, before: Rest | None
    ) -> tuple[Rest, BaseException | None]:
        """What the card sees of the drive, and what a sink that failed on the way raised."""
        lost: list[BaseException] = []

        def read() -> Block:
            block = stream.read()
            if not lost:
                try:
                    sink(block)
                except Exception as error:  # noqa: BLE001 - make-safe: a full disk must not keep us from rest
                    lost.append(error)
            return block

        try:
            rest = self.watch(read, stream, patience_s, before)
        except Exception:  # noqa: BLE001 - make-safe: the stream is broken; a fresh one may still see the drive
            stream.__exit__(None, None, None)
            try:
                with self.open_stream(stream.rate_hz) as second:
                    rest = self.watch(second.read, second, patience_s, before)
            except Exception as again:  # noqa: BLE001 - make-safe: nothing left to measure with
                rest = Rest(False, math.nan, f"the card cannot see the drive: {again}")
        return rest, (lost[0] if lost else None)


def drive_volts(block: Block, scales: tuple[Scale, ...]) -> NDArray[np.float64]:
    """Volts at the amplifier's input, one per scan."""
    return scales[DRIVE].volts(block.raw[DRIVE])


def channel_skew_s(scales: Sequence[Scale]) -> float:
    """How much later than the drive the displacement of the same scan was converted: it makes the sensor seem quicker."""
    return scales[DISPLACEMENT].skew_s - scales[DRIVE].skew_s
