"""What a newcomer sees first: one thing to try, and how one's own bench comes in. Shown once; again from the sheet of keys."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from app.gui.widgets.form import mark

TRY = (
    "A sine dwell on a simulated tactor: 18 frequencies in about half a minute. Nothing is connected and nothing can "
    "break. The points arrive on the model's curve, and the run is kept as a file in the folder {folder}."
)
STEPS = (
    ("tactor-bench devices", "tells what is connected to this computer."),
    ("tactor-bench bench new my-bench.toml", "writes a first bench file from it, with a comment on every line."),
    (
        "tactor-bench check --bench my-bench.toml",
        "checks the wiring with a tenth of a volt, the specimen disconnected.",
    ),
    ("tactor-bench --bench my-bench.toml", "starts with it; or open the file here:"),
)
SAFETY = (
    "0 V at the amplifier's input is −500 V on the specimen. Read docs/safety.md before a real bench is switched on."
)
PLACES = (
    "Measure (Ctrl+1) runs one protocol.  Campaign (Ctrl+2) carries a specimen through all of them.  "
    "Explore (Ctrl+3) plays with the model.  Runs (Ctrl+4) holds every run.  F1 tells every key."
)


class FirstPage(QWidget):
    """Covers the pages until somebody has chosen."""

    try_pressed = Signal()
    browse_pressed = Signal()
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        heading = QLabel("Welcome to Tactor Bench")
        mark(heading, "welcome")
        self.about = _text("")
        self.go = QPushButton("Try it on the simulated bench   (Enter)")
        self.go.setProperty("kind", "go")
        self.go.setMinimumHeight(64)
        self.go.clicked.connect(self.try_pressed)
        self.browse = QPushButton("Open a bench file …")
        self.browse.clicked.connect(self.browse_pressed)
        close = QPushButton("Not now   (Esc)")
        close.clicked.connect(self.closed)
        self.said = _text("")
        mark(self.said, "fault")
        self.said.hide()
        left, right = _panel("See it work"), _panel("Set up my bench")
        left.addWidget(self.about)
        left.addSpacing(10)
        left.addWidget(self.go)
        left.addStretch()
        right.addWidget(_text("In a terminal:"))
        steps = QGridLayout()
        steps.setHorizontalSpacing(10)
        steps.setVerticalSpacing(2)
        for at, (command, words) in enumerate(STEPS):
            steps.addWidget(QLabel(f"{at + 1}."), 2 * at, 0)
            line = QLabel(command)
            mark(line, "command")
            line.setTextInteractionFlags(
                Qt.TextInteractionFlag.TextSelectableByMouse | Qt.TextInteractionFlag.TextSelectableByKeyboard
            )
            line.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            steps.addWidget(line, 2 * at, 1)
            steps.addWidget(_text(words), 2 * at + 1, 1)
        steps.setColumnStretch(1, 1)
        right.addLayout(steps)
        right.addSpacing(8)
        right.addWidget(self.browse)
        right.addWidget(self.said)
        right.addSpacing(8)
        danger = _text(SAFETY)
        mark(danger, "danger")
        right.addWidget(danger)
        right.addStretch()
        columns = QHBoxLayout()
        columns.setSpacing(18)
        for column in (left, right):
            frame = QFrame()
            mark(frame, "panel")
            frame.setLayout(column)
            columns.addWidget(frame, 1, Qt.AlignmentFlag.AlignTop)
        below = QHBoxLayout()
        places = _text(PLACES)
        mark(places, "note-size")
        below.addWidget(places, 1)
        below.addWidget(close)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(40, 16, 40, 16)
        layout.setSpacing(14)
        layout.addWidget(heading)
        layout.addLayout(columns)
        layout.addLayout(below)
        layout.addStretch()

    def open(self, folder: str) -> None:
        """Show it."""
        self.about.setText(TRY.format(folder=folder))
        self.say("")
        self.go.setFocus()

    def say(self, words: str) -> None:
        """Why a bench file was not opened."""
        self.said.setText(words)
        self.said.setVisible(bool(words))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            (self.browse if self.browse.hasFocus() else self.go).click()
            return
        super().keyPressEvent(event)


def _panel(title: str) -> QVBoxLayout:
    column = QVBoxLayout()
    column.setContentsMargins(24, 18, 24, 18)
    column.setSpacing(8)
    heading = QLabel(title)
    mark(heading, "heading")
    column.addWidget(heading)
    return column


def _text(words: str) -> QLabel:
    label = QLabel(words)
    label.setWordWrap(True)
    label.setTextFormat(Qt.TextFormat.PlainText)
    mark(label, "large")
    return label
