"""Run panel: protocol form, specimen, folder, rehearsal and the Run button."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, QSignalBlocker, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QToolButton, QWidget

from app.common import UsageError, format_bytes, pluralize, remember_conditions, remembered_conditions
from app.gui.face import px, set_length, set_margins
from app.gui.measure.presets import PresetButton, PresetStore
from app.gui.results import ResultCard, rich_table
from app.gui.widgets import (
    ACTIONS,
    SELECTABLE,
    UPRIGHT,
    BackgroundWorker,
    Mode,
    ProtocolForm,
    Segments,
    SheetButton,
    choose_file,
    column,
    configure,
    make_button,
    make_combo,
    make_label,
    make_labelled_grid,
    make_line_edit,
    make_pane,
    make_scroll_area,
    row,
    set_style_kind,
    show_key,
    show_text,
    tooltip,
)
from app.identification import read_label
from app.services import FormResult
from app.session import WindowState, format_bench_duration, format_voltage_range
from drivers import Bench, BenchError
from protocols import PROTOCOLS, rehearse
from protocols.base import Protocol

BenchGetter = Callable[[], Bench | None]

MIN_CONTENT_HEIGHT = 90
"""Least height of the scroll area between the protocol's name and the button Run."""

OPERATOR_POLL_MS = 30_000
"""Interval between readings of the operator: another program may set it, and it expires at midnight."""

SETUP, RESULT = "set-up", "result"

ABOUT_LINES = 3
"""Height of the description of the protocol, or of the field with the keyboard."""


