"""Typeface: the bundled font in four sizes, and lengths that grow with the text size."""

from pathlib import Path

from PySide6.QtCore import QMargins, QSize
from PySide6.QtGui import QFont, QFontDatabase, QFontMetricsF, QGuiApplication
from PySide6.QtWidgets import QAbstractButton, QApplication, QLayout, QWidget

FAMILY = "Inter"
FONTS = Path(__file__).with_name("fonts")
LABEL_PX, VALUE_PX, PRESENT_PX, ANSWER_PX = SIZES_PX = 12, 15, 28, 40
"""Labels, axes, notes and buttons; values, headings and rows; present values, sign and prompt; the one answer of a card."""

FEATURES = {"tnum": 1, "calt": 1, "cv05": 1}
"""Figures of one width, the right dash and minus for their neighbours, an l that is no I.

The bundled files are Inter 4 but for one thing: the feature of the figures leaves the hyphen of words as narrow as it is.
"""

LARGE_TRACKING = -0.025
"""Additional space between the letters of large texts, in parts of their size: the font is cut for small ones."""

REGULAR, MEDIUM, SEMIBOLD, BOLD = (QFont.Weight.Normal, QFont.Weight.Medium, QFont.Weight.DemiBold, QFont.Weight.Bold)

TEXT_SIZES = {"automatic": 0, "100": 100, "115": 115, "125": 125, "150": 150}
"""Choices of the text size in per cent, as they are stored in the settings."""

LARGE_SCREEN, LARGE_TEXT = QSize(2240, 1260), 1.25
"""A screen from which on the automatic text size is larger."""

LEAST_WINDOW = QSize(900, 540)
"""Smallest window at a text size of 100 %."""

KINDS: dict[str, tuple[int, QFont.Weight]] = {
    "heading": (VALUE_PX, SEMIBOLD),
    "step": (VALUE_PX, SEMIBOLD),
    "step-detail": (LABEL_PX, SEMIBOLD),
    "large": (VALUE_PX, REGULAR),
    "welcome": (PRESENT_PX, SEMIBOLD),
    "act": (PRESENT_PX, SEMIBOLD),
    "answer": (ANSWER_PX, SEMIBOLD),
    "present": (PRESENT_PX, SEMIBOLD),
    "unit": (PRESENT_PX, REGULAR),
    "key": (LABEL_PX, MEDIUM),
    "danger": (LABEL_PX, SEMIBOLD),
    "hint": (VALUE_PX, REGULAR),
    "running": (VALUE_PX, SEMIBOLD),
    "value": (VALUE_PX, SEMIBOLD),
    "caption": (LABEL_PX, SEMIBOLD),
    "moved": (LABEL_PX, SEMIBOLD),
    "tag": (LABEL_PX, SEMIBOLD),
    "mark": (LABEL_PX, BOLD),
    "sign": (PRESENT_PX, BOLD),
    "pill": (LABEL_PX, SEMIBOLD),
    "go": (VALUE_PX, SEMIBOLD),
    "main": (VALUE_PX, MEDIUM),
    "stop": (VALUE_PX, BOLD),
}
"""Size and weight of a text by the kind of its widget or painted text; texts of other kinds have the application's font."""


def install_fonts(percent: int = 0) -> None:
    """Load the bundled font and make it the application's, at a text size in per cent; 0: by the screen."""
    if FAMILY not in QFontDatabase.families():
        for path in sorted(FONTS.glob("*.ttf")):
            QFontDatabase.addApplicationFont(str(path))
    scale = _fitting_scale(percent / 100.0)
    font = QFont(FAMILY)
    font.setPixelSize(round(LABEL_PX * scale))
    font.setHintingPreference(QFont.HintingPreference.PreferNoHinting)
    for name, value in FEATURES.items():
        font.setFeature(QFont.Tag.fromString(name), value)
    if font != QApplication.font():
        QApplication.setFont(font)


def _fitting_scale(wanted: float) -> float:
    """Return the scale of the text, at most what the screen has space for; 0 wanted: by the screen."""
    screen = QGuiApplication.primaryScreen().size()
    is_large = screen.width() >= LARGE_SCREEN.width() and screen.height() >= LARGE_SCREEN.height()
    scale = wanted or (LARGE_TEXT if is_large else 1.0)
    most = min(screen.width() / LEAST_WINDOW.width(), screen.height() / LEAST_WINDOW.height())
    return max(min(scale, most), 1.0)


def text_scale() -> float:
    """Return the text size in use; 1 is 100 %."""
    size = QApplication.font().pixelSize()
    return size / LABEL_PX if size > 0 else 1.0


def px(length: float) -> int:
    """Return a length of the design at the text size in use."""
    return round(length * text_scale())


def text_font(kind: str = "") -> QFont:
    """Return the font of one of `KINDS` at the text size in use."""
    size, weight = KINDS.get(kind, (LABEL_PX, REGULAR))
    font = QFont(QApplication.font())
    font.setPixelSize(px(size))
    font.setWeight(weight)
    if size >= PRESENT_PX:
        font.setLetterSpacing(QFont.SpacingType.AbsoluteSpacing, LARGE_TRACKING * px(size))
    return font


def text_width(text: str, kind: str = "") -> float:
    """Return the width of a text in pixels."""
    return QFontMetricsF(text_font(kind)).horizontalAdvance(text)


def set_margins(layout: QLayout, margins: tuple[int, int, int, int], spacing: int | None = None) -> None:
    """Set margins and spacing of a layout in lengths of the design; they follow the text size."""
    layout.setProperty("design", [*margins, -1 if spacing is None else spacing])
    _apply_margins(layout)


def _apply_margins(layout: QLayout) -> None:
    design = layout.property("design")
    if design is None:
        return
    *margins, spacing = (int(each) for each in design)
    layout.setContentsMargins(QMargins(*map(px, margins)))
    if spacing >= 0:
        layout.setSpacing(px(spacing))


def set_length(widget: QWidget, width: int = 0, height: int = 0, least_width: int = 0, icon: int = 0) -> None:
    """Fix a widget's width or height, or set its least width or a button's icon, in lengths of the design; they follow the text size."""
    widget.setProperty("design", [width, height, least_width, icon])
    _apply_length(widget)


def _apply_length(widget: QWidget) -> None:
    design = widget.property("design")
    if design is None:
        return
    width, height, least_width, icon = (int(each) for each in design)
    if least_width:
        widget.setMinimumWidth(px(least_width))
    if width:
        widget.setFixedWidth(px(width))
    if height:
        widget.setFixedHeight(px(height))
    if icon and isinstance(widget, QAbstractButton):
        widget.setIconSize(QSize(px(icon), px(icon)))


def rescale(window: QWidget) -> None:
    """Apply the text size in use to the fonts, margins and fixed lengths of a window."""
    widgets = (window, *window.findChildren(QWidget))
    for widget in widgets:
        if str(widget.property("kind") or "") in KINDS:
            widget.setFont(text_font(str(widget.property("kind"))))
        _apply_length(widget)
    window.setStyleSheet(window.styleSheet())  # styled widgets do not follow the application's font
    for layout in window.findChildren(QLayout):
        _apply_margins(layout)
        layout.invalidate()
    for widget in widgets:  # the item of a layout keeps the sizes of a widget in a hidden page
        widget.updateGeometry()
