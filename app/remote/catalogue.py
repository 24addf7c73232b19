"""Catalogue of a folder of runs over HTTP, read-only: list, search, plot, figures, downloads and reports for colleagues.

Nothing is written into the folder: the index is in the user's cache, exports and reports are made in the temporary directory. A run is found by its
path in the catalogue and never by a path of the request.
"""

import shutil
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping
from functools import lru_cache
from http import HTTPStatus
from io import BytesIO
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO, NamedTuple, TypeVar
from urllib.parse import quote

from app.archive import (
    FORMAT_NAMES,
    LARGEST_FIGURES,
    Catalogue,
    ExportError,
    RunFilter,
    RunSummary,
    compare_runs,
    export_run,
    read_sketch,
    run_result,
)
from app.common import Progress, Severity, UsageError, format_bytes, format_duration
from app.identification import SheetError
from app.plotting import run_figure
from app.remote.web_server import (
    DOCUMENT_POLICY,
    FileHandler,
    PageHandler,
    ServerLimits,
    SessionHandler,
    WebServer,
)
from model import ParameterError, Specimen, format_quantity
from protocols.runfile import Run, RunReadError, translate_read_errors

T = TypeVar("T")

ROWS_PER_PAGE = 50
RESCAN_S = 3.0
"""The folder is listed again for a request after this time."""
SKETCH_POINTS, SKETCH_SIZE = 120, (120, 44)
"""Points of a thumbnail, and its width and height in pixels."""
SIGNS = {Severity.SUCCESS: "rest", Severity.WARNING: "live", Severity.ERROR: "urgent"}
"""Class of the sign in the common style sheet, by the severity of a verdict."""
SENTENCES = (
    RunReadError,
    ExportError,
    SheetError,
    ParameterError,
    UsageError,
    OSError,
    ValueError,
)
"""Errors whose message is an answer: of a damaged file, of a report without a result, of a wrong search."""


WriteReport = Callable[[Path, str, Path, Progress], tuple[Path, Path]]
"""Writes the report of a specimen: folder of the runs, specimen, folder of the report, progress; returns PDF and HTML."""


class _Download(NamedTuple):
    """An open file without a name of its own, its name for the browser, and its length in bytes."""

    file: BinaryIO
    name: str
    length: int


