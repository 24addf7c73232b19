"""Run request (protocol, folder, specimen, run to resume) and the controls of a running run."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Self

from protocols.base import Event, Prompt, Protocol, ReferenceModel, RunConditions, SpecimenMounted

if TYPE_CHECKING:
    from protocols.resume import ResumableRun


@dataclass(frozen=True, slots=True)
class RunRequest:
    """A requested run.

    Attributes:
        resume: earlier run whose points are carried over.
        prepare: prompts for the operator before the first entry.
        reference: model of the free specimen for comparison with the result; default: the paper's tactor.
        mountings: the last mounting of each part of the specimen, before `prepare`.
        conditions: operator, and state of the air; None if not stated.
        calibration_warning: expired calibrations of the instruments; every point is then flagged. Empty for valid ones.
        notes: further messages for the log of the run.
        item: campaign item of the run; empty outside a campaign.
    """

    protocol: Protocol
    folder: Path
    specimen: str
    resume: "ResumableRun | None" = None
    prepare: tuple[Prompt, ...] = ()
    item: str = ""
    reference: ReferenceModel | None = None
    mountings: tuple[SpecimenMounted, ...] = ()
    conditions: RunConditions | None = None
    calibration_warning: str = ""
    notes: tuple[str, ...] = ()

    @classmethod
    def resuming(cls, path: Path, folder: Path, repeat_entries: Sequence[int] = ()) -> Self:
        """Return the request that resumes the run `path`, or measures `repeat_entries` of it again. Reads the file.

        Raises:
            RunReadError: `path` is no resumable run.
        """
        from protocols.resume import load_resumable  # h5py is slow to import
        from protocols.runfile import translate_read_errors

        earlier = load_resumable(path, repeat_entries)
        with translate_read_errors(path):
            reference = earlier.record.reference_model
        return cls(earlier.protocol, folder, earlier.record.specimen, earlier, reference=reference)


@dataclass(frozen=True, slots=True)
class RunControl:
    """Controls of a run that other threads use; checked after every block and in every wait.

    Attributes:
        external_events: events of other threads, such as injected faults; stored and published with the run's own.
        offer_stop: opens the page on which a phone can stop this run, and returns its address; raises BenchError. None: there is none.
    """

    cancel: threading.Event = field(default_factory=threading.Event)
    pause: threading.Event = field(default_factory=threading.Event)
    external_events: SimpleQueue[Event] = field(default_factory=SimpleQueue)
    offer_stop: Callable[[], str] | None = None
