"""Selection of runs by words, person, instrument and date, for lists and the command `runs`."""

from collections.abc import Iterable
from dataclasses import dataclass

from app.archive.run_search import found_first, read_query
from app.archive.run_summary import RunSummary


@dataclass(frozen=True, slots=True)
class RunFilter:
    """Selection of runs; empty fields select all. Every word of `search_text` must begin a word of the run; it may contain fields, see `read_query`."""

    search_text: str = ""
    specimen: str = ""
    protocol: str = ""
    state: str = ""
    since: str = ""
    """ISO, UTC."""
    verdict: str = ""
    """A word of the verdict: `good`, `not judged`, `crashed`."""
    operator: str = ""
    checked_by: str = ""
    """Name of the person who checked the run; `nobody` selects runs without a check."""
    instrument: str = ""
    """Part of the identity of an instrument, such as a serial number."""

    def apply(self, entries: Iterable[RunSummary]) -> list[RunSummary]:
        """Return the selected entries in the two groups of `split`, the first group first."""
        first, others = self.split(entries)
        return first + others

    def split(self, entries: Iterable[RunSummary]) -> tuple[list[RunSummary], list[RunSummary]]:
        """Return the selected entries that have the words of the search in specimen or tags, and those that have them elsewhere.

        Raises:
            ValueError: the search has an unknown field or a wrong date.
        """
        if self == RunFilter(self.search_text):
            return found_first(read_query(self.search_text), entries)
        chosen = (
            e
            for e in entries
            if (not self.specimen or e.specimen == self.specimen)
            and (not self.protocol or e.protocol == self.protocol)
            and (not self.state or e.state == self.state)
            and (not self.since or e.start_time >= self.since)
            and (not self.verdict or self.verdict in e.verdict_text.split(", "))
            and (not self.operator or e.operator.casefold() == self.operator.casefold())
            and (not self.checked_by or _is_checked_by(e, self.checked_by.casefold()))
            and (not self.instrument or self.instrument.casefold() in e.instruments.casefold())
        )
        return found_first(read_query(self.search_text), chosen)


def _is_checked_by(summary: RunSummary, name: str) -> bool:
    return not summary.checked_by if name == "nobody" else name in summary.checked_by.casefold().split(", ")
