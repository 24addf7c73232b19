"""Computing in several processes: on all cores of this computer, or on a Dask cluster of several computers."""

import asyncio
import importlib.util
import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import get_context
from typing import Any

from app.common import UsageError, print_message

CONNECT_TIMEOUT_S = 10
"""Timeout for the answer of a cluster's scheduler."""

NO_WORKERS_S = 10.0
"""Time without a worker after which a message is shown."""

POLL_S = 1.0
"""Interval between questions to the scheduler for its workers."""

RETRIES = 2
"""How often a task that raised is computed again; a task of a lost worker is computed again in any case."""


class ClusterError(Exception):
    """The processes ended, or cannot run the program; the message gives the remedy."""


@contextmanager
def cluster_executor(address: str | None) -> Iterator[Executor | None]:
    """Yield an executor on the Dask cluster at `address`, on all cores of this computer for `local`, or None for no address.

    A worker that is lost is survived. A message tells when no worker is left. SIGTERM ends the block like Ctrl-C.

    Raises:
        UsageError: Dask is not installed, no scheduler answers at the address, or a worker has another version of the program.
        ClusterError: within the block, the processes or the cluster ended, or a worker cannot load the program.
    """
    try:
        with _terminating_as_interrupt():
            if address is None:
                yield None
            elif address == "local":
                ignore_interrupts = partial(
                    signal.signal, signal.SIGINT, signal.SIG_IGN
                )  # this process ends the others
                with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), ignore_interrupts) as pool:
                    yield pool
            else:
                with _dask_executor(address) as pool:
                    yield pool
    except (BrokenExecutor, CancelledError) as error:
        raise ClusterError(_ended(address)) from error


def _ended(address: str | None) -> str:
    return (
        f"the processes of --cluster {address} ended before everything was computed, and nothing was written; "
        "compute it again, without --cluster if it happens again"
    )


@contextmanager
def _dask_executor(address: str) -> Iterator[Executor]:
    if importlib.util.find_spec("distributed") is None:
        raise UsageError(
            "--cluster needs Dask, which is not installed; run \"pip install 'tactor-bench[cluster]'\", or leave --cluster out"
        )
    from distributed import Client, KilledWorker

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # otherwise it logs every connection
    try:
        client = Client(address, timeout=CONNECT_TIMEOUT_S)
    except (OSError, ValueError, TimeoutError) as error:
        raise UsageError(
            f"no Dask scheduler answers at '{address}' ({error}); start one with 'dask scheduler', "
            "or compute on all cores of this computer with --cluster local"
        ) from None
    ended = threading.Event()
    watch = threading.Thread(target=_tell_missing_workers, args=(client, address, ended), daemon=True)
    try:
        _check_versions(client)
        watch.start()
        # An executor would wait for running tasks at its end; the client drops them.
        yield client.get_executor(retries=RETRIES)
    except KilledWorker as error:
        raise ClusterError(_ended(address)) from error
    except ImportError as error:
        raise ClusterError(f"a worker of --cluster {address} cannot load the program ({error}): {_INSTALL}") from error
    finally:
        ended.set()
        with suppress(OSError, TimeoutError):  # a lost scheduler does not answer
            client.close(timeout=CONNECT_TIMEOUT_S)


_INSTALL = "install the same version of tactor-bench with the extra 'cluster' on every computer"


def _check_versions(client: Any) -> None:
    """Raise UsageError for a worker that has another version of the program: its numbers may differ."""
    from drivers.watchdog import version

    own = version()
    for worker, other in client.run(version).items():
        if other != own:
            raise UsageError(f"the worker {worker} has tactor-bench {other}, this computer {own}: {_INSTALL}")


def _tell_missing_workers(client: Any, address: str, ended: threading.Event) -> None:
    """Tell once of each time in which the scheduler has no worker, until the computation has ended."""
    seen_s, told = time.monotonic(), False
    while not ended.wait(POLL_S):
        workers: Any = True
        with suppress(Exception, asyncio.CancelledError):  # the block itself reports a lost scheduler
            workers = client.scheduler_info()["workers"]
        if workers:
            seen_s, told = time.monotonic(), False
        elif not told and time.monotonic() - seen_s >= NO_WORKERS_S:
            told = True
            print_message(
                f"tactor-bench: no worker is connected to the scheduler at {address}; waiting for one "
                f"('dask worker {address}' on any computer), Ctrl-C ends"
            )


@contextmanager
def _terminating_as_interrupt() -> Iterator[None]:
    """Within the block SIGTERM raises KeyboardInterrupt, so that partial files are removed."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    previous = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


class CountingExecutor(Executor):
    """Maps calls in `pool`, or in this thread, and reports each result before it is yielded."""

    def __init__(self, pool: Executor | None, advance: Callable[[Any], None]) -> None:
        self._map = map if pool is None else pool.map
        self._advance = advance

    def map(self, fn: Callable[..., Any], *iterables: Any, **_: Any) -> Iterator[Any]:
        """Yield the results in order."""
        for result in self._map(fn, *iterables):
            self._advance(result)
            yield result
