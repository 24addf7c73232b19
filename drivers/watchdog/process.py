"""Watchdog process: brings the source to rest when the program's heartbeats stop while live.

`python -m drivers.watchdog.process` reads its configuration as the first line of standard input, then one command a line, and
ends with that pipe. Its actions are logged in the folder of the runs. It never judges the safety of the specimen, which only the
program's card can measure: it passes on the reports of the source, and gives the manual steps if the source does not answer.
"""

import contextlib
import importlib
import json
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from drivers.bench import HvAmplifier
from drivers.clock import SharedTime, WallClock
from drivers.drive_shapes import LevelPulse
from drivers.errors import BenchError, InstrumentError
from drivers.interfaces import Source
from drivers.transport import lock_as_watchdog
from drivers.watchdog.config import WatchdogConfig
from drivers.watchdog.hang_detection import ProcessActivity, raise_own_priority
from drivers.watchdog.log import append_line
from drivers.watchdog.origin import describe_copy

POLL_PERIOD_S, REST_PERIOD_S = 0.02, 1.0
"""Interval between two looks at the program while live, and at rest, where there is nothing to watch but the pipe."""

TICK_PERIOD_S = 0.25
RETRY_INTERVAL_S = 0.25
WARNING_AFTER_S = 3.0
"""Duration after which a way to rest is reported while it lasts: a silent source may keep its driver waiting."""

REQUESTED_REST_TIMEOUT_S = 2.0
"""Duration of retries after a request of the program, which waits and measures afterwards."""

MIN_RAMP_V_PER_S = 10.0
"""Smallest slope of its ramp to rest: 2.5 V in a quarter of a second, in equal steps. A sine of 5 V peak to peak is steeper above 1 Hz.
"""

SWITCH_OFF_INSTRUCTION = "Switch the high voltage OFF at the amplifier itself before anybody touches the specimen"


