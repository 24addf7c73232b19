"""Settings of the main window, as the settings page lists them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QCheckBox, QLineEdit

from app.gui.remote import RemoteController
from app.gui.status import NOTICE_KEY, SOUND_KEY, Notifier
from app.gui.widgets import APPEARANCES, configure, make_combo

if TYPE_CHECKING:
    from app.gui.help import Setting
    from app.gui.measure import RunPanel

NOTIFICATIONS = (
    (SOUND_KEY, "Sound", "When the operator is needed, a run has ended, or the bench is unsafe"),
    (NOTICE_KEY, "Notices of the desktop", "The same as text, while another window is in front; unsafe always"),
)


def make_settings(
    appearance_name: str,
    set_appearance: Callable[[str], object],
    panel: RunPanel,
    is_busy: Callable[[], bool],
    notifier: Notifier,
    remote: RemoteController,
) -> list[Setting]:
    """Return the settings of the settings page.

    Args:
        appearance_name: the present one of `APPEARANCES`.
        set_appearance: applies another one.
        panel: has the fields for folder and specimen.
        is_busy: returns whether a run is in progress, during which these are not changed.
        notifier: plays sounds and shows notices.
        remote: serves the web page.
    """
    from app.gui.help import Setting
    from app.gui.remote import DESCRIPTION, RemoteSetting

    choices = ((text, name) for name, text in APPEARANCES.items())
    appearance = make_combo("settings.appearance", "", choices)
    appearance.setCurrentIndex(max(appearance.findData(appearance_name), 0))
    appearance.currentIndexChanged.connect(lambda _: set_appearance(appearance.currentData()))
    fields = []
    for name, edit in (("folder", panel.folder_edit), ("specimen", panel.specimen_edit)):
        copy = configure(QLineEdit(edit.text()), f"settings.{name}")
        copy.editingFinished.connect(lambda copy=copy, edit=edit: is_busy() or edit.setText(copy.text()))
        edit.textChanged.connect(copy.setText)
        fields.append(copy)
    notifications = []
    for key, title, about in NOTIFICATIONS:
        box = configure(QCheckBox("on"), f"settings.{key}", checked=notifier.is_on(key))
        box.toggled.connect(lambda on, key=key: notifier.switch(key, on))
        notifications.append(Setting(title, box, about))
    return [
        Setting("Appearance", appearance, "Light colours, dark colours, or the system's"),
        Setting("Folder for run files", fields[0], "Where runs are written, and which runs are listed"),
        Setting("Specimen", fields[1], "Name that is written into new runs"),
        *notifications,
        Setting("Web page", RemoteSetting(remote), DESCRIPTION),
    ]
