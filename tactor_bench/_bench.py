"""Connection of a bench, and runs of protocols on it that always end at rest."""

import os
import signal
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from app.archive import AfterRun
from app.common import ExitCode, UsageError
from app.config import BenchConfig
from app.identification import reference_model
from app.services import refuse_without_operator
from app.session import (
    UNATTENDED_BLOCK_S,
    BenchFailed,
    BenchOpened,
    RunRejected,
    Session,
    SessionEvent,
    build_protocol,
    choose_bench,
    load_protocol_class,
)
from app.session import connect as open_instruments
from drivers import BenchError, Closeable, UnsafeError, threads_left_behind
from protocols.base import Protocol, RestMeasured, RunStatus
from protocols.runner import RunRequest
from tactor_bench._frontend import front_end
from tactor_bench._run import MeasuredRun, open_run

__all__ = ["BenchError", "BenchSession", "RunFailedError", "UnsafeError", "connect"]


class RunFailedError(BenchError):
    """A run failed or was stopped, and is at rest; the message gives the reason.

    Attributes:
        path: its run file with the data measured before, None if it could not be created.
    """

    def __init__(self, reason: str, path: Path | None) -> None:
        super().__init__(reason)
        self.path = path


class BenchSession(Closeable):
    """A connected bench. Every run begins and ends at measured rest; closing it releases the instruments.

    Attributes:
        name: name in the bench file.
        simulated: whether it is the simulated bench.
        identities: identities of the instruments by role, for example `generator`.
        folder: folder of run files.
        specimen: default name of the specimen.
    """

    def __init__(
        self,
        config: BenchConfig,
        speed: float | None,
        folder: Path,
        specimen: str,
        *,
        progress: bool,
        without_commissioning: str = "",
        after_run: str = "",
    ) -> None:
        self.folder, self.specimen, self._config = folder, specimen, config
        self.name, self.simulated, self.identities = config.name, config.simulated, dict[str, str]()
        self._failure = ""
        self._connected = threading.Event()
        self._running = threading.Lock()
        self._front_end = front_end(progress=progress)
        self._after_run = AfterRun(self._front_end.observe, config, after_run)
        self._session = Session(
            lambda: open_instruments(
                config, speed, UNATTENDED_BLOCK_S, without_commissioning=without_commissioning, notice=after_run
            ),
            [self._observe, self._front_end.observe, self._after_run.observe],
            self._front_end.operator,
            folder,
        )
        self._session.start()
        _close_at_exit(self)
        try:
            self._front_end.wait(self._connected)
            if self._failure:
                raise BenchError(self._failure)
        except BaseException:
            self.close()
            raise

    def __repr__(self) -> str:
        return f"<{self.name}{', SIMULATED' if self.simulated else ''}: {self._session.state}>"

    def run(
        self,
        protocol: str | Path | Protocol,
        *,
        specimen: str = "",
        folder: str | Path = "",
        check: bool = True,
        parameters: Mapping[str, Any] | None = None,
        **more: Any,
    ) -> MeasuredRun:
        """Run a protocol, wait for its end, and open its run file.

        Progress and prompts are shown as by `tactor-bench run`: on the terminal, or under the notebook's cell, where a prompt is
        answered by typing. Ctrl-C, or interrupting the kernel, brings the bench to rest and then raises KeyboardInterrupt; the
        data measured before are in the run file. If the process or the kernel dies, the watchdog brings the bench to rest.

        Args:
            protocol: its name (`tactor-bench protocols` lists them), a file of your own (`./my_protocol.py`), or a protocol with
                its parameters.
            specimen: name of the specimen; default: the bench's.
            folder: folder of the run file; default: the bench's.
            check: whether a run without a result (stopped, failed, did not pass, nothing usable) raises RunFailedError; otherwise
                it is returned with its status and verdict.
            parameters: parameters of the protocol, by name.
            **more: further parameters of the protocol: numbers in SI, or texts with a unit (`peak_to_peak_v="4 V"`).

        Returns:
            The run. `run.verdict` is its verdict: the `outcome` is `good` or `doubtful`, without `check` also
            `no result`, `did not pass`, `stopped` or `failed`; `reasons` and `checks` give the reasons.

        Raises:
            ValueError: an unknown protocol or parameter, or a value out of range; or a real bench without a terminal or notebook
                for the answers to prompts. Nothing has moved.
            RunFailedError: the run gave no result, or its file could not be created; the bench is at rest.
            UnsafeError: rest could not be confirmed. The message gives the manual steps.
            BenchError: the bench has been closed or lost, or another thread's run is in progress.
            KeyboardInterrupt: the run was interrupted, and is at rest.

        Example:
            >>> with connect("sim", speed="max") as bench:  # doctest: +SKIP
            ...     run = bench.run("sine-dwell", frequencies_hz=[100, 150, 160], specimen="T7")
            >>> run.points["peak_to_peak"]  # doctest: +SKIP
            array([0.00076, 0.00116, 0.00112])
        """
        request = _protocol(protocol, {**(parameters or {}), **more})
        if not self.simulated and not self._front_end.operator_reachable:
            try:
                refuse_without_operator(self._config, request)
            except UsageError as refusal:
                raise ValueError(str(refusal)) from None
        if not self._running.acquire(blocking=False):
            raise BenchError(f"{self.name}: another run is in progress; wait for its end")
        try:
            path = self._measure(request, Path(folder or self.folder), specimen or self.specimen)
        finally:
            self._running.release()
        ended = self._session.outcome
        reason = ended.reason if ended else self._failure or f"{self.name} has been closed"
        if ended and ended.status is RunStatus.UNSAFE:
            error = UnsafeError(reason)
            error.add_note(f"The run file is {path}")
            raise error
        if self._front_end.stopped_by is not None:
            self._pass_on(self._front_end.stopped_by)
            kept = f"; the measured data are in {path}" if path else ""
            raise KeyboardInterrupt(f"{reason}{'; the bench is at rest' * self._at_rest}{kept}")
        if ended is None:
            raise BenchError(reason)
        if path is None or (check and not ended.verdict.outcome.has_result):
            completed = ended.status is RunStatus.COMPLETED
            raise RunFailedError(self._front_end.failure or (ended.summary if completed else reason), path)
        return open_run(path)

    def close(self) -> None:
        """Stop a run in progress, wait for rest, and release the instruments. Closing twice is harmless."""
        self._session.close()
        self._after_run.close()
        _OPEN.discard(self)

    def _measure(self, protocol: Protocol, folder: Path, specimen: str) -> Path | None:
        """Run a protocol to its end; return the run file, None if none was created."""
        self._rejected = self._at_rest = False
        session = self._session
        with self._front_end.running(session):
            session.run(RunRequest(protocol, folder, specimen, reference=reference_model(folder, specimen)))
            try:
                if self._front_end.stopped_by is not None:  # before a run could be stopped
                    session.stop()
                self._front_end.wait(session.finished)
            except BaseException:
                session.stop()
                session.finished.wait()
                raise
        return None if self._rejected or session.outcome is None else session.path

    def _pass_on(self, number: int) -> None:
        """Repeat the signal that ends this program, after the bench is at rest and closed."""
        if number != signal.SIGINT:
            self.close()
            signal.raise_signal(number)

    def _observe(self, event: SessionEvent) -> None:
        match event:
            case BenchOpened(_, _, identities):
                self.identities = dict(identities)
                self._connected.set()
            case BenchFailed(message):
                self._failure = message
                self._connected.set()
            case RunRejected():
                self._rejected = True
            case RestMeasured(confirmed):
                self._at_rest = confirmed