class WatchdogLoop:
    """Monitors one program and brings one source to rest."""

    def __init__(self, config: WatchdogConfig) -> None:
        self._config = config
        shared = SharedTime(Path(config.time_file), config.speed) if config.time_file else None
        self._clock = WallClock(config.speed, shared)
        self._source: Source | None = None
        self._amplifier: HvAmplifier | None = None
        self._log_folder: Path | None = None
        self._live = self._took_over = False
        self._level: tuple[LevelPulse, float] | None = None
        """A level of the program with an end that may be hastened, and the bench time of its natural end."""
        self._last_tick_s = time.monotonic()
        self._program = ProcessActivity(os.getppid())
        self._last_heartbeat = self._last_pulse = self._program.mark()
        self._allowed_silence_s = config.silence_s
        self._program_acts = threading.Event()
        """Set where the program runs again and commands the source itself: an attempt that fails is not repeated then."""
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(target=self._read_lines, daemon=True).start()

    def run(self) -> None:
        """Monitor until the program has ended."""
        try:
            self._locks = lock_as_watchdog(self._config.locks)
            if self._config.own_connection:
                self._open_source()
        except BenchError as error:
            send_line(f"failed {error}")
            return
        send_line(f"ready {describe_copy()}")
        while True:
            try:
                line = self._lines.get(timeout=POLL_PERIOD_S if self._live else REST_PERIOD_S)
            except queue.Empty:
                line = ""
            self._program.update()
            if line is None:
                self._on_program_exit()
                return
            if line == "bye":
                return
            if line:
                self._handle_line(line)
            elif self._live and (silent := self._silence_reason()):
                self._live = False
                if not self._config.own_connection:
                    self._kill_program()
                self._bring_to_rest(silent, self._config.retry_time_s(self._config.patience_s))
            if self._live and time.monotonic() - self._last_tick_s > TICK_PERIOD_S:
                self._last_tick_s = time.monotonic()
                send_line("tick")

    def _on_program_exit(self) -> None:
        if self._live or self._took_over:
            self._bring_to_rest(
                "the program ended without a word while the bench was live",
                self._config.retry_time_s(self._config.patience_s),
            )
        else:
            self._log("the program ended without a word; the source was at rest, nothing was to be done")

    def _handle_line(self, line: str) -> None:
        keyword, _, argument = line.partition(" ")
        match keyword:
            case "beat":
                self._last_heartbeat, self._allowed_silence_s = self._program.mark(), float(argument)
            case "pulse":
                self._last_pulse = self._program.mark()
            case "level" if argument:
                pulse = json.loads(argument)
                end_s = self._clock.now() + pulse.pop("remaining_s")
                self._level = LevelPulse(**pulse), end_s
            case "level":
                self._level = None
            case "live":
                self._live, self._took_over, self._level = True, False, None
                self._last_heartbeat = self._last_pulse = self._program.mark()
                self._allowed_silence_s = self._config.silence_s
            case "mine":
                self._live, self._last_heartbeat, self._last_pulse = True, self._program.mark(), self._program.mark()
            case "rest":
                self._live = self._took_over = False
            case "log":
                self._log_folder = Path(argument)
            case "note":
                self._log(argument, to_stderr=False)
            case "help" if self._config.own_connection:
                self._bring_to_rest(
                    f"the program could not, and requested it: {argument}",
                    self._config.retry_time_s(REQUESTED_REST_TIMEOUT_S),
                    to_stderr=False,
                )
            case "help":
                send_line("could-not the watchdog has no separate connection while the program runs")

    def _silence_reason(self) -> str:
        silence = self._program.since(self._last_pulse)
        if silence.exceeds(self._config.silence_s):
            return f"the program was frozen: it sent nothing for {silence.elapsed_s:.2f} s"
        silence = self._program.since(self._last_heartbeat)
        if silence.exceeds(self._allowed_silence_s):
            return f"the thread that reads the card sent nothing for {silence.elapsed_s:.2f} s"
        return ""

    def _bring_to_rest(self, reason: str, timeout_s: float, to_stderr: bool = True) -> None:
        """Bring the source to rest, retrying for `timeout_s`; report and log the outcome."""
        send_line(f"acting {reason}")
        self._took_over = True
        self._program_acts.clear()
        begin = time.monotonic()
        first = ""
        with self._warning_if_late(reason, to_stderr) as warn:
            while True:
                try:
                    self._try_to_rest(reconnect=bool(first))
                except Exception as error:  # noqa: BLE001 - make-safe: any failure is retried
                    warn(f"the source does not obey: {error}. The watchdog tries again for {timeout_s:g} s")
                    if not first:
                        send_line("failing")
                    first = first or f"{error}"
                    self._close_source()
                    took = time.monotonic() - begin
                    if took <= timeout_s:
                        time.sleep(RETRY_INTERVAL_S)
                    if took > timeout_s or self._program_acts.is_set():
                        outcome = f"The source could NOT be brought to rest within {took:.0f} s: {first}. {SWITCH_OFF_INSTRUCTION}"
                        self._log(f"{reason}. {outcome}", to_stderr)
                        send_line(f"could-not {outcome}")
                        return
                else:
                    break
        rest_v, took = self._config.map.rest_v, time.monotonic() - begin
        outcome = (
            f"The source was brought to rest in {took:.2f} s and reports that it idles at {rest_v:g} V (not measured)"
        )
        self._log(f"{reason}. {outcome}", to_stderr)
        send_line(f"done {outcome}")

    @contextlib.contextmanager
    def _warning_if_late(self, reason: str, enabled: bool) -> Iterator[Callable[[str], None]]:
        """Log once that the specimen may be live: at the call of the result, or after WARNING_AFTER_S in the block.

        Only for a dead or hung program: a running program warns by itself.
        """
        once = threading.Lock()

        def warn(subject: str) -> None:
            if enabled and once.acquire(blocking=False):
                self._log(f"{reason}. The specimen may be live: {subject}. {SWITCH_OFF_INSTRUCTION}")

        timer = threading.Timer(WARNING_AFTER_S, warn, (f"the source is not at rest after {WARNING_AFTER_S:g} s",))
        timer.daemon = True
        timer.start()
        try:
            yield warn
        finally:
            timer.cancel()
            once.acquire(blocking=False)  # a timer firing at this moment is too late

    def _try_to_rest(self, reconnect: bool) -> None:
        if self._amplifier is None or self._source is None:
            self._open_source()
        assert self._amplifier is not None
        assert self._source is not None
        if reconnect:
            self._source.reconnect()
        if self._level is not None:
            with contextlib.suppress(Exception):  # then the natural end is waited for
                self._amplifier.adopt_level(*self._level)
        self._amplifier.force_rest()
        if not self._amplifier.is_source_at_rest():
            raise InstrumentError(f"{self._source.identity} does not report that it is at rest")

    def _open_source(self) -> None:
        config = self._config
        module, _, name = config.source.partition(":")
        driver = getattr(importlib.import_module(module), name)
        source: Source
        if not config.resource:
            source = driver(clock=self._clock, **config.options)
        else:
            from drivers.transport import VisaLink

            link = VisaLink(
                config.resource, config.timeout_s, config.backend, baud=config.baud, lock_key=config.lock_key
            )
            try:
                source = driver(link, self._clock, **config.options)
            except BaseException:
                link.close()
                raise
        swift = replace(config.limits, ramp_v_per_s=max(config.limits.ramp_v_per_s, MIN_RAMP_V_PER_S))
        self._source, self._amplifier = source, HvAmplifier(source, config.map, swift, self._clock)

    def _close_source(self) -> None:
        """Close a connection that is not shared with the program, so that the next attempt reconnects."""
        if not self._config.own_connection and self._source is not None:
            self._source.close()
            self._source = self._amplifier = None

    def _kill_program(self) -> None:
        """Kill the hung program, which holds the only connection, and wait until it has ended."""
        with contextlib.suppress(OSError):
            os.kill(os.getppid(), getattr(signal, "SIGKILL", signal.SIGTERM))
        deadline = time.monotonic() + 1.0
        while time.monotonic() < deadline:
            with contextlib.suppress(queue.Empty):
                if self._lines.get(timeout=POLL_PERIOD_S) is None:
                    break
        self._lines.put("bye")

    def _read_lines(self) -> None:
        for line in sys.stdin:
            if line == "mine\n":
                self._program_acts.set()
            self._lines.put(line.rstrip("\n"))
        self._lines.put(None)

    def _log(self, message: str, to_stderr: bool = True) -> None:
        """Append to the log; also write to the terminal if no running program reports it."""
        with contextlib.suppress(OSError, ValueError):
            if to_stderr:
                sys.stderr.write(f"tactor-bench watchdog: {message}\n")
                sys.stderr.flush()
        if self._log_folder is not None:
            append_line(self._log_folder, message)


def send_line(line: str) -> None:
    """Send a line to the program, if it still reads."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.write(" ".join(line.split()) + "\n")
        sys.stdout.flush()


def main() -> NoReturn:
    """Monitor until standard input closes."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP", "SIGPIPE", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    raise_own_priority()
    line = sys.stdin.readline()
    if line:
        WatchdogLoop(WatchdogConfig.from_line(line)).run()
    os._exit(0)  # a thread still blocks in a read of standard input; there is nothing to clean up


if __name__ == "__main__":
    main()
