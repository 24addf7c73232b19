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

from app.gui.widgets.actions import shortcut_label
from app.gui.widgets.form import set_style_kind

CAMPAIGN_INTRODUCTION = (
    "A campaign is all measurements of one specimen in the paper's order, each after what it rests on. "
    "It can be stopped at any time: how it stands is read from the run files."
)
PATH_ROLE = Qt.ItemDataRole.UserRole


class CampaignStart(QWidget):
    """A form of one line, and the campaigns there are."""

    create_requested = Signal(str)
    open_requested = Signal(object)
    browse_pressed = Signal()

    def __init__(self) -> None:
        super().__init__()
        heading = QLabel("Begin a campaign")
        set_style_kind(heading, "heading")
        about = QLabel(CAMPAIGN_INTRODUCTION)
        about.setWordWrap(True)
        set_style_kind(about, "large")
        self.location_label = QLabel()
        set_style_kind(self.location_label, "note-size")
        self.location_label.setWordWrap(True)
        self.specimen_edit = QLineEdit()
        self.specimen_edit.setPlaceholderText("name of the specimen, for example T7")
        self.specimen_edit.setAccessibleName("specimen of the new campaign")
        self.specimen_edit.returnPressed.connect(self._request_create)
        self.specimen_edit.textChanged.connect(self._validate)
        self.begin_button = QPushButton("Begin   (Enter)")
        self.begin_button.setProperty("kind", "go")
        self.begin_button.clicked.connect(self._request_create)
        self.message_label = QLabel()
        self.message_label.setWordWrap(True)
        set_style_kind(self.message_label, "fault")
        self.message_label.hide()
        self.existing_label = QLabel("Or go on with one that is there")
        set_style_kind(self.existing_label, "running")
        self.campaign_list = QListWidget()
        self.campaign_list.setAccessibleName("campaigns that are there")
        self.campaign_list.setMaximumHeight(10 * self.campaign_list.fontMetrics().height())
        self.campaign_list.itemActivated.connect(lambda item: self.open_requested.emit(item.data(PATH_ROLE)))
        browse = QPushButton(shortcut_label("Open another …", "campaign.open"))
        browse.clicked.connect(self.browse_pressed)
        row = QHBoxLayout()
        row.addWidget(self.specimen_edit, 1)
        row.addWidget(self.begin_button)
        row.setSpacing(10)
        last = QHBoxLayout()
        last.addWidget(browse)
        last.addStretch()
        frame = QFrame()
        set_style_kind(frame, "panel")
        frame.setMaximumWidth(760)
        column = QVBoxLayout(frame)
        column.setContentsMargins(28, 22, 28, 22)
        column.setSpacing(10)
        for widget in (heading, about):
            column.addWidget(widget)
        column.addLayout(row)
        column.addWidget(self.message_label)
        column.addWidget(self.location_label)
        column.addSpacing(14)
        column.addWidget(self.existing_label)
        column.addWidget(self.campaign_list, 1)
        column.addLayout(last)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 10, 0, 10)
        layout.addStretch(1)
        layout.addWidget(frame, 8, Qt.AlignmentFlag.AlignTop)
        layout.addStretch(1)
        self._validate()

    def show_campaigns(self, paths: Sequence[Path], folder: Path, specimen: str, simulated: bool) -> None:
        """Show what there is, and where a new one would be."""
        kind = "Simulated runs count, real ones do not" if simulated else "Real runs count, simulated ones do not"
        self.location_label.setText(f"Kept beside the runs in {folder.absolute()}. {kind}.")
        if not self.specimen_edit.isModified():
            self.specimen_edit.setText(specimen)
        if [self.campaign_list.item(at).data(PATH_ROLE) for at in range(self.campaign_list.count())] != list(paths):
            self.campaign_list.clear()
            for path in paths:
                item = QListWidgetItem(f"{path.name.removesuffix('.campaign.json')}      {path.parent}")
                item.setData(PATH_ROLE, path)
                self.campaign_list.addItem(item)
            self.campaign_list.setCurrentRow(0)
        for widget in (self.existing_label, self.campaign_list):
            widget.setVisible(bool(paths))

    def show_message(self, text: str) -> None:
        """Why something was not done."""
        self.message_label.setText(text)
        self.message_label.setVisible(bool(text))

    def _request_create(self) -> None:
        if self.begin_button.isEnabled():
            self.create_requested.emit(self.specimen_edit.text().strip())

    def _validate(self) -> None:
        self.begin_button.setEnabled(bool(self.specimen_edit.text().strip()))
