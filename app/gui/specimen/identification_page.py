"""Identification page over the pages: parameters of a specimen from its runs, their uncertainty budget, and acceptance."""

import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QLabel, QListWidget, QListWidgetItem, QVBoxLayout, QWidget

from app.archive import Catalogue, RunFilter, RunState, RunSummary
from app.common import Severity, pluralize, sentence_case
from app.gui.specimen.budget_plot import BudgetPlot
from app.gui.widgets import (
    ACTIONS,
    SELECTABLE,
    BackgroundWorker,
    StatusLine,
    WrappedRow,
    clear_layout,
    column,
    configure,
    fill_table,
    fit_to_rows,
    make_button,
    make_label,
    make_line_edit,
    make_pane,
    make_panel,
    make_read_only_table,
    make_scroll_area,
    make_toggle,
    row,
    set_tone,
)
from app.identification import (
    ADEQUACY_TEXT,
    MIN_REASON_LENGTH,
    IdentificationResult,
    accept_identification,
    assumed_line,
    budget_bars,
    contradictions,
    dimensions_line,
    doubt_about,
    format_relative,
    held_parameters,
    identify,
    is_reason,
    nonideality_lines,
    steps_line,
    unstated_errors,
)
from model import EstimatedQuantity, format_with_uncertainty, shown_unit
from model.identification import Explanation, FitCancelled, FitOptions

NOTHING_TO_IDENTIFY = "No run in {} has a result yet: measure a specimen first, on the page Measure (Ctrl+1)."
COLUMNS = ("parameter", "value ± total", "unit", "total", "statistical", "from")
PATH_ROLE = Qt.ItemDataRole.UserRole
ACCEPTABLE = "The result can be accepted as the calibration of this specimen."
DECISION_NEEDED = "The result is {}. Find the cause; or write why it is to be used all the same: the reason is kept with the calibration and printed with it."
REASON_NEEDED = (
    f"Nothing is accepted: write why the result is to be used all the same, with at least {MIN_REASON_LENGTH} letters"
)
ADEQUACY_SEVERITY = {True: Severity.SUCCESS, False: Severity.ERROR, None: Severity.WARNING}


@dataclass(frozen=True, slots=True)
class IdentificationSubject:
    """Subject of an identification: a specimen of a folder, with given runs or all of its runs with a result."""

    folder: Path
    specimen: str
    runs: tuple[Path, ...] = ()


