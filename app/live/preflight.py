"""Preflight check: rehearses a run in the background with the model's prediction and reports warnings."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from app.identification import ActiveModel
from app.live.latest_only import LatestOnlyWorker
from drivers import Bench, BenchError
from model import ParameterError
from protocols import rehearse
from protocols.base import Protocol


@dataclass(frozen=True, slots=True, eq=False)
class PreflightRequest:
    """A run about to be started."""

    protocol: Protocol
    bench: Bench
    active_model: ActiveModel
    folder: Path

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for the same form on the same bench."""
        return id(self.protocol), id(self.bench), id(self.active_model), self.folder


class PreflightCheck:
    """Rehearses the newest request only."""

    def __init__(self) -> None:
        self._worker = LatestOnlyWorker(_rehearsal_warnings, self._store, "preflight")
        self._requested: PreflightRequest | None = None
        self._result: tuple[PreflightRequest, tuple[str, ...]] | None = None

    def warnings(self, request: PreflightRequest) -> tuple[str, ...]:
        """Return the warnings of a run, none while it is being rehearsed; returns at once."""
        if self._requested is None or request.key != self._requested.key:
            self._requested = request
            self._worker.submit(request)
        return self._result[1] if self._result is not None and self._result[0] is self._requested else ()

    def close(self) -> None:
        """Stop the thread."""
        self._worker.close()

    def _store(self, request: PreflightRequest, result: tuple[str, ...] | Exception) -> None:
        self._result = (request, result if isinstance(result, tuple) else (str(result),))


def _rehearsal_warnings(request: PreflightRequest) -> Iterator[tuple[str, ...]]:
    bench = request.bench
    try:
        rehearsal = rehearse(
            request.protocol,
            bench.amplifier,
            sensor=bench.sensor,
            tactor=request.active_model.tactor,
            meters=bench.meters,
            channels=bench.channels,
            folder=request.folder,
        )
    except (BenchError, ParameterError) as error:
        yield (str(error),)
    else:
        yield tuple(
            f"{caution}. Foreseen with {request.active_model.description}" if "model" in caution else caution
            for caution in rehearsal.cautions
        )