class RunFolder:
    """Read access to a folder of runs, from any thread.

    Args:
        folder: the folder; runs in folders below are included.
        write_report: of a specimen; raises UsageError where there is nothing to report.
    """

    def __init__(self, folder: Path, write_report: WriteReport) -> None:
        self.folder, self._write_report = folder.resolve(), write_report
        self._catalogue, self._lock = Catalogue(self.folder), Lock()
        self._entries: dict[str, RunSummary] = {}
        self._scanned_s = -RESCAN_S
        self._sketch = lru_cache(maxsize=5000)(self._read_sketch)
        self._plot = lru_cache(maxsize=64)(self._draw_plot)

    def entries(self) -> Mapping[str, RunSummary]:
        """Return the runs by their paths, newest first; links that lead out of the folder are left out.

        Raises:
            OSError: the index cannot be read or written.
        """
        with self._lock:
            if time.monotonic() - self._scanned_s >= RESCAN_S:
                if self._catalogue.scan().has_changes or not self._entries:
                    listed = self._catalogue.entries()
                    self._entries = {run.path: run for run in listed if self._is_inside(self.folder / run.path)}
                self._scanned_s = time.monotonic()
            return self._entries

    def _is_inside(self, path: Path) -> bool:
        return path.resolve().is_relative_to(self.folder)

    def sketch(self, run: RunSummary) -> str:
        """Return a thumbnail as the `points` of an SVG polyline; empty if the run has none."""
        return self._sketch(run.path, run.modified_ns) if run.readable else ""

    def _read_sketch(self, path: str, _modified_ns: int) -> str:
        width, height = SKETCH_SIZE
        try:
            x, y = read_sketch(self.folder / path, SKETCH_POINTS)
        except RunReadError:  # the row says it
            return ""
        places = zip(3 + (width - 6) * x, height - 3 - (height - 6) * y, strict=True)
        return " ".join(f"{across:.1f},{down:.1f}" for across, down in places)

    def plot(self, run: RunSummary) -> bytes:
        """Return the picture of a run as SVG.

        Raises:
            RunReadError: the run cannot be read.
        """
        return self._plot(run.path, run.modified_ns, run.size)

    def _draw_plot(self, path: str, _modified_ns: int, _size: int) -> bytes:
        image = BytesIO()
        with Run(self.folder / path) as run, translate_read_errors(run.path):
            run_figure(run, Specimen()).savefig(image, format="svg")
        return image.getvalue()

    def facts(self, run: RunSummary) -> dict[str, Any]:
        """Return what the page of a run shows besides its summary.

        Raises:
            RunReadError: the run cannot be read.
        """
        with Run(self.folder / run.path) as opened, translate_read_errors(opened.path):
            result = run_result(opened)
        rows = [(each.name, each.values[0]) for each in compare_runs([run]) if not each.is_result]
        return {"result": result, "rows": rows}

    def export(self, run: RunSummary, kind: Any, progress: Progress) -> _Download:
        """Return a run in a format, several files as a ZIP file.

        Raises:
            RunReadError, ExportError: as `export_run`.
            OperationCancelled: the client has gone.
        """
        with tempfile.TemporaryDirectory() as scratch, Run(self.folder / run.path) as opened:
            written = export_run(opened, Path(scratch), kind, progress=progress)
            progress.raise_if_cancelled()
            if len(written) == 1:
                return _unnamed(written[0], written[0].name)
            packed = Path(scratch) / "packed.zip"
            with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
                for path in written:
                    archive.write(path, path.name)
            mark = "_SIMULATED" if run.simulated else ""
            return _unnamed(packed, f"{Path(run.path).stem}{mark}_{kind}.zip")

    def run_file(self, run: RunSummary) -> _Download:
        """Return the run file itself.

        Raises:
            ExportError: it is being written.
        """
        if run.running:
            raise ExportError(f"{run.name} is being written: take it when the run has ended, or export its points")
        path = self.folder / run.path
        return _Download(path.open("rb"), path.name, path.stat().st_size)

    def report(self, specimen: str, suffix: str, progress: Progress) -> _Download:
        """Return the two-page report of a specimen, `pdf` or `html`, with limits and laboratory of the folder.

        Raises:
            UsageError, SheetError: there is nothing to report.
        """
        with tempfile.TemporaryDirectory() as scratch:
            pdf, html = self._write_report(self.folder, specimen, Path(scratch), progress)
            path = pdf if suffix == "pdf" else html
            return _unnamed(path, path.name)


def _unnamed(path: Path, name: str) -> _Download:
    """Return a copy of a file that has no name and goes with its last reader."""
    copy = tempfile.TemporaryFile()  # noqa: SIM115 - closed when it was sent
    with path.open("rb") as file:
        shutil.copyfileobj(file, copy)
    length = copy.tell()
    copy.seek(0)
    return _Download(copy, name, length)


class CatalogueServer(WebServer):
    """Serves the catalogue of a folder; every page with data needs the token.

    Args:
        folder: the folder of the runs, which is only read.
        write_report: see `RunFolder`.
        limits: times and numbers of connections.
    """

    def __init__(self, folder: Path, write_report: WriteReport, limits: ServerLimits | None = None) -> None:
        runs = {"runs": RunFolder(folder, write_report)}
        files = [(f"/{name}", FileHandler, {"name": name}) for name in ("page.css", "catalogue.js")]
        routes = [
            ("/", _ListPage, runs),
            ("/run/(.+)", _RunPage, runs),
            ("/plot/(.+)", _Plot, runs),
            (f"/export/({'|'.join(FORMAT_NAMES)})/(.+)", _Export, runs),
            ("/file/(.+)", _RunFile, runs),
            ("/report/(html|pdf)/(.+)", _ReportPage, runs),
            ("/session", SessionHandler, {}),
        ]
        super().__init__([*files, *routes], limits, template_path=str(Path(__file__).parent))


