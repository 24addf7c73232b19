"""Result card of a run: verdict, key figure with its uncertainties, further quantities, checks, hints, file, next actions."""

from collections.abc import Sequence, Set
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from PySide6.QtCore import QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QFrame, QLayout, QWidget

from app.common import (
    MAX_POINT_ROWS,
    OUTCOME_SYMBOLS,
    ResultLine,
    ResultSummary,
    Severity,
    check_row,
    outcome_severity,
    pluralize,
    sentence_case,
    summarize_result,
    typeset,
)
from app.gui.face import draw_box, painting, px, tokens
from app.gui.widgets import (
    SELECTABLE,
    ElidedLabel,
    WrappedRow,
    column,
    configure,
    make_button,
    make_label,
    make_pane,
    row,
    set_style_kind,
    set_tone,
    tooltip,
)
from app.live import EstimateUpdate
from app.session import WindowState
from protocols import PROTOCOLS
from protocols.base import CheckResult, Outcome, RunEnded, Verdict

MAX_REASON_LENGTH = 200
MAX_CHECKS = 6
"""Checks that are listed, those that did not pass first."""

BUTTONS = {
    "accept": ("Accept", "Let this result count in the campaign: its values are carried over to the next measurements"),
    "next": ("Next", "Show the next measurement and its reason on the page Campaign"),
    "again": ("Again", tooltip("run", "Measure with the parameters of the form")),
    "continue": ("Continue", "Measure the missing points, into a file beside this one"),
    "open": ("Open", "Show the run on the page Runs"),
    "explore": ("Explore", "Lay the run over the model on the page Explore"),
    "report": ("Report", "Write the report of this specimen, with all its runs in the folder, as PDF and HTML"),
}
"""Captions and tool tips."""

UNFINISHED = (Outcome.STOPPED, Outcome.FAILED, Outcome.UNSAFE)
NOTE = "± one standard uncertainty; statistical: by the scatter of this run; total: with the sensor's gain. The other parts come with Identify … (Shift+F7)"
BUDGET = "<a href='budget'>total not known</a>"
SO_FAR = "So far, by noise, hysteresis and creep; everything else is as in {}, and counts as exact, as does the sensor's gain."
TOO_FEW = "Not enough points yet to separate the parameters; points at other frequencies will."


class UncertaintyBar(QWidget):
    """Statistical uncertainty, dark, within the total, pale, on one scale; alone where the total is not known."""

    def __init__(self) -> None:
        super().__init__()
        self.statistical_share = 1.0

    def sizeHint(self) -> QSize:
        return QSize(px(72), px(16))

    def minimumSizeHint(self) -> QSize:
        return QSize(px(32), px(16))

    def paintEvent(self, _event: QPaintEvent) -> None:
        colors = tokens()
        whole = QRectF(0.5, self.height() / 2 - 4, self.width() - 1, 8)
        dark = max(self.statistical_share * whole.width(), 2.0)
        with painting(self) as painter:
            draw_box(painter, whole, 2, colors.sunken, colors.outline)
            painter.fillRect(QRectF(whole.center().x() - dark / 2, whole.y() + 1, dark, 6), QColor(colors.text2))
            painter.fillRect(QRectF(whole.center().x() - 1, whole.y() - 3, 2, 14), QColor(colors.text))


