"""Differences between selected runs in settings, conditions, instruments and results; rows with equal values are folded."""

from collections.abc import Sequence

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QHeaderView, QWidget

from app.archive import RunSummary, compare_runs
from app.common import sentence_case
from app.comparison import LETTERS, MAX_RUNS
from app.gui.face import follow_tokens
from app.gui.plots import color_of, curve_tone
from app.gui.widgets import Segments, column, fill_table, fit_to_rows, make_label, make_read_only_table, row


class DifferencesPane(QWidget):
    """Table of runs side by side, hidden for one run and for more than `most`."""

    def __init__(self, most: int = MAX_RUNS) -> None:
        super().__init__()
        self._most = most
        self._runs: tuple[RunSummary, ...] = ()
        self.segments = Segments("runs.differences", "rows", (("Differences", False), ("All", True)))
        self.segments.select(False)
        self.table = make_read_only_table((), "runs.differences-table", "what differs", stretched="none", wordWrap=True)
        self.table.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.note_label = make_label(kind="note", name="runs.differences-note")
        heading = make_label("What differs", "caption", wrap=False)
        column(row(heading, None, self.segments), self.table, self.note_label, parent=self, spacing=4)
        self.segments.chosen.connect(lambda _: self._fill())
        self.hide()
        follow_tokens(self, lambda _: self._fill())

    def show_runs(self, runs: Sequence[RunSummary]) -> None:
        """Compare runs, in the order of the list."""
        self.setVisible(1 < len(runs) <= self._most)
        if tuple(runs) != self._runs:
            self._runs = tuple(runs)
            self._fill()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        fit_to_rows(self.table)

    def _fill(self) -> None:
        if self.isHidden():
            return
        rows = compare_runs(self._runs)
        differing = [each for each in rows if not each.is_equal]
        shown = rows if self.segments.selected else differing
        self.segments.buttons[False].setText(f"Differences, {len(differing)}")
        self.segments.buttons[True].setText(f"All, {len(rows)}")
        letters = LETTERS[: len(self._runs)]
        last = ("Difference",) if any(each.difference for each in shown) else ()
        titles = ("", *letters, *last)
        self.table.setColumnCount(len(titles))
        self.table.setHorizontalHeaderLabels(titles)
        self.table.horizontalHeader().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        colors = ["", *(color_of(curve_tone(at)).name() for at in range(len(letters))), ""]
        fill_table(
            self.table,
            [(sentence_case(each.name), *each.values, *([each.difference] if last else ())) for each in shown],
            lambda _row, place: colors[place],
            right_aligned=range(1, len(titles)),
        )
        fit_to_rows(self.table)
        same = len(rows) - len(differing)
        self.note_label.setText(
            f"{same} settings and results are equal; σ: statistical standard uncertainty of the difference"
        )
