"""How the handbook is built from these pages: `python3 start.py docs`. Nothing is fetched, neither then nor when it is read."""

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

project = html_title = "Tactor Bench"
root_doc = "index"
exclude_patterns = ["README.md"]  # the index has it
extensions = ["myst_parser"]
suppress_warnings = ["toc.not_included"]  # the decisions are reached from their list
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_copy_source = html_show_sphinx = False
html_math_renderer = "mathml"


def setup(app: Sphinx) -> None:
    """Equations as MathML, which browsers draw by themselves; Sphinx's own ways fetch a script or need TeX."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))


def inline(page: HTML5Translator, node: nodes.math) -> None:
    page.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def block(page: HTML5Translator, node: nodes.math_block) -> None:
    page.body.append(tex2mathml(node.astext(), as_block=True))
    raise nodes.SkipNode
