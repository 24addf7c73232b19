"""Where a study is computed: here, or on a Dask cluster; and how far it is."""

import importlib.util
import logging
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any

from app.exits import UsageError

CONNECT_S = 10
"""How long a cluster's scheduler may take to answer."""


@contextmanager
def workers(address: str | None) -> Iterator[Executor | None]:
    """An executor on the cluster at `address`, on one started here for `local`, or None for no address.

    Raises:
        UsageError: Dask is not installed, or nobody answers at the address.
    """
    if address is None:
        yield None
        return
    if importlib.util.find_spec("distributed") is None:
        raise UsageError(
            "--cluster needs Dask, which is not installed; run \"pip install 'tactor-bench[cluster]'\", or leave --cluster out"
        )
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.ERROR)  # it tells every connection otherwise
    try:
        if address == "local":
            # Nothing of it can be reached from another computer.
            here = "127.0.0.1:0"
            client = Client(processes=False, dashboard_address=here, worker_dashboard_address=here)
        else:
            client = Client(address, timeout=CONNECT_S)
    except (OSError, ValueError, TimeoutError) as error:
        raise UsageError(
            f"no Dask scheduler answers at '{address}' ({error}); start one with 'dask scheduler', "
            "or compute here with --cluster local"
        ) from None
    with client, client.get_executor() as pool:
        yield pool


class Counting(Executor):
    """Passes chunks of parameter sets on, to `pool` or to this thread, and tells how many sets are done."""

    def __init__(self, pool: Executor | None, advance: Callable[[int], None]) -> None:
        self._pool, self._advance = pool, advance

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        if self._pool is not None:
            return self._pool.submit(fn, *args, **kwargs)
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future

    def map(
        self, fn: Callable[..., Any], *iterables: Any, timeout: float | None = None, chunksize: int = 1
    ) -> Iterator[Any]:
        """Results in order; each is an array with one row a parameter set."""
        if self._pool is None:
            results: Iterator[Any] = map(fn, *iterables)
        else:
            results = self._pool.map(fn, *iterables, timeout=timeout, chunksize=chunksize)
        for result in results:
            self._advance(len(result))
            yield result
