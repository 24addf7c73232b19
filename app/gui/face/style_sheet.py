"""Style sheet of the window, generated from the tokens.

It has colours, lines and paddings relative to the text, but no sizes: fonts and lengths follow from the text size
(`typeface`), so that no sheet is set when a window is resized.
"""

from pathlib import Path
from string import Template

from app.gui.face.tokens import COLORS, Tokens

SHEET = Template(Path(__file__).with_name("window.qss").read_text(encoding="utf-8"))
"""With a place for each colour of the tokens, by its name."""


def style_sheet(tokens: Tokens) -> str:
    """Return the style sheet of the window."""
    return SHEET.substitute({name: getattr(tokens, name) for name in COLORS})
