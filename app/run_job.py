"""A run that a session was asked for, and what its file says before it begins."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.bench import Bench
from protocols.protocol import Protocol
from protocols.steps import Prompt

if TYPE_CHECKING:
    from protocols.continuation import Earlier
    from protocols.fresh_run import Header


@dataclass(frozen=True, slots=True)
class Job:
    """A run with its protocol, and the run it goes on with."""

    protocol: Protocol
    folder: Path
    specimen: str
    earlier: "Earlier | None" = None
    prepare: tuple[Prompt, ...] = ()


@dataclass(frozen=True, slots=True)
class Again:
    """A run that goes on with another one, which is read when its turn comes."""

    path: Path
    entries: tuple[int, ...]
    folder: Path

    def read(self) -> Job:
        """The job that goes on with that run.

        Raises:
            RunError: there is no such run to go on with.
        """
        from protocols.continuation import earlier

        before = earlier(self.path, self.entries)
        return Job(before.protocol, self.folder, before.specimen, before)


def header(protocol: Protocol, bench: Bench, specimen: str, continues: Path | None = None) -> "Header":
    """What the run file says about a run before it begins."""
    from protocols.fresh_run import Header

    return Header(
        protocol=protocol.name,
        title=protocol.title,
        parameters=protocol.model_dump(mode="json"),
        point_type=protocol.point_type,
        axes=protocol.axes,
        sensor=bench.sensor,
        bench=bench.record,
        simulated=bench.simulated,
        specimen=specimen,
        continues=continues,
    )
