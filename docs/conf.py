"""Sphinx configuration of the handbook (`python3 start.py docs`); neither building nor reading it needs a network."""

from html import escape

import ziamath
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

project = html_title = "Tactor Bench"
root_doc = "index"
exclude_patterns = ["README.md"]  # included by the index
extensions = ["myst_parser"]
suppress_warnings = ["toc.not_included"]  # the decisions are reached from their list
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_copy_source = html_show_sphinx = html_show_copyright = False
html_math_renderer = "svg"


def setup(app: Sphinx) -> None:
    """Render equations as SVG: Sphinx's own methods fetch a script or need TeX, and MathML needs fonts that few readers have."""
    app.add_html_math_renderer("svg", (inline, None), (block, None))


def inline(page: HTML5Translator, node: nodes.math) -> None:
    page.body.append(drawn(node.astext(), 16.0, inline=True))
    raise nodes.SkipNode


def block(page: HTML5Translator, node: nodes.math_block) -> None:
    page.body.append(f'<div style="overflow-x: auto; margin: 1em 0">{drawn(node.astext(), 18.0, inline=False)}</div>')
    raise nodes.SkipNode


def drawn(latex: str, size: float, *, inline: bool) -> str:
    """Return an equation as SVG in the text colour, aligned with the baseline, with its LaTeX source as label."""
    equation = ziamath.Latex(latex, size=size, inline=inline, color="currentColor")
    place = f"vertical-align: {equation.getyofst():.2f}px" if inline else "display: block; margin: auto"
    label = f'<svg role="img" aria-label="{escape(latex, quote=True)}" style="{place}"'
    return str(equation.svg()).replace("<svg", label, 1)
