"""Files of a report: PDF and HTML, and the logo of the laboratory."""

from dataclasses import replace
from pathlib import Path

from app.common import NO_PROGRESS, Progress, UsageError
from app.config import read_laboratory
from app.identification import chosen_threshold
from app.report.content import build_report
from app.report.document import Report
from app.report.drawings import draw_report
from app.report.html import write_html
from app.report.limits import LIMITS_FILE_NAME, read_limits
from app.report.pdf import fit_first_page, write_pdf
from app.report.runs import ReportRun
from app.report.specimen import SpecimenModel
from drivers import open_regular
from model.response import ABDOMEN_THRESHOLD, PerceptionThreshold
from protocols.runfile import safe_name

MAX_LOGO_BYTES = 2_000_000


def write_folder_report(folder: Path, specimen: str, out: Path, progress: Progress = NO_PROGRESS) -> tuple[Path, Path]:
    """Write the two-page report of a specimen with limits, threshold and laboratory of the folder of its runs; PDF and HTML.

    Raises:
        ReportError, LimitsError, SheetError, UsageError, OSError: as the functions that it calls.
    """
    beside, threshold, laboratory = folder / LIMITS_FILE_NAME, chosen_threshold(folder), read_laboratory(folder)
    limits = read_limits(beside) if beside.exists() else None
    report, model, _ = build_report(folder, specimen, limits, progress, threshold, False, laboratory)
    return write_report(replace(report, logo=read_logo(laboratory.logo)), model, (), out, progress, threshold)


def write_report(
    report: Report,
    specimen: SpecimenModel,
    runs: tuple[ReportRun, ...],
    out: Path,
    progress: Progress = NO_PROGRESS,
    threshold: PerceptionThreshold = ABDOMEN_THRESHOLD,
) -> tuple[Path, Path]:
    """Write PDF and HTML.

    Raises:
        RunReadError: a run file is damaged.
        OSError: one cannot be written; an existing file is unchanged then.
    """
    name = safe_name(report.specimen)
    pdf, html = out / f"{name}_report.pdf", out / f"{name}_report.html"
    report = fit_first_page(report)
    drawings = draw_report(report, specimen, [run for run in runs if not run.problem], progress, threshold)
    progress.update(0.9, "writing")
    write_html(report, drawings, html)  # first: its template may have an error
    write_pdf(report, drawings, pdf)
    return pdf, html


def read_logo(path: Path | None) -> bytes:
    """Return the PNG picture of a file; nothing without one.

    Raises:
        UsageError: it cannot be read, or is no PNG picture of usual size.
    """
    if path is None:
        return b""
    try:
        with open_regular(path) as file:
            data: bytes = file.read(MAX_LOGO_BYTES + 1)
    except OSError as error:
        raise UsageError(f"the logo {path} cannot be read: {error.strerror or error}; give a PNG picture") from None
    if not data.startswith(b"\x89PNG\r\n\x1a\n") or len(data) > MAX_LOGO_BYTES:
        raise UsageError(
            f"the logo {path} is no PNG picture of at most {MAX_LOGO_BYTES / 1e6:g} MB; convert it, or leave it out"
        )
    return data
