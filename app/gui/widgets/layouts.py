"""Declarative layouts, labels, buttons and other configured widgets."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from PySide6.QtCore import QRectF, QSignalBlocker, Qt
from PySide6.QtGui import QFont, QPaintEvent, QValidator
from PySide6.QtWidgets import (
    QBoxLayout,
    QComboBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QSplitter,
    QVBoxLayout,
    QWidget,
)

from app.common import TRUE_MINUS, Severity, sentence_case
from app.gui.face import KINDS, draw_icon, painting, px, set_margins, text_font, tokens
from app.gui.widgets.key_caps import show_key

B = TypeVar("B", bound=QBoxLayout)
W = TypeVar("W", bound=QWidget)
Part = QWidget | QLayout
Item = Part | tuple[Part, int] | tuple[QWidget, int, Qt.AlignmentFlag] | int | None
"""A widget or layout, alone or with its stretch (and alignment); a number of pixels to leave free; or None, which takes the remaining space."""

Margins = tuple[int, int, int, int]
"""Left, top, right and bottom in pixels of the design, which follow the text size."""
NO_MARGINS: Margins = (0, 0, 0, 0)
PANEL_MARGINS: Margins = (12, 12, 12, 12)

SELECTABLE = Qt.TextInteractionFlag.TextSelectableByMouse
UPRIGHT: dict[str, Any] = {
    "focusPolicy": Qt.FocusPolicy.NoFocus,
    "horizontalScrollBarPolicy": Qt.ScrollBarPolicy.ScrollBarAlwaysOff,
}
"""Properties of a scroll area that scrolls vertically only, and does not take the keyboard."""


def configure(widget: W, name: str = "", **properties: object) -> W:
    """Set a widget's object name and Qt properties, and return it; `kind` selects a style of the style sheet."""
    widget.setObjectName(name)
    for key, value in properties.items():
        is_property = widget.setProperty(key, value)
        assert is_property or key == "kind", f"{type(widget).__name__} has no property {key}"
    if properties.get("kind") in KINDS:
        widget.setFont(text_font(str(properties["kind"])))
    return widget


def set_style_kind(widget: QWidget, kind: str) -> None:
    """Set the property `kind` that the style sheet selects, with its font, and restyle the widget."""
    if widget.property("kind") != kind:
        widget.setProperty("kind", kind)
        widget.setFont(text_font(kind) if kind in KINDS else QFont())  # an own font does not follow the text size
        _restyle(widget)


def set_tone(widget: QWidget, severity: Severity) -> None:
    """Give a widget the text colour of a severity."""
    if widget.property("tone") != severity.value:
        widget.setProperty("tone", severity.value)
        _restyle(widget)


def _restyle(widget: QWidget) -> None:
    widget.style().unpolish(widget)
    widget.style().polish(widget)


def column(
    *items: Item, parent: QWidget | None = None, margins: Margins = NO_MARGINS, spacing: int | None = None
) -> QVBoxLayout:
    """Return a vertical layout of items."""
    return _fill(QVBoxLayout(parent) if parent else QVBoxLayout(), items, margins, spacing)


def row(
    *items: Item, parent: QWidget | None = None, margins: Margins = NO_MARGINS, spacing: int | None = None
) -> QHBoxLayout:
    """Return a horizontal layout of items."""
    return _fill(QHBoxLayout(parent) if parent else QHBoxLayout(), items, margins, spacing)


def grid(
    *cells: tuple[QWidget, int, int] | tuple[QWidget, int, int, int, int] | tuple[QWidget, int, int, Qt.AlignmentFlag],
    parent: QWidget | None = None,
    margins: Margins = NO_MARGINS,
    spacing: tuple[int, int] = (-1, -1),
    stretch: Mapping[int, int] | None = None,
) -> QGridLayout:
    """Return a grid of widgets, each with its row, its column and, where needed, its spans or alignment.

    Args:
        cells: the widgets and their places.
        parent: widget that gets the layout.
        margins: of the whole grid.
        spacing: horizontal and vertical, in pixels.
        stretch: of columns, by their index.
    """
    layout = QGridLayout(parent)
    set_margins(layout, margins)
    layout.setHorizontalSpacing(spacing[0] if spacing[0] < 0 else px(spacing[0]))
    layout.setVerticalSpacing(spacing[1] if spacing[1] < 0 else px(spacing[1]))
    for at, share in (stretch or {}).items():
        layout.setColumnStretch(at, share)
    for widget, *place in cells:
        layout.addWidget(widget, *place)
    return layout


def make_label(text: str = "", kind: str = "", wrap: bool = True, name: str = "", **properties: object) -> QLabel:
    """Return a label of plain text, unless `properties` have another format, styled as `kind` of the style sheet."""
    if kind:
        properties["kind"] = kind
    return configure(QLabel(text), name, **{"wordWrap": wrap, "textFormat": Qt.TextFormat.PlainText} | properties)


def show_text(label: QLabel, text: str) -> None:
    """Show a text in a label; an empty one hides it."""
    label.setText(text)
    label.setVisible(bool(text))


def clear_layout(layout: QLayout) -> None:
    """Remove the widgets of a layout and delete them."""
    while (item := layout.takeAt(0)) is not None:
        if (widget := item.widget()) is not None:
            widget.deleteLater()


