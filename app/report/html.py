"""HTML report: texts, tables and inline SVG figures in one self-contained file."""

from base64 import b64encode
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from traceback import extract_tb
from typing import Any

from app.common import Table, UsageError, sentence_case
from app.config import LABORATORY_FILE_NAME
from app.plotting import ReportPlot, VectorDrawing
from app.report.document import Block, Paragraph, Photograph, Report
from app.report.drawings import Drawings
from protocols.base import write_atomic

PAGE_TEMPLATE = files("app.report").joinpath("report.html").read_text("utf-8")
"""The program's own; a laboratory's begins as a copy of it."""


def write_html(report: Report, drawings: Drawings, path: Path) -> None:
    """Write the report by the template of the laboratory, or the program's own.

    Raises:
        UsageError: the template has an error, or leaves out marks, fingerprint or signatures.
        OSError: it cannot be written; an existing file is unchanged then.
    """
    write_atomic(path, _render(report.laboratory.template or PAGE_TEMPLATE, _contents(report, drawings)))


def _contents(report: Report, drawings: Drawings) -> dict[str, Any]:
    """Return what a template can show."""
    from markupsafe import Markup

    plots, parts = iter(drawings.plots), {}

    def body(blocks: Iterable[Block], heading: str = "h2") -> Markup:
        made = [(block, Markup("\n".join(_html_block(block, plots, heading)))) for block in blocks]  # noqa: S704 - escaped
        parts.update({block.title: text for block, text in made if isinstance(block, Table | ReportPlot)})
        return Markup("\n").join(text for _, text in made)

    marks = " ".join(report.page_marks)
    return {
        "title": report.title,
        "specimen": report.specimen,
        "laboratory": report.laboratory,
        "logo": f"data:image/png;base64,{b64encode(report.logo).decode()}" if report.logo else "",
        "marks": marks,
        "meaning": ": no number here was measured on a real specimen" if marks == "SIMULATED" else "",
        "fingerprint": report.fingerprint,
        "software": report.software_version,
        "style": Markup(report.laboratory.style),  # noqa: S704 - has no '<'
        "first_page": body(report.first_page),
        "signatures": report.signatures,
        "sections": [
            {"title": each.title, "own_page": each.own_page, "body": body(each.blocks, "h3")}
            for each in report.appendix
        ],
        "parts": parts,
        "runs": [{"name": name, "picture": Markup(drawing.svg)} for name, drawing in drawings.runs],  # noqa: S704
        "record": report.record,
    }


def _render(template: str, contents: dict[str, Any]) -> str:
    """Return the page. A template can access only the values that are passed to it.

    Raises:
        UsageError: the template has an error, or leaves out what every report states.
    """
    from jinja2 import StrictUndefined, TemplateError, TemplateSyntaxError
    from jinja2.sandbox import ImmutableSandboxedEnvironment
    from markupsafe import escape as escaped

    environment = ImmutableSandboxedEnvironment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    try:
        text = str(environment.from_string(template).render(contents))
    except (TemplateError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        lines = [frame.lineno for frame in extract_tb(error.__traceback__) if frame.filename == "<template>"]
        line = error.lineno if isinstance(error, TemplateSyntaxError) else next(reversed(lines), 1)
        raise UsageError(
            f"the template of the report, line {line}: {error}; correct it, or remove `template` from {LABORATORY_FILE_NAME}"
        ) from None
    stated = (contents["marks"], contents["fingerprint"], *contents["signatures"])
    if missing := [each for each in stated if escaped(each) not in text]:
        raise UsageError(
            f"the template of the report leaves out '{missing[0]}': marks, fingerprint and signatures belong on every report"
        )
    return text


def _html_block(block: Block, plots: Iterator[Sequence[VectorDrawing]], heading: str) -> Iterator[str]:
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
            f"<tr><th scope='row'>{escape(sentence_case(name))}</th>{cell.format(escape(text))}</tr>"
            for name, text in pairs
        )
        return f"<table class='facts'>{caption}{facts}</table>"
    heads = "".join(f"<th scope='col'>{escape(sentence_case(head))}</th>" for head in table.headings)
    rows = "".join(
        f"<tr{' class=bad' if at in table.highlighted_rows else ''}><th scope='row'>{escape(row[0])}</th>"
        f"{''.join(cell.format(escape(text)) for text in row[1:])}</tr>"
        for at, row in enumerate(table.text_rows)
    )
    wide = f"<table>{caption}<thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"
    return f"<div class='wide' tabindex='0' role='region' aria-label='{escape(table.title, quote=True)}'>{wide}</div>"
