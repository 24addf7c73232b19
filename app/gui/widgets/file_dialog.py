"""Asking for a file or a folder while a run may be going on: the window stays alive, and Stop stays in reach."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog, QWidget

from app.gui.widgets.actions import share_action

Mode = QFileDialog.FileMode


def choose_files(
    parent: QWidget, title: str, callback: Callable[[list[Path]], object], name_filter: str = "", start: str = "",
    mode: Mode = Mode.ExistingFile,
) -> QFileDialog:  # fmt: skip
    """Ask, and go on at once; `then` is called with what was chosen, if anything was.

    Not the system's own dialog: that one, and any that is modal, would keep the Stop key and button to itself.

    Args:
        parent: over whose window it stands.
        title: what is asked for.
        callback: takes the paths.
        name_filter: which files are listed, as Qt words it: `Runs (*.h5)`.
        start: the folder that is looked at first; with `ModalFit.AnyFile` a name, too.
        mode: one file, several, a folder, or a file that need not be there.
    """
    where = Path(start)
    dialog = QFileDialog(parent, title, str(where.parent if mode is Mode.AnyFile else where), name_filter)
    dialog.setOption(QFileDialog.Option.DontUseNativeDialog)
    dialog.setFileMode(mode)
    if mode is Mode.Directory:
        dialog.setOption(QFileDialog.Option.ShowDirsOnly)
    if mode is Mode.AnyFile:
        dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
        dialog.selectFile(where.name)
    dialog.setWindowModality(Qt.WindowModality.NonModal)
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    dialog.filesSelected.connect(lambda names: callback([Path(name) for name in names]))
    share_action(dialog, "stop")
    dialog.show()
    return dialog
