"""Start pane of the Campaign page: creates a campaign or opens an existing one."""

from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QListWidget, QListWidgetItem, QWidget

from app.gui.widgets import ACTIONS, StatusLine, configure, make_button, make_label, make_line_edit, make_panel, row

CAMPAIGN_INTRODUCTION = (
    "A campaign is all measurements of one specimen in the paper's order, each after the measurements it depends on. "
    "It can be stopped at any time: its status is read from the run files."
)
PATH_ROLE = Qt.ItemDataRole.UserRole


class CampaignStart(QWidget):
    """Specimen field for a new campaign, and a list of existing ones; `browse` chooses another file."""

    create_requested = Signal(str)
    open_requested = Signal(object)

    def __init__(self, browse: Callable[[], object]) -> None:
        super().__init__()
        self.location_label = make_label(kind="note-size")
        self.specimen_edit = make_line_edit(
            "campaign.specimen", "specimen of the new campaign", placeholderText="name of the specimen, for example T7"
        )
        self.setFocusProxy(self.specimen_edit)
        self.specimen_edit.returnPressed.connect(self._request_create)
        self.specimen_edit.textChanged.connect(self._validate)
        self.begin_button = make_button("Begin", self._request_create, "go", name="campaign.begin", key="Enter")
        self.message_label = configure(StatusLine(), "campaign.start-message")
        self.existing_label = make_label("Or open an existing one", "running", wrap=False)
        self.campaign_list = configure(QListWidget(), "campaign.list", accessibleName="campaigns that are there")
        self.campaign_list.setMaximumHeight(10 * self.campaign_list.fontMetrics().height())
        self.campaign_list.itemActivated.connect(lambda item: self.open_requested.emit(item.data(PATH_ROLE)))
        another = make_button("Open another …", browse, name="campaign.browse", key=ACTIONS["campaign.open"].shortcut)
        panel = make_panel(
            make_label("Begin a campaign", "heading", wrap=False),
            make_label(CAMPAIGN_INTRODUCTION, "large"),
            row((self.specimen_edit, 1), self.begin_button, spacing=10),
            self.message_label,
            self.location_label,
            14,
            self.existing_label,
            (self.campaign_list, 1),
            row(another, None),
            margins=(28, 22, 28, 22),
            spacing=10,
        )
        panel.setMaximumWidth(760)
        layout = row((panel, 8, Qt.AlignmentFlag.AlignTop), parent=self, margins=(0, 10, 0, 10))
        layout.insertStretch(0, 1)
        layout.addStretch(1)
        self._validate()

    def show_campaigns(self, paths: Sequence[Path], folder: Path, specimen: str, simulated: bool) -> None:
        """Show the existing campaigns and the folder of a new one."""
        kind = "Only simulated runs are part of it" if simulated else "Only real runs are part of it"
        self.location_label.setText(f"Stored with the runs in {folder.absolute()}. {kind}.")
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

    def _request_create(self) -> None:
        if self.begin_button.isEnabled():
            self.create_requested.emit(self.specimen_edit.text().strip())

    def _validate(self) -> None:
        self.begin_button.setEnabled(bool(self.specimen_edit.text().strip()))
