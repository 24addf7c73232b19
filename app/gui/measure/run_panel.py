"""What shall be measured, on what, and where it is kept: the form, specimen and folder, the rehearsal, and Run."""

from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import (
    QComboBox,
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

from app.common.formatting import counted, duration, size
from app.gui.measure.estimates_panel import EstimatesPanel
from app.gui.measure.presets import PresetButton, Presets
from app.gui.widgets.form import Form, mark
from app.gui.widgets.theme import Theme
from app.session.state import View, volts_between
from drivers.bench.bench import Bench
from drivers.errors import BenchError
from protocols.base.protocol import Protocol
from protocols.registry import PROTOCOLS
from protocols.rehearsal import rehearse

GetBench = Callable[[], Bench | None]


class RunPanel(QWidget):
    """The left side of the measuring page.

    Args:
        protocol: fills the form at first.
        bench: what the rehearsal asks; None while there is no bench.
        presets: the lab's own sets of parameters.
    """

    run_pressed = Signal()
    changed = Signal()

    def __init__(
        self,
        protocol: Protocol,
        bench: GetBench,
        presets: Presets,
        theme: Theme,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self._bench = bench
        self._texts: dict[str, Protocol] = {}
        """What the forms of the other protocols said last."""
        self._can_run, self._why = False, ""
        self._rehearsed: tuple[object, ...] = ()
        self._told = ("", False)
        self.form = Form(protocol)
        self.choice = QComboBox()
        self.choice.setToolTip("What to measure")
        self.choice.setAccessibleName("protocol")
        for name in PROTOCOLS:
            self.choice.addItem(PROTOCOLS.title(name), name)
        self.choice.setCurrentIndex(self.choice.findData(protocol.name))
        self.about = QLabel(about(type(protocol)))
        self.about.setWordWrap(True)
        mark(self.about, "note")
        self.specimen, self.folder = QLineEdit(), QLineEdit()
        self.rehearsal = QLabel()
        self.rehearsal.setWordWrap(True)
        self.rehearsal.setTextFormat(Qt.TextFormat.PlainText)
        self.cautions = QLabel()
        self.cautions.setWordWrap(True)
        self.cautions.setTextFormat(Qt.TextFormat.PlainText)
        mark(self.cautions, "caution")
        self.cautions.hide()
        self.told = EstimatesPanel(theme)
        self.run = QPushButton("Run   (F5 or Ctrl+R)")
        self.run.setProperty("kind", "go")
        self.presets = PresetButton(presets)
        self._browse = QToolButton()
        self._scroll = QScrollArea()
        self._build()
        self.form.changed.connect(self._edited)
        self.choice.currentIndexChanged.connect(self._chosen)
        self.presets.taken.connect(self.fill)
        self.presets.show_for(type(protocol), lambda: self.protocol)
        self.run.clicked.connect(self.run_pressed)
        self._browse.clicked.connect(self._choose_folder)
        self.specimen.textChanged.connect(self._edited)
        self.folder.textChanged.connect(self._edited)

    @property
    def protocol(self) -> Protocol | None:
        """What the form says, None while it is faulty."""
        return self.form.checked.protocol

    @property
    def kind(self) -> type[Protocol]:
        """Which protocol the form is of."""
        return self.form.kind

    def fill(self, protocol: Protocol) -> None:
        """Show a protocol and its parameters."""
        if type(protocol) is self.form.kind:
            self.form.set(protocol)
            return
        if (present := self.protocol) is not None:
            self._texts[present.name] = present
        self.form = Form(protocol)
        self.form.setAutoFillBackground(False)
        self._scroll.setWidget(self.form)  # deletes the form before
        self.form.changed.connect(self._edited)
        self.about.setText(about(type(protocol)))
        self.presets.show_for(type(protocol), lambda: self.protocol)
        with QSignalBlocker(self.choice):
            self.choice.setCurrentIndex(self.choice.findData(protocol.name))
        self._edited()

    def _chosen(self) -> None:
        name = self.choice.currentData()
        self.fill(self._texts.get(name) or PROTOCOLS[name].model_validate({}))

    @property
    def ready(self) -> bool:
        """Whether Run would begin something."""
        return self.run.isEnabled()

    def show_view(self, view: View) -> None:
        """Whether a run may begin, and why not."""
        for editor in (self.form, self.choice, self.specimen, self.folder, self._browse, self.presets):
            editor.setEnabled(not view.busy)
        self.rehearsal.setVisible(not view.busy)
        self.told.allow(view.busy)
        self._can_run = view.can_run
        self._why = view.why_not
        self._judge()

    def show_cautions(self, words: Sequence[str]) -> None:
        """What is foreseen to go wrong with what the form says."""
        text = "\n".join(f"⚠ {each}." for each in words)
        if text != self.cautions.text():
            self.cautions.setText(text)
            self.cautions.setVisible(bool(words))

    def _edited(self) -> None:
        self._judge()
        self.changed.emit()

    def _judge(self) -> None:
        """Rehearse what the form says, and allow Run or not."""
        about = (self.form.checked, self._bench())
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
        bench = self._bench()
        if bench is None:
            return "Duration, volts and file size are told when the bench is there.", False
        try:
            told = rehearse(protocol, bench.amplifier)
        except BenchError as refusal:
            return f"✕ {refusal}", True
        entries = counted(told.entries, "point")
        prompts = counted(told.prompts, "prompt")
        return (
            f"{entries}, {prompts}, about {duration(told.duration_s)}, "
            f"{volts_between(told.lowest_specimen_v, told.highest_specimen_v)} on the specimen, "
            f"file about {size(told.file_bytes)}. Closest to a limit: {told.worst}."
        ), False

    def _choose_folder(self) -> None:
        chosen = QFileDialog.getExistingDirectory(self, "Folder for run files", self.folder.text())
        if chosen:
            self.folder.setText(str(Path(chosen)))

    def _build(self) -> None:
        mark(self.choice, "heading")
        top = QHBoxLayout()
        top.addWidget(self.choice, 1)
        top.addWidget(self.presets)
        scroll = self._scroll
        scroll.setWidget(self.form)
        scroll.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        scroll.setWidgetResizable(True)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setFrameShape(QFrame.Shape.NoFrame)
        scroll.setMinimumHeight(40)
        scroll.viewport().setAutoFillBackground(False)
        self.form.setAutoFillBackground(False)
        self._browse.setText("…")
        mark(self._browse, "tool")
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
        layout.addWidget(self.about)
        layout.addWidget(scroll, 1)
        layout.addLayout(where)
        layout.addWidget(self.rehearsal)
        layout.addWidget(self.cautions)
        layout.addWidget(self.told)
        layout.addWidget(self.run)


def about(kind: type[Protocol]) -> str:
    """The first sentence a protocol says of itself."""
    return " ".join((kind.__doc__ or "").strip().split("\n\n")[0].split())
