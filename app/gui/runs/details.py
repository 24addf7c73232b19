"""Details of the selected runs: plot, results, tags, note, export."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from textwrap import shorten
from typing import Any

from PySide6.QtCore import QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QFocusEvent
from PySide6.QtWidgets import QLabel, QPlainTextEdit, QWidget

from app.archive import FORMAT_NAMES, FORMATS, LoadedRun, RunSummary
from app.common import typeset
from app.comparison import Comparison
from app.gui.plots import ResultPlots
from app.gui.results import ResultCard
from app.gui.runs.compare import ComparisonPlot, DifferencesPane
from app.gui.runs.folder_model import RunFolderModel
from app.gui.widgets import (
    SELECTABLE,
    UPRIGHT,
    Menu,
    ProgressRow,
    column,
    configure,
    give_menu,
    grid,
    make_button,
    make_label,
    make_line_edit,
    make_scroll_area,
    row,
    set_style_kind,
    show_text,
    tooltip,
)
from app.session import protocol_title
from protocols import PROTOCOLS
from protocols.base import RunEnded, RunStatus

EMPTY_TEXT = "No run is listed.\n\nRun files and tables can be dropped here; the folder is set on the Measure page."
NO_MATCH_TEXT = "No run matches the search."
READING_TEXT = "The runs of the folder are being read …"
MIN_PLOT_WIDTH, MIN_PLOT_HEIGHT = 320, 160
MAX_SIDE_BY_SIDE = 3
"""Runs whose differences fit beside the list; more are in the comparison."""
MAX_REASON_LENGTH = 280
"""Characters of the reasons of a run's verdict that are shown next to the list."""


class _Low:
    """Prefers its least height: the pane scrolls only where that has no room."""

    def sizeHint(self) -> QSize:
        return QSize(MIN_PLOT_WIDTH, MIN_PLOT_HEIGHT)


class _LowComparisonPlot(_Low, ComparisonPlot): ...


class _LowResultPlots(_Low, ResultPlots): ...


class _NoteEdit(QPlainTextEdit):
    """Note editor that emits a signal when it loses the focus."""

    focus_lost = Signal()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        super().focusOutEvent(event)
        self.focus_lost.emit()


