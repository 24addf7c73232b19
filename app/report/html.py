"""HTML report: texts, tables and inline SVG figures in one self-contained file."""

from base64 import b64encode
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path

from app.common import Table
from app.plotting import ReportPlot, VectorDrawing
from app.report.document import Block, Paragraph, Report
from app.report.drawings import Drawings
from protocols.base import write_atomic

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


def write_html(report: Report, drawings: Drawings, path: Path) -> None:
    """Write the report.

    Raises:
        OSError: it cannot be written; an existing file is unchanged then.
    """
    title = escape(f"Specimen {report.specimen}")
    plots = iter(drawings.plots)
    parts = [*_html_head(report), *_html_blocks(report.first_page, plots)]
    who = f"Signed by {escape(report.signed_by)}" if report.signed_by else "Measured by"
    parts.append(f"<div class='sign'><span>{who}</span><span>Checked by</span><span>Date</span></div>")
    for section in report.appendix:
        parts += [f"<h2>{escape(section.title)}</h2>", *_html_blocks(section.blocks, plots)]
    if drawings.runs:
        parts.append("<h2>Every run</h2>")
    for name, drawing in drawings.runs:
        parts += [f"<h3>{escape(name)}</h3>", drawing.svg]
    if report.laboratory.footer:
        parts.append(f"<p class='note'>{escape(report.laboratory.footer)}</p>")
    body = "\n".join(parts)
    write_atomic(
        path,
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{STYLE}</style></head><body>\n{body}\n</body></html>\n",
    )


def _html_head(report: Report) -> Iterable[str]:
    if report.laboratory.header:
        yield f"<p class='note'>{escape(report.laboratory.header)}</p>"
    if report.logo:
        yield f"<img class='logo' alt='' src='data:image/png;base64,{b64encode(report.logo).decode()}'>"
    if report.laboratory.name:
        yield f"<p><strong>{escape(report.laboratory.name)}</strong></p>"
    yield f"<h1>Specimen {escape(report.specimen)}</h1>"
    if report.page_marks:
        marks = " ".join(report.page_marks)
        meaning = ": no number here was measured on a real specimen" if marks == "SIMULATED" else ""
        yield f"<div class='mark' aria-hidden='true'>{escape(marks)}</div>"
        yield f"<p class='banner'>{escape(marks + meaning)}</p>"
    yield f"<p>{escape(report.subtitle)}</p>"
    yield f"<p class='note'>fingerprint of the run files {report.fingerprint}; {escape(report.software_version)}</p>"


def _html_blocks(blocks: Iterable[Block], plots: Iterator[Sequence[VectorDrawing]]) -> Iterable[str]:
    for block in blocks:
        match block:
            case Paragraph():
                yield f"<p class='{block.tone}'>{escape(block.text)}</p>"
            case ReportPlot():
                caption = f"<figcaption>{escape(block.caption)}</figcaption>" if block.caption else ""
                svg = "".join(drawing.svg for drawing in next(plots))
                yield f"<figure><h3>{escape(block.title)}</h3>{svg}{caption}</figure>"
            case Table():
                yield _html_table(block)
                if block.note:
                    yield f"<p class='note'>{escape(block.note)}</p>"


def _html_table(table: Table) -> str:
    heads = "".join(f"<th>{escape(head)}</th>" for head in table.headings)
    cell = "<td class='code'>{}</td>" if table.monospace else "<td>{}</td>"
    rows = "".join(
        f"<tr{' class=bad' if at in table.highlighted_rows else ''}>{''.join(cell.format(escape(text)) for text in row)}</tr>"
        for at, row in enumerate(table.text_rows)
    )
    return f"<table><caption>{escape(table.title)}</caption><tr>{heads}</tr>{rows}</table>"