def connect(
    bench: str | Path = "sim",
    *,
    folder: str | Path = "runs",
    specimen: str = "unnamed",
    speed: float | str | None = None,
    seed: int | None = None,
    progress: bool = True,
    without_commissioning: str = "",
    after_run: str = "",
) -> BenchSession:
    """Connect a bench; use it with `with`, or close it.

    Args:
        bench: a bench file, or `sim` for the simulated bench of the program.
        folder: folder of run files.
        specimen: default name of the specimen.
        speed: speed of a simulated bench, 1 to 20 times real, or `max` for a virtual clock.
        seed: seed of the simulated bench's noise.
        progress: whether to show progress; otherwise only prompts and problems are shown.
        without_commissioning: reason for high voltage with a real source without a valid commissioning record (`tactor-bench
            commission`); every run stores it.
        after_run: program to start after each run with its file, e.g. `"upload --to notebook {run}"`.

    Raises:
        ValueError: the bench file is invalid, or speed or seed do not fit it; every fault is listed.
        BenchError: an instrument is absent, or another one answers.

    Example:
        >>> with connect("sim", speed="max", progress=False) as bench:
        ...     bench.name, bench.simulated
        ('simulated bench', True)
    """
    try:
        config, pace = choose_bench(str(bench), speed, seed)
    except UsageError as error:
        raise ValueError(str(error)) from None
    return BenchSession(
        config,
        pace,
        Path(folder),
        specimen,
        progress=progress,
        without_commissioning=without_commissioning.strip(),
        after_run=after_run,
    )


def _protocol(protocol: str | Path | Protocol, values: Mapping[str, Any]) -> Protocol:
    if isinstance(protocol, Protocol):
        if values:
            raise ValueError("this protocol has its parameters; give them there, or give the protocol's name")
        return protocol
    plain = {name: value.tolist() if hasattr(value, "tolist") else value for name, value in values.items()}
    try:
        return build_protocol(load_protocol_class(str(protocol)), plain)
    except UsageError as error:
        raise ValueError(str(error)) from None


_OPEN: set[BenchSession] = set()
_AT_EXIT = threading.Lock()


def _close_all() -> None:
    """Close the benches that are still open when the program ends: their threads would keep the interpreter from ending."""
    threading.main_thread().join()
    for each in tuple(_OPEN):
        each.close()
    if threads_left_behind():
        os._exit(ExitCode.FAILED)


_CLOSER = threading.Thread(target=_close_all, name="closes benches at exit", daemon=True)
"""`atexit` is too late, since Python joins threads before; the end of the main thread is not."""


def _close_at_exit(bench: BenchSession) -> None:
    """Close a bench that is still open when the program ends."""
    with _AT_EXIT:
        if _CLOSER.ident is None:
            _CLOSER.start()
        _OPEN.add(bench)