class RunDetailsPane(QWidget):
    """Shows the selected runs of a folder; tags and note are saved when their field loses the focus."""

    notes_changed = Signal(str, str)
    export_pressed = Signal(str)

    def __init__(self, folder_model: RunFolderModel) -> None:
        super().__init__()
        self._folder_model = folder_model
        self._saved_notes, self._run_path, self._people = ("", ""), "", ""
        self.heading = make_label(kind="caption", name="runs.heading")
        links: dict[str, Any] = {"textFormat": Qt.TextFormat.AutoText, "openExternalLinks": True}
        self.message_label = make_label(name="runs.message", visible=False, **links)
        self.facts_label = make_label(name="runs.facts", textInteractionFlags=SELECTABLE)
        self.card = ResultCard("runs.card", ("next", "report"))
        """Of a single selected run."""
        self.differences = DifferencesPane(MAX_SIDE_BY_SIDE)
        self.progress_row = ProgressRow("transfers")
        self.plot = configure(_LowComparisonPlot(), "runs.plot", minimumHeight=MIN_PLOT_HEIGHT)
        self.empty_label = make_label(kind="note-size", name="runs.empty", alignment=Qt.AlignmentFlag.AlignCenter)
        self.clear_button = make_button("Clear the search", None, "choice", name="runs.clear", key="Esc", visible=False)
        self.tags_edit = make_line_edit("runs.tags", "tags", placeholderText="good, second try")
        self.note_edit = configure(_NoteEdit(), "runs.note", accessibleName="note", tabChangesFocus=True)
        self.note_edit.setMaximumHeight(3 * self.note_edit.fontMetrics().lineSpacing() + 14)
        self.tags_edit.editingFinished.connect(self._save_notes)
        self.note_edit.focus_lost.connect(self._save_notes)
        self.open_button, self.continue_button, self.explore_button = (
            make_button(text, None, "choice", tip, f"runs.{name}")
            for text, tip, name in (
                ("Open", "Enter", "open"),
                ("Continue", tooltip("runs.continue"), "continue-button"),
                ("Explore", tooltip("runs.explore"), "explore"),
            )
        )
        self.result_plots = configure(_LowResultPlots(), "runs.result", minimumHeight=MIN_PLOT_HEIGHT, minimumWidth=120)
        self.result_plots.hide()
        about = "export the selected runs"
        self.export_button = make_button(
            "Export", None, "choice", tooltip("runs.export"), "runs.export", accessibleName=about
        )
        give_menu(self.export_button, self._fill_exports)
        self._build()

    def _build(self) -> None:
        fields = grid(
            (QLabel("Tags"), 0, 0),
            (self.tags_edit, 0, 1),
            (QLabel("Note"), 1, 0, Qt.AlignmentFlag.AlignTop),
            (self.note_edit, 1, 1),
        )
        buttons = row(self.open_button, self.continue_button, self.explore_button, None, self.export_button, spacing=6)
        plots = ((self.plot, 1), (self.result_plots, 1), (self.empty_label, 1))
        clearing = row(None, self.clear_button, None)
        area = make_scroll_area(
            *plots, clearing, self.facts_label, self.differences, self.card, fields, spacing=6, **UPRIGHT
        )
        content = area.widget()
        self._content_layout = None if content is None else content.layout()
        column(
            self.heading,
            (area, 1),
            self.message_label,
            self.progress_row,
            buttons,
            parent=self,
            margins=(8, 0, 0, 0),
            spacing=6,
        )
        self.plot.hide()  # until something is chosen

    def _fill_exports(self, menu: Menu) -> None:
        """Fill the menu with the formats of the data, and the picture of the plot that is shown."""
        for kind in FORMATS:
            menu.addAction(FORMAT_NAMES[kind], partial(self.export_pressed.emit, kind))
        menu.addSeparator()
        files = (self.result_plots.chart if self.plot.isHidden() else self.plot).tools.files
        picture = menu.addAction("Picture of the plot (PNG, SVG, PDF) …", files.choose_picture)
        picture.setEnabled(not (self.plot.isHidden() and self.result_plots.isHidden()))

    def show_message(self, text: str, is_error: bool = False) -> None:
        """Show a message or an error."""
        show_text(self.message_label, text)
        set_style_kind(self.message_label, "fault" if is_error else "note")

    def show_selection(self, selected: Sequence[RunSummary], readable: bool = True) -> None:
        """Show facts and notes of the selected runs and, once their files are read, the plot; `readable`: at least one can be opened."""
        one = selected[0] if len(selected) == 1 else None
        if one is None or self.card.summary is None or Path(self.card.summary.path).name != Path(one.path).name:
            self.card.hide()
            self.facts_label.show()
        for widget in (self.open_button, self.explore_button, self.export_button):
            widget.setEnabled(readable)
        self.open_button.setText("Open" if len(selected) < 2 else "Compare")
        self.tags_edit.setEnabled(bool(selected))
        self.note_edit.setEnabled(one is not None)
        if one is not None:
            self.heading.setText(
                f"{one.specimen or one.name}   {protocol_title(one.protocol)}   {one.symbol} {one.verdict_text}"
            )
            self._people = _people_text(one)
            reason = shorten(one.explanation, MAX_REASON_LENGTH, placeholder=" … (Enter opens all of it)")
            lines = [reason, *typeset(one.estimates_text).split("; "), self._people, one.path]
            self.facts_label.setText("\n".join(line for line in lines if line))
        else:
            self.heading.setText(f"{len(selected)} runs chosen" if selected else "Nothing is chosen")
            self.facts_label.setText("")
        self.differences.show_runs([run for run in selected if run.readable])
        texts, of = ((one.tags, one.note), one.path) if one is not None else (("", ""), "")
        # A list read before the last note was saved must not overwrite it, nor text that is being typed.
        if of != self._run_path or not (self.tags_edit.hasFocus() or self.note_edit.hasFocus()):
            self._saved_notes, self._run_path = texts, of
            with QSignalBlocker(self.tags_edit):
                self.tags_edit.setText(texts[0])
            self.note_edit.setPlainText(texts[1])
        if not selected:
            self.show_runs(None, 0)

    def show_runs(self, comparison: Comparison | None, selected_count: int, why: str = "") -> None:
        """Plot the selected runs; None: they have no curve, which `why` may explain."""
        count = 0 if comparison is None else len(comparison.runs)
        self.plot.show_comparison(
            comparison, f"{count} of {selected_count} are shown" if 0 < count < selected_count else ""
        )
        self.plot.setVisible(count > 0)
        self.result_plots.hide()
        self.empty_label.setVisible(not count)
        self.clear_button.setVisible(not selected_count and bool(self._folder_model.summaries))
        empty_text = READING_TEXT if self._folder_model.is_reading else EMPTY_TEXT
        empty_text = empty_text if self.clear_button.isHidden() else NO_MATCH_TEXT
        none_text = why or "No curve to compare.\nEnter opens the run."
        self.empty_label.setText(none_text if selected_count else empty_text)

    def show_result(self, run: LoadedRun) -> None:
        """Show the card of a single run, and plot one without a response over frequency by its own points, curves or checks."""
        kind = PROTOCOLS.get(run.record.protocol)
        self.card.show_summary(run.result)
        show_text(self.facts_label, self._people)
        if kind is None or not (run.points or run.series) or self.plot.isVisibleTo(self):
            return
        ended = RunEnded(RunStatus.COMPLETED, "", "", run.record.estimates, run.record.verdict)
        self.result_plots.show_results(kind, run.points, run.series, ended, run.record.simulated)
        self.result_plots.show()
        self.empty_label.hide()
        if self.isVisible() and self._content_layout is not None:
            self._content_layout.activate()  # now: the plot replaces the previous contents

    def _save_notes(self) -> None:
        texts = (self.tags_edit.text().strip(), self.note_edit.toPlainText().strip())
        if texts != self._saved_notes:
            self._saved_notes = texts
            self.notes_changed.emit(*texts)


def _people_text(run: RunSummary) -> str:
    """Return who measured and checked a run, and the air."""
    temperature_c, humidity = run.record.conditions.temperature_c, run.record.conditions.humidity
    parts = (
        f"measured by {run.operator}" if run.operator else "",
        f"checked by {run.checked_by}" if run.checked_by else "",
        "" if temperature_c is None else f"{temperature_c:.1f} °C",
        "" if humidity is None else f"{100 * humidity:.0f} % relative humidity",
    )
    return ", ".join(filter(None, parts))
