"""Search in lists of runs: words, and fields such as `specimen:T2 verdict:good after:2026-10`."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from app.archive.run_summary import RunSummary

TERM = re.compile(r'(?:(?P<field>[^\W\d]+):)?(?:"(?P<quoted>[^"]*)"?|(?P<plain>\S+))?')
WORD = re.compile(r"[^\W_]+")
DATES = ("after", "before")

TEXTS: Mapping[str, "Callable[[RunSummary], str]"] = {
    "protocol": lambda run: run.protocol,
    "verdict": lambda run: run.verdict_text,
    "tag": lambda run: run.tags,
    "note": lambda run: run.note,
    "operator": lambda run: run.operator,
    "checked": lambda run: run.checked_by or "nobody",
    "sensor": lambda run: run.sensor,
    "instrument": lambda run: run.instruments,
    "bench": lambda run: run.bench,
    "file": lambda run: run.path,
    "state": lambda run: str(run.state),
    "result": lambda run: run.estimates_text,
}
"""Text of a run by the name of a field; its words are compared by their beginnings."""

FIELDS = ("specimen", *TEXTS, *DATES)


class Term(NamedTuple):
    """One word, or a value with the name of its field."""

    value: str
    field: str = ""

    def __str__(self) -> str:
        value = f'"{self.value}"' if " " in self.value else self.value
        return f"{self.field}:{value}" if self.field else value


def read_query(text: str) -> list[Term]:
    """Parse a search; a field without a value, as it is being typed, selects nothing.

    Raises:
        ValueError: an unknown field, or no date where one belongs; the message names what there is.
    """
    terms = []
    for found in TERM.finditer(text):
        field, value = (found["field"] or "").casefold(), found["quoted"] or found["plain"] or ""
        if field and field not in FIELDS:
            raise ValueError(f"there is no field '{field}'; there are: {', '.join(FIELDS)}")
        if field in DATES and value:
            read_since(value)
        if value:
            terms.append(Term(value, field))
    return terms


def search_words(*texts: str) -> str:
    """Return the words of texts in small letters, each after one space: a word begins with `x` if ` x` is in it."""
    return "".join(f" {word}" for text in texts for word in WORD.findall(text.casefold()))


def matcher(term: Term) -> "Callable[[RunSummary], bool]":
    """Return whether a run has a term: the name of a specimen is compared whole, or up to a `*`; other texts by their words' beginnings."""
    value = term.value.casefold()
    if term.field == "specimen":
        beginning = value.removesuffix("*")
        if beginning != value:
            return lambda run: run.specimen.casefold().startswith(beginning)
        return lambda run: run.specimen.casefold() == value
    if term.field in DATES:
        at = read_since(value)
        return (lambda run: run.start_time >= at) if term.field == "after" else (lambda run: run.start_time < at)
    words = search_words(value)
    if term.field:
        of = TEXTS[term.field]
        return lambda run: words in search_words(of(run))
    return lambda run: words in run.search_text


def found_first(terms: Sequence[Term], runs: "Iterable[RunSummary]") -> "tuple[list[RunSummary], list[RunSummary]]":
    """Return the runs that have all terms: those with every word in specimen or tags, and the others, each in their order."""
    if not terms:
        return list(runs), []
    found = list(runs)
    for test in map(matcher, terms):
        found = [run for run in found if test(run)]
    words = [search_words(term.value) for term in terms if not term.field]
    first: list[RunSummary] = []
    others: list[RunSummary] = []
    for run in found:
        named = run.search_text.partition("\n")[0]
        (first if all(word in named for word in words) else others).append(run)
    return first, others


def read_since(text: str, now: datetime | None = None) -> str:
    """Parse `2026-11-01`, `2026-11`, `2026`, `today`, `7 d`, `12 h` into ISO time in UTC.

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
            begin = datetime.fromisoformat(text + {4: "-01-01", 7: "-01"}.get(len(text), ""))
        except ValueError:
            raise ValueError(f"'{text}' is not a date") from None
        begin = begin.astimezone() if begin.tzinfo is None else begin
    return begin.astimezone(UTC).isoformat(timespec="milliseconds")
