"""Grid of the window: three classes of width, and the heights and columns that never follow from their contents."""

from dataclasses import dataclass

from PySide6.QtWidgets import QWidget

from app.gui.face.typeface import text_scale

MENU_HEIGHT, STRIP_HEIGHT, STATUS_HEIGHT = 26, 64, 28


@dataclass(frozen=True, slots=True)
class SizeClass:
    """Columns of a window in lengths of the design.

    Attributes:
        name: S, M or L.
        least_width: of the window.
        rail: width of the navigation rail; it has words beside its icons where it is wide enough.
        gap: between columns of the strip, and around the parts of a page.
        sign, measured, aim, pause, stop: widths of the strip's columns; the run has the rest.
        left: outer width of a page's left column.
        result: outer width of the column at the right of the plots of Measure; 0 for none.
        items, decision, finding: widths of the list of a campaign, of the decision about its result, and of the finding of a control chart.
    """

    name: str
    least_width: int
    rail: int
    gap: int
    sign: int
    measured: int
    aim: int
    pause: int
    stop: int
    left: int
    result: int
    items: int
    decision: int
    finding: int


CLASS_S = SizeClass("S", 900, 56, 8, 220, 230, 126, 60, 100, 240, 0, 208, 248, 248)
CLASS_M = SizeClass("M", 1040, 80, 12, 220, 234, 148, 80, 128, 276, 0, 232, 296, 336)
CLASS_L = SizeClass("L", 1600, 80, 12, 240, 280, 240, 88, 136, 336, 432, 304, 400, 400)


def size_class(width: float) -> SizeClass:
    """Return the class of a window's width in lengths of the design."""
    return next((each for each in (CLASS_L, CLASS_M) if width >= each.least_width), CLASS_S)


def class_of(widget: QWidget) -> SizeClass:
    """Return the class of the window that a widget is in."""
    return size_class(widget.window().width() / text_scale())