class ResultCard(QFrame):
    """The same on every page; on the page Measure it is preliminary during a run and stays to the start of the next.

    What its height has no place for is left out, in this order: note, file, the end of the reasons, checks, hints, reasons, further quantities; never
    the verdict, the key figure and the buttons.

    Args:
        prefix: of the object names.
        actions: names of the buttons; and "budget", the link to the identification, which finds the total uncertainty.
    """

    requested = Signal(str, object)
    """Name of an action, and the path of the run."""

    def __init__(self, prefix: str = "result", actions: tuple[str, ...] = (*BUTTONS, "budget")) -> None:
        super().__init__()
        configure(self, prefix, kind="panel")
        self._actions = actions
        self._outcome: RunEnded | None = None
        self._fitted: tuple[object, ...] = ()
        self._room = 0
        self._update, self._is_running, self._marked_by_ribbon = EstimateUpdate(), False, False
        self.summary: ResultSummary | None = None
        self.verdict_label = make_label(kind="pill", wrap=False, name=f"{prefix}.verdict")
        self.count_label = make_label(kind="note", wrap=False, name=f"{prefix}.count")
        self.simulated_label = make_label("SIMULATED", "simulated-mark", wrap=False, name=f"{prefix}.simulated")
        self.buttons = {
            name: make_button(text, partial(self._request, name), "choice", tip, f"{prefix}.{name}")
            for name, (text, tip) in BUTTONS.items()
            if name in actions
        }
        self._acceptable: Set[str] = frozenset()
        self._mark_next_step()
        head = (self.verdict_label, self.count_label, self.simulated_label)
        self._build(prefix, *head)

    def _build(self, prefix: str, *head: QWidget) -> None:
        self.reason_label = make_label(kind="small", name=f"{prefix}.reason", textInteractionFlags=SELECTABLE)
        self.hints_label = make_label(kind="caution", name=f"{prefix}.hints", textInteractionFlags=SELECTABLE)
        self.name_label = make_label(kind="large", name=f"{prefix}.name")
        self.figure_label = make_label(kind="answer", wrap=False, name=f"{prefix}.figure")
        self.unit_label = make_label(kind="unit", wrap=False, name=f"{prefix}.unit")
        self.bar = UncertaintyBar()
        self.total_label = make_label(wrap=False, name=f"{prefix}.total", textFormat=Qt.TextFormat.RichText)
        self.total_label.setToolTip(
            "The budget of the identification (Shift+F7) has the total" * ("budget" in self._actions)
        )
        self.total_label.linkActivated.connect(self._request)
        self.statistical_label = make_label(wrap=False, name=f"{prefix}.statistical")
        rich: dict[str, Any] = {"textFormat": Qt.TextFormat.RichText, "textInteractionFlags": SELECTABLE}
        self.more_label, self.checks_label = (
            make_label(kind="small", name=f"{prefix}.{part}", **rich) for part in ("more", "checks")
        )
        self.note_label = make_label(NOTE, "note")
        self.file_label = configure(ElidedLabel(), f"{prefix}.file", kind="note")
        bottom = Qt.AlignmentFlag.AlignBottom
        self.key_figure = make_pane(
            self.name_label,
            row((self.figure_label, 0, bottom), (self.unit_label, 0, bottom), None, spacing=8),
            row(self.bar, column(self.total_label, self.statistical_label, spacing=0), None, spacing=12),
            spacing=0,
        )
        self.unit_label.setContentsMargins(0, 0, 0, px(3))  # on the base line of the figure
        self._optional: tuple[QWidget, ...] = (
            self.note_label,
            self.file_label,
            self.checks_label,
            self.hints_label,
            self.reason_label,
            self.more_label,
        )
        self._rows: list[tuple[str, str]] = []
        self._points_text = self._reasons = ""
        column(
            WrappedRow(*head, spacing=8), self.reason_label, self.key_figure, self.more_label, self.checks_label, self.hints_label,
            self.file_label, self.note_label, WrappedRow(*self.buttons.values(), spacing=6), parent=self,
            margins=(12, 10, 12, 10), spacing=6,
        )  # fmt: skip
        self.hide()

    def set_state(self, view: WindowState) -> None:
        """Show the estimates so far during a run, then its outcome; hidden before the first."""
        for name in ("continue", "again"):
            self.buttons[name].setEnabled(view.can_run)
        began, self._is_running = view.busy and not self._is_running, view.busy
        self._marked_by_ribbon = view.simulated
        if began:
            self._update = EstimateUpdate()
        if view.busy:
            self._outcome = None
            self._show_preliminary(view)
        elif view.outcome is not self._outcome and (ended := view.outcome) is not None:
            self._outcome = ended
            planned = view.progress.entries if view.progress is not None else 0
            self.show_summary(
                summarize_result(
                    ended.verdict, ended.reason, ended.estimates, PROTOCOLS.get(view.protocol), view.points, ended.hints,
                    ended.path, view.simulated, planned, view.gain_uncertainty,
                )
            )  # fmt: skip
        self.setVisible(view.busy or self._outcome is not None)

    def show_update(self, update: EstimateUpdate, view: WindowState | None) -> None:
        """Show the estimates of the points so far."""
        ours = view is not None and view.busy and update.points <= len(view.points)
        if view is not None and ours and update is not self._update:
            self._update = update
            self._show_preliminary(view)

    def _show_preliminary(self, view: WindowState) -> None:
        update, planned = self._update, view.progress.entries if view.progress is not None else 0
        self._show(
            summarize_result(
                Verdict(), "", (*update.results, *update.estimates), None, view.points, simulated=view.simulated, planned=planned,
                gain_uncertainty=view.gain_uncertainty,
            )
        )  # fmt: skip
        self._set_verdict("● Preliminary" if view.prompt is None else "Waits for you", Severity.WARNING, "")
        waiting = bool(view.points) and update.message.startswith("not identifiable")
        self.note_label.setText(
            SO_FAR.format(update.active_model.description) if update.estimates else TOO_FEW if waiting else ""
        )
        self.note_label.setToolTip(update.message)
        for button in self.buttons.values():
            button.hide()
        self._fit()

    def show_summary(self, summary: ResultSummary) -> None:
        """Show the result of a run."""
        self._show(summary)
        self._mark_next_step()
        outcome = summary.verdict.outcome
        reasons = summary.verdict.describe(summary.reason)
        self._set_verdict(f"{OUTCOME_SYMBOLS[outcome]} {outcome.capitalize()}", outcome_severity(outcome), reasons)
        written = bool(summary.path) and bool(summary.measured)
        for name, button in self.buttons.items():
            button.setVisible(name == "again" or (written and (name != "accept" or self._is_acceptable)))
        if (resuming := self.buttons.get("continue")) is not None:
            resuming.setVisible(written and outcome in UNFINISHED)
            of = f" with {summary.measured} of {summary.planned}" if summary.planned else ""
            resuming.setText(f"Continue{of}")
        self.note_label.setText(NOTE)
        self._fit()
        self.show()

    @property
    def _is_acceptable(self) -> bool:
        return self.summary is not None and Path(self.summary.path).name in self._acceptable

    def offer_next(self, title: str) -> None:
        """Show the name of the next measurement of the campaign on its button; an empty name means that there is none."""
        self.buttons["next"].setText(f"Next: {title.lower()}" if title else "Next")
        self._fit()

    def offer_acceptance(self, names: Set[str]) -> None:
        """Offer to accept the result, as the next step, if its run is one of these files."""
        self._acceptable = names
        if self._outcome is not None:
            self.buttons["accept"].setVisible(self._is_acceptable)
            self._mark_next_step()
            self._fit()

    def _mark_next_step(self) -> None:
        """Give the next step the look of the main button: accept the result if that is offered, else measure on."""
        for name, is_next in (("accept", True), ("next", not self._is_acceptable)):
            if name in self.buttons:
                set_style_kind(self.buttons[name], "primary" if is_next else "choice")

    def _show(self, summary: ResultSummary) -> None:
        self.summary = summary
        self.simulated_label.setVisible(summary.simulated and not self._marked_by_ribbon)
        planned = f"{summary.usable} of " if summary.planned else ""
        count = f"{planned}{pluralize(summary.planned or summary.usable, 'point')} usable"
        self.count_label.setText(count if summary.measured else "")
        is_told = summary.verdict.outcome is not Outcome.GOOD and (summary.reason or summary.verdict.reasons)
        reasons = summary.verdict.describe(summary.reason) if is_told else ""
        self._reasons = typeset(sentence_case(reasons))
        self.hints_label.setText(typeset("\n".join(f"⚠ {hint}." for hint in summary.hints)))
        self._show_figure(summary.lines[0] if summary.lines else _checks_passed(summary.verdict.checks))
        self._rows = [(sentence_case(line.name), line.text) for line in (*summary.lines[1:], *summary.others)]
        self._points_text = "" if summary.lines else _point_table(summary)
        self.checks_label.setText(_check_table(summary.verdict.checks))
        self.file_label.setText(Path(summary.path).name)
        self.file_label.setToolTip(summary.path)

    def _show_figure(self, line: ResultLine | None) -> None:
        self.key_figure.setVisible(line is not None)
        if line is None:
            return
        self.name_label.setText(sentence_case(line.name))
        self.figure_label.setText(line.figure)
        self.unit_label.setText(line.unit)
        unknown = BUDGET if "budget" in self._actions and not self._is_running else "total not known"
        self.total_label.setText(f"{line.total} total" if line.total else unknown if line.statistical else "")
        self.statistical_label.setText(f"{line.statistical} statistical" if line.statistical else "")
        self.bar.statistical_share = line.statistical_share
        self.bar.update()
        for widget in (self.bar, self.total_label, self.statistical_label):
            widget.setVisible(bool(line.statistical))

    def set_room(self, height: int) -> None:
        """Set the height that the card has at most; 0: as much as it needs."""
        self._room = height
        self._fit()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """Leave out what the room has no place for."""
        layout = self.layout()
        if layout is None:
            return
        more = self._points_text + rich_table(self._rows)
        texts = (*(str(part.property("text")) for part in self._optional[:-2]), self._reasons, more)
        shown = tuple(button.isHidden() for button in self.buttons.values())
        if (fitted := (self.width(), self._room, self.fontMetrics().height(), shown, texts)) == self._fitted:
            return
        self._fitted = fitted
        self.more_label.setText(more)
        self._show_reasons(len(self._reasons))
        for part, text in zip(self._optional, texts, strict=True):
            part.setVisible(bool(text))
        for part in self._optional if self._room else ():
            if self._is_whole(layout):
                break
            if part is self.checks_label:
                self._show_reasons(MAX_REASON_LENGTH)
                if self._is_whole(layout):
                    break
            if part is self.more_label:
                self._shorten(layout)
            else:
                part.hide()

    def _show_reasons(self, length: int) -> None:
        """Show the reasons of the verdict, or their beginning, with all of them in the tool tip."""
        is_whole = len(self._reasons) <= length
        self.reason_label.setText(self._reasons if is_whole else f"{self._reasons[:length].rsplit(' ', 1)[0]} …")
        self.reason_label.setToolTip("" if is_whole else self._reasons)

    def _is_whole(self, layout: QLayout) -> bool:
        layout.invalidate()
        return layout.totalHeightForWidth(self.width()) <= self._room

    def _shorten(self, layout: QLayout) -> None:
        """Leave out the last quantities that have no place."""
        for count in range(len(self._rows) - 1, -1, -1):
            self.more_label.setText(rich_table(self._rows[:count]))
            self.more_label.setVisible(count > 0)
            if self._is_whole(layout):
                return

    def show_reading(self) -> None:
        """Show that a run is being read, and hide the result of the run before."""
        self._show(ResultSummary(Verdict(), "", ()))
        self.summary = None
        self._set_verdict("reading …", Severity.INFO, "")
        self.note_label.setText("")
        for button in self.buttons.values():
            button.hide()
        self._fit()

    def _set_verdict(self, text: str, severity: Severity, tip: str) -> None:
        self.verdict_label.setText(text)
        self.verdict_label.setToolTip(tip)
        set_tone(self.verdict_label, severity)

    def _request(self, name: str) -> None:
        self.requested.emit(name, Path("" if self.summary is None else self.summary.path))


