"""Where no campaign is open: begin one of a specimen, or go on with one that is there."""

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from app.gui.widgets.form import mark

ABOUT = (
    "A campaign is all measurements of one specimen in the paper's order, each after what it rests on. "
    "It can be stopped at any time: how it stands is read from the run files."
)
PATH = Qt.ItemDataRole.UserRole


class CampaignStart(QWidget):
    """A form of one line, and the campaigns there are."""

    begun = Signal(str)
    opened = Signal(object)
    browse_pressed = Signal()

    def __init__(self) -> None:
        super().__init__()
        heading = QLabel("Begin a campaign")
        mark(heading, "heading")
        about = QLabel(ABOUT)
        about.setWordWrap(True)
        mark(about, "large")
        self.where = QLabel()
        mark(self.where, "note-size")
        self.where.setWordWrap(True)
        self.specimen = QLineEdit()
        self.specimen.setPlaceholderText("name of the specimen, for example T7")
        self.specimen.setAccessibleName("specimen of the new campaign")
        self.specimen.returnPressed.connect(self._begin)
        self.specimen.textChanged.connect(self._judge)
        self.begin = QPushButton("Begin   (Enter)")
        self.begin.setProperty("kind", "go")
        self.begin.clicked.connect(self._begin)
        self.said = QLabel()
        self.said.setWordWrap(True)
        mark(self.said, "fault")
        self.said.hide()
        self.there = QLabel("Or go on with one that is there")
        mark(self.there, "running")
        self.list = QListWidget()
        self.list.setAccessibleName("campaigns that are there")
        self.list.setMaximumHeight(10 * self.list.fontMetrics().height())
        self.list.itemActivated.connect(lambda item: self.opened.emit(item.data(PATH)))
        browse = QPushButton("Open another …   (Ctrl+O)")
        browse.clicked.connect(self.browse_pressed)
        row = QHBoxLayout()
        row.addWidget(self.specimen, 1)
        row.addWidget(self.begin)
        row.setSpacing(10)
        last = QHBoxLayout()
        last.addWidget(browse)
        last.addStretch()
        frame = QFrame()
        mark(frame, "panel")
        frame.setMaximumWidth(760)
        column = QVBoxLayout(frame)
        column.setContentsMargins(28, 22, 28, 22)
        column.setSpacing(10)
        for widget in (heading, about):
            column.addWidget(widget)
        column.addLayout(row)
        column.addWidget(self.said)
        column.addWidget(self.where)
        column.addSpacing(14)
        column.addWidget(self.there)
        column.addWidget(self.list, 1)
        column.addLayout(last)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 10, 0, 10)
        layout.addStretch(1)
        layout.addWidget(frame, 8, Qt.AlignmentFlag.AlignTop)
        layout.addStretch(1)
        self._judge()

    def offer(self, paths: Sequence[Path], folder: Path, specimen: str, simulated: bool) -> None:
        """Show what there is, and where a new one would be."""
        kind = "Simulated runs count, real ones do not" if simulated else "Real runs count, simulated ones do not"
        self.where.setText(f"Kept beside the runs in {folder.absolute()}. {kind}.")
        if not self.specimen.isModified():
            self.specimen.setText(specimen)
        if [self.list.item(at).data(PATH) for at in range(self.list.count())] != list(paths):
            self.list.clear()
            for path in paths:
                item = QListWidgetItem(f"{path.name.removesuffix('.campaign.json')}      {path.parent}")
                item.setData(PATH, path)
                self.list.addItem(item)
            self.list.setCurrentRow(0)
        for widget in (self.there, self.list):
            widget.setVisible(bool(paths))

    def say(self, words: str) -> None:
        """Why something was not done."""
        self.said.setText(words)
        self.said.setVisible(bool(words))

    def _begin(self) -> None:
        if self.begin.isEnabled():
            self.begun.emit(self.specimen.text().strip())

    def _judge(self) -> None:
        self.begin.setEnabled(bool(self.specimen.text().strip()))
