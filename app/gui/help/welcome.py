"""Welcome page of the first start: a demo run, and how to set up a bench."""

from functools import partial

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QFrame, QPushButton, QWidget

from app.gui.widgets import (
    Item,
    StatusLine,
    column,
    configure,
    make_button,
    make_label,
    make_panel,
    make_scroll_area,
    row,
)

DEMO_TEXT = (
    "A sine dwell on a simulated tactor: 18 frequencies in about half a minute. Nothing is connected and nothing can "
    "break. The points arrive on the model's curve, and the run is kept as a file in the folder {folder}."
)
SETUP_TEXT = (
    "The page Bench looks for generator and card, shows their live values, calibrates the sensor, checks the wiring, commissions "
    "the source, and writes the commented bench file. In a terminal: tactor-bench devices, bench new, check, commission."
)
SAFETY_TEXT = "0 V at the amplifier's input is −500 V on the specimen. Read 'Safety' in the help (F1) before a real bench is switched on."
PAGES_TEXT = (
    "Measure (Ctrl+1) runs one protocol.  Campaign (Ctrl+2) runs all of them on a specimen.  "
    "Explore (Ctrl+3) varies the model.  Runs (Ctrl+4) lists every run.  Bench (Ctrl+5) sets up the bench.  "
    "Laboratory (Ctrl+6) compares specimens.  F1 lists every key."
)


class WelcomePage(QWidget):
    """Covers the pages until the user has made a choice."""

    demo_requested = Signal()
    tutorial_requested = Signal(str)
    """Name of a tutorial."""
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.about_label = make_label(kind="large", name="welcome.about")
        self.message_label = configure(StatusLine(), "welcome.message")
        self.demo_button = make_button(
            "Try it on the simulated bench",
            self.demo_requested.emit,
            "go",
            name="welcome.demo",
            key="Enter",
            minimumHeight=64,
        )
        self.setup_button = configure(QPushButton("Set up a bench …"), "welcome.setup", minimumHeight=44)
        self.tutorial_buttons = [
            make_button(text, partial(self.tutorial_requested.emit, name), name=f"welcome.tutorial.{name}")
            for name, text in (("tour", "Ten-minute tour, step by step"), ("own-bench", "Guide me through it"))
        ]
        self.browse_button = configure(QPushButton("Open a bench file …"), "welcome.browse")
        close = make_button("Not now", self.closed.emit, name="welcome.close", key="Esc")
        left = _panel("See it work", self.about_label, 10, self.demo_button, self.tutorial_buttons[0], None)
        right = _panel(
            "Set up my bench",
            make_label(SETUP_TEXT, "large"),
            10,
            self.setup_button,
            self.tutorial_buttons[1],
            self.browse_button,
            self.message_label,
            8,
            make_label(SAFETY_TEXT, "danger"),
            None,
        )
        top = Qt.AlignmentFlag.AlignTop
        area = make_scroll_area(
            make_label("Welcome to Tactor Bench", "welcome", wrap=False),
            row((left, 1, top), (right, 1, top), spacing=18),
            row((make_label(PAGES_TEXT, "note-size"), 1), close),
            None,
            margins=(40, 16, 40, 16),
            spacing=14,
            focusPolicy=Qt.FocusPolicy.NoFocus,
        )
        column(area, parent=self)

    def show_page(self, folder: str) -> None:
        """Show where runs are stored, and focus the demo button."""
        self.about_label.setText(DEMO_TEXT.format(folder=folder))
        self.message_label.show_message("")
        self.demo_button.setFocus()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            focused = next(
                (b for b in (self.setup_button, self.browse_button, *self.tutorial_buttons) if b.hasFocus()),
                self.demo_button,
            )
            focused.click()
            return
        super().keyPressEvent(event)


def _panel(title: str, *items: Item) -> QFrame:
    return make_panel(make_label(title, "heading", wrap=False), *items, margins=(24, 18, 24, 18), spacing=8)
