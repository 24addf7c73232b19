"""Declarative box layouts, labels and buttons."""

from collections.abc import Callable
from typing import TypeVar

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QBoxLayout, QHBoxLayout, QLabel, QLayout, QPushButton, QVBoxLayout, QWidget

L = TypeVar("L", bound=QBoxLayout)
STRETCH = None
"""Item that takes the space left over."""

Part = QWidget | QLayout
Item = Part | tuple[Part, int] | tuple[QWidget, int, Qt.AlignmentFlag] | int | None
"""A widget or layout, alone or with its stretch (and alignment); a number of pixels to leave free; or `STRETCH`."""


def column(
    *items: Item,
    parent: QWidget | None = None,
    margins: tuple[int, int, int, int] | None = None,
    spacing: int | None = None,
) -> QVBoxLayout:
    """Return a vertical layout of items; `margins` are left, top, right and bottom in pixels."""
    return _fill(QVBoxLayout(parent) if parent is not None else QVBoxLayout(), items, margins, spacing)


def row(
    *items: Item,
    parent: QWidget | None = None,
    margins: tuple[int, int, int, int] | None = None,
    spacing: int | None = None,
) -> QHBoxLayout:
    """Return a horizontal layout of items; `margins` are left, top, right and bottom in pixels."""
    return _fill(QHBoxLayout(parent) if parent is not None else QHBoxLayout(), items, margins, spacing)


def make_label(text: str = "", kind: str = "", wrap: bool = True) -> QLabel:
    """Return a label of plain text, styled as `kind` of the style sheet."""
    made = QLabel(text)
    made.setWordWrap(wrap)
    made.setTextFormat(Qt.TextFormat.PlainText)
    if kind:
        made.setProperty("kind", kind)
    return made


def make_button(text: str, on_click: Callable[[], object], kind: str = "", tip: str = "") -> QPushButton:
    """Return a button that calls `on_click`, styled as `kind` of the style sheet."""
    button = QPushButton(text)
    if kind:
        button.setProperty("kind", kind)
    button.setToolTip(tip)
    button.clicked.connect(lambda _checked=False: on_click())
    return button


def _fill(layout: L, items: tuple[Item, ...], margins: tuple[int, int, int, int] | None, spacing: int | None) -> L:
    if margins is not None:
        layout.setContentsMargins(*margins)
    if spacing is not None:
        layout.setSpacing(spacing)
    for item in items:
        match item:
            case None:
                layout.addStretch()
            case int():
                layout.addSpacing(item)
            case (QWidget() as widget, stretch, alignment):
                layout.addWidget(widget, stretch, alignment)
            case (QWidget() as widget, stretch):
                layout.addWidget(widget, stretch)
            case (QLayout() as inner, stretch):
                layout.addLayout(inner, stretch)
            case QWidget():
                layout.addWidget(item)
            case QLayout():
                layout.addLayout(item)
    return layout
