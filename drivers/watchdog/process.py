"""`python -m drivers.watchdog.process`: hears the program's beats and, when they stop while live, goes to rest by itself.

It reads its charge as the first line of standard input, then one word a line; it lives as long as that pipe. What it
did stands in its log beside the runs. It never judges whether the specimen is safe: it has no eyes, only the program's
card has; so it says what the source says of itself, and what to do by hand where the source does not answer.
"""

import contextlib
import importlib
import os
import queue
import signal
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from drivers.bench.amplifier import HvAmplifier
from drivers.clock import WallClock
from drivers.errors import BenchError, InstrumentError
from drivers.interfaces import Source
from drivers.watchdog.config import Charge
from drivers.watchdog.log import write

TICK_S = 0.02
SAY_S = 0.5
AGAIN_S = 0.25
HELP_S = 2.0
"""How long it tries when the program asked: the program waits, and measures afterwards."""

SWIFT_V_PER_S = 10.0
"""Slope of its way to rest where the bench file's is slower: 2.5 V in a quarter of a second, still in the guard's steps.

A sine of 5 V peak to peak is steeper than that from 1 Hz on.
"""

BY_HAND = "Switch the high voltage OFF at the amplifier itself before anybody touches the specimen"


class Hound:
    """One program, one source, and when each was last heard."""

    def __init__(self, charge: Charge) -> None:
        self._charge = charge
        self._clock = WallClock(charge.speed)
        self._source: Source | None = None
        self._amplifier: HvAmplifier | None = None
        self._folder: Path | None = None
        self._live = self._acted = False
        self._beat_s = self._pulse_s = self._said_s = time.monotonic()
        self._promise_s = charge.silence_s
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(target=self._hear, daemon=True).start()

    def watch(self) -> None:
        """Until the program has ended."""
        try:
            if self._charge.own_connection:
                self._open()
        except BenchError as error:
            say(f"failed {error}")
            return
        say(f"ready {self._source.identity if self._source else 'it opens the wire when it must'}")
        woke = time.monotonic()
        while True:
            try:
                line = self._lines.get(timeout=TICK_S)
            except queue.Empty:
                line = ""
            now = time.monotonic()
            if (late := now - woke - 5 * TICK_S) > 0:
                # Time in which this process did not run itself is no silence of the other.
                self._beat_s, self._pulse_s = self._beat_s + late, self._pulse_s + late
            if line is None:
                self._program_ended()
                return
            if line == "bye":
                return
            if line:
                self._obey(line, now)
            elif self._live and (silent := self._silence(now)):
                self._live = False
                if not self._charge.own_connection:
                    self._end_program()
                self._rest(silent, self._charge.patience_s)
            if self._live and now - self._said_s > SAY_S:
                self._said_s = now
                say("tick")
            woke = time.monotonic()

    def _program_ended(self) -> None:
        if self._live or self._acted:
            self._rest("the program ended without a word while the bench was live", self._charge.patience_s)
        else:
            self._log("the program ended without a word; the source was at rest, nothing was to be done")

    def _obey(self, line: str, now: float) -> None:
        word, _, words = line.partition(" ")
        match word:
            case "beat":
                self._beat_s, self._promise_s = now, float(words)
            case "pulse":
                self._pulse_s = now
            case "live":
                self._live, self._acted = True, False
                self._beat_s, self._pulse_s, self._promise_s = now, now, self._charge.silence_s
            case "rest":
                self._live = self._acted = False
            case "log":
                self._folder = Path(words)
            case "note":
                self._log(words, aloud=False)
            case "help" if self._charge.own_connection:
                self._rest(f"the program could not, and asked for it: {words}", HELP_S, aloud=False)
            case "help":
                say("could-not the watchdog has no connection of its own while the program lives")

    def _silence(self, now: float) -> str:
        if now - self._pulse_s > self._charge.silence_s:
            return f"the program was frozen: it said nothing for {now - self._pulse_s:.2f} s"
        if now - self._beat_s > self._promise_s:
            return f"the thread that reads the card said nothing for {now - self._beat_s:.2f} s"
        return ""

    def _rest(self, why: str, patience_s: float, aloud: bool = True) -> None:
        """Bring the source to rest, trying for `patience_s`; say and log what came of it."""
        say(f"acting {why}")
        self._acted = True
        begin = time.monotonic()
        first = ""
        while True:
            try:
                self._once(again=bool(first))
            except Exception as error:  # noqa: BLE001 - make-safe: whatever fails, it is tried again
                first = first or f"{error}"
                self._drop()
                if time.monotonic() - begin > patience_s:
                    took = time.monotonic() - begin
                    outcome = f"The source could NOT be brought to rest within {took:.0f} s: {first}. {BY_HAND}"
                    self._log(f"{why}. {outcome}", aloud)
                    say(f"could-not {outcome}")
                    return
                time.sleep(AGAIN_S)
            else:
                break
        rest_v, took = self._charge.map.rest_v, time.monotonic() - begin
        outcome = (
            f"The source was brought to rest in {took:.2f} s and says that it idles at {rest_v:g} V "
            "(nobody has measured it)"
        )
        self._log(f"{why}. {outcome}", aloud)
        say(f"done {outcome}")

    def _once(self, again: bool) -> None:
        if self._amplifier is None or self._source is None:
            self._open()
        assert self._amplifier is not None
        assert self._source is not None
        if again:
            self._source.reconnect()
        self._amplifier.force_rest()
        if not self._amplifier.source_at_rest():
            raise InstrumentError(f"{self._source.identity} does not say that it is at rest")

    def _open(self) -> None:
        charge = self._charge
        module, _, name = charge.source.partition(":")
        driver = getattr(importlib.import_module(module), name)
        source: Source
        if not charge.resource:
            source = driver(clock=self._clock, **charge.options)
        else:
            from drivers.transport.visa import VisaLink

            link = VisaLink(charge.resource, charge.timeout_s, baud=charge.baud)
            try:
                source = driver(link, self._clock, **charge.options)
            except BaseException:
                link.close()
                raise
        swift = replace(charge.limits, ramp_v_per_s=max(charge.limits.ramp_v_per_s, SWIFT_V_PER_S))
        self._source, self._amplifier = source, HvAmplifier(source, charge.map, swift, self._clock)

    def _drop(self) -> None:
        """Let go of a wire that belongs to nobody else, so that the next attempt opens it anew."""
        if not self._charge.own_connection and self._source is not None:
            self._source.close()
            self._source = self._amplifier = None

    def _end_program(self) -> None:
        """The wire is the program's as long as it lives, and it hangs: end it, and wait until it has gone."""
        with contextlib.suppress(OSError):
            os.kill(os.getppid(), getattr(signal, "SIGKILL", signal.SIGTERM))
        deadline = time.monotonic() + 1.0
        while time.monotonic() < deadline:
            with contextlib.suppress(queue.Empty):
                if self._lines.get(timeout=TICK_S) is None:
                    break
        self._lines.put("bye")

    def _hear(self) -> None:
        for line in sys.stdin:
            self._lines.put(line.rstrip("\n"))
        self._lines.put(None)

    def _log(self, words: str, aloud: bool = True) -> None:
        """Into the log; also onto the terminal where no living program says it."""
        with contextlib.suppress(OSError, ValueError):
            if aloud:
                sys.stderr.write(f"tactor-bench watchdog: {words}\n")
                sys.stderr.flush()
        if self._folder is not None:
            write(self._folder, words)


def say(words: str) -> None:
    """One line for the program, if it still listens."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.write(" ".join(words.split()) + "\n")
        sys.stdout.flush()


def main() -> NoReturn:
    """Watch until standard input closes."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP", "SIGPIPE", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    charge = sys.stdin.readline()
    if charge:
        Hound(Charge.from_line(charge)).watch()
    os._exit(0)  # a thread still stands in a read of standard input; there is nothing to tear down


if __name__ == "__main__":
    main()