class IdentificationPage(QWidget):
    """Identifies a specimen by the joint fit, in the background, with its sheet."""

    title = "Identification"
    closed = Signal()
    progressed = Signal(int, float)
    """Evaluations and chi-square of a fit that is running; from its thread."""

    def __init__(self) -> None:
        super().__init__()
        self._cancelled = threading.Event()
        self._worker = BackgroundWorker("identification", self, self._cancelled.set)
        self._also: tuple[str, ...] = ()
        self._plain = False
        self._fitted_runs: tuple[Path, ...] = ()
        self._outdated = False
        self.subject = IdentificationSubject(Path(), "")
        self.result: IdentificationResult | None = None
        self.heading = make_label(kind="heading", wrap=False, name="identification.heading")
        self.simulated_label = make_label(
            "SIMULATED", "simulated-mark", wrap=False, name="identification.simulated", visible=False
        )
        self.run_list = configure(QListWidget(), "identification.run-list", accessibleName="runs of the identification")
        self.runs_button = make_toggle("Runs", "Choose the runs", "identification.runs", self.run_list)
        self.identify_button = make_button(
            "Identify", self.identify, "go", "Fit the model to the runs that are ticked", "identification.fit"
        )
        self.message_label = configure(StatusLine(), "identification.message")
        self.verdict_label = make_label(kind="running", name="identification.verdict")
        self.finding_label = make_label(name="identification.finding", textInteractionFlags=SELECTABLE)
        self.text_label = make_label(name="identification.text", textInteractionFlags=SELECTABLE)
        self.table = make_read_only_table(COLUMNS, "identification.table", "identified parameters", wordWrap=False)
        self.table.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.budget_title = make_label("Uncertainty budget: shares of the squared total", "caption", wrap=False)
        self.budget_plot = BudgetPlot()
        self.specimens = make_scroll_area(accessibleName="specimens of the folder")
        """Choice of a specimen where none is named."""
        self.proposals = QWidget()
        self._proposal_rows: QVBoxLayout = column(parent=self.proposals, spacing=6)
        self.reason_edit, self.by_edit, self.note_edit = (
            make_line_edit(f"identification.{name}", label, placeholderText=label)
            for name, label in (("reason", "why it is used all the same"), ("by", "accepted by"), ("note", "note"))
        )
        self.accept_label = make_label(name="identification.accept-text")
        self.accept_button = make_button(
            "Accept",
            self.accept,
            "",
            "Store it as the active calibration of the specimen; earlier versions are kept",
            "identification.accept",
        )
        self.accept_message = configure(StatusLine(), "identification.accept-message")
        self._build()
        self.progressed.connect(self._show_progress)
        self.run_list.itemChanged.connect(lambda _: self._update_runs_button())
        self.reason_edit.textChanged.connect(lambda _: self.accept_message.show_message(""))
        self._clear()

    def show_subject(self, subject: IdentificationSubject) -> None:
        """Show a specimen, and list and fit its runs; the same specimen again only with new runs or another sheet."""
        if subject == self.subject and self._worker.pending:
            return
        if subject == self.subject and self.result is not None:
            self._worker.submit(lambda: subject.runs or _runs_of(subject), self._on_runs_again, self._on_error)
            return
        self._cancelled.set()  # a fit of another specimen
        self.subject, self._also, self._plain = subject, (), False
        self.heading.setText(f"Identification of {subject.specimen}" if subject.specimen else "No specimen")
        self._clear()
        if not subject.specimen:
            self._worker.submit(lambda: _results_of(subject.folder), self._offer_specimens, self._on_error, "runs")
            return
        self.message_label.show_message("looking for runs …", persistent=True)
        self._worker.submit(
            lambda: subject.runs or _runs_of(subject), self._on_runs, self._on_error, latest_only="runs"
        )

    def identify(self, also: Sequence[str] | None = None, plain: bool | None = None) -> None:
        """Fit the model to the runs that are ticked; while a fit runs: cancel it.

        Args:
            also: parameters that are free in addition; None: as in the last fit.
            plain: whether the beam model is fitted alone, without usual nonidealities; None: as the last fit.
        """
        if self._worker.pending:
            self._cancelled.set()
            return
        self._also = self._also if also is None else tuple(also)
        self._plain = plain_fit = self._plain if plain is None else plain
        runs, options = self.chosen_runs, FitOptions(also=self._also)
        if not runs:
            self.message_label.show_message("Tick a run first.", is_error=True)
            return
        self._clear()
        self._fitted_runs, self._outdated = runs, False
        self._cancelled.clear()
        self._show_fitting(True)
        self._worker.submit(
            lambda: identify(
                runs, options=options, plain=plain_fit, cancelled=self._cancelled.is_set, progress=self.progressed.emit
            ),
            self._on_identified,
            self._on_error,
        )

    def accept(self) -> None:
        """Store the result as the active calibration."""
        result, runs = self.result, self._fitted_runs
        if result is None:
            return
        if doubt_about(result) and not is_reason(self.reason_edit.text()):
            self._on_refused(ValueError(REASON_NEEDED))
            return
        by, note, reason = (edit.text().strip() for edit in (self.by_edit, self.note_edit, self.reason_edit))
        self.accept_button.setEnabled(False)

        def store() -> str:
            version, path = accept_identification(result, self.subject.folder, runs, by, note, reason)
            decision = f"; {version.decision}" if version.decision else ""
            return f"Accepted as version {version.version} of {result.specimen}, now active, in {path}{decision}"

        self._worker.submit(store, partial(self.accept_message.show_message, persistent=True), self._on_refused)

    @property
    def chosen_runs(self) -> tuple[Path, ...]:
        """The runs that are ticked."""
        items = [self.run_list.item(at) for at in range(self.run_list.count())]
        return tuple(item.data(PATH_ROLE) for item in items if item.checkState() is Qt.CheckState.Checked)

    def outdate(self) -> None:
        """Fit again when the page is shown next: the sheet has changed."""
        self._outdated = True

    # -- inside ----------------------------------------------------------------------------------------------------------

    def _on_runs(self, runs: Sequence[Path]) -> None:
        self.run_list.clear()
        for path in runs:
            item = QListWidgetItem(path.name)
            item.setData(PATH_ROLE, path)
            item.setCheckState(Qt.CheckState.Checked)
            self.run_list.addItem(item)
        self._update_runs_button()
        if runs:
            self.identify()
        else:
            self.message_label.show_message(
                f"There is no run of {self.subject.specimen} with a result in {self.subject.folder}.", is_error=True
            )

    def _offer_specimens(self, results: Sequence[RunSummary]) -> None:
        """Offer the specimens of the folder, each with its number of runs."""
        folder, counts = self.subject.folder, Counter(each.specimen for each in results if each.specimen)
        text = "Which specimen? These have runs with a result." if counts else NOTHING_TO_IDENTIFY.format(folder)
        self.message_label.show_message(text, persistent=True)
        buttons = [
            make_button(
                f"{name}, {pluralize(count, 'run')}",
                partial(self.show_subject, IdentificationSubject(folder, name)),
                name=f"identification.specimen.{name}",
            )
            for name, count in sorted(counts.items())
        ]
        self.specimens.setWidget(make_pane(WrappedRow(*buttons)))
        self.specimens.setVisible(bool(buttons))

    def _on_runs_again(self, runs: Sequence[Path]) -> None:
        listed = [self.run_list.item(at).data(PATH_ROLE) for at in range(self.run_list.count())]
        if listed != list(runs):
            self._on_runs(runs)
        elif self._outdated:
            self.identify()

    def _on_identified(self, result: IdentificationResult) -> None:
        self.result = result
        self._show_fitting(False)
        self.heading.setText(f"Identification of {result.specimen}")
        self.simulated_label.setVisible(result.observations.simulated)
        self._show_verdict(result)
        heading = [assumed_line(result), dimensions_line(result), held_parameters(result)]
        if exact := unstated_errors(result):
            heading.append(f"exact for want of a stated uncertainty: {', '.join(exact)}.")
        notes = [
            *contradictions(result),
            f"not identifiable from these runs: {'; '.join(result.unidentified)}" if result.unidentified else "",
        ]
        if seen := nonideality_lines(result):
            notes.append(f"beyond the beam model: {'; '.join(seen)}")
        notes += [steps_line(result, also="the button Fit with", plain="the button Fit the beam model alone")]
        notes += [result.verdict, *result.notes]
        lines = [f"{sentence_case(text).rstrip('.')}." for text in (*heading, *notes) if text]
        self.text_label.setText("\n".join(lines))
        statistical = result.statistical_errors
        fill_table(self.table, [_cells(each, statistical.get(each.name)) for each in result.identified])
        fit_to_rows(self.table)
        bars = budget_bars(result)
        self.budget_title.setVisible(bool(bars))
        self.budget_plot.show_bars(bars)
        self._show_proposals(result)
        doubt = doubt_about(result)
        self.accept_label.setText(DECISION_NEEDED.format(doubt.partition(":")[0]) if doubt else ACCEPTABLE)
        self.reason_edit.setVisible(bool(doubt))
        self.accept_button.setEnabled(True)
        self._content.show()

    def _on_refused(self, error: Exception) -> None:
        self.accept_button.setEnabled(True)
        self.accept_message.show_message(sentence_case(str(error)), is_error=True)
        if self.reason_edit.isVisible():
            self.reason_edit.setFocus()

    def _on_error(self, error: Exception) -> None:
        self._show_fitting(False)
        if isinstance(error, FitCancelled):
            self.message_label.show_message("The fit was cancelled.", persistent=True)
        else:
            self.message_label.show_message(sentence_case(str(error)), is_error=True)

    def _show_progress(self, evaluations: int, chi_square: float) -> None:
        if self._worker.pending and not self._cancelled.is_set():
            text = f"fitting {pluralize(len(self._fitted_runs), 'run')}: {evaluations} evaluations, chi-square {chi_square:.5g} …"
            self.message_label.show_message(text, persistent=True)

    def _show_fitting(self, fitting: bool) -> None:
        self.identify_button.setText("Cancel" if fitting else "Identify again")
        count = pluralize(len(self._fitted_runs), "run")
        also = f" with {', '.join(self._also)} free" if self._also else ""
        self.message_label.show_message(f"fitting {count}{also} …" if fitting else "", persistent=True)

    def _show_verdict(self, result: IdentificationResult) -> None:
        adequacy = result.adequacy
        adequate = None if adequacy is None else adequacy.adequate
        message = "not tested" if adequacy is None else adequacy.message
        self.verdict_label.setText(ADEQUACY_TEXT[adequate].upper())
        self.finding_label.setText(f"{sentence_case(message)}.")
        set_tone(self.verdict_label, ADEQUACY_SEVERITY[adequate])

    def _show_proposals(self, result: IdentificationResult) -> None:
        clear_layout(self._proposal_rows)
        diagnosis = None if result.adequacy is None else result.adequacy.diagnosis
        explanations = [step.explanation for step in result.steps]
        for explanation in (*explanations, *(() if diagnosis is None else diagnosis.likeliest)):
            self._proposal_rows.addWidget(self._make_proposal(explanation))
        if self._also:
            without = make_button(
                f"Fit without {', '.join(self._also)}",
                lambda: self.identify(()),
                "choice",
                name="identification.without",
            )
            note = make_label(f"Free in addition: {', '.join(self._also)}.", wrap=False)
            self._proposal_rows.addWidget(make_pane(row(note, without, None)))
        self._proposal_rows.addWidget(self._make_choice_of_model())

    def _make_choice_of_model(self) -> QWidget:
        """Return the button for the fit of the beam model alone, or back."""
        text = "Fit with nonidealities" if self._plain else "Fit the beam model alone"
        tip = "Creep, hysteresis and the other usual nonidealities are " + (
            "fitted, each within its usual size" if self._plain else "held at none, and no cause is added"
        )
        button = make_button(text, lambda: self.identify((), not self._plain), "choice", tip, "identification.plain")
        return make_pane(row(button, None))

    def _make_proposal(self, explanation: Explanation) -> QWidget:
        name = explanation.cause.name
        moved = "; ".join(
            f"{s.name} {s.before:.4g} → {format_with_uncertainty(s.after, s.standard_error)}"
            for s in explanation.shifts
        )
        chi = f"chi-square with it {explanation.chi_square:.5g} for {explanation.degrees_of_freedom} degrees of freedom"
        text = make_label(
            f"May be the cause: {explanation.cause_text}. {chi}." + (f" It moves {moved}." if moved else "")
        )
        if not explanation.cause.proposable or name in self._also:
            return make_pane(text)
        tip, act = f"The fit in which {name} is free as well", lambda: self.identify((*self._also, name))
        button = make_button(f"Fit with {name}", act, "choice", tip, f"identification.also.{name}")
        return make_pane(row((text, 1), button, spacing=10))

    def _clear(self) -> None:
        self.result = None
        self.specimens.hide()
        for button in (self.identify_button, self.runs_button):
            button.setVisible(bool(self.subject.specimen))
        self._content.hide()
        self.simulated_label.hide()
        self.message_label.show_message("")
        self.accept_message.show_message("")
        self.reason_edit.clear()

    def _update_runs_button(self) -> None:
        chosen, every = len(self.chosen_runs), self.run_list.count()
        self.runs_button.setText(f"Runs: {chosen} of {every}")

    def _build(self) -> None:
        self.run_list.setFixedHeight(7 * (self.fontMetrics().height() + 6))
        labels = []
        for text, edit in (("by", self.by_edit), ("note", self.note_edit)):
            label = QLabel(text)
            label.setBuddy(edit)
            labels.append(label)
        self._content = make_pane(
            self.verdict_label,
            self.finding_label,
            self.proposals,
            self.text_label,
            self.table,
            self.budget_title,
            self.budget_plot,
            make_panel(
                self.accept_label,
                self.reason_edit,
                row(labels[0], (self.by_edit, 1), labels[1], (self.note_edit, 2), self.accept_button, spacing=8),
                self.accept_message,
                margins=(12, 8, 12, 8),
            ),
            None,
            margins=(0, 0, 8, 0),
            spacing=8,
        )
        area = make_scroll_area(self._content, focusPolicy=Qt.FocusPolicy.NoFocus)
        close = make_button(
            "Close", self.closed.emit, name="identification.close", key=ACTIONS["identification"].shortcut
        )
        column(
            row(self.heading, self.simulated_label, None, self.runs_button, self.identify_button, close, spacing=8),
            self.run_list,
            self.message_label,
            (self.specimens, 1),
            (area, 1),
            parent=self,
            margins=(16, 8, 8, 6),
            spacing=6,
        )


