"""Laboratory page: many specimens, control charts, calibration certificates and audit trail of the folder of runs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from functools import cached_property, partial
from pathlib import Path
from typing import TypeVar

from PySide6.QtCore import QSettings, Qt, QTimer, Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from app.archive import Catalogue
from app.common import AuditEntry, AuditError, Progress, UsageError, pluralize, read_entries
from app.config import Certificate, read_certificates
from app.fleet import Bounds, Fleet, FleetError, read_fleet
from app.gui.laboratory.audit_pane import AuditPane
from app.gui.laboratory.certificates_pane import CertificatesPane
from app.gui.laboratory.chart_pane import ChartPane
from app.gui.laboratory.fleet_pane import FleetPane
from app.gui.laboratory.view_pane import ViewPane
from app.gui.widgets import (
    BackgroundWorker,
    LowPane,
    ProgressRow,
    Segments,
    StatusLine,
    column,
    configure,
    make_button,
    make_label,
    row,
)
from app.session import WindowState
from model import ParameterError

SPECIMENS, CHART, CERTIFICATES, AUDIT = range(4)
READ_DELAY_MS = 400
"""After which a page that is shown again reads the folder: at once it would compete with its own painting."""
VIEWS = ("Specimens", "Control chart", "Certificates", "Audit trail")
PANES = ("fleet", "chart", "certificates", "audit")
"""Attributes of the page with the panes of `VIEWS`."""

TO_BEGIN = "Measure a specimen on the page Measure (Ctrl+1): every run with a result is shown here. The folder is chosen there, too."
P = TypeVar("P", bound=QWidget)


@dataclass(frozen=True)
class FolderRecords:
    """Contents of the page for a folder of runs.

    Attributes:
        fleet: values of its specimens; None if no run has a result.
        problem: reason why there is no fleet, or no limits.
        audit_problems: faults of lines of the audit trail, as sentences.
    """

    folder: Path
    fleet: Fleet | None = None
    limits: Mapping[str, Bounds] = field(default_factory=dict)
    golden: str = ""
    problem: str = ""
    certificates: Sequence[Certificate] = ()
    certificate_problems: Sequence[str] = ()
    entries: Sequence[AuditEntry] = ()
    audit_problems: Sequence[str] = ()


def read_records(
    folder: Path, index: Path | None, simulated: bool | None, progress: Progress, excluded: Sequence[Path] = ()
) -> FolderRecords:
    """Return the records of a folder; a cancelled scan leaves the runs that were read before.

    Args:
        folder: of the runs.
        index: path of its catalogue; None for the usual one.
        simulated: whether simulated runs are meant; None: real ones, and simulated ones if there are no others.
        progress: of the scan.
        excluded: files that are not read, because a run writes them.
    """
    from app.identification import chosen_threshold  # these imports take half a second
    from app.report import LIMITS_FILE_NAME, LimitsError, read_limits
    from model.response import ABDOMEN_THRESHOLD

    fleet, limits, problem = None, None, ""
    try:
        if not folder.is_dir():
            raise FleetError(f"there is no folder {folder} yet: it is made by the first run")
        catalogue = Catalogue(folder, index)
        if not catalogue.scan(progress, tuple(excluded)).complete:
            problem = "Reading was stopped: runs that were not read before are missing."
        threshold = ABDOMEN_THRESHOLD
        try:
            threshold = chosen_threshold(folder)
        except (UsageError, ParameterError) as error:
            problem = str(error)
        fleet = read_fleet(folder, catalogue, simulated, threshold)
    except FleetError as error:
        problem = f"No specimens: {error}"
    except OSError as error:
        problem = str(error)
    if (path := folder / LIMITS_FILE_NAME).exists():
        try:
            limits = read_limits(path)
        except LimitsError as error:
            problem = problem or str(error)
    certificates, damaged = read_certificates(folder)
    try:
        entries, audit_problems = read_entries(folder)
    except (AuditError, OSError) as error:
        entries, audit_problems = [], []
        if (folder / "audit.jsonl").exists():
            audit_problems = [str(error)]
    return FolderRecords(
        folder,
        fleet,
        {} if limits is None else limits.bounds,
        "" if limits is None else limits.golden,
        problem,
        certificates,
        damaged,
        entries,
        audit_problems,
    )


class LaboratoryPage(QWidget):
    """Four views of one folder; each is created when it is first shown.

    Args:
        folder: returns the folder of the runs.
        index: path of the catalogue; None for the usual one.
    """

    title = "Laboratory"
    run_open_requested = Signal(object)
    """Path of a run to open."""

    def __init__(self, folder: Callable[[], Path], index: Path | None = None) -> None:
        super().__init__()
        self._folder, self._index = folder, index
        self.progress_row = ProgressRow("laboratory")
        self._worker = BackgroundWorker("laboratory views", self)
        self._records: FolderRecords | None = None
        self._excluded: tuple[Path, ...] = ()
        self._busy, self._read_due = False, True
        self._due_timer = QTimer(self, singleShot=True, interval=READ_DELAY_MS)
        self._due_timer.timeout.connect(self._request_reading)
        self._messages = dict[int, tuple[str, bool]]()
        self._shown = dict[int, tuple[FolderRecords, date]]()
        """Contents of each view."""
        self.views = Segments("laboratory.view", "view", ((text, at) for at, text in enumerate(VIEWS)))
        self.views.select(SPECIMENS)
        self.simulated_mark = make_label("SIMULATED", "simulated-mark", wrap=False, name="laboratory.simulated")
        self.simulated_mark.hide()
        tip = "Real and simulated runs are never mixed"
        self.kind_button = make_button("Simulated runs", self.reload, "choice", tip, checkable=True, visible=False)
        self.count_label = make_label(kind="note", wrap=False, name="laboratory.count")
        self.message_label = configure(StatusLine(), "laboratory.message")
        self.stack = QStackedWidget()
        self.empty_label = make_label(kind="note-size", name="laboratory.empty", alignment=Qt.AlignmentFlag.AlignCenter)
        self.stack.addWidget(self.empty_label)
        top = row(
            self.views, None, self.simulated_mark, self.kind_button, self.count_label, spacing=6, margins=(0, 2, 0, 0)
        )
        contents = LowPane()
        column(top, self.progress_row, self.message_label, (self.stack, 1), parent=contents, spacing=6)
        column(contents, parent=self)
        self.views.chosen.connect(self.show_view)

    # -- interface to the main window ----------------------------------------------------------------------------------

    @property
    def view(self) -> int:
        return int(str(self.views.selected))

    @cached_property
    def fleet(self) -> FleetPane:
        """The specimens, created if necessary."""
        return self._add(FleetPane(self._worker, partial(self._show_message, SPECIMENS)))

    @cached_property
    def chart(self) -> ChartPane:
        """The control charts, created if necessary."""
        return self._add(ChartPane(self._worker, partial(self._show_message, CHART)))

    @cached_property
    def certificates(self) -> CertificatesPane:
        """The certificates, created if necessary."""
        return self._add(CertificatesPane())

    @cached_property
    def audit(self) -> AuditPane:
        """The audit trail, created if necessary."""
        return self._add(AuditPane(self.reload))

    def set_state(self, view: WindowState) -> None:
        """Show a window state; the folder is read again after a run."""
        self._read_due = self._read_due or (self._busy and not view.busy)
        self._busy = view.busy

    def set_active_file(self, path: Path | None) -> None:
        """Set the run file that this program is writing, which is not read."""
        self._excluded = () if path is None else (path,)

    def activate(self) -> None:
        """Take the keyboard focus; read changes by other programs."""
        if self._records is not None:
            self._due_timer.start()
        self.show_view(self.view)
        self.views.buttons[self.view].setFocus()

    def tick(self) -> None:
        """Read the folder if another one is meant, or a run has ended."""
        changed = self._records is not None and self._records.folder != self._folder()
        if (self._read_due or changed) and not self.progress_row.running and self.isVisible():
            self.reload()

    def save_state(self, settings: QSettings) -> None:
        settings.setValue("laboratory/view", self.view)

    def restore_state(self, settings: QSettings) -> None:
        last = str(settings.value("laboratory/view", ""))
        if last.isdigit() and int(last) < len(VIEWS):
            self.views.select(int(last))

    # -- commands ------------------------------------------------------------------------------------------------------

    def show_view(self, view: int) -> None:
        self.views.select(view)
        self._show_pane(view)
        text, is_error = self._messages.get(view, ("", False))
        self.message_label.show_message(text, is_error=is_error)
        self._show_records()

    def _show_pane(self, view: int) -> None:
        """Show a view, or what to do for it where no run has a result."""
        records, pane = self._records, getattr(self, PANES[view])
        is_empty = records is not None and records.fleet is None and view in (SPECIMENS, CHART)
        if records is not None and is_empty:
            self.empty_label.setText(f"{records.problem}.\n\n{TO_BEGIN}")
        self.stack.setCurrentWidget(self.empty_label if is_empty else pane)

    def reload(self) -> None:
        """Read the folder in the background."""
        if self.progress_row.running:
            return
        folder, index, excluded = self._folder(), self._index, self._excluded
        simulated = True if self.kind_button.isChecked() else None
        self._read_due = False
        before = self._records

        def work(progress: Progress) -> FolderRecords:
            records = read_records(folder, index, simulated, progress, excluded)
            return before if before is not None and records == before else records

        self.progress_row.run("reading runs", work, self._on_read, self._on_error)

    # -- inside --------------------------------------------------------------------------------------------------------

    def _request_reading(self) -> None:
        self._read_due = True

    def _add(self, pane: P) -> P:
        self.stack.addWidget(pane)
        if isinstance(pane, ViewPane):
            pane.run_open_requested.connect(self._open_run)
        return pane

    def _on_read(self, records: FolderRecords) -> None:
        self._records = records
        fleet = records.fleet or Fleet(())
        self.simulated_mark.setVisible(fleet.simulated)
        self.kind_button.setVisible(self.kind_button.isChecked() or fleet.left_out > 0)
        specimens, runs = len({v.specimen for v in fleet.values}), len({v.path for v in fleet.values})
        self.count_label.setText(f"{pluralize(specimens, 'specimen')}, {pluralize(runs, 'run')} with results")
        today = datetime.now(UTC).date()
        states = [each.state(today) for each in records.certificates]
        worst = next((state for state in ("expired", "due soon") if state in states), "")
        self.views.buttons[CERTIFICATES].setText(
            f"{VIEWS[CERTIFICATES]}   {states.count(worst)} {worst}" if worst else VIEWS[CERTIFICATES]
        )
        self._show_records()
        QTimer.singleShot(0, self, lambda: self.chart)  # which takes longest to make, before it is selected

    def _show_records(self) -> None:
        """Show the records in the visible view, once."""
        records, view = self._records, self.view
        today = datetime.now(UTC).date()
        shown, day = self._shown.get(view, (None, today))
        if records is None or (shown is records and day == today):
            return
        self._shown[view] = (records, today)
        self._show_pane(view)
        self._show_message(view, "", is_error=False)
        match view:
            case 0:
                self.fleet.show_fleet(records.folder, records.fleet, records.limits, records.golden)
            case 1:
                self.chart.show_fleet(records.folder, records.fleet, records.golden)
            case 2:
                self.certificates.show_certificates(records.certificates, records.certificate_problems, today)
            case _:
                self.audit.show_entries(records.folder, records.entries, records.audit_problems)

    def _on_error(self, error: Exception) -> None:
        self._show_message(self.view, str(error), is_error=True)

    def _show_message(self, view: int, text: str, is_error: bool) -> None:
        """Show a message of a view while that is visible; an empty one shows again why nothing could be read."""
        if not text and self._records is not None and self._records.fleet is not None and view in (SPECIMENS, CHART):
            text, is_error = self._records.problem, bool(self._records.problem)
        self._messages[view] = (text, is_error)
        if view == self.view:
            self.message_label.show_message(text, is_error=is_error)

    def _open_run(self, path: str) -> None:
        if self._records is not None:
            self.run_open_requested.emit(self._records.folder / path)
