"""What shall be measured, on what, and where it is kept: the form, specimen and folder, the rehearsal, and Run."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QFileDialog,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QScrollArea,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from app.gui.form import Form, mark
from app.view import View, volts_between
from app.words import duration, size
from drivers.amplifier import HvAmplifier
from drivers.errors import BenchError
from protocols.protocol import Protocol
from protocols.rehearsal import rehearse

GetAmplifier = Callable[[], HvAmplifier | None]


class RunPanel(QWidget):
    """The left side of the measuring page.

    Args:
        amplifier: the guard that the rehearsal asks; None while there is no bench.
    """

    run_pressed = Signal()
    changed = Signal()

    def __init__(self, protocol: Protocol, amplifier: GetAmplifier, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._amplifier = amplifier
        self._defaults = type(protocol).model_validate({})
        self._can_run, self._why = False, ""
        self._rehearsed: tuple[object, ...] = ()
        self._told = ("", False)
        self.form = Form(protocol)
        self.specimen, self.folder = QLineEdit(), QLineEdit()
        self.rehearsal = QLabel()
        self.rehearsal.setWordWrap(True)
        self.rehearsal.setTextFormat(Qt.TextFormat.PlainText)
        self.run = QPushButton("Run   (F5 or Ctrl+R)")
        self.run.setProperty("kind", "go")
        self.defaults = QPushButton("Defaults")
        self.defaults.setToolTip("The values of the paper")
        self._browse = QToolButton()
        self._build(type(protocol).title)
        self.form.changed.connect(self._edited)
        self.defaults.clicked.connect(lambda: self.form.set(self._defaults))
        self.run.clicked.connect(self.run_pressed)
        self._browse.clicked.connect(self._choose_folder)
        self.specimen.textChanged.connect(self._edited)
        self.folder.textChanged.connect(self._edited)

    @property
    def protocol(self) -> Protocol | None:
        """What the form says, None while it is faulty."""
        return self.form.checked.protocol

    @property
    def ready(self) -> bool:
        """Whether Run would begin something."""
        return self.run.isEnabled()

    def show_view(self, view: View) -> None:
        """Whether a run may begin, and why not."""
        for editor in (self.form, self.specimen, self.folder, self._browse, self.defaults):
            editor.setEnabled(not view.busy)
        self._can_run = view.can_run
        self._why = (
            "a run is going on"
            if view.busy
            else "read and acknowledge the message first"
            if view.unsafe
            else "there is no bench"
            if not view.connected
            else ""
        )
        self._judge()

    def _edited(self) -> None:
        self._judge()
        self.changed.emit()

    def _judge(self) -> None:
        """Rehearse what the form says, and allow Run or not."""
        about = (self.form.checked, self._amplifier())
        if about != self._rehearsed:
            self._rehearsed, self._told = about, self._rehearse()
        words, fault = self._told
        self.rehearsal.setText(words)
        mark(self.rehearsal, "fault" if fault else "")
        missing = "" if self.folder.text().strip() else "a folder is needed"
        why = self._why or missing or ("the form has a fault" if fault or self.protocol is None else "")
        self.run.setEnabled(self._can_run and not why)
        self.run.setToolTip(f"Cannot run: {why}" if why else "Begin the run: F5 or Ctrl+R")

    def _rehearse(self) -> tuple[str, bool]:
        """Duration, points, volts and file size, or why it cannot be; whether it is a fault."""
        protocol = self.protocol
        if protocol is None:
            words = self.form.checked.faults.get("", "") or "Correct the field marked above."
            return f"✕ {words}", True
        amplifier = self._amplifier()
        if amplifier is None:
            return "Duration, volts and file size are told when the bench is there.", False
        try:
            told = rehearse(protocol, amplifier)
        except BenchError as refusal:
            return f"✕ {refusal}", True
        entries = "1 point" if told.entries == 1 else f"{told.entries} points"
        return (
            f"{entries}, about {duration(told.duration_s)}, "
            f"{volts_between(told.lowest_specimen_v, told.highest_specimen_v)} on the specimen, "
            f"file about {size(told.file_bytes)}. Closest to a limit: {told.worst}."
        ), False

    def _choose_folder(self) -> None:
        chosen = QFileDialog.getExistingDirectory(self, "Folder for run files", self.folder.text())
        if chosen:
            self.folder.setText(str(Path(chosen)))

    def _build(self, title: str) -> None:
        heading = QLabel(title)
        heading.setProperty("kind", "heading")
        top = QHBoxLayout()
        top.addWidget(heading, 1)
        top.addWidget(self.defaults)
        scroll = QScrollArea()
        scroll.setWidget(self.form)
        scroll.setWidgetResizable(True)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setFrameShape(QFrame.Shape.NoFrame)
        scroll.setMinimumHeight(60)
        scroll.viewport().setAutoFillBackground(False)
        self.form.setAutoFillBackground(False)
        self._browse.setText("…")
        self._browse.setToolTip("Choose the folder")
        self._browse.setAccessibleName("choose the folder")
        self.specimen.setToolTip("Name of the specimen, written into the run file and its name")
        self.folder.setToolTip("Where run files are kept")
        where = QGridLayout()
        where.setHorizontalSpacing(8)
        where.setVerticalSpacing(4)
        for at, (words, editor) in enumerate((("specimen", self.specimen), ("folder", self.folder))):
            label = QLabel(words)
            label.setBuddy(editor)
            editor.setAccessibleName(words)
            where.addWidget(label, at, 0)
            where.addWidget(editor, at, 1)
        where.addWidget(self._browse, 1, 2)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 2, 8, 0)
        layout.setSpacing(8)
        layout.addLayout(top)
        layout.addWidget(scroll, 1)
        layout.addLayout(where)
        layout.addWidget(self.rehearsal)
        layout.addWidget(self.run)
