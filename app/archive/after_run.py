"""Actions after each finished run, on a separate thread: backup of its file, a command of the user, plug-ins.

None of them affects the run: it has ended, its file is closed, and failures are reported.
"""

import os
import shlex
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from app.common import UsageError, truncate_text
from app.config import BenchConfig
from drivers import Deadline
from protocols.base import LogMessage, RunEnded

ENTRY_POINT_GROUP = "tactor_bench.after_run"
"""Entry points of installed packages; each is called with the path of the run file and the event `RunEnded`, and returns a problem or nothing."""

RUN_PLACEHOLDER = "{run}"
MAX_OUTPUT_LENGTH = 300


class AfterRun:
    """Observer of a session's events that acts after each run with a file.

    Args:
        report: called with a log message for each action that failed; from another thread.
        config: the bench file, whose table [backup] names the folder into which run files are copied.
        command: program with arguments, started without a shell; `{run}` is replaced by the path of the run file, which
            otherwise is the last argument. The environment has `TACTOR_BENCH_RUN` and `TACTOR_BENCH_OUTCOME`.

    Raises:
        UsageError: the command cannot be split into words.
    """

    def __init__(self, report: Callable[[LogMessage], object], config: BenchConfig, command: str = "") -> None:
        self._report, self._command = report, split_command(command)
        self._backup = Path(config.backup.folder) if config.backup.folder else None
        self._executor: ThreadPoolExecutor | None = None

    def observe(self, event: Any) -> None:
        """Start the actions if this is the end of a run."""
        if isinstance(event, RunEnded) and event.path and Path(event.path).is_file():
            path = Path(event.path)
            if next(self._actions(path, event), None) is None:
                return  # without a thread: memory may be short
            if self._executor is None:
                self._executor = ThreadPoolExecutor(1, "after run")
            self._executor.submit(self._act, path, event)

    def close(self) -> None:
        """Wait for the actions of the last run."""
        if self._executor is not None:
            self._executor.shutdown()

    def _act(self, path: Path, ended: RunEnded) -> None:
        for name, action in self._actions(path, ended):
            try:
                problem = action()
            except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
                problem = f"{type(error).__name__}: {error}"
            if problem:
                self._report(LogMessage(f"After the run {path.name}: {name}: {problem}"))

    def _actions(self, path: Path, ended: RunEnded) -> Iterator[tuple[str, Callable[[], str]]]:
        if self._backup is not None:
            yield "backup", partial(_back_up, path, self._backup)
        if self._command:
            yield self._command[0], partial(_run_command, self._command, path, ended)
        for point in entry_points(group=ENTRY_POINT_GROUP):
            yield point.name, partial(_call_plug_in, point, path, ended)


def split_command(command: str) -> tuple[str, ...]:
    """Return the words of a command.

    Raises:
        UsageError: a quotation mark has no partner.
    """
    try:
        return tuple(shlex.split(command, posix=os.name == "posix"))
    except ValueError as error:
        raise UsageError(
            f"--after-run {command}: {error}; put the program and its arguments in one pair of quotes"
        ) from None


def _back_up(path: Path, target: Path) -> str:
    from app.archive.backup import back_up  # reads HDF5, which is slow to import: not before the first run has ended

    try:
        return "; ".join(back_up(path.parent, target, [path]).problems)
    except UsageError as error:
        return str(error)


def _call_plug_in(point: EntryPoint, path: Path, ended: RunEnded) -> str:
    return str(point.load()(path, ended) or "")


def _run_command(command: tuple[str, ...], path: Path, ended: RunEnded) -> str:
    """Run the command; return the failure as text."""
    arguments = [word.replace(RUN_PLACEHOLDER, str(path)) for word in command]
    if not any(RUN_PLACEHOLDER in word for word in command):
        arguments.append(str(path))
    environment = {"TACTOR_BENCH_RUN": str(path), "TACTOR_BENCH_OUTCOME": str(ended.verdict.outcome)}
    try:
        done = subprocess.run(  # noqa: S603 - the command of the user
            arguments,
            env={**os.environ, **environment},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=Deadline.AFTER_RUN.seconds,
            check=False,
        )
    except OSError as error:
        return f"it cannot be started: {error.strerror or error}"
    except subprocess.TimeoutExpired:
        return f"it was ended after {Deadline.AFTER_RUN.seconds:.0f} s"
    if done.returncode == 0:
        return ""
    output = " ".join((done.stderr or done.stdout).split())
    return f"exit code {done.returncode}. {truncate_text(output, MAX_OUTPUT_LENGTH)}".rstrip(". ")