class RunPanel(QWidget):
    """The left side of the measuring page.

    Args:
        protocol: fills the form at first.
        bench: the connected bench, for the rehearsal; None before it is connected.
        presets: the lab's own sets of parameters.
    """

    run_pressed = Signal()
    changed = Signal()
    operator_named = Signal(str)
    """Who measures, as it is typed."""
    label_scanned = Signal(object)
    """A `SpecimenLabel` with a hash."""

    def __init__(self, protocol: Protocol, bench: BenchGetter, presets: PresetStore) -> None:
        super().__init__()
        self._bench = bench
        self._edited_protocols: dict[str, Protocol] = {}
        """Last edited parameters of the other protocols."""
        self._can_run, self._blocked_reason = False, ""
        self._is_beside = False
        """Whether the result card stands beside the plots."""
        self._rehearsed_inputs: tuple[object, ...] = ()
        self._rehearsal_result = ("", False)
        choices = ((PROTOCOLS.title(name), name) for name in PROTOCOLS)
        self.protocol_box = make_combo(
            "measure.protocol", "protocol", choices, kind="heading", toolTip="What to measure"
        )
        self.about_label = make_label(kind="note", name="measure.about", alignment=Qt.AlignmentFlag.AlignTop)
        tip = "Name of the specimen, written into the run file and its name"
        self.specimen_edit = make_line_edit("measure.specimen", "specimen", toolTip=tip)
        self.sheet_button = SheetButton("measure")
        self.folder_edit = make_line_edit("measure.folder", "folder", toolTip="Where run files are kept")
        self.operator_edit = make_line_edit(
            "measure.operator",
            "operator",
            placeholderText="who measures today?",
            toolTip="Who measures, until midnight; stored in every run. Empty: the login of the computer",
        )
        rich: dict[str, Any] = {"textFormat": Qt.TextFormat.AutoText, "textInteractionFlags": SELECTABLE}
        self.rehearsal_label = make_label(name="measure.rehearsal", **rich)
        self.warnings_label = make_label(kind="caution", name="measure.warnings", visible=False)
        self.result_card = ResultCard()
        self.no_result_label = make_label(
            "No run yet. Its result stands here, and stays until the next one begins.", "note"
        )
        self.segments = Segments("measure.side", "left column", (("Set-up", SETUP), ("Result", RESULT)))
        self._busy = False
        self._left_editor: QWidget | None = None
        """Widget that had the focus when the run began; it gets the focus back at the end."""
        self.run_button = make_button(
            "Run", self.run_pressed.emit, "go", name="measure.run", key=ACTIONS["run"].shortcut
        )
        set_length(self.run_button, height=44)
        self.preset_button = PresetButton(presets, lambda: self.protocol)
        self._browse = configure(
            QToolButton(),
            "measure.browse",
            kind="tool",
            text="…",
            toolTip="Choose the folder",
            accessibleName="choose the folder",
        )
        self._form_place = column()
        self._build()
        self._show_form(protocol)
        self._connect_signals()

    def _connect_signals(self) -> None:
        self.segments.chosen.connect(self.show_side)
        self.protocol_box.currentIndexChanged.connect(self._on_protocol_chosen)
        self.preset_button.preset_chosen.connect(self.set_protocol)
        self._browse.clicked.connect(self._choose_folder)
        self.specimen_edit.textChanged.connect(self._on_edited)
        self.folder_edit.textChanged.connect(self._on_edited)
        self.operator_edit.textEdited.connect(self.operator_named)
        self.specimen_edit.returnPressed.connect(self._on_specimen_entered)

    def _on_specimen_entered(self) -> None:
        """Take the name out of a scanned label: a barcode scanner types it and ends with Enter, which starts no run."""
        label = read_label(self.specimen_edit.text())
        self.specimen_edit.setText(label.specimen)
        self.specimen_edit.selectAll()  # the next scan replaces it
        if label.sheet_hash:
            self.label_scanned.emit(label)

    @property
    def protocol(self) -> Protocol | None:
        """The form's protocol, None while the form has an error."""
        return self.form.result.value

    @property
    def kind(self) -> type[Protocol]:
        """Protocol class of the form."""
        return self.form.kind

    @property
    def folder(self) -> Path:
        """Folder for run files."""
        return Path(self.folder_edit.text().strip()).expanduser()

    @property
    def specimen(self) -> str:
        """Name of the specimen."""
        return self.specimen_edit.text().strip()

    def set_protocol(self, protocol: Protocol) -> None:
        """Show a protocol and its parameters."""
        if type(protocol) is self.form.kind:
            self.form.set_protocol(protocol)
            return
        if (present := self.protocol) is not None:
            self._edited_protocols[present.name] = present
        self._show_form(protocol)
        self._on_edited()

    def _show_form(self, protocol: Protocol) -> None:
        for last in self.findChildren(ProtocolForm):
            last.setParent(None)  # it leaves the layout now, not when the event loop deletes it
            last.deleteLater()
        self.form = ProtocolForm(protocol)
        self._form_place.addWidget(self.form)
        self.form.changed.connect(self._on_edited)
        self.form.help_changed.connect(self._show_help)
        self._align_labels()
        self._show_help("")
        self.preset_button.kind = type(protocol)
        with QSignalBlocker(self.protocol_box):
            self.protocol_box.setCurrentIndex(self.protocol_box.findData(protocol.name))

    def _align_labels(self) -> None:
        """Put the fields below each other where the column is wide."""
        width = self.form.label_width() if self._is_beside else 0
        self.form.set_label_width(width)
        self._where.setColumnMinimumWidth(0, width)

    def _show_help(self, text: str) -> None:
        self.about_label.setText(text or protocol_summary(self.form.kind))

    def choose_protocol(self, name: str) -> None:
        """Show the set-up of a protocol with the parameters that it had last."""
        if self.protocol_box.isEnabled():
            self.protocol_box.setCurrentIndex(self.protocol_box.findData(name))
            self.show_side(SETUP)

    def _on_protocol_chosen(self) -> None:
        name = self.protocol_box.currentData()
        self.set_protocol(self._edited_protocols.get(name) or PROTOCOLS[name].model_validate({}))

    @property
    def can_start(self) -> bool:
        """Whether a run can be started."""
        return self.run_button.isEnabled()

    def set_state(self, view: WindowState) -> None:
        """Show whether a run can begin, and why not."""
        focused = self.window().focusWidget()
        page = self.parentWidget()
        if view.busy and not self._busy and page and focused is not None and self.isAncestorOf(focused):
            self._left_editor = focused  # a disabled editor would give the keyboard to a control at random
            page.setFocus()
        for editor in (self.form, self.protocol_box, *self._editors, self._browse, self.preset_button):
            editor.setEnabled(not view.busy)
        self.rehearsal_label.setVisible(not view.busy)
        began, self._busy = view.busy and not self._busy, view.busy
        self.result_card.set_state(view)
        self.no_result_label.setVisible(self.result_card.isHidden())
        waits = view.prompt is not None
        self.run_button.setText("Run" if not view.busy else "Waits for you" if waits else "Running")
        show_key(self.run_button, "" if view.busy else ACTIONS["run"].shortcut)
        result = self.segments.buttons[RESULT]
        result.setText("Result so far" if view.busy else "Result")
        result.setEnabled(not self.result_card.isHidden())
        if began:
            self.show_side(RESULT)
        self._can_run = view.can_run or view.can_queue
        self._blocked_reason = "" if view.can_queue else view.blocked_reason
        self._update_rehearsal()
        if not view.busy and self._left_editor is not None:
            if self.window().focusWidget() is page:
                self._left_editor.setFocus()
            self._left_editor = None

    def show_side(self, side: object) -> None:
        """Show the set-up or the result; both stand side by side in a wide window."""
        self.segments.select(side)
        self.segments.setVisible(not self._is_beside)
        self._setup.setVisible(self._is_beside or side == SETUP)
        if not self._is_beside:
            self.result_pane.setVisible(side == RESULT)

    def place_result(self, beside: QWidget | None) -> None:
        """Move the result card beside the plots, or under the switch of this column."""
        if beside is self.result_pane.parentWidget() or (beside is None and self.result_pane.parentWidget() is self):
            return
        self._is_beside = beside is not None
        set_margins(self._places, (16, 16, 16, 16) if self._is_beside else (8, 8, 8, 8), 8)
        self._align_labels()
        if beside is None:
            self._places.insertWidget(2, self.result_pane, 1)
        else:
            self._places.removeWidget(self.result_pane)
            self.result_pane.setParent(beside)
            self.result_pane.show()
        self.show_side(self.segments.selected)

    def minimumSizeHint(self) -> QSize:
        """Return the least size of the set-up: the result card fits itself to any height."""
        least, around = self._setup.minimumSizeHint(), self.segments.sizeHint().height() + self.run_button.height()
        return QSize(least.width() + px(16), least.height() + around + px(32))

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        if self.result_pane.parentWidget() is self:
            taken = self.segments.sizeHint().height() + self.run_button.height() + px(32)
            self.result_card.set_room(self.height() - taken)

    def show_operator(self, name: str) -> None:
        """Show who measures today, unless another name is being typed."""
        if not self.operator_edit.hasFocus():
            self.operator_edit.setText(name)

    def show_warnings(self, messages: Sequence[str]) -> None:
        """Show the warnings of the preflight check."""
        text = "\n".join(f"⚠ {each}." for each in messages)
        if text != self.warnings_label.text():
            show_text(self.warnings_label, text)

    def _on_edited(self) -> None:
        self._update_rehearsal()
        self.changed.emit()

    def _update_rehearsal(self) -> None:
        """Rehearse the form and enable or disable Run."""
        about = (self.form.result, self._bench())
        if about != self._rehearsed_inputs:
            self._rehearsed_inputs, self._rehearsal_result = about, rehearsal_text(*about)
        text, fault = self._rehearsal_result
        self.rehearsal_label.setText(text)
        set_style_kind(self.rehearsal_label, "card" if text.startswith("<") else "fault" if fault else "note")
        missing = "" if self.folder_edit.text().strip() else "a folder is needed"
        why = self._blocked_reason or missing or ("the form has a fault" if fault or self.protocol is None else "")
        self.run_button.setEnabled(self._can_run and not why)
        self.run_button.setToolTip(f"Cannot run: {why}" if why else tooltip("run"))

    def _choose_folder(self) -> None:
        choose_file(
            self, "Folder for run files", lambda path: self.folder_edit.setText(str(path)), start=str(self.folder),
            mode=Mode.Directory,
        )  # fmt: skip

    def _build(self) -> None:
        self.about_label.setMinimumHeight(ABOUT_LINES * self.about_label.fontMetrics().lineSpacing())
        self._editors = (self.specimen_edit, self.folder_edit, self.operator_edit)
        for editor in self._editors:  # the column has its width from the window's class, and the buttons keep theirs
            editor.setMinimumWidth(1)
        places = {
            self.specimen_edit.accessibleName(): self.specimen_edit,
            "": make_pane(row(self.sheet_button, None)),
            self.folder_edit.accessibleName(): make_pane(row((self.folder_edit, 1), self._browse, spacing=4)),
            self.operator_edit.accessibleName(): self.operator_edit,
        }
        self._where = make_labelled_grid(places, (8, 4), stretch={1: 1})
        # A low window scrolls the parts above the button; a result is never squeezed.
        self._content_area = make_scroll_area(
            self._form_place,
            self._where,
            self.rehearsal_label,
            self.warnings_label,
            None,
            margins=(4, 0, 4, 0),
            spacing=8,
            minimumHeight=MIN_CONTENT_HEIGHT,
            **UPRIGHT,
        )
        self._setup = make_pane(
            row((self.protocol_box, 1), self.preset_button), self.about_label, (self._content_area, 1), spacing=8
        )
        self.result_pane = QWidget()
        self.result_layout = column(self.result_card, self.no_result_label, None, parent=self.result_pane, spacing=12)
        self._places = column(
            self.segments, (self._setup, 1), (self.result_pane, 1), self.run_button, parent=self,
            margins=(8, 8, 8, 8), spacing=8,
        )  # fmt: skip
        self.show_side(SETUP)


