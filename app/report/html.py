"""HTML report: texts, tables and inline SVG figures in one self-contained file."""

from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any

from app.common import Table, write_atomic
from app.plotting.panels import LEGEND_IN, ReportPlot, draw_plot, new_figure
from app.report.document import Block, Paragraph, Report

FIGURE_WIDTH_IN = 7.0
"""Width of a figure, inches."""

STYLE = """
body { font-family: sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #111; background: #fff; line-height: 1.4; }
table { border-collapse: collapse; margin: 0 0 .5rem; width: 100%; }
caption { text-align: left; font-weight: bold; padding: .8rem 0 .3rem; }
th, td { border-bottom: 1px solid #ccc; padding: .2rem .8rem .2rem 0; text-align: left; vertical-align: top; font-size: .85rem; }
tr.bad td, p.bad { color: #b00018; font-weight: bold; } p.good { color: #006030; font-weight: bold; }
td.code { font-family: monospace; overflow-wrap: anywhere; }
.note, figcaption { font-size: .8rem; color: #444; margin: 0 0 1.2rem; } figure { margin: 1rem 0; } h3 { margin-bottom: .2rem; }
.banner { color: #c00018; border: 4px solid #c00018; padding: .5rem 1rem; font-weight: bold; }
.mark { position: fixed; inset: 0; display: flex; align-items: center; justify-content: center; text-align: center; pointer-events: none;
  color: red; opacity: .12; font-size: 5rem; font-weight: bold; transform: rotate(-25deg); }
.sign { display: flex; gap: 2rem; margin: 2rem 0; } .sign span { flex: 1; border-bottom: 1px solid #111; padding-top: 2rem; }
.logo { float: right; max-height: 4rem; max-width: 12rem; }
svg { max-width: 100%; height: auto; }
@media print { figure, tr { break-inside: avoid; } }
"""


@contextmanager
def html_report(report: Report, path: Path) -> Iterator[Callable[[str, Any], None]]:
    """Yield a function that adds the picture of a run; at the end the file is written whole, or not at all after an exception.

    Raises:
        OSError: it cannot be written.
    """
    title = escape(f"Specimen {report.specimen}")
    parts = [*_html_head(report), *_html_blocks(report.first_page)]
    who = f"Signed by {escape(report.signed_by)}" if report.signed_by else "Measured by"
    parts.append(f"<div class='sign'><span>{who}</span><span>Checked by</span><span>Date</span></div>")
    for section in report.appendix:
        parts += [f"<h2>{escape(section.title)}</h2>", *_html_blocks(section.blocks)]
    heading = ["<h2>Every run</h2>"]

    def add(name: str, figure: Any) -> None:
        parts.extend((*heading, f"<h3>{escape(name)}</h3>", _inline_svg(figure, f"Run {name}")))
        heading.clear()

    yield add
    if report.footer:
        parts.append(f"<p class='note'>{escape(report.footer)}</p>")
    body = "\n".join(parts)
    write_atomic(
        path,
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{STYLE}</style></head><body>\n{body}\n</body></html>\n",
    )


def _html_head(report: Report) -> Iterable[str]:
    if report.header:
        yield f"<p class='note'>{escape(report.header)}</p>"
    if report.logo:
        yield f"<img class='logo' alt='' src='data:image/png;base64,{b64encode(report.logo).decode()}'>"
    if report.laboratory:
        yield f"<p><strong>{escape(report.laboratory)}</strong></p>"
    yield f"<h1>Specimen {escape(report.specimen)}</h1>"
    if report.page_marks:
        marks = " ".join(report.page_marks)
        meaning = ": no number here was measured on a real specimen" if marks == "SIMULATED" else ""
        yield f"<div class='mark' aria-hidden='true'>{escape(marks)}</div>"
        yield f"<p class='banner'>{escape(marks + meaning)}</p>"
    yield f"<p>{escape(report.subtitle)}</p>"
    yield f"<p class='note'>fingerprint of the run files {report.fingerprint}; {escape(report.software_version)}</p>"


def _html_blocks(blocks: Iterable[Block]) -> Iterable[str]:
    for block in blocks:
        match block:
            case Paragraph():
                yield f"<p class='{block.tone}'>{escape(block.text)}</p>"
            case ReportPlot():
                yield _html_plot(block)
            case Table():
                yield _html_table(block)
                if block.note:
                    yield f"<p class='note'>{escape(block.note)}</p>"


def _html_plot(plot: ReportPlot) -> str:
    height = plot.row_height_in * plot.rows + LEGEND_IN
    figure = new_figure(figsize=(FIGURE_WIDTH_IN, height))
    draw_plot(figure, plot, (0.0, 0.0, FIGURE_WIDTH_IN, height))
    caption = f"<figcaption>{escape(plot.caption)}</figcaption>" if plot.caption else ""
    return f"<figure><h3>{escape(plot.title)}</h3>{_inline_svg(figure, plot.title)}{caption}</figure>"


def _html_table(table: Table) -> str:
    heads = "".join(f"<th>{escape(head)}</th>" for head in table.headings)
    cell = "<td class='code'>{}</td>" if table.monospace else "<td>{}</td>"
    rows = "".join(
        f"<tr{' class=bad' if at in table.highlighted_rows else ''}>{''.join(cell.format(escape(text)) for text in row)}</tr>"
        for at, row in enumerate(table.text_rows)
    )
    return f"<table><caption>{escape(table.title)}</caption><tr>{heads}</tr>{rows}</table>"


def _inline_svg(figure: Any, title: str) -> str:
    import matplotlib as mpl

    store = StringIO()
    with mpl.rc_context({"svg.hashsalt": "tactor-bench", "svg.fonttype": "none"}):
        figure.savefig(store, format="svg", metadata={"Date": None, "Creator": None})
    text = store.getvalue()
    return text[text.index("<svg") :].replace("<svg ", f'<svg role="img" aria-label="{escape(title)}" ', 1)
