"""Supervisor: gives up a session whose thread hangs, warns meanwhile, and answers Stop; in a thread of its own."""

import math
import threading
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

from drivers import MANUAL_SHUTDOWN_INSTRUCTIONS, Bench, CallThread, Deadline, OverdueError, threads_left_behind
from protocols.base import Event, LogMessage, RunEnded, RunStatus, Verdict

if TYPE_CHECKING:
    from protocols.runner import Runner

POLL_S = 0.1
WARNING_S = 0.3
"""Silence of the run's thread, beyond the allowed silence, after which the warning *may be live* is given."""

WAITING = "The stop waits for an answer of an instrument or of the disk; after its deadline the run ends all the same"


CALLS = {
    Deadline.CARD_DRIVER: ("A call of the card's driver", ""),
    Deadline.SOURCE_SETUP: (
        "The generator's driver",
        ". High voltage was not switched on for this run: switch the generator off and on, look at its cable and driver",
    ),
}
"""Calls that cannot be broken off: what hangs, and the remedy."""


@dataclass(frozen=True, slots=True)
class Signs:
    """Signs of life of a session's thread; times in seconds, negative where there is nothing to wait for.

    Attributes:
        at_end: whether the run has left its drive behind and computes or stores its result.
        told_unsafe: whether the run was reported unsafe, and its thread has not done what follows.
        closing_s: since the session was to close, without a run.
        quiet_s: since its last event.
        stopped_s: since a stop was requested.
        call, call_overdue_s: which call it is in that cannot be broken off, and for how long beyond its deadline.
        silent_s: for which it has given no sign of life to the watchdog beyond what is allowed.
        watchdog_acts: whether the watchdog has taken the source over, or nothing watches on a bench in real time.
    """

    connecting: bool = False
    running: bool = False
    watching_card: bool = False
    may_be_live: bool = False
    at_end: bool = False
    told_unsafe: bool = False
    closing_s: float = -1.0
    quiet_s: float = 0.0
    stopped_s: float = -1.0
    call: Deadline = Deadline.CARD_DRIVER
    call_overdue_s: float = -1.0
    silent_s: float = -1.0
    watchdog_acts: bool = False

    def hang(self, early_stop: Deadline) -> str:
        """Return why the session is to be given up; empty if it is not."""
        live = self.running and self.may_be_live
        if self.call_overdue_s > 0:
            hangs, remedy = CALLS[self.call]
            return f"{hangs} has not returned for {self.call_overdue_s + self.call.seconds:.0f} s{remedy}"
        if live and self.silent_s > Deadline.RUN_THREAD.seconds:
            return f"The run hangs: its thread has given no sign of life for {self.silent_s:.0f} s, in an instrument's driver or in this program"
        if self.connecting and self.quiet_s > Deadline.BENCH_OPENING.seconds:
            return f"An instrument's driver hangs: the bench is not open after {self.quiet_s:.0f} s. Nothing was driven"
        if self.told_unsafe and self.quiet_s > Deadline.BENCH_CLOSING.seconds:
            return f"The run was reported unsafe, and its thread has not ended after {self.quiet_s:.0f} s"
        if min(self.closing_s, self.quiet_s) > Deadline.BENCH_CLOSING.seconds:
            return f"An instrument's driver hangs: the bench is not released after {self.closing_s:.0f} s"
        waits_s = min(self.quiet_s, self.stopped_s)
        early = self.connecting or self.watching_card or (self.running and not live and not self.at_end)
        if early and waits_s > early_stop.seconds:
            hangs, remedy = (
                CALLS[self.call] if self.call_overdue_s > -self.call.seconds else ("An instrument's driver", "")
            )
            return f"{hangs} has not returned within {waits_s:.1f} s of the stop, before anything was driven{remedy}"
        if self.running and waits_s > Deadline.STOPPED_RUN.seconds:
            return f"The stopped run hangs in an instrument's driver or in this program: it has not ended after {waits_s:.0f} s"
        return ""


