"""Control of a playing NI output task: rewriting of its drive as a fade-out, and waiting for its samples."""

import math

import numpy as np

from drivers.clock import Clock
from drivers.drive_shapes import Drive
from drivers.errors import InstrumentError
from drivers.nidaq.output_task import OutputTask, PlaybackProgress
from drivers.nidaq.rendering import fade_out, idle_level_after_stop_v

RELEASE_TIMEOUT_S = 2.0
"""Longest wait for a measurement of the output at the level of its task's release."""

RELEASE_ROUND_TRIPS = 90
"""Longest time from a stopped drive to its released task: up to six measurements of the output with 13 messages each."""


class PlaybackControl:
    """Fades out and follows the task of one output.

    Args:
        clock: bench time.
        margin_s: allowance for computer and bus in a rewrite.
        description: name of the output, for messages.
    """

    def __init__(self, clock: Clock, margin_s: float, description: str) -> None:
        self._clock, self._margin_s, self._description = clock, margin_s, description

    def fade_out(self, task: OutputTask, drive: Drive) -> tuple[float, int, int]:
        """Rewrite a running drive so that it fades out.

        Returns the idle level after the fade-out, the sample that reaches it, and the first sample of the drive's remainder.

        Raises:
            AcquisitionError: NI's driver refuses the samples, or the card does not answer.
        """
        rate, margin_s = task.rate_hz, self._margin_s
        while True:
            progress = PlaybackProgress(task, self._clock, margin_s)
            hold = math.ceil((self._margin_s + RELEASE_TIMEOUT_S + RELEASE_ROUND_TRIPS * progress.reply_s) * rate)
            first = progress.first_changeable(hold)
            level_v = idle_level_after_stop_v(drive, rate, first)
            if first >= task.total:
                return level_v, task.total, task.total
            wave = fade_out(drive, rate, first)
            end = first + wave.size
            if task.rewrite(first, np.concatenate((wave, np.full(min(hold, task.total - end), level_v))), progress):
                break
            margin_s = max(2 * margin_s, 0.1)  # this program was delayed
        return level_v, end, end + hold

    def fill(self, task: OutputTask, first: int, level_v: float, played: int) -> None:
        """Rewrite the remainder of a stopped drive with its idle level, until the fade-out has been played.

        Otherwise the remainder would follow the fade if this program died before it releases the task.
        """
        piece = math.ceil(task.rate_hz)
        while first < task.total and task.generated() < played:
            count = min(piece, task.total - first)
            task.rewrite(first, np.full(count, level_v))
            first += count
            self._clock.sleep(0.02)

    def await_sample(self, task: OutputTask, sample: int) -> bool:
        """Wait until a sample has been converted; return False if the task still waits for its trigger.

        Raises:
            InstrumentError: the output does not continue.
        """
        sample = min(sample, task.total)
        began_s, begins = self._clock.now(), task.generated()
        patience_s = (sample - begins) / task.rate_hz + 2 * self._margin_s + 2.0
        while (played := task.generated()) < sample:
            waited_s = self._clock.now() - began_s
            if played == 0 and task.trigger and waited_s > self._margin_s:
                return False
            if waited_s > patience_s:
                raise InstrumentError(f"{self._description} plays no further; check the card's power and its USB cable")
            self._clock.sleep(min(max((sample - played) / task.rate_hz, 1e-4), 0.02))
        return True