def _cells(e: EstimatedQuantity, statistical: float | None) -> tuple[str, ...]:
    """Return the texts of a row; both uncertainties are rounded alike."""
    factor, unit = shown_unit(e.unit, e.name)
    value = format_with_uncertainty(factor * e.value, factor * e.standard_error)
    relative = [
        None if error is None or not e.value else abs(error / e.value) for error in (e.standard_error, statistical)
    ]
    shares = format_relative(*relative)
    return e.name, value, unit, *shares, ", ".join(e.source)


def _results_of(folder: Path, specimen: str = "") -> list[RunSummary]:
    """Return the runs of a folder, or of a specimen in it, that have a result."""
    catalogue = Catalogue(folder)
    catalogue.scan()
    return [each for each in RunFilter(specimen=specimen).apply(catalogue.entries()) if _counts(each)]


def _runs_of(subject: IdentificationSubject) -> tuple[Path, ...]:
    """Return the runs of a specimen that have a result; simulated ones only where there are no others."""
    entries = _results_of(subject.folder, subject.specimen)
    real = [e for e in entries if not e.simulated]
    return tuple(subject.folder / e.path for e in sorted(real or entries, key=lambda e: (e.start_time, e.path)))


def _counts(run: RunSummary) -> bool:
    return run.readable and (run.has_result or run.state == RunState.IMPORTED)