class _DataHandler(PageHandler):
    """Answer with contents of the folder."""

    needs_token = True

    def initialize(self, runs: RunFolder) -> None:
        self._runs = runs

    def refuse(self) -> None:
        """Answer with the page that takes the token from the browser's address."""
        self.set_status(HTTPStatus.UNAUTHORIZED)
        self.set_header("WWW-Authenticate", 'Bearer realm="Tactor Bench"')
        self.render("catalogue.html", title="No valid token", body="token")

    async def read(self, action: Callable[[], T], pool: str = "pages") -> T | None:
        """Return the result of an action in a thread of a pool; None after an answer with the sentence of its error."""

        def told() -> tuple[T | None, str]:
            try:
                return action(), ""
            except SENTENCES as error:
                return None, str(error)

        found = await self.work(told, pool)
        if found is not None and found[1]:
            text = found[1].replace(f"{self._runs.folder}/", "").replace(str(self._runs.folder), "the folder")
            self.send_error(HTTPStatus.UNPROCESSABLE_ENTITY, text=text)
            return None
        return None if found is None else found[0]

    async def run_of(self, path: str) -> RunSummary | None:
        """Return the run at a path of the catalogue; if there is none, answer 404 and return None."""
        entries = await self.read(self._runs.entries)
        if entries is not None and path not in entries:
            self.send_error(
                HTTPStatus.NOT_FOUND, text="there is no such run: it was moved or deleted, or the address is wrong"
            )
        return None if entries is None else entries.get(path)

    async def send(
        self, download: _Download | None, kind: str = "application/octet-stream", inline: bool = False
    ) -> None:
        """Send a file, as a page of its own or as a download."""
        if download is None:
            return
        with download.file:
            self.set_header("Content-Type", kind)
            self.set_header("Content-Security-Policy", DOCUMENT_POLICY)
            disposition = "inline" if inline else "attachment"
            self.set_header("Content-Disposition", f"{disposition}; filename*=UTF-8''{quote(download.name)}")
            await self.stream(download.file.read, download.length)


class _ListPage(_DataHandler):
    async def get(self, *_: str) -> None:
        query = self.get_query_argument("q", "")
        text = self.get_query_argument("page", "1")
        page = max(int(text), 1) if text.isdecimal() and len(text) < 7 else 1

        def listed() -> tuple[int, int, list[tuple[RunSummary, str]]]:
            entries = self._runs.entries()
            found = RunFilter(query).apply(entries.values())
            shown = found[(page - 1) * ROWS_PER_PAGE : page * ROWS_PER_PAGE]
            return len(entries), len(found), [(run, self._runs.sketch(run)) for run in shown]

        if (answer := await self.read(listed)) is not None:
            total, count, rows = answer
            self.render(
                "catalogue.html",
                title=f"Runs in {self._runs.folder.name}",
                body="list",
                query=query,
                page=page,
                pages=max(-(-count // ROWS_PER_PAGE), 1),
                total=total,
                count=count,
                rows=rows,
                size=SKETCH_SIZE,
                figures=_key_figures,
                length=format_duration,
                quote=quote,
            )


def _key_figures(run: RunSummary) -> str:
    """Return the figures of a run by which lists are sorted, with their total uncertainties, or else its first estimate."""
    found = (figure for figure in run.figures if figure.name in ("natural_frequency", *LARGEST_FIGURES))
    texts = (format_quantity(each.value, each.total, each.unit, each.name) for each in found)
    return ", ".join(texts) or run.estimates_text.partition("; ")[0]


class _RunPage(_DataHandler):
    async def get(self, *parts: str) -> None:
        if (run := await self.run_of(parts[-1])) is None:
            return
        facts: dict[str, Any] | None = {"result": None, "rows": []}
        if run.readable:
            facts = await self.read(lambda: self._runs.facts(run))
        if facts is not None:
            shown = {**facts, "run": run, "sign": SIGNS.get(run.severity, ""), "formats": FORMAT_NAMES, "quote": quote}
            self.render("catalogue.html", title=run.name, body="run", bytes_text=format_bytes(run.size), **shown)


class _Plot(_DataHandler):
    async def get(self, *parts: str) -> None:
        run = await self.run_of(parts[-1])
        if run is not None and (image := await self.read(lambda: self._runs.plot(run), "drawings")) is not None:
            self.answer("image/svg+xml", image, {"Content-Security-Policy": DOCUMENT_POLICY})


class _Export(_DataHandler):
    async def get(self, *parts: str) -> None:
        if (run := await self.run_of(parts[-1])) is not None:
            await self.send(await self.read(lambda: self._runs.export(run, parts[0], self.progress), "exports"))


class _RunFile(_DataHandler):
    async def get(self, *parts: str) -> None:
        if (run := await self.run_of(parts[-1])) is not None:
            await self.send(await self.read(lambda: self._runs.run_file(run)), "application/x-hdf5")


class _ReportPage(_DataHandler):
    async def get(self, *parts: str) -> None:
        suffix, specimen = parts
        kind = "application/pdf" if suffix == "pdf" else "text/html; charset=utf-8"
        found = await self.read(lambda: self._runs.report(specimen, suffix, self.progress), "drawings")
        await self.send(found, kind, inline=True)
