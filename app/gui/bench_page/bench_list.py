"""List of benches: the simulated ones, the user's bench files, and a new one."""

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QAbstractItemView, QListWidget, QListWidgetItem, QWidget

from app.gui.widgets import choose_files, column, configure, make_button, make_label

SIMULATED = (("sim", "Simulated bench"), ("ideal", "Simulated, ideal"))


class BenchList(QWidget):
    """The benches; selecting one shows it, and does not connect to it."""

    selected = Signal(str)
    """Path of a bench file, or name of a simulated bench."""
    new_pressed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.list = configure(
            QListWidget(),
            "bench.list",
            accessibleName="benches",
            selectionMode=QAbstractItemView.SelectionMode.SingleSelection,
            minimumHeight=90,
            horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff,
        )
        new = make_button("New bench", self.new_pressed.emit, tip="Begin the file of another bench", name="bench.new")
        browse = make_button("Open a file …", self._browse, tip="A bench file from elsewhere", name="bench.browse")
        column(make_label("Benches", "heading", wrap=False), (self.list, 1), new, browse, parent=self)
        self.list.currentItemChanged.connect(self._on_current)

    def show_benches(self, files: Sequence[Path], current: str, open_bench: str) -> None:
        """List the benches; `current` is selected without being announced, and `open_bench` marked."""
        named = [*SIMULATED, *((str(path), path.stem) for path in files)]
        if current and current not in dict(named):
            named.append((current, Path(current).stem))
        if not current:
            named.append(("", "new bench"))
        self.list.blockSignals(True)
        self.list.clear()
        for name, title in named:
            item = QListWidgetItem(f"{title}  (open)" if name == open_bench else title)
            item.setData(Qt.ItemDataRole.UserRole, name)
            item.setToolTip(name)
            self.list.addItem(item)
            if name == current:
                self.list.setCurrentItem(item)
        self.list.blockSignals(False)

    def _on_current(self, item: QListWidgetItem | None) -> None:
        if item is not None and (name := item.data(Qt.ItemDataRole.UserRole)):
            self.selected.emit(name)

    def _browse(self) -> None:
        choose_files(self, "Open a bench file", lambda paths: self.selected.emit(str(paths[0])), "Bench files (*.toml)")