class SupervisedSession(Protocol):
    """A session as the supervisor sees it."""

    runner: "Runner | None"

    def signs(self) -> Signs: ...

    def say(self, event: Event) -> None: ...

    def give_up(self, hangs: str) -> None: ...


class Supervisor(threading.Thread):
    """Looks at a session until it has ended or was given up.

    Args:
        early_stop: deadline of a stop before arming.
    """

    def __init__(self, session: SupervisedSession, early_stop: Deadline) -> None:
        super().__init__(name="session supervisor", daemon=True)
        self._session, self._early_stop = session, early_stop
        self.ended = threading.Event()
        self._warned = self._answered = False
        self._looked_s, self._late_s = math.inf, 0.0

    def run(self) -> None:
        while not self.ended.wait(POLL_S):
            if self.look(self._session.signs()):
                return

    def _running_time(self, signs: Signs) -> Signs:
        """Return the signs with the silence in which this process ran: a computer that stood still explains the rest."""
        now_s = time.monotonic()
        late_s = max(now_s - self._looked_s - POLL_S, 0.0)
        self._looked_s, self._late_s = now_s, self._late_s + late_s if signs.silent_s > 0 else 0.0
        return replace(signs, silent_s=signs.silent_s - self._late_s)

    def look(self, signs: Signs) -> bool:
        """Act on the signs of life; return whether the session was given up."""
        live = signs.running and signs.may_be_live
        warns = live and signs.silent_s > WARNING_S and signs.watchdog_acts
        if warns and not self._warned and (runner := self._session.runner):
            reason = f"the run has given no sign of life for {signs.silent_s:.1f} s more than allowed"
            self._session.say(runner.live_warning(reason))
        self._warned = warns or (self._warned and live)
        if hangs := self._running_time(signs).hang(self._early_stop):
            self._session.give_up(hangs)
            return True
        waits = min(signs.quiet_s, signs.stopped_s) > Deadline.STOP_ANSWER.seconds
        if waits and not self._answered:
            self._session.say(LogMessage(WAITING))
        self._answered = waits
        return False


class Rescue:
    """Ends a run whose thread hangs, in threads that exist before memory may be short."""

    def __init__(self) -> None:
        self._to_rest, self._to_end = CallThread("way to rest"), CallThread("end of a run that hangs")

    def end_run(self, runner: "Runner", bench: Bench, status: RunStatus, hangs: str) -> RunEnded:
        """Bring the source to rest, conclude the run, and return how it ended."""
        left = threads_left_behind()
        reason = f"{hangs}. Threads left behind: {len(left)} ({', '.join(left)})"
        if runner.may_be_live:
            said = self._bring_to_rest(bench, hangs)
            bench.watchdog.log(f"the program could not measure rest: {hangs}. {said}")
            status, reason = RunStatus.UNSAFE, f"{MANUAL_SHUTDOWN_INSTRUCTIONS}. {reason}. {said}"
        try:
            return self._to_end.call(lambda: runner.give_up(status, reason), Deadline.BENCH_CLOSING.seconds)
        except OverdueError:
            return RunEnded(status, reason, str(runner.path), (), Verdict.of_status(status, reason))

    def close(self) -> None:
        """End the threads."""
        self._to_rest.end()
        self._to_end.end()

    def _bring_to_rest(self, bench: Bench, hangs: str) -> str:
        """Ask the watchdog, then command the source over a new connection; return both reports."""
        watchdog = bench.watchdog
        said = watchdog.takeover_outcome or watchdog.request_rest(hangs)
        if said:
            said = f"The watchdog reports: {said}"
        if watchdog.brought_to_rest:
            return said
        try:
            self._to_rest.call(bench.amplifier.reconnect_and_force_rest, Deadline.BENCH_CLOSING.seconds)
        except Exception as error:  # noqa: BLE001 - make-safe: whatever a driver raises is reported
            return f"{said}. The source did not obey: {error}".lstrip(". ")
        return f"{said}. The source obeyed a command over a new connection".lstrip(". ")
