"""What may go wrong with a run, told before it begins: the rehearsal with the model's prediction, beside the window. No Qt."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from app.identification.active_model import ActiveModel
from app.live.latest_only import LatestOnlyWorker
from drivers.bench.bench import Bench
from drivers.errors import BenchError
from model.parameter_spec import ParameterError
from protocols.base.protocol import Protocol
from protocols.rehearsal import rehearse


@dataclass(frozen=True, slots=True, eq=False)
class PreflightRequest:
    """What somebody is about to run."""

    protocol: Protocol
    bench: Bench
    active_model: ActiveModel
    folder: Path

    def same_as(self, other: "PreflightRequest | None") -> bool:
        """Whether it is the same form on the same bench."""
        return (
            other is not None
            and all(
                mine is theirs
                for mine, theirs in (
                    (self.protocol, other.protocol),
                    (self.bench, other.bench),
                    (self.active_model, other.active_model),
                )
            )
            and self.folder == other.folder
        )


class PreflightCheck:
    """Rehearses what is intended, the newest only."""

    def __init__(self) -> None:
        self._worker: LatestOnlyWorker[PreflightRequest, tuple[str, ...]] | None = None
        self._requested: PreflightRequest | None = None
        self._result: tuple[PreflightRequest, tuple[str, ...]] | None = None

    def submit(self, request: PreflightRequest) -> None:
        """Want to know of a run; returns at once."""
        if request.same_as(self._requested):
            return
        self._requested = request
        if self._worker is None:
            self._worker = LatestOnlyWorker(_rehearsal_warnings, self._store, "foresight")
        self._worker.submit(request)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about what was asked last; none while it is being rehearsed."""
        return self._result[1] if self._result is not None and self._result[0] is self._requested else ()

    def close(self) -> None:
        """End the thread."""
        if self._worker is not None:
            self._worker.close()

    def _store(self, request: PreflightRequest, result: tuple[str, ...] | Exception) -> None:
        self._result = (request, result if isinstance(result, tuple) else (str(result),))


def _rehearsal_warnings(request: PreflightRequest) -> Iterator[tuple[str, ...]]:
    bench = request.bench
    try:
        told = rehearse(
            request.protocol,
            bench.amplifier,
            sensor=bench.sensor,
            tactor=request.active_model.tactor,
            meters=bench.meters,
            folder=request.folder,
        )
    except (BenchError, ParameterError) as error:
        yield (str(error),)
    else:
        yield tuple(
            f"{words}. Foreseen with {request.active_model.description}" if "model" in words else words
            for words in told.cautions
        )
