"""Result card of a run: verdict, identified quantities or points, hints, file, and next actions."""

from functools import partial
from html import escape
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame

from app.common import MAX_POINT_ROWS, OUTCOME_SYMBOLS, ResultSummary, Severity, outcome_severity, summarize_result
from app.gui.widgets import (
    SELECTABLE,
    STRETCH,
    WrappedRow,
    column,
    configure,
    make_button,
    make_label,
    row,
    set_tone,
    tooltip,
)
from app.session import WindowState
from protocols import PROTOCOLS
from protocols.base import Outcome, RunEnded

MAX_LARGE = 3
"""Quantities in large type; the others follow in small type."""

MAX_REASON_LENGTH = 200

BUTTONS = {
    "open": ("Open", "Show the run on the page Runs"),
    "again": ("Again", tooltip("run", "Measure with the parameters of the form")),
    "explore": ("Use in Explore", "Lay the run over the model on the page Explore"),
    "continue": ("Continue", "Measure the missing points, into a file beside this one"),
    "next": ("Next", "Show the next measurement and its reason on the page Campaign"),
    "report": ("Report", "Write the report of this specimen, with all its runs in the folder, as PDF and HTML"),
}
"""Captions and tool tips."""

UNFINISHED = (Outcome.STOPPED, Outcome.FAILED, Outcome.UNSAFE)


