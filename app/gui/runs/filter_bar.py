"""Filter bar above the list of runs: search, choices, count and scan progress."""

from collections.abc import Sequence
from functools import partial

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QComboBox, QLineEdit, QWidget

from app.archive import FIELDS, RunFilter, RunSummary, ScanResult, Term, read_query, read_since
from app.gui.widgets import (
    clear_layout,
    column,
    configure,
    fill_combo,
    make_button,
    make_combo,
    make_label,
    make_pane,
    row,
)
from app.session import protocol_title

SINCE = (("any time", ""), ("today", "today"), ("7 days", "7d"), ("30 days", "30d"), ("a year", "365d"))


class RunFilterBar(QWidget):
    """Search field and combo boxes that filter the list of runs."""

    changed = Signal()
    list_requested = Signal()
    stop_pressed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.search_edit = configure(
            QLineEdit(),
            "runs.search",
            placeholderText="Words, or specimen:T2  tag:reference  after:2026-10  sensor:LK",
            accessibleName="search",
            toolTip=f"Beginnings of words in specimen, tags, results and notes; or fields: {', '.join(FIELDS)}",
            clearButtonEnabled=True,
        )
        self.specimen, self.protocol, self.verdict = (
            make_combo(
                f"runs.{name}",
                name,
                [(f"any {name}", "")],
                sizeAdjustPolicy=QComboBox.SizeAdjustPolicy.AdjustToContents,
            )
            for name in ("specimen", "protocol", "verdict")
        )
        self.since = make_combo("runs.since", "begun", SINCE)
        self._combos = (self.specimen, self.protocol, self.verdict, self.since)
        self.count_label = make_label(kind="note", wrap=False, name="runs.count")
        self.stop_button = make_button(
            "Stop reading", self.stop_pressed.emit, "choice", name="runs.stop-reading", visible=False
        )
        shown = (*self._combos, self.count_label, self.stop_button)
        self._chip_row = row(None, spacing=6)
        self.chips = make_pane(self._chip_row)
        """The fields of the search, each with a button that takes it away."""
        self.chips.hide()
        self._chip_terms: list[Term] = []
        column(row((self.search_edit, 1), *shown, spacing=6), self.chips, parent=self, margins=(0, 2, 0, 0), spacing=6)
        self.search_edit.textChanged.connect(self._show_chips)
        self.search_edit.textChanged.connect(lambda _: self.changed.emit())
        for combo in self._combos:
            combo.currentIndexChanged.connect(lambda _: self.changed.emit())
        self._count_text = ""

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Move from the search field to the list with Down and Enter, which the field does not use."""
        if self.search_edit.hasFocus() and event.key() in (Qt.Key.Key_Down, Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.list_requested.emit()
        else:
            super().keyPressEvent(event)

    @property
    def selected_filter(self) -> RunFilter:
        """The selected filter."""
        since = self.since.currentData()
        return RunFilter(
            self.search_edit.text(),
            self.specimen.currentData(),
            self.protocol.currentData(),
            since=read_since(since) if since else "",
            verdict=self.verdict.currentData(),
        )

    def _show_chips(self, text: str) -> None:
        try:
            terms = read_query(text)
        except ValueError:  # `show_mistake` reports it
            return
        fields = [term for term in terms if term.field]
        if fields == self._chip_terms:
            return
        self._chip_terms = fields
        clear_layout(self._chip_row)
        for at, term in enumerate(fields):
            button = make_button(
                f"{term.field}: {term.value} ×", partial(self._drop, term), "choice", name=f"runs.chip.{at}"
            )
            button.setToolTip("Take this field out of the search")
            self._chip_row.addWidget(button)
        self._chip_row.addStretch(1)
        self.chips.setVisible(bool(fields))

    def _drop(self, dropped: Term) -> None:
        terms = read_query(self.search_edit.text())
        terms.remove(dropped)
        self.search_edit.setText(" ".join(map(str, terms)))
        self.search_edit.setFocus()

    def show_mistake(self, text: str) -> None:
        """Show what is wrong with the search; the list stays as it was."""
        self.count_label.setText(text.partition(";")[0])
        self.count_label.setToolTip(text)

    def clear(self) -> bool:
        """Clear the filter and return whether there was one."""
        if self.selected_filter == RunFilter():
            return False
        self.search_edit.clear()
        for combo in self._combos:
            combo.setCurrentIndex(0)
        return True

    def set_choices(self, summaries: Sequence[RunSummary]) -> None:
        """Fill the combo boxes with the values of these runs."""
        for combo, values in (
            (self.specimen, {e.specimen for e in summaries}),
            (self.protocol, {e.protocol for e in summaries}),
            (self.verdict, {word for e in summaries for word in e.verdict_text.split(", ")}),
        ):
            name = protocol_title if combo is self.protocol else str
            offered = ((name(value), value) for value in sorted(values - {""}, key=str.casefold))
            fill_combo(combo, [(f"any {combo.accessibleName()}", ""), *offered])

    def show_count(self, shown: int, total: int) -> None:
        """Show the number of listed runs and the total."""
        some = f"{shown:,} of " if shown != total else ""
        self._count_text = f"{some}{total:,} runs".replace(",", " ")
        if not self.stop_button.isVisible():
            self.count_label.setText(self._count_text)
            self.count_label.setToolTip("")

    def show_scan_result(self, result: ScanResult) -> None:
        """Show the result of a folder scan."""
        self.stop_button.hide()
        self.count_label.setText(f"{self._count_text}{'' if result.complete else '; reading was stopped'}")
        self.count_label.setToolTip("\n".join(result.skipped))

    def show_progress(self, fraction: float, text: str) -> None:
        """Show how far a scan is."""
        if text and fraction < 1:
            self.stop_button.show()
            self.count_label.setText(text)