def _checks_passed(checks: Sequence[CheckResult]) -> ResultLine | None:
    """Return the key figure of a run that passes or fails: how many of its checks passed."""
    if not checks:
        return None
    passed = f"{sum(check.passed for check in checks)} of {len(checks)}"
    return ResultLine("checks passed", passed, "", passed)


def _check_table(checks: Sequence[CheckResult]) -> str:
    """Return the checks as rich text, those that did not pass first."""
    shown = [check_row(check) for check in sorted(checks, key=lambda check: check.passed)[:MAX_CHECKS]]
    rows = [
        ("✓" if each.passed else "✕", sentence_case(each.name), f"{each.figure} {each.unit}".strip()) for each in shown
    ]
    more = len(checks) - len(shown)
    return rich_table(rows) + (f"… and {pluralize(more, 'check')} more" if more else "")


LONGEST_VALUE = 20
"""Characters of a value that are kept in one line; the narrowest card has no place for more beside a name."""


def rich_table(lines: Sequence[Sequence[str]], heads: Sequence[str] = (), wrap: bool = False) -> str:
    """Return rows as rich text, the last column at the right; empty without rows. An empty first column is left out.

    Args:
        lines: the cells of each row.
        heads: titles of the columns.
        wrap: break long values, instead of names.
    """
    if not lines:
        return ""
    sides = ["left"] * (len(heads) - 1) + ["right"]
    head = "".join(
        f"<th align='{side}'>{escape(sentence_case(each))}</th>" for side, each in zip(sides, heads, strict=False)
    )
    rows = []
    for *names, value in lines:
        whole = "; white-space:nowrap" if wrap else ""
        cells = "".join(f"<td style='padding-right:6px{whole}'>{escape(each)}</td>" for each in names if each)
        figure, mark, uncertainty = value.partition("±")
        # Uncertainty and unit stay in one line: no break at a space, nor behind a slash (word joiner).
        whole_unit = figure + (mark + uncertainty).replace(" ", "\u00a0").replace("/", "/\u2060")
        style = "" if wrap or len(value) > LONGEST_VALUE else " style='white-space:nowrap'"
        rows.append(f"<tr>{cells}<td align='right'{style}><b>{escape(whole_unit)}</b></td></tr>")
    return f"<table width='100%'>{f'<tr>{head}</tr>' if heads else ''}{''.join(rows)}</table>"


def _point_table(summary: ResultSummary) -> str:
    shown = summary.points[:MAX_POINT_ROWS]
    more = len(summary.points) - len(shown)
    return rich_table(shown, summary.point_names) + (f"… and {more} more in the file" if more and shown else "")
