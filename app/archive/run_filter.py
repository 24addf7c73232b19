"""Selection of runs by words, person, instrument and date, for lists and the command `runs`."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from app.archive.run_summary import RunSummary


@dataclass(frozen=True, slots=True)
class RunFilter:
    """Selection of runs; empty fields select all. Every word of `search_text` must occur."""

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
        """Return the selected entries in their order."""
        search_words = self.search_text.casefold().split()
        return [
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
            and all(word in e.search_text for word in search_words)
        ]


def _is_checked_by(summary: RunSummary, name: str) -> bool:
    return not summary.checked_by if name == "nobody" else name in summary.checked_by.casefold().split(", ")


def read_since(text: str, now: datetime | None = None) -> str:
    """Parse `2026-11-01`, `2026-11`, `today`, `7 d`, `12 h` into ISO time in UTC.

    Raises:
        ValueError: the text has none of these forms.
    """
    now = (now or datetime.now()).astimezone()
    text = text.strip().casefold()
    number, unit = text[:-1].strip(), text[-1:]
    if text == "today":
        begin = now.replace(hour=0, minute=0, second=0, microsecond=0)
    elif unit in ("h", "d") and number.isdigit():
        begin = now - timedelta(hours=int(number) * (24 if unit == "d" else 1))
    else:
        try:
            begin = datetime.fromisoformat(f"{text}-01" if len(text) == 7 else text)
        except ValueError:
            raise ValueError(f"'{text}' is not a date") from None
        begin = begin.astimezone() if begin.tzinfo is None else begin
    return begin.astimezone(UTC).isoformat(timespec="milliseconds")