def make_button(
    text: str,
    on_click: Callable[[], object] | None = None,
    kind: str = "",
    tip: str = "",
    name: str = "",
    key: str = "",
    **properties: object,
) -> QPushButton:
    """Return a button that calls `on_click`, if given, styled as `kind` of the style sheet, with the cap of its `key`."""
    if kind:
        properties["kind"] = kind
    button = configure(QPushButton(text), name, toolTip=tip, **properties)
    if on_click is not None:
        button.clicked.connect(lambda _checked=False: on_click())
    if key:
        show_key(button, key)
    return button


def make_panel(*items: Item, margins: Margins = PANEL_MARGINS, spacing: int = 6, frame: QFrame | None = None) -> QFrame:
    """Return a frame, or the given one, around a column of items."""
    frame = configure(frame or QFrame(), kind="panel")
    column(*items, parent=frame, margins=margins, spacing=spacing)
    return frame


def make_progress_bar(steps: int, height: int, name: str = "") -> QProgressBar:
    """Return a progress bar from 0 to `steps` without a text, of a height in pixels."""
    return configure(QProgressBar(), name, maximum=steps, textVisible=False, minimumHeight=height, maximumHeight=height)


def make_pane(*items: Item, margins: Margins = NO_MARGINS, spacing: int | None = None) -> QWidget:
    """Return a widget with a column of items."""
    pane = QWidget()
    column(*items, parent=pane, margins=margins, spacing=spacing)
    return pane


def make_scroll_area(
    *items: Item, margins: Margins = NO_MARGINS, spacing: int | None = None, **properties: object
) -> QScrollArea:
    """Return a transparent scroll area without a frame, whose content, a column of items, is as wide as the area."""
    area = configure(QScrollArea(), "", widgetResizable=True, frameShape=QFrame.Shape.NoFrame, **properties)
    area.viewport().setAutoFillBackground(False)
    if items:
        content = make_pane(*items, margins=margins, spacing=spacing)
        area.setWidget(content)
        content.setAutoFillBackground(False)
    return area


class ComboBox(QComboBox):
    """Combo box with an arrow, which a style sheet takes away."""

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        side = px(12)
        with painting(self) as painter:
            at = QRectF(self.width() - 1.75 * side, (self.height() - side) / 2, side, side)
            draw_icon(painter, "down", at, tokens().text2)


class TrueMinus(QValidator):
    """Shows a typed hyphen of a number as the minus that it means."""

    def validate(self, text: str, at: int) -> tuple[QValidator.State, str, int]:
        return QValidator.State.Acceptable, text.replace("-", TRUE_MINUS), at


def make_combo(
    name: str, accessible_name: str, choices: Iterable[tuple[str, object]] = (), **properties: object
) -> ComboBox:
    """Return a combo box of choices: texts with their data."""
    combo = configure(ComboBox(), name, accessibleName=accessible_name, **properties)
    for text, data in choices:
        combo.addItem(text, data)
    return combo


def make_line_edit(name: str, accessible_name: str, **properties: object) -> QLineEdit:
    """Return a field for one line of text."""
    return configure(QLineEdit(), name, accessibleName=accessible_name, **properties)


def fill_combo(combo: QComboBox, choices: Iterable[tuple[str, object]], preferred: object = None) -> None:
    """Replace the choices without a signal; the chosen data stay chosen, else the preferred, else the first."""
    chosen = combo.currentData()
    with QSignalBlocker(combo):
        combo.clear()
        for text, data in choices:
            combo.addItem(text, data)
        places = (combo.findData(each) for each in (chosen, preferred) if each is not None)
        combo.setCurrentIndex(next((at for at in places if at >= 0), 0))


def make_labelled_grid(
    editors: Mapping[str, QWidget],
    spacing: tuple[int, int],
    stretch: Mapping[int, int] | None = None,
    wrap: bool = False,
) -> QGridLayout:
    """Return a grid of editors in the second column, each with its label, from top to bottom; `wrap`: long labels are wrapped."""
    fields = grid(spacing=spacing, stretch=stretch)
    for at, (text, editor) in enumerate(editors.items()):
        label = make_label(sentence_case(text), wrap=wrap)
        label.setBuddy(editor)
        fields.addWidget(label, at, 0)
        fields.addWidget(editor, at, 1)
    return fields


def make_splitter(
    name: str,
    *parts: tuple[QWidget, int],
    orientation: Qt.Orientation = Qt.Orientation.Horizontal,
    sizes: list[int] | None = None,
) -> QSplitter:
    """Return a splitter of widgets with their stretch; its position is saved by its name."""
    splitter = configure(QSplitter(orientation), name, childrenCollapsible=False)
    for at, (widget, stretch) in enumerate(parts):
        splitter.addWidget(widget)
        splitter.setStretchFactor(at, stretch)
    if sizes is not None:
        splitter.setSizes(sizes)
    return splitter


def make_toggle(text: str, tip: str, name: str, shown: QWidget) -> QPushButton:
    """Return a button that shows a widget, which is hidden at first, and hides it again."""
    button = make_button(text, None, "choice", tip, name, checkable=True)
    shown.hide()
    button.toggled.connect(shown.setVisible)
    return button


def _fill(layout: B, items: Iterable[Item], margins: Margins, spacing: int | None) -> B:
    set_margins(layout, margins, spacing)
    for item in items:
        if item is None:
            layout.addStretch()
        elif isinstance(item, int):
            layout.addSpacing(px(item))
        else:
            part, *place = item if isinstance(item, tuple) else (item,)
            add: Callable[..., None] = layout.addLayout if isinstance(part, QLayout) else layout.addWidget
            add(part, *place)
    return layout
