"""What may go wrong with a run, told before it begins: the rehearsal with the model's prediction, beside the window. No Qt."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from app.identification.active_model import Believed
from app.live.latest_only import Latest
from drivers.bench.bench import Bench
from drivers.errors import BenchError
from model.parameter_spec import ParameterError
from protocols.base.protocol import Protocol
from protocols.rehearsal import rehearse


@dataclass(frozen=True, slots=True, eq=False)
class Intent:
    """What somebody is about to run."""

    protocol: Protocol
    bench: Bench
    believed: Believed
    folder: Path

    def is_as(self, other: "Intent | None") -> bool:
        """Whether it is the same form on the same bench."""
        return (
            other is not None
            and all(
                mine is theirs
                for mine, theirs in (
                    (self.protocol, other.protocol),
                    (self.bench, other.bench),
                    (self.believed, other.believed),
                )
            )
            and self.folder == other.folder
        )


class Foresight:
    """Rehearses what is intended, the newest only."""

    def __init__(self) -> None:
        self._latest: Latest[Intent, tuple[str, ...]] | None = None
        self._asked: Intent | None = None
        self._told: tuple[Intent, tuple[str, ...]] | None = None

    def ask(self, intent: Intent) -> None:
        """Want to know of a run; returns at once."""
        if intent.is_as(self._asked):
            return
        self._asked = intent
        if self._latest is None:
            self._latest = Latest(_cautions, self._keep, "foresight")
        self._latest.ask(intent)

    @property
    def words(self) -> tuple[str, ...]:
        """Sentences about what was asked last; none while it is being rehearsed."""
        return self._told[1] if self._told is not None and self._told[0] is self._asked else ()

    def close(self) -> None:
        """End the thread."""
        if self._latest is not None:
            self._latest.close()

    def _keep(self, intent: Intent, answer: tuple[str, ...] | Exception) -> None:
        self._told = (intent, answer if isinstance(answer, tuple) else (str(answer),))


def _cautions(intent: Intent) -> Iterator[tuple[str, ...]]:
    bench = intent.bench
    try:
        told = rehearse(
            intent.protocol,
            bench.amplifier,
            sensor=bench.sensor,
            tactor=intent.believed.tactor,
            meters=bench.meters,
            folder=intent.folder,
        )
    except (BenchError, ParameterError) as error:
        yield (str(error),)
    else:
        yield tuple(
            f"{words}. Foreseen with {intent.believed.words}" if "model" in words else words for words in told.cautions
        )