def protocol_summary(kind: type[Protocol]) -> str:
    """Return the first paragraph of a protocol's docstring."""
    return " ".join((kind.__doc__ or "").strip().split("\n\n")[0].split())


def rehearsal_text(form: FormResult[Any], bench: Bench | None) -> tuple[str, bool]:
    """Return points, duration, volts, nearest limit and file size of a run, or the error; and whether it is an error."""
    if form.value is None:
        return f"✕ {form.errors.get('', '') or 'Correct the field marked above.'}", True
    if bench is None:
        return "Duration, volts and file size are shown when the bench is connected.", False
    try:
        rehearsal = rehearse(form.value, bench.amplifier, sensor=bench.sensor, channels=bench.channels)
    except BenchError as refusal:
        return f"✕ {refusal}", True
    entries = pluralize(rehearsal.entries, "point")
    prompts = pluralize(rehearsal.prompts, "prompt")
    rows = (
        ("This run", f"{entries}, {prompts}, {format_bench_duration(rehearsal.duration_s, bench)}"),
        ("Specimen", format_voltage_range(rehearsal.lowest_specimen_v, rehearsal.highest_specimen_v)),
        ("Nearest limit", rehearsal.worst),
        ("File", f"about {format_bytes(rehearsal.file_bytes)}"),
    )
    return rich_table(rows, wrap=True), False


class OperatorOfToday(QObject):
    """Shows today's operator and stores a typed one."""

    def __init__(self, panel: RunPanel, worker: BackgroundWorker, parent: QObject) -> None:
        super().__init__(parent)
        self._panel, self._worker = panel, worker
        panel.operator_named.connect(self._store)
        timer = QTimer(self, interval=OPERATOR_POLL_MS)
        timer.timeout.connect(self.read)
        timer.start()

    def read(self) -> None:
        """Show the stored operator; the file is read in the background."""
        self._worker.submit(remembered_conditions, lambda conditions: self._panel.show_operator(conditions.operator))

    def _store(self, name: str) -> None:
        def store() -> None:
            with suppress(UsageError):  # a name that cannot be stored is not; the login is
                remember_conditions(name)

        self._worker.submit(store)
