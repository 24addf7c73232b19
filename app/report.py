"""The report of a specimen: one page to sign, and an appendix with every run; PDF and HTML from the same content.

Two calls with the same files give the same bytes: nothing in it tells when it was made, only when things were measured.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from html import escape
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.config import AmplifierTable
from app.figures import THRESHOLD_M
from app.identifying import Identified, identify
from app.observing import OBSERVERS
from app.picture import figure_of
from app.words import uncertain
from model.amplifier import AmplifierMap
from model.parameters import Membrane, Tactor
from model.perception import margin, usable_bands
from model.response import amplifier_response
from model.uncertainty import Band, Estimates, linear_band
from protocols.quality import usable
from protocols.runreader import Run, RunError

PAGE_INCHES = (8.27, 11.69)
BAND_HZ = np.linspace(5.0, 250.0, 246)


class ReportError(Exception):
    """There is nothing to report. The sentence says why and what to do."""


@dataclass(frozen=True, slots=True)
class Grid:
    """A table: a title, heads, rows of text."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Report:
    """What stands in the report, before it is set."""

    specimen: str
    simulated: bool
    summary: tuple[str, ...]
    grids: tuple[Grid, ...]
    identified: Identified | None
    runs: tuple[Path, ...]


def gather(folder: Path, specimen: str) -> Report:
    """Read all runs of a specimen and identify it.

    Raises:
        ReportError: there is no run of it.
    """
    runs = tuple(_runs_of(folder, specimen))
    if not runs:
        raise ReportError(
            f"there is no run of specimen '{specimen}' in {folder}; 'tactor-bench runs' lists what is there"
        )
    telling: list[Path] = []
    rows, instruments = [], dict[tuple[str, str], None]()
    simulated = False
    for path in runs:
        with Run(path) as run:
            points = run.points()
            good = usable(points.get("quality", ()))
            simulated |= run.simulated
            if run.protocol in OBSERVERS and good.any():
                telling.append(path)
            rows.append(
                (path.name, run.protocol, run.start_time[:16], run.state, f"{good.sum()} of {len(good)}", _hash(path))
            )
            for role, name in run.configuration.get("identities", {}).items():
                instruments[role, str(name)] = None
            sensor = run.sensor
            dates = f"calibrated {sensor.calibrated or 'unknown'}, gain known to {100 * sensor.gain_relative_uncertainty:.2g} %"
            instruments["sensor's calibration", dates] = None
    found = identify(telling, "joint") if telling else None
    summary = [found.verdict + "." if found else "No run tells about the model."]
    grids = []
    if found is not None:
        summary += [f"Not identifiable from these runs: {words}." for words in found.unidentified]
        summary += [_use(found, runs)]
        grids.append(_parameters(found))
        grids.append(
            Grid(
                "How well each run is explained",
                ("run", "residuals", "chi-square", "p"),
                tuple((m.label, str(m.points), f"{m.chi_square:.1f}", f"{m.probability:.2g}") for m in found.misfits),
            )
        )
    grids.append(Grid("Instruments", ("role", "identity"), tuple(instruments)))
    grids.append(Grid("Runs", ("file", "protocol", "begun (UTC)", "ended", "usable", "SHA-256, first 16"), tuple(rows)))
    return Report(specimen, simulated, tuple(summary), tuple(grids), found, runs)


def to_pdf(report: Report, path: Path) -> None:
    """Write the PDF.

    Raises:
        OSError: it cannot be written.
    """
    from matplotlib.backends.backend_pdf import PdfPages

    about = {"Title": f"Specimen {report.specimen}", "Creator": "tactor-bench", "CreationDate": None, "ModDate": None}
    with PdfPages(path, metadata=about) as pdf:
        for page in _pages(report):
            pdf.savefig(page)


def to_html(report: Report, path: Path) -> None:
    """Write the HTML: the same words, tables and figures in one file.

    Raises:
        OSError: it cannot be written.
    """
    mark = (
        "<p class='simulated'>SIMULATED: no number here was measured on a real specimen</p>" if report.simulated else ""
    )
    parts = [
        f"<h1>Specimen {escape(report.specimen)}</h1>",
        mark,
        *(f"<p>{escape(words)}</p>" for words in report.summary),
    ]
    parts += [_svg(figure) for figure in _first_figures(report)]
    parts += [_html_grid(grid) for grid in report.grids]
    parts.append("<h2>Appendix: every run</h2>")
    for path_, figure in _run_figures(report):
        parts += [f"<h3>{escape(path_.name)}</h3>", _svg(figure)]
    path.write_text(HTML.format(title=escape(report.specimen), body="\n".join(parts)), "utf-8")