class ResultCard(QFrame):
    """The same on every page; on the page Measure it stays from the end of a run to the start of the next.

    Args:
        prefix: of the object names.
        actions: names of the buttons.
        compact: the verdict in one line, beside a table that has the rest.
        scrolls: it lies in an area that scrolls: it is as high as it needs to be, with all reasons of the verdict.
    """

    requested = Signal(str, object)
    """Name of an action, and the path of the run."""

    def __init__(
        self,
        prefix: str = "result",
        actions: tuple[str, ...] = tuple(BUTTONS),
        compact: bool = False,
        scrolls: bool = False,
    ) -> None:
        super().__init__()
        configure(self, prefix, kind="" if compact else "panel")
        self._compact, self._scrolls = compact, scrolls
        self._outcome: RunEnded | None = None
        self.summary: ResultSummary | None = None
        self.verdict_label = make_label(kind="running", wrap=not compact, name=f"{prefix}.verdict")
        self.reason_label = make_label(kind="small", name=f"{prefix}.reason", textInteractionFlags=SELECTABLE)
        self.hints_label = make_label(kind="caution", name=f"{prefix}.hints", textInteractionFlags=SELECTABLE)
        self.value_labels = [
            [
                make_label(kind=kind, name=f"{prefix}.{part}-{at}")
                for part, kind in (("name", "note"), ("value", "value"))
            ]
            for at in range(MAX_LARGE)
        ]
        self.more_label = make_label(kind="small", name=f"{prefix}.more", textInteractionFlags=SELECTABLE)
        self.more_label.setTextFormat(Qt.TextFormat.RichText)
        self.note_label = make_label(
            "± one standard error of this run's noise; with gain: also of the sensor's gain. The other uncertainties come with Identify … (Shift+F7)",
            "note",
        )
        self.file_label = make_label(kind="small", name=f"{prefix}.file", textInteractionFlags=SELECTABLE)
        self.buttons = {
            name: make_button(
                BUTTONS[name][0], partial(self._request, name), "choice", BUTTONS[name][1], f"{prefix}.{name}"
            )
            for name in actions
        }
        self.simulated_label = make_label("SIMULATED", "simulated-mark", wrap=False, name=f"{prefix}.simulated")
        if compact:
            row(
                self.verdict_label, self.simulated_label, *self.buttons.values(), STRETCH,
                parent=self, spacing=14,
            )  # fmt: skip
            return
        values = (label for pair in self.value_labels for label in pair)
        column(
            row((self.verdict_label, 1), self.simulated_label),
            self.reason_label,
            self.hints_label,
            *values,
            self.more_label,
            self.note_label,
            self.file_label,
            WrappedRow(*self.buttons.values(), spacing=6),
            parent=self,
            margins=(10, 8, 10, 8),
            spacing=2,
        )
        self.hide()

    def set_state(self, view: WindowState) -> None:
        """Show the outcome of the last run; hidden during a run and before the first."""
        for name in ("continue", "again"):
            self.buttons[name].setEnabled(view.can_run)
        if view.outcome is not self._outcome:
            self._outcome = ended = view.outcome
            if ended is not None:
                planned = view.progress.entries if view.progress is not None else 0
                self.show_summary(
                    summarize_result(
                        ended.verdict, ended.reason, ended.estimates, PROTOCOLS.get(view.protocol), view.points, ended.hints,
                        ended.path, view.simulated, planned, view.gain_uncertainty,
                    )
                )  # fmt: skip
        self.simulated_label.setVisible(view.simulated)
        self.setVisible(self._outcome is not None and not view.busy)

    def show_summary(self, summary: ResultSummary) -> None:
        """Show the result of a run."""
        self.summary = summary
        self._show_verdict()
        reasons = summary.verdict.describe(summary.reason)
        short = self._scrolls or len(reasons) <= MAX_REASON_LENGTH
        brief = reasons if short else f"{reasons[:MAX_REASON_LENGTH].rsplit(' ', 1)[0]} …"
        written = bool(summary.path) and bool(summary.measured)
        self.simulated_label.setVisible(summary.simulated)
        for name, button in self.buttons.items():
            button.setVisible(written or name == "again")
        if self._compact:
            return
        self.reason_label.setText(f"{brief[:1].upper()}{brief[1:]}")
        self.reason_label.setToolTip(reasons if brief is not reasons else "")
        self.hints_label.setText("\n".join(f"⚠ {hint}." for hint in summary.hints))
        self.hints_label.setVisible(bool(summary.hints))
        lines = summary.quantities
        for at, labels in enumerate(self.value_labels):
            name, value = lines[at] if at < len(lines) else ("", "")
            total = summary.totals[at] if at < len(summary.totals) else ""
            for label, shown in zip(labels, (f"{name}, {total}" if total else name, value), strict=True):
                label.setText(shown)
                label.setVisible(bool(shown))
        self.more_label.setText(
            _table((*lines[MAX_LARGE:], *summary.others)) if lines else _point_table(summary) + _table(summary.others)
        )
        self.more_label.setVisible(bool(self.more_label.text()))
        self.note_label.setVisible(bool(lines or summary.points))
        self.file_label.setText(Path(summary.path).name)
        self.file_label.setToolTip(summary.path)
        self.file_label.setVisible(bool(summary.path))
        if (resuming := self.buttons.get("continue")) is not None:
            resuming.setVisible(written and summary.verdict.outcome in UNFINISHED)
            of = f" with {summary.measured} of {summary.planned}" if summary.planned else ""
            resuming.setText(f"Continue{of}")

    def show_reading(self) -> None:
        """Show that a run is being read, and hide the result of the run before."""
        self.summary = None
        self.verdict_label.setText("reading …")
        set_tone(self.verdict_label, Severity.INFO)
        self.simulated_label.hide()
        for button in self.buttons.values():
            button.hide()

    def _request(self, name: str) -> None:
        self.requested.emit(name, Path("" if self.summary is None else self.summary.path))

    def _show_verdict(self) -> None:
        if (summary := self.summary) is None:
            return
        verdict = summary.verdict.outcome
        self.verdict_label.setText(f"{OUTCOME_SYMBOLS[verdict]} {verdict.upper()}")
        self.verdict_label.setToolTip(summary.verdict.describe(summary.reason))
        set_tone(self.verdict_label, outcome_severity(verdict))


def _table(lines: tuple[tuple[str, str], ...], heads: tuple[str, str] | None = None) -> str:
    """Return rows of two columns as rich text; empty without rows."""
    if not lines:
        return ""
    head = "" if heads is None else "".join(f"<th align='left'>{escape(each)}&nbsp;&nbsp;</th>" for each in heads)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(each)}&nbsp;&nbsp;</td>" for each in line) + "</tr>" for line in lines
    )
    return f"<table>{f'<tr>{head}</tr>' if head else ''}{rows}</table>"


def _point_table(summary: ResultSummary) -> str:
    shown = summary.points[:MAX_POINT_ROWS]
    more = len(summary.points) - len(shown)
    return _table(shown, summary.point_names) + (f"… and {more} more in the file" if more and shown else "")
