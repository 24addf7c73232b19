"""Summary of a run file, the row of the catalogue."""

import json
from datetime import datetime
from enum import StrEnum
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple

from app.common import OUTCOME_SYMBOLS, Severity, outcome_severity
from protocols import BUILT_IN_PROTOCOLS
from protocols.base import Outcome, RunFigure

if TYPE_CHECKING:
    from protocols.runfile import RunRecord


class RunState(StrEnum):
    """State of a run; the first five are stored in the file."""

    COMPLETED = "completed"
    STOPPED = "stopped"
    FAILED = "failed"
    UNSAFE = "unsafe"
    RUNNING = "running"
    CRASHED = "crashed"
    """Status `running`, but the process that wrote it does not exist any more."""
    IMPORTED = "imported"
    """Points come from an imported table."""
    NEWER = "newer version"
    DAMAGED = "damaged"


STATE_SYMBOLS = {
    RunState.RUNNING: ("▶", Severity.WARNING),
    RunState.CRASHED: ("✕", Severity.ERROR),
    RunState.IMPORTED: ("⇥", Severity.INFO),
    RunState.NEWER: ("?", Severity.WARNING),
    RunState.DAMAGED: ("✕", Severity.ERROR),
}
"""Symbols and severities of states that come before the verdict."""


class RunSummary(NamedTuple):
    """Row of the catalogue: record of a run, contents of its sidecar, and the columns by which lists are sorted and filtered.

    A plain tuple, as a list may have ten thousand.
    """

    path: str
    """Relative to the folder, with slashes."""
    state: str
    record_json: str = "{}"
    protocol: str = ""
    specimen: str = ""
    start_time: str = ""
    """ISO, UTC: sorts as text."""
    simulated: int = 0
    points: int = 0
    seconds: float = 0.0
    verdict: str = str(Outcome.NOT_JUDGED)
    """The outcome of the verdict."""
    failed_checks: str = ""
    """Names of the failed checks of a run that did not pass."""
    estimates_text: str = ""
    """Estimates as text."""
    operator: str = ""
    instruments: str = ""
    """Identities with serial numbers, and the state of the sensor's calibration, as text."""
    bench: str = ""
    sensor: str = ""
    figures_json: str = "[]"
    """Figures of a built-in protocol as they were read; use `figures`."""
    tags: str = ""
    note: str = ""
    checked_by: str = ""
    """Second persons who checked it."""
    search_text: str = ""
    """Searched words (see `search_words`): words of specimen and tags on the first line, other words on the second."""
    natural_hz: float = -1.0
    largest_m: float = -1.0
    """Figures by which lists are sorted; -1 for a missing figure."""
    modified_ns: int = 0
    size: int = 0
    notes_ns: int = 0

    @property
    def record(self) -> "RunRecord":
        """The record of the run; for an unreadable file, the facts from its name and the error."""
        from protocols.runfile import decode_record  # not needed for a list of good runs

        return decode_record(self.record_json)

    @property
    def figures(self) -> tuple[RunFigure, ...]:
        """Figures for comparisons with other runs and specimens, see `app.archive.figures`.

        Figures of a laboratory's protocol are made anew: its file may be another one than when the run was indexed, or was not loaded.
        """
        if self.protocol not in BUILT_IN_PROTOCOLS and (record := self.record).title:
            from app.archive.figures import run_figures

            return run_figures(record)
        return tuple(RunFigure(*figure) for figure in json.loads(self.figures_json))

    @property
    def name(self) -> str:
        return PurePosixPath(self.path).name

    @property
    def started_at(self) -> datetime | None:
        """Start time in local time; None if unknown."""
        try:
            return datetime.fromisoformat(self.start_time).astimezone()
        except (ValueError, OverflowError, OSError):  # also years that the local time zone does not reach
            return None

    @property
    def readable(self) -> bool:
        """Whether the file can be opened."""
        return self.state not in (RunState.NEWER, RunState.DAMAGED)

    @property
    def requested_parameters(self) -> dict[str, Any]:
        """The parameters as they were requested, before they were adapted to the source."""
        return {**self.record.parameters, **self.record.requested}

    @property
    def outcome(self) -> Outcome:
        return Outcome(self.verdict)

    @property
    def has_result(self) -> bool:
        """Whether the run gave a result; a run of an earlier version if it was completed without a failed check."""
        if self.outcome is Outcome.NOT_JUDGED:
            return self.state == RunState.COMPLETED and not self.failed_checks
        return self.outcome.has_result

    @property
    def verdict_text(self) -> str:
        """The verdict as a word: `good`; of a run without one also its state: `imported, not judged`, `running`."""
        if self.outcome is not Outcome.NOT_JUDGED or self.state == RunState.COMPLETED:
            return self.verdict
        ended = self.readable and self.state not in (RunState.RUNNING, RunState.CRASHED)
        return f"{self.state}, {self.verdict}" if ended else str(self.state)

    @property
    def symbol(self) -> str:
        """The symbol of the verdict, for readers without colours."""
        return self._symbol_and_severity[0]

    @property
    def severity(self) -> Severity:
        return self._symbol_and_severity[1]

    @property
    def _symbol_and_severity(self) -> tuple[str, Severity]:
        shown = STATE_SYMBOLS.get(RunState(self.state)) if self.outcome is Outcome.NOT_JUDGED else None
        return shown or (OUTCOME_SYMBOLS[self.outcome], outcome_severity(self.outcome))

    @property
    def verdict_reasons(self) -> str:
        """Reasons of the verdict, with remedies."""
        return "; ".join(self.record.verdict.reasons)

    @property
    def explanation(self) -> str:
        """The reasons of the verdict; how the run ended where there are none; and why a later verdict is not used."""
        return "; ".join(filter(None, (self.verdict_reasons or self.record.reason, self.record.caution)))

    @property
    def running(self) -> bool:
        return self.state == RunState.RUNNING

    @property
    def resumable(self) -> bool:
        """Whether the run was interrupted with points that a resumed run keeps."""
        interrupted = (RunState.STOPPED, RunState.FAILED, RunState.UNSAFE, RunState.CRASHED)
        return self.state in interrupted and self.record.entry_count > 0
