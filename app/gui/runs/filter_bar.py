"""The row above the list of runs: search, choices, how many there are, and how far a look at the folder is."""

from collections.abc import Sequence

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QLineEdit, QPushButton, QWidget

from app.archive.catalogue import Scanned
from app.archive.run_summary import Entry, Wanted, read_since

SINCE = (("any time", ""), ("today", "today"), ("7 days", "7d"), ("30 days", "30d"), ("a year", "365d"))


class _Search(QLineEdit):
    """Down and Enter go on to the list."""

    left = Signal()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Down, Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.left.emit()
            return
        super().keyPressEvent(event)


class RunFilter(QWidget):
    """Says which runs are wanted."""

    changed = Signal()
    to_list = Signal()
    stop_pressed = Signal()
    progressed = Signal(int, int)
    """How many of how many files are read; told from another thread."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.search = _Search()
        self.search.setPlaceholderText("Search: words in names, results, tags, notes   ( / )")
        self.search.setAccessibleName("search")
        self.search.setClearButtonEnabled(True)
        self.specimen, self.protocol, self.state, self.since = (QComboBox() for _ in range(4))
        for combo, words in (
            (self.specimen, "any specimen"),
            (self.protocol, "any protocol"),
            (self.state, "any status"),
        ):
            combo.addItem(words, "")
            combo.setAccessibleName(words.removeprefix("any "))
            combo.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
        for words, text in SINCE:
            self.since.addItem(words, text)
        self.since.setAccessibleName("begun")
        self.told = QLabel()
        self.told.setProperty("kind", "note")
        self.stop = QPushButton("Stop reading")
        self.stop.setProperty("kind", "choice")
        self.stop.hide()
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 2, 0, 0)
        row.setSpacing(6)
        row.addWidget(self.search, 1)
        for widget in (self.specimen, self.protocol, self.state, self.since, self.told, self.stop):
            row.addWidget(widget)
        self.search.textChanged.connect(lambda _: self.changed.emit())
        self.search.left.connect(self.to_list)
        for combo in (self.specimen, self.protocol, self.state, self.since):
            combo.currentIndexChanged.connect(lambda _: self.changed.emit())
        self.stop.clicked.connect(self.stop_pressed)
        self.progressed.connect(self._progress)
        self._count = ""

    @property
    def wanted(self) -> Wanted:
        """What the row says."""
        since = self.since.currentData()
        return Wanted(
            self.search.text(),
            self.specimen.currentData(),
            self.protocol.currentData(),
            self.state.currentData(),
            read_since(since) if since else "",
        )

    def clear(self) -> bool:
        """Want everything; whether something was filtered."""
        if self.wanted == Wanted():
            return False
        self.search.clear()
        for combo in (self.specimen, self.protocol, self.state, self.since):
            combo.setCurrentIndex(0)
        return True

    def offer(self, entries: Sequence[Entry]) -> None:
        """The choices that there are."""
        for combo, values in (
            (self.specimen, {e.specimen for e in entries}),
            (self.protocol, {e.protocol for e in entries}),
            (self.state, {str(e.state) for e in entries}),
        ):
            with QSignalBlocker(combo):
                chosen = combo.currentData()
                while combo.count() > 1:
                    combo.removeItem(combo.count() - 1)
                for value in sorted(values - {""}, key=str.casefold):
                    combo.addItem(value, value)
                combo.setCurrentIndex(max(combo.findData(chosen), 0))

    def count(self, found: int, known: int) -> None:
        """How many are shown of how many."""
        number = f"{known:,}".replace(",", " ")
        self._count = f"{number} runs" if found == known else f"{found:,}".replace(",", " ") + f" of {number} runs"
        if not self.stop.isVisible():
            self.told.setText(self._count)

    def scanned(self, scanned: Scanned) -> None:
        """The folder was looked at."""
        self.stop.hide()
        rest = "" if scanned.whole else "; reading was stopped"
        self.told.setText(f"{self._count}{rest}")
        self.told.setToolTip("\n".join(scanned.skipped))

    def _progress(self, done: int, due: int) -> None:
        if due > 20 and done < due:
            self.stop.show()
            self.told.setText(f"reading {done} of {due}")
