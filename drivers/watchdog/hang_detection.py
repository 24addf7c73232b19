"""Activity of another process: duration of its silence, and the part in which it could have run (busy computer)."""

import contextlib
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

SAMPLE_PERIOD_S = 0.05
OWN_PAUSE_S = 0.25
"""Longest valid interval between two samples: a longer one is a pause of the observing process."""

BUSY_PERCENT = 90.0
"""Use of the processors, percent, above which a process may have to wait for one."""

BUSY_EXTRA_S = 1.0
"""Longest additional silence on a busy computer, after which even a process without processor time counts as hung."""

STARVED_EXTRA_S = 2.5
"""Longest additional silence of a process whose threads are observed waiting for a processor (Linux)."""

NOT_RUNNING = (psutil.STATUS_STOPPED, psutil.STATUS_TRACING_STOP, psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)


@dataclass(frozen=True, slots=True)
class Silence:
    """Seconds since the last heartbeat of a process, without pauses of the observer: total, and the part in which it could run.

    `waited_s` is the part in which one of its threads was observed waiting for a processor.
    """

    elapsed_s: float
    available_s: float
    waited_s: float = 0.0

    def exceeds(self, allowed_s: float) -> bool:
        """Whether the process counts as dead with an allowance of `allowed_s`."""
        return (
            self.available_s > allowed_s
            or self.elapsed_s - self.waited_s > allowed_s + BUSY_EXTRA_S
            or self.elapsed_s > allowed_s + STARVED_EXTRA_S
        )


class ProcessActivity:
    """Observes a process: on a busy computer only its processor time counts as time in which it could run.

    A stopped process, or one that waits despite a free processor, could have run all the time.
    """

    def __init__(self, pid: int) -> None:
        self._process: psutil.Process | None = None
        with contextlib.suppress(psutil.Error):
            self._process = psutil.Process(pid)
        self._elapsed_s = self._available_s = self._processor_s = self._waited_s = 0.0
        self._tasks = Path(f"/proc/{pid}/task")
        self._queued_s: dict[str, float] = {}
        """Total waiting time of each thread for a processor."""
        self._sampled_s = time.monotonic()
        self._fraction(1.0)

    def mark(self) -> Silence:
        """Return the reading of the last `update`, for `since`."""
        return Silence(self._elapsed_s, self._available_s, self._waited_s)

    def since(self, mark: Silence) -> Silence:
        """Return the time since `mark`, as of the last `update`."""
        return Silence(
            self._elapsed_s - mark.elapsed_s, self._available_s - mark.available_s, self._waited_s - mark.waited_s
        )

    def skip_pause(self) -> None:
        """Count the time since the last `update` neither as silence nor as life: nobody observed."""
        self._sampled_s = time.monotonic()

    def update(self) -> None:
        """Take a sample if one is due; call it at least every OWN_PAUSE_S, from one thread."""
        now = time.monotonic()
        passed_s = now - self._sampled_s
        if passed_s < SAMPLE_PERIOD_S:
            return
        self._sampled_s = now
        counted_s = min(passed_s, OWN_PAUSE_S)
        self._elapsed_s += counted_s
        self._available_s += counted_s * self._fraction(passed_s)
        self._waited_s += min(self._longest_wait_s(), counted_s)

    def _longest_wait_s(self) -> float:
        """Return the longest waiting time of a thread for a processor since the last call; 0 if unknown."""
        before, self._queued_s = self._queued_s, {}
        with contextlib.suppress(OSError, ValueError, IndexError):
            for task in self._tasks.iterdir():
                self._queued_s[task.name] = 1e-9 * float((task / "schedstat").read_text().split()[1])
        return max((now_s - before.get(name, now_s) for name, now_s in self._queued_s.items()), default=0.0)

    def _fraction(self, passed_s: float) -> float:
        """Return the fraction of the last `passed_s` in which the process could run."""
        busy = psutil.cpu_percent(None) >= BUSY_PERCENT
        if self._process is None:
            return 1.0
        try:
            status, times = self._process.status(), self._process.cpu_times()
        except psutil.Error:
            return 1.0
        used_s, self._processor_s = times.user + times.system - self._processor_s, times.user + times.system
        return min(used_s / passed_s, 1.0) if busy and status not in NOT_RUNNING else 1.0


def raise_own_priority() -> None:
    """Raise the priority of this process on a busy computer, if the operating system permits it."""
    with contextlib.suppress(psutil.Error, OSError):
        psutil.Process().nice(getattr(psutil, "HIGH_PRIORITY_CLASS", -10))
