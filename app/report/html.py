"""HTML report: texts, tables and inline SVG figures in one self-contained file."""

from base64 import b64encode
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path

from app.common import Table
from app.plotting import ReportPlot, VectorDrawing
from app.report.document import Block, Paragraph, Photograph, Report
from app.report.drawings import Drawings
from protocols.base import write_atomic

STYLE = """
:root { color-scheme: light dark; --ink: #111; --paper: #fff; --line: #ccc; --note: #444; --bad: #b00018; --good: #006030; }
@media (prefers-color-scheme: dark) { :root { --ink: #eee; --paper: #16181b; --line: #555; --note: #bbb; --bad: #ff8a8a; --good: #7fd6a0; } }
body { font-family: sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: var(--ink); background: var(--paper); line-height: 1.4; }
table { border-collapse: collapse; margin: 0 0 .5rem; width: 100%; } .wide { overflow-x: auto; }
caption { text-align: left; font-weight: bold; padding: .8rem 0 .3rem; }
th, td { border-bottom: 1px solid var(--line); padding: .2rem .8rem .2rem 0; text-align: left; vertical-align: top; font-size: .85rem; }
tbody th { font-weight: normal; } .facts th { width: 6rem; }
tr.bad :is(td, th), p.bad { color: var(--bad); font-weight: bold; } p.good { color: var(--good); font-weight: bold; }
.code { font-family: monospace; overflow-wrap: anywhere; }
.note, figcaption { font-size: .8rem; color: var(--note); margin: 0 0 1.2rem; } figure { margin: 1rem 0; } h2, h3 { margin: 1rem 0 .2rem; font-size: 1.1rem; }
.banner { color: var(--bad); border: 4px solid var(--bad); padding: .5rem 1rem; font-weight: bold; }
.mark { position: fixed; inset: 0; display: flex; align-items: center; justify-content: center; text-align: center; pointer-events: none;
  color: red; opacity: .12; font-size: min(5rem, 12vw); font-weight: bold; transform: rotate(-25deg); }
.sign { display: flex; flex-wrap: wrap; gap: 2rem; margin: 3rem 0 2rem; } .sign span { flex: 1 9rem; border-top: 1px solid var(--ink); }
.logo { float: right; max-height: 4rem; max-width: 12rem; } .photograph { float: right; max-height: 9rem; max-width: 40%; margin: 0 0 .5rem 1rem; }
svg { max-width: 100%; height: auto; background: #fff; }
@page { size: A4; margin: 1.5cm; }
@media print { :root { color-scheme: light; --ink: #000; --paper: #fff; --line: #999; --note: #444; --bad: #b00018; --good: #006030; }
  body { max-width: none; margin: 0; padding: 0; font-size: 9pt; line-height: 1.25; } th, td, .note, figcaption { font-size: 8pt; } .page { break-before: page; }
  figure, tr { break-inside: avoid; } h1 { margin: 0; font-size: 16pt; } h2, h3 { font-size: 10pt; } p, figure, .sign, caption { margin: .2rem 0; padding: 0; } .wide { overflow: visible; } }
"""
"""Light and dark on a screen; printed as the PDF. A laboratory's own style sheet follows it."""


def write_html(report: Report, drawings: Drawings, path: Path) -> None:
    """Write the report.

    Raises:
        OSError: it cannot be written; an existing file is unchanged then.
    """
    title = escape(report.title)
    plots = iter(drawings.plots)
    parts = [*_html_head(report), *_html_blocks(report.first_page, plots)]
    lines = "".join(f"<span>{escape(text)}</span>" for text in report.signatures)
    parts.append(f"<div class='sign'>{lines}</div>")
    for at, section in enumerate(report.appendix):
        new_page = " class='page'" if at == 0 or section.own_page else ""
        parts += [f"<h2{new_page}>{escape(section.title)}</h2>", *_html_blocks(section.blocks, plots, "h3")]
    if drawings.runs:
        parts.append("<h2>Every run</h2>")
    for name, drawing in drawings.runs:
        parts += [f"<h3>{escape(name)}</h3>", drawing.svg]
    if report.laboratory.footer:
        parts.append(f"<p class='note'>{escape(report.laboratory.footer)}</p>")
    body = "\n".join(parts)
    write_atomic(
        path,
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{STYLE}{report.laboratory.style}</style></head><body><main>\n{body}\n</main></body></html>\n",
    )


def _html_head(report: Report) -> Iterable[str]:
    if report.laboratory.header:
        yield f"<p class='note'>{escape(report.laboratory.header)}</p>"
    if report.logo:
        yield f"<img class='logo' alt='{escape(report.laboratory.name or 'logo of the laboratory', quote=True)}' src='data:image/png;base64,{b64encode(report.logo).decode()}'>"
    if report.laboratory.name:
        yield f"<p><strong>{escape(report.laboratory.name)}</strong></p>"
    yield f"<h1>{escape(report.title)}</h1>"
    if report.page_marks:
        marks = " ".join(report.page_marks)
        meaning = ": no number here was measured on a real specimen" if marks == "SIMULATED" else ""
        yield f"<div class='mark' aria-hidden='true'>{escape(marks)}</div>"
        yield f"<p class='banner'>{escape(marks + meaning)}</p>"
    yield f"<p class='note'>fingerprint of the run files {report.fingerprint}; {escape(report.software_version)}</p>"


def _html_blocks(
    blocks: Iterable[Block], plots: Iterator[Sequence[VectorDrawing]], heading: str = "h2"
) -> Iterable[str]:
    for block in blocks:
        match block:
            case Paragraph():
                yield f"<p class='{block.tone}'>{escape(block.text)}</p>"
            case ReportPlot():
                caption = f"<figcaption>{escape(block.caption)}</figcaption>" if block.caption else ""
                svg = "".join(drawing.svg for drawing in next(plots))
                yield f"<figure><{heading}>{escape(block.title)}</{heading}>{svg}{caption}</figure>"
            case Photograph():
                kind = "png" if block.data.startswith(b"\x89PNG") else "jpeg"
                source = f"data:image/{kind};base64,{b64encode(block.data).decode()}"
                yield f"<img class='photograph' alt='{escape(block.description, quote=True)}' src='{source}'>"
            case Table():
                yield _html_table(block)
                if block.note:
                    yield f"<p class='note'>{escape(block.note)}</p>"


def _html_table(table: Table) -> str:
    cell = "<td class='code'>{}</td>" if table.monospace else "<td>{}</td>"
    caption = f"<caption>{escape(table.title)}</caption>"
    if table.vertical:
        pairs = zip(table.headings, table.text_rows[0], strict=True)
        facts = "".join(
            f"<tr><th scope='row'>{escape(name)}</th>{cell.format(escape(text))}</tr>" for name, text in pairs
        )
        return f"<table class='facts'>{caption}{facts}</table>"
    heads = "".join(f"<th scope='col'>{escape(head)}</th>" for head in table.headings)
    rows = "".join(
        f"<tr{' class=bad' if at in table.highlighted_rows else ''}><th scope='row'>{escape(row[0])}</th>"
        f"{''.join(cell.format(escape(text)) for text in row[1:])}</tr>"
        for at, row in enumerate(table.text_rows)
    )
    wide = f"<table>{caption}<thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"
    return f"<div class='wide' tabindex='0' role='region' aria-label='{escape(table.title, quote=True)}'>{wide}</div>"
