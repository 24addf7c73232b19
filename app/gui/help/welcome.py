"""What a newcomer sees first: one thing to try, and how one's own bench comes in. Shown once; again from the sheet of keys."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from app.gui.widgets.form import set_style_kind

DEMO_TEXT = (
    "A sine dwell on a simulated tactor: 18 frequencies in about half a minute. Nothing is connected and nothing can "
    "break. The points arrive on the model's curve, and the run is kept as a file in the folder {folder}."
)
SETUP_STEPS = (
    ("tactor-bench devices", "tells what is connected to this computer."),
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
    "Measure (Ctrl+1) runs one protocol.  Campaign (Ctrl+2) carries a specimen through all of them.  "
    "Explore (Ctrl+3) plays with the model.  Runs (Ctrl+4) holds every run.  F1 tells every key."
)


class WelcomePage(QWidget):
    """Covers the pages until somebody has chosen."""

    demo_requested = Signal()
    browse_pressed = Signal()
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        heading = QLabel("Welcome to Tactor Bench")
        set_style_kind(heading, "welcome")
        self.about_label = _text_label("")
        self.demo_button = QPushButton("Try it on the simulated bench   (Enter)")
        self.demo_button.setProperty("kind", "go")
        self.demo_button.setMinimumHeight(64)
        self.demo_button.clicked.connect(self.demo_requested)
        self.browse_button = QPushButton("Open a bench file …")
        self.browse_button.clicked.connect(self.browse_pressed)
        close = QPushButton("Not now   (Esc)")
        close.clicked.connect(self.closed)
        self.message_label = _text_label("")
        set_style_kind(self.message_label, "fault")
        self.message_label.hide()
        left, right = _panel("See it work"), _panel("Set up my bench")
        left.addWidget(self.about_label)
        left.addSpacing(10)
        left.addWidget(self.demo_button)
        left.addStretch()
        right.addWidget(_text_label("In a terminal:"))
        steps = QGridLayout()
        steps.setHorizontalSpacing(10)
        steps.setVerticalSpacing(2)
        for at, (command, words) in enumerate(SETUP_STEPS):
            steps.addWidget(QLabel(f"{at + 1}."), 2 * at, 0)
            line = QLabel(command)
            set_style_kind(line, "command")
            line.setTextInteractionFlags(
                Qt.TextInteractionFlag.TextSelectableByMouse | Qt.TextInteractionFlag.TextSelectableByKeyboard
            )
            line.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            steps.addWidget(line, 2 * at, 1)
            steps.addWidget(_text_label(words), 2 * at + 1, 1)
        steps.setColumnStretch(1, 1)
        right.addLayout(steps)
        right.addSpacing(8)
        right.addWidget(self.browse_button)
        right.addWidget(self.message_label)
        right.addSpacing(8)
        danger = _text_label(SAFETY_TEXT)
        set_style_kind(danger, "danger")
        right.addWidget(danger)
        right.addStretch()
        columns = QHBoxLayout()
        columns.setSpacing(18)
        for column in (left, right):
            frame = QFrame()
            set_style_kind(frame, "panel")
            frame.setLayout(column)
            columns.addWidget(frame, 1, Qt.AlignmentFlag.AlignTop)
        below = QHBoxLayout()
        places = _text_label(PAGES_TEXT)
        set_style_kind(places, "note-size")
        below.addWidget(places, 1)
        below.addWidget(close)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(40, 16, 40, 16)
        layout.setSpacing(14)
        layout.addWidget(heading)
        layout.addLayout(columns)
        layout.addLayout(below)
        layout.addStretch()

    def show_page(self, folder: str) -> None:
        """Show it."""
        self.about_label.setText(DEMO_TEXT.format(folder=folder))
        self.show_message("")
        self.demo_button.setFocus()

    def show_message(self, text: str) -> None:
        """Why a bench file was not opened."""
        self.message_label.setText(text)
        self.message_label.setVisible(bool(text))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            (self.browse_button if self.browse_button.hasFocus() else self.demo_button).click()
            return
        super().keyPressEvent(event)


def _panel(title: str) -> QVBoxLayout:
    column = QVBoxLayout()
    column.setContentsMargins(24, 18, 24, 18)
    column.setSpacing(8)
    heading = QLabel(title)
    set_style_kind(heading, "heading")
    column.addWidget(heading)
    return column


def _text_label(text: str) -> QLabel:
    label = QLabel(text)
    label.setWordWrap(True)
    label.setTextFormat(Qt.TextFormat.PlainText)
    set_style_kind(label, "large")
    return label
