"""Runs of a folder, by the catalogue of the Runs page and `tactor-bench runs`."""

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TypeVar

from app.archive import Catalogue, RunFilter, RunSummary, read_since
from tactor_bench._run import Fact, MeasuredRun

T = TypeVar("T")


class _Fact(Fact[RunSummary, T]):
    source = "summary"


@dataclass(frozen=True, repr=False)
class CatalogueEntry:
    """One run of a folder, without opening its file.

    Attributes:
        path: the file.
        status: as `MeasuredRun.status`; in addition `newer version` and `damaged`, with a `reason`.
        start_time: local time, None for a file without one.
        points: number of points.
        verdict: outcome of the verdict, for example `good`.
        verdict_reasons: reasons, with remedies.
        duration_s: length of the sampled data.
        estimates_text: identified quantities as text.
        summary: row of the catalogue, source of all attributes except `path`.
    """

    path: Path
    summary: RunSummary

    protocol = _Fact(lambda row: row.protocol)
    specimen = _Fact(lambda row: row.specimen)
    status = _Fact(lambda row: str(row.state))
    reason = _Fact(lambda row: row.record.reason)
    start_time = _Fact(lambda row: row.started_at)
    simulated = _Fact(lambda row: bool(row.simulated))
    points = _Fact(lambda row: row.points)
    duration_s = _Fact(lambda row: row.seconds)
    estimates_text = _Fact(lambda row: row.estimates_text)
    verdict = _Fact(lambda row: row.verdict)
    verdict_reasons = _Fact(lambda row: row.verdict_reasons)
    tags = _Fact(lambda row: tuple(tag for tag in row.tags.split(", ") if tag))
    note = _Fact(lambda row: row.note)

    def __repr__(self) -> str:
        names = ("path", *(name for name, value in vars(type(self)).items() if isinstance(value, _Fact)))
        return f"CatalogueEntry({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    def open(self) -> MeasuredRun:
        """Open the run.

        Raises:
            RunReadError: it is damaged or missing.
        """
        return MeasuredRun(self.path)


def runs(
    folder: str | Path = "runs",
    *,
    specimen: str = "",
    protocol: str = "",
    status: str = "",
    verdict: str = "",
    since: str | datetime | timedelta = "",
    search: str = "",
) -> list[CatalogueEntry]:
    """List the runs in a folder and below, newest first; an empty argument is no filter.

    Args:
        folder: folder of the run files.
        specimen: only runs of this specimen.
        protocol: only runs of this protocol, for example `sine-dwell`.
        status: only runs of this status, for example `completed`.
        verdict: only runs of this verdict, for example `good`, `no result` or `not judged`.
        since: only runs since a day (`2026-11-21`), a month (`2026-11`), `today`, or within a time (`12h`, `7d`); or a datetime,
            or a timedelta back from now.
        search: words that must all begin a word of specimen, tags, reasons, results or notes, and fields: `tag:"second try" sensor:LK`;
            runs with the words in specimen or tags come first.

    Raises:
        FileNotFoundError: the folder does not exist.
        ValueError: `since` is not a time, or `search` has an unknown field or a wrong date.

    Example:
        >>> [entry.path.name for entry in runs("runs", specimen="T7", since="7d")]  # doctest: +SKIP
        ['20261121T091502Z_T7_sine-dwell.h5']
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}; name the one your runs are in")
    if isinstance(since, timedelta):
        since = datetime.now().astimezone() - since
    begun = read_since(since.isoformat() if isinstance(since, datetime) else since) if since else ""
    catalogue = Catalogue(folder)
    catalogue.scan()
    entries = RunFilter(search, specimen, protocol, status, begun, verdict).apply(catalogue.entries())
    return [CatalogueEntry(folder / row.path, row) for row in entries]
