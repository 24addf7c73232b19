"""Exercises of a source: drives that are played with high voltage off while the card records the output."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from drivers import DRIVE_CHANNEL, ArmedBench, Block, Clock, Drive, DriveRejectedError, InstrumentError
from model import Array
from protocols.commissioning.messages import SEPARATED_AT_START, SEPARATED_AT_STOP, Message, MessageLog

LEAD_S, TAIL_S = 0.1, 0.15
"""Duration of the recording before the first message of a drive, after its end and after Stop."""

GOLDEN_RATIO = 0.618


@dataclass(frozen=True, slots=True)
class Trace:
    """The recorded output of one exercise.

    Attributes:
        name: name of the exercise.
        drive: started drive.
        rate_hz: scans per second.
        start_s: bench time of the first sample.
        volts: (N,), at the amplifier's input.
        others: (channels, N), volts at the card's other inputs.
        messages: messages to the source, in order; empty for a source without its own connection.
        started_s: bench time of the driver's return from starting the drive.
        stop_s: bench time of the Stop command.
        rest_s: bench time of the driver's report of rest.
        error: error of the driver; empty without error.
        held_until_s: earliest bench time of the end of a held level; infinite if it does not end by itself.
    """

    name: str
    drive: Drive
    rate_hz: float
    start_s: float
    volts: Array
    others: Array
    messages: tuple[Message, ...]
    started_s: float
    stop_s: float
    rest_s: float
    error: str = ""
    held_until_s: float = math.inf

    @classmethod
    def of_blocks(cls, name: str, drive: Drive, bench: ArmedBench, blocks: Sequence[Block], *facts: Any) -> Self:
        """Return the trace of recorded blocks; `facts` are the fields from `messages` on."""
        counts = np.concatenate([block.raw for block in blocks], axis=1)
        volts = [scale.to_volts(raw) for scale, raw in zip(bench.scales, counts, strict=True)]
        start_s = bench.stream.start_time_s + blocks[0].start / bench.rate_hz
        others = np.array(volts[DRIVE_CHANNEL + 1 :])
        return cls(name, drive, bench.rate_hz, start_s, volts[DRIVE_CHANNEL], others, *facts)

    def span(self, begin_s: float, end_s: float) -> Array:
        """Return the samples between two bench times."""
        first, last = (round((t - self.start_s) * self.rate_hz) for t in (begin_s, end_s))
        return self.volts[max(first, 0) : max(last, 0)]


class Exerciser:
    """Plays drives on an exercised bench and records the output.

    Args:
        bench: bench with high voltage off, see `Bench.exercised`.
        clock: bench time.
        messages: log of the messages to the source.
        check_stop: called with every block that is read; raises to abandon.
    """

    def __init__(
        self, bench: ArmedBench, clock: Clock, messages: MessageLog, check_stop: Callable[[], object] = lambda: None
    ) -> None:
        self._bench, self._clock, self._messages, self._check_stop = bench, clock, messages, check_stop
        self._blocks: list[Block] = []
        self._played = 0

    def record(
        self,
        name: str,
        drive: Drive,
        *,
        stop_after_s: float | None = None,
        in_mid_drive: Callable[[], None] | None = None,
        timed_stop: bool = False,
        as_waveform: bool = False,
        instead: Callable[[], object] | None = None,
        observe_s: float = TAIL_S,
    ) -> Trace | None:
        """Play a drive to its end and record it; return None if this source does not play such a drive.

        Args:
            name: of the exercise.
            drive: drive within the drive limits.
            stop_after_s: time of Stop before the end of the drive.
            in_mid_drive: callback in the middle of the drive.
            timed_stop: Stop as in a run; otherwise its messages are separated and confirmed, so that each transient has one cause.
            as_waveform: hold a level as a finite waveform, as in a run, and record it to its own end.
            instead: callback in place of the start of the drive.
            observe_s: duration of the recording after Stop.

        Raises:
            BenchError: the card does not answer.
        """
        self._read_until(self._clock.now())  # discard the samples since the last exercise
        self._blocks.clear()
        self._messages.take()
        self._read_until(self._clock.now() + LEAD_S)
        self._messages.separated = SEPARATED_AT_START
        self._played += 1
        # At varying positions between two scans, so that a drive does not start on a scan by chance.
        self._clock.sleep(GOLDEN_RATIO * self._played % 1.0 / self._bench.rate_hz)
        error = ""
        amplifier = self._bench.amplifier
        # A level held by the offset measures the volts of the offset; as a waveform it would measure the amplitude.
        amplifier.holds_by_offset = not as_waveform
        try:
            if instead is None:
                amplifier.start_drive(drive)
            else:
                instead()
        except DriveRejectedError:
            return None
        except InstrumentError as refused:
            error = str(refused)
        finally:
            self._messages.separated = frozenset()
        started_s = self._clock.now()
        held_until_s = started_s + amplifier.level_remaining_s
        duration_s = drive.duration_s + TAIL_S if stop_after_s is None else stop_after_s
        if as_waveform and stop_after_s is None and math.isfinite(amplifier.remaining_s):
            duration_s = amplifier.remaining_s + TAIL_S
        if in_mid_drive is not None and not error:
            self._read_until(started_s + drive.duration_s / 2)
            in_mid_drive()
        self._read_until(started_s + duration_s)
        stop_s = self._clock.now()
        self._messages.separated = frozenset() if timed_stop else SEPARATED_AT_STOP
        try:
            self._bench.amplifier.force_rest()
        except InstrumentError as refused:
            error = error or str(refused)
        finally:
            self._messages.separated = frozenset()
        rest_s = self._clock.now()
        self._read_until(rest_s + observe_s)
        messages = self._messages.take()
        facts = (messages, started_s, stop_s, rest_s, error, held_until_s)
        return Trace.of_blocks(name, drive, self._bench, self._blocks, *facts)

    def _read_until(self, time_s: float) -> None:
        """Read blocks until all samples before a bench time are available."""
        while (
            not self._blocks or self._bench.stream.start_time_s + self._blocks[-1].stop / self._bench.rate_hz < time_s
        ):
            self._blocks.append(self._bench.read_block())
            self._check_stop()
