"""Welcome page of the first start: a demo run, and how to set up a bench."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QFrame, QLabel, QWidget

from app.gui.widgets import (
    SELECTABLE,
    STRETCH,
    Item,
    StatusLine,
    column,
    configure,
    grid,
    make_button,
    make_label,
    make_panel,
    make_scroll_area,
    row,
    shortcut_label,
)

DEMO_TEXT = (
    "A sine dwell on a simulated tactor: 18 frequencies in about half a minute. Nothing is connected and nothing can "
    "break. The points arrive on the model's curve, and the run is kept as a file in the folder {folder}."
)
SETUP_STEPS = (
    ("tactor-bench devices", "lists what is connected to this computer."),
    ("tactor-bench bench new my-bench.toml", "writes a first bench file from it, with a comment on every line."),
    (
        "tactor-bench check --bench my-bench.toml",
        "checks the wiring with a tenth of a volt, the specimen disconnected.",
    ),
    ("tactor-bench --bench my-bench.toml", "starts with it; or open the file here:"),
)
SAFETY_TEXT = (
    "0 V at the amplifier's input is −500 V on the specimen. Read docs/safety.md before a real bench is switched on."
)
PAGES_TEXT = (
    "Measure (Ctrl+1) runs one protocol.  Campaign (Ctrl+2) runs all of them on a specimen.  "
    "Explore (Ctrl+3) varies the model.  Runs (Ctrl+4) lists every run.  F1 lists every key."
)


class WelcomePage(QWidget):
    """Covers the pages until the user has made a choice."""

    demo_requested = Signal()
    browse_pressed = Signal()
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.about_label = make_label(kind="large", name="welcome.about")
        self.message_label = configure(StatusLine(), "welcome.message")
        self.demo_button = make_button(
            "Try it on the simulated bench   (Enter)",
            self.demo_requested.emit,
            "go",
            name="welcome.demo",
            minimumHeight=64,
        )
        self.browse_button = make_button("Open a bench file …", self.browse_pressed.emit, name="welcome.browse")
        close = make_button(shortcut_label("Not now", "escape"), self.closed.emit, name="welcome.close")
        steps = grid(spacing=(10, 2), stretch={1: 1})
        for at, (command, purpose) in enumerate(SETUP_STEPS):
            steps.addWidget(QLabel(f"{at + 1}."), 2 * at, 0)
            steps.addWidget(
                make_label(
                    command,
                    "command",
                    wrap=False,
                    textInteractionFlags=SELECTABLE | Qt.TextInteractionFlag.TextSelectableByKeyboard,
                    focusPolicy=Qt.FocusPolicy.NoFocus,
                ),
                2 * at,
                1,
            )
            steps.addWidget(make_label(purpose, "large"), 2 * at + 1, 1)
        left = _panel("See it work", self.about_label, 10, self.demo_button, STRETCH)
        right = _panel(
            "Set up my bench",
            make_label("In a terminal:", "large"),
            steps,
            8,
            self.browse_button,
            self.message_label,
            8,
            make_label(SAFETY_TEXT, "danger"),
            STRETCH,
        )
        top = Qt.AlignmentFlag.AlignTop
        content, area = QWidget(), make_scroll_area(focusPolicy=Qt.FocusPolicy.NoFocus)
        column(
            make_label("Welcome to Tactor Bench", "welcome", wrap=False),
            row((left, 1, top), (right, 1, top), spacing=18),
            row((make_label(PAGES_TEXT, "note-size"), 1), close),
            STRETCH,
            parent=content,
            margins=(40, 16, 40, 16),
            spacing=14,
        )
        area.setWidget(content)
        content.setAutoFillBackground(False)
        column(area, parent=self, margins=(0, 0, 0, 0))

    def show_page(self, folder: str) -> None:
        """Show where runs are stored, and focus the demo button."""
        self.about_label.setText(DEMO_TEXT.format(folder=folder))
        self.message_label.show_message("")
        self.demo_button.setFocus()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            (self.browse_button if self.browse_button.hasFocus() else self.demo_button).click()
            return
        super().keyPressEvent(event)


def _panel(title: str, *items: Item) -> QFrame:
    return make_panel(make_label(title, "heading", wrap=False), *items, margins=(24, 18, 24, 18), spacing=8)
