"""Non-modal dialog for files and folders that leaves the Stop key in reach."""

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
    """Open a dialog and return immediately; `callback` is called with the chosen paths, if any.

    Not the system's dialog and not modal: either would block the Stop key and button.

    Args:
        parent: parent of the dialog.
        title: title of the dialog.
        callback: called with the paths.
        name_filter: which files are listed, in Qt's syntax: `Runs (*.h5)`.
        start: the initial folder; with `Mode.AnyFile` also a file name.
        mode: one file, several, a folder, or a file that need not exist.
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


def choose_file(
    parent: QWidget, title: str, callback: Callable[[Path], object], name_filter: str = "", start: str = "",
    mode: Mode = Mode.ExistingFile,
) -> QFileDialog:  # fmt: skip
    """Open a dialog for one path; as `choose_files`."""
    return choose_files(parent, title, lambda paths: callback(paths[0]), name_filter, start, mode)