HTML = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Specimen {title}</title><style>
body {{ font-family: sans-serif; max-width: 60rem; margin: 2rem auto; color: #111; }}
table {{ border-collapse: collapse; margin: 0 0 1.5rem; }} caption {{ text-align: left; font-weight: bold; padding: .3rem 0; }}
th, td {{ border-bottom: 1px solid #ccc; padding: .2rem .8rem .2rem 0; text-align: left; font-size: .9rem; }}
.simulated {{ color: #c00018; border: 4px solid #c00018; padding: .5rem 1rem; font-weight: bold; }}
svg {{ max-width: 100%; height: auto; }}
</style></head><body>
{body}
</body></html>
"""


def _runs_of(folder: Path, specimen: str) -> list[Path]:
    found = []
    for path in sorted(folder.glob("*.h5")):
        try:
            with Run(path) as run:
                if run.specimen == specimen:
                    found.append(path)
        except RunError:
            continue  # what is no run, or damaged, cannot say whose it is; 'tactor-bench runs' names it
    return found


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]


def _parameters(found: Identified) -> Grid:
    """Estimates beside the paper's Table I."""
    table = asdict(Tactor()) | asdict(Membrane())
    rows = []
    for e in found.estimates:
        paper = table.get(e.name)
        far = f"{(e.value - paper) / e.standard_error:+.1f}" if paper is not None and e.standard_error > 0 else ""
        rows.append(
            (e.name, uncertain(e.value, e.standard_error, "1"), e.unit, "" if paper is None else f"{paper:.6g}", far)
        )
    heads = ("parameter", "value ± standard error", "unit", "paper's Table I", "difference / error")
    return Grid("Parameters", heads, tuple(rows))


def _amplifier(path: Path) -> AmplifierMap:
    with Run(path) as run:
        return AmplifierTable.of(run.configuration).map


def _use(found: Identified, runs: Sequence[Path]) -> str:
    """How far above the threshold of the skin the free tactor is, over the band of touch."""
    map_ = _amplifier(runs[0])
    moved = _moved(found.tactor, map_)
    bands = usable_bands(BAND_HZ, moved)
    if not bands:
        return "At full drive it stays below the skin's threshold from 5 to 250 Hz."
    over = margin(BAND_HZ, moved)
    worst = int(np.argmin(np.where(over >= 1, over, np.inf)))
    where = " and ".join(f"from {low:.0f} to {high:.0f} Hz" for low, high in bands)
    return (
        f"At full drive its max - min lies above the skin's threshold of {1e6 * THRESHOLD_M:g} µm {where}, "
        f"by a factor of at least {float(over[worst]):.1f} (at {BAND_HZ[worst]:.0f} Hz)."
    )


def _first_figures(report: Report, marked: bool = True) -> list[Any]:
    """The response with its band, and what the model leaves of the measured points; `marked` SIMULATED by itself."""
    found = report.identified
    if found is None:
        return []
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    map_ = _amplifier(report.runs[0])
    figure = Figure(figsize=(7.3, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    response, residual = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    curve, band = _moved(found.tactor, map_), _band(found, map_)
    response.plot(BAND_HZ, 1e6 * curve, color="tab:blue", label="model as identified, free, full drive")
    if band is not None:
        response.fill_between(
            BAND_HZ, 1e6 * band.lower, 1e6 * band.upper, color="tab:blue", alpha=0.25, lw=0, label="95 % band"
        )
    for path in report.runs:
        with Run(path) as run:
            if run.protocol != "sine-dwell":
                continue
            points = run.points()
            good = usable(points["quality"])
            full = np.abs(points["drive_amplitude"] - map_.rest_v) < 0.02 * map_.rest_v
            at = good & full
            f, moved, error = (points[name][at] for name in ("frequency", "peak_to_peak", "peak_to_peak_errors"))
        response.errorbar(f, 1e6 * moved, 2e6 * error, fmt="o", ms=4, color="tab:red")
        model = np.interp(f, BAND_HZ, curve)
        residual.errorbar(f, 100 * (moved / model - 1), 200 * error / model, fmt="o", ms=4, color="tab:red")
    response.axhline(1e6 * THRESHOLD_M, color="tab:green", lw=1)
    response.set(ylabel="max - min (µm)", ylim=(0, None))
    response.legend(fontsize=8)
    residual.axhline(0, color="tab:blue", lw=1)
    residual.set(xlabel="frequency (Hz)", ylabel="Δ (%)", xlim=(0, 255))
    if marked:
        _watermark(figure, report)
    return [figure]


def _band(found: Identified, map_: AmplifierMap) -> Band | None:
    """The free curve at full drive with its 95 % band; None where nothing that was identified moves it."""
    known = asdict(Tactor())
    at = [i for i, e in enumerate(found.estimates) if e.name in known]
    if not at:
        return None
    names, values = zip(*((found.estimates[i].name, found.estimates[i].value) for i in at), strict=True)

    def curve(varied: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
        rows = zip(*varied.values(), strict=True)
        return np.array([_moved(replace(found.tactor, **dict(zip(varied, row, strict=True))), map_) for row in rows])

    return linear_band(curve, Estimates(names, values, found.covariance[np.ix_(at, at)]))


def _moved(tactor: Tactor, map_: AmplifierMap) -> NDArray[np.float64]:
    """Max - min of the free tactor at full drive over `BAND_HZ`, (F,)."""
    return amplifier_response(tactor, BAND_HZ, map_.rest_v, map_.rest_v, map_).peak_to_peak


def _run_figures(report: Report) -> list[tuple[Path, Any]]:
    tactor = report.identified.tactor if report.identified is not None else Tactor()
    figures = []
    for path in report.runs:
        with Run(path) as run:
            figures.append((path, figure_of(run, tactor)))
    return figures


def _pages(report: Report) -> list[Any]:
    """Matplotlib figures, one a page."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    pages = []
    page = Figure(figsize=PAGE_INCHES)
    FigureCanvasAgg(page)
    page.text(0.08, 0.955, f"Specimen {report.specimen}", fontsize=20, weight="bold", va="top")
    y = 0.915
    for words in report.summary:
        lines = _wrapped(words, 105)
        page.text(0.08, y, lines, fontsize=8.5, va="top")
        y -= 0.0145 * (lines.count("\n") + 1) + 0.004
    first = _first_figures(report, marked=False)
    if first:
        picture = _raster(first[0])
        height = 0.84 * PAGE_INCHES[0] / PAGE_INCHES[1] * picture.shape[0] / picture.shape[1]
        axes = page.add_axes((0.08, y - height - 0.005, 0.84, height))
        axes.imshow(picture, interpolation="lanczos")
        axes.set_axis_off()
        y -= height + 0.02
    for grid in report.grids:
        height = 0.0165 * (len(grid.rows) + 1) + 0.03
        if y - height < 0.05:
            _watermark(page, report)
            pages.append(page)
            page = Figure(figsize=PAGE_INCHES)
            FigureCanvasAgg(page)
            y = 0.95
        page.text(0.08, y, grid.title, fontsize=10, weight="bold", va="top")
        _set_grid(page, grid, y - 0.024)
        y -= height + 0.012
    _watermark(page, report)
    pages.append(page)
    for path, figure in _run_figures(report):
        figure.text(0.01, 0.004, path.name, fontsize=7, color="gray")
        pages.append(figure)
    return pages


def _set_grid(page: Any, grid: Grid, top: float) -> None:
    """Columns as wide as what stands in them."""
    widths = np.array([max(len(row[i]) for row in (grid.heads, *grid.rows)) + 2 for i in range(len(grid.heads))], float)
    left = 0.08 + 0.84 * np.concatenate([[0], np.cumsum(widths)[:-1]]) / max(widths.sum(), 100)
    size = min(7.5, 7.5 * 128 / max(widths.sum(), 100))
    for at, row in enumerate((grid.heads, *grid.rows)):
        for x, text in zip(left, row, strict=True):
            page.text(x, top - 0.0165 * at, text, fontsize=size, va="top", weight="bold" if at == 0 else "normal")


def _watermark(figure: Any, report: Report) -> None:
    if report.simulated:
        figure.text(0.5, 0.5, "SIMULATED", fontsize=64, color="red", alpha=0.12, ha="center", va="center", rotation=25)


def _wrapped(words: str, letters: int) -> str:
    import textwrap

    return "\n".join(textwrap.wrap(words, letters))


def _raster(figure: Any) -> Any:
    """A figure as pixels, to be set into a page."""
    from matplotlib.image import imread

    store = BytesIO()
    figure.savefig(store, format="png", dpi=200)
    store.seek(0)
    return imread(store)


def _svg(figure: Any) -> str:
    import matplotlib as mpl

    store = StringIO()
    with mpl.rc_context({"svg.hashsalt": "tactor-bench"}):
        figure.savefig(store, format="svg", metadata={"Date": None, "Creator": None})
    text = store.getvalue()
    return text[text.index("<svg") :]


def _html_grid(grid: Grid) -> str:
    heads = "".join(f"<th>{escape(head)}</th>" for head in grid.heads)
    rows = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in grid.rows)
    return f"<table><caption>{escape(grid.title)}</caption><tr>{heads}</tr>{rows}</table>"
