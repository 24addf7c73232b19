"""Bench page: switch of benches, the instruments of one, scan, live values and its file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from PySide6.QtCore import QSettings, Qt, QTimer, QUrl, Signal
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QPushButton, QWidget

from app.config import BenchConfig, BenchDraft, bench_files
from app.gui.bench_page.calibration_panel import CalibrationPanel
from app.gui.bench_page.commissioning_panel import CommissioningPanel
from app.gui.bench_page.editor import BenchEditor
from app.gui.bench_page.live_panel import LivePanel
from app.gui.bench_page.wiring_panel import WiringPanel
from app.gui.status import SessionController, SimulationControls
from app.gui.widgets import (
    BackgroundWorker,
    ElidedLabel,
    WrappedRow,
    WrappingPane,
    choose_file,
    column,
    configure,
    make_button,
    make_scroll_area,
    make_toggle,
    row,
)
from app.live import CommissioningJob
from app.session import WindowState, build_protocol
from protocols import PROTOCOLS, WIRING_CHECK

STALE_S = 1.0
"""A reading older than this is not shown as a live value."""

SIMULATED = (("sim", "Simulated bench"), ("ideal", "Simulated, ideal"))


class BenchSwitch(WrappingPane):
    """The simulated benches, the user's bench files, and a new one; choosing one shows it, and does not connect to it.

    Args:
        begin: begins a new bench.
    """

    selected = Signal(str)
    """Path of a bench file, or name of a simulated bench."""

    def __init__(self, begin: Callable[[], object]) -> None:
        super().__init__()
        configure(self, "bench.switch", accessibleName="benches")
        self.buttons: dict[str, QPushButton] = {}
        """By path or name; the new bench has an empty one."""
        new = make_button("New bench", begin, "link", "Begin the file of another bench", "bench.new")
        browse = make_button("Open a file …", self._browse, "link", "A bench file from elsewhere", "bench.browse")
        self._others = (new, browse)
        self._row = WrappedRow(*self._others)
        self.setLayout(self._row)

    def show_benches(self, files: Sequence[Path], current: str, open_bench: str) -> None:
        """Show the benches with `current` chosen and `open_bench` marked."""
        named = dict((*SIMULATED, *((str(path), path.stem) for path in files)))
        named.setdefault(current, Path(current).stem or "new bench")
        while self._row.takeAt(0) is not None:
            pass
        for name in self.buttons.keys() - named.keys():
            self.buttons.pop(name).deleteLater()
        # A button that stays is kept, because it may have the keyboard focus.
        self.buttons = {name: self.buttons.get(name) or self._make_button(name) for name in named}
        for name, title in named.items():
            self.buttons[name].setText(f"{title}  (open)" if name == open_bench else title)
        for button in (*self.buttons.values(), *self._others):
            self._row.addWidget(button)
        self.buttons[current].setChecked(True)

    def _make_button(self, name: str) -> QPushButton:
        act = partial(self.selected.emit, name) if name else None
        return make_button("", act, "choice", name, f"bench.show.{name}", checkable=True, autoExclusive=True)

    def hasHeightForWidth(self) -> bool:
        """Return False: its least height follows from its width, and the page below shrinks to nothing."""
        return False

    def take_focus(self) -> None:
        """Give the keyboard to the chosen bench."""
        chosen = next((each for each in self.buttons.values() if each.isChecked()), self._others[0])
        chosen.setFocus()

    def _browse(self) -> None:
        choose_file(self, "Open a bench file", lambda path: self.selected.emit(str(path)), "Bench files (*.toml)")


class BenchPage(QWidget):
    """One page of the window.

    Args:
        controller: of the session with the open bench.
        config: of the open bench.
        open_bench: path of its file, or name of the simulated bench.
    """

    title = "Bench"
    bench_chosen = Signal(str)
    """Path or name of the bench to connect to."""
    run_requested = Signal(object)
    """A protocol for the open bench."""

    def __init__(self, controller: SessionController, config: BenchConfig, open_bench: str) -> None:
        super().__init__()
        self._controller, self._config, self._open_bench = controller, config, open_bench
        self._adapter = adapter = controller.adapter
        self._worker = BackgroundWorker("bench page", self)
        self._state: WindowState | None = None
        self.benches = BenchSwitch(self._begin_bench)
        self.connect_button = make_button(
            "Save and connect",
            self.save_and_connect,
            "go",
            "Open this bench in the window",
            "bench.connect",
            minimumHeight=36,
        )
        self.save_button = make_button("Save", self.save, tip="Write the commented bench file", name="bench.save")
        self.discard_button = make_button(
            "Discard changes", self.discard, tip="Show the bench as its file is", name="bench.discard"
        )
        self._edited: dict[str, BenchDraft] = {}
        """Drafts of other benches with changes that are not saved, by name."""
        self.show_button = make_button(
            "Show file", lambda: _show_file(self.draft), tip="Open the folder of the file", name="bench.show"
        )
        self.file_label = configure(ElidedLabel(), "bench.file", kind="note")
        self.calibration = CalibrationPanel(self._move_target if config.simulated else None)
        self.calibrate_button = make_toggle(
            "Calibrate …", "Two or more positions with their volts", "bench.calibrate", self.calibration
        )
        controls, run = None, self.run_requested.emit
        if adapter.simulation is not None:
            controls = SimulationControls(adapter.simulation, controller.change_speed, "bench.session")
        self.wiring = WiringPanel(lambda: run(build_protocol(PROTOCOLS[WIRING_CHECK], {})))
        self.editor = BenchEditor(self._worker, controls, self.wiring, self.calibrate_button)
        self.live = LivePanel(adapter.feed, config.amplifier.amplifier_map, config.simulated, run)
        self.live_button = make_toggle(
            "Live view, level and tone by hand", "Traces, to align the laser", "bench.live", self.live
        )
        self.commissioning = CommissioningPanel(self._worker, self.commission, controller.stop)
        self._build()
        self.show_bench(open_bench)

    # -- interface to the window -----------------------------------------------------------------------------------------

    def set_state(self, view: WindowState) -> None:
        """Show identity and state of the instruments of the open bench."""
        self._state = view
        if self.editor.simulation.controls is not None:
            self.editor.simulation.controls.set_state(view)
        self._update_buttons()

    def activate(self) -> None:
        self.benches.take_focus()

    def tick(self) -> None:
        """Show live values of the open bench."""
        reading = self._adapter.feed.reading if self.is_open else None
        if reading is not None and reading.age_s > STALE_S:
            reading = None
        for tile in self.editor.tiles:
            tile.show_reading(reading)
        self.calibration.show_reading(reading)
        if self.live.isVisible():
            self.live.tick()
        self.commissioning.tick()

    def restore_state(self, settings: QSettings) -> None:
        """Restore the addresses beside *Scan*."""
        self.editor.hosts_edit.setText(str(settings.value("bench/hosts", "")))

    def save_state(self, settings: QSettings) -> None:
        """Save the addresses beside *Scan*."""
        settings.setValue("bench/hosts", self.editor.hosts_edit.text())

    def show_message(self, text: str) -> None:
        """Show why the bench cannot be opened."""
        self.editor.message_label.show_message(text, is_error=True)

    @property
    def draft(self) -> BenchDraft | None:
        """The bench that is shown, as it is edited."""
        return self.editor.draft

    @property
    def is_open(self) -> bool:
        """Whether the displayed bench is the open one."""
        return self.draft is not None and self.draft.name == self._open_bench

    # -- commands --------------------------------------------------------------------------------------------------------

    def show_bench(self, name: str, simulated: bool = False, typed_name: str = "") -> None:
        """Show a bench file or a simulated bench; an empty name begins a new one, real or `simulated`, with a name that was typed."""
        if self.draft is not None and self.draft.config != self.draft.saved:
            self._edited[self.draft.name] = self.draft
        kept = self._edited.pop(name, None)

        def load() -> tuple[BenchDraft, list[Path]]:
            draft = kept or (BenchDraft.load(name) if name else BenchDraft.new(simulated))
            return draft.with_tables(name=typed_name) if typed_name else draft, bench_files()

        self._worker.submit(load, lambda loaded: self._show_draft(*loaded), self._on_error, latest_only="load")

    def discard(self) -> None:
        """Show the bench as its file is."""
        if self.draft is not None:
            name = self.draft.name
            self.editor.draft = None
            self.show_bench(name)

    def save(self, connect: bool = False) -> None:
        """Write the bench file."""
        draft = self.draft
        if draft is None or self.editor.has_faults:
            self.show_message("A value is at fault: correct it first, it is marked in red.")
            return

        def saved(result: tuple[BenchDraft, list[Path]]) -> None:
            self._show_draft(*result)
            self.editor.message_label.show_message(f"Saved: {result[0].name}")
            if connect:
                self.bench_chosen.emit(result[0].name)

        self._worker.submit(lambda: (draft.save(), bench_files()), saved, self._on_error)

    def save_and_connect(self) -> None:
        """Write the bench file if it was edited, and open the bench in the window."""
        if self.draft is None:
            return
        if self.draft.edited:
            self.save(connect=True)
        else:
            self.bench_chosen.emit(self.draft.name)

    def commission(self) -> None:
        """Commission the source of the open bench, and its interlock."""
        job = CommissioningJob(self._config, self._adapter)
        self.commissioning.follow(job)
        self._controller.commission(job)

    # -- inside ----------------------------------------------------------------------------------------------------------

    @property
    def _can_run(self) -> bool:
        """Whether the bench that is shown is open as it is shown, and free."""
        draft, view = self.draft, self._state
        if draft is None or view is None or draft.edited or not self.is_open:
            return False
        return draft.config.same_bench(self._config) and view.can_run

    def _move_target(self, by_m: float) -> None:
        feed, move = self._adapter.feed, self._adapter.faults.move_target
        self._worker.submit(lambda: move(by_m), lambda _: feed.restart_reading(), self._on_error)

    def _show_draft(self, draft: BenchDraft, files: list[Path]) -> None:
        self.benches.show_benches(files, draft.name, self._open_bench)
        self.editor.show_draft(draft, draft.name == self._open_bench)
        if not draft.name and self.window().focusWidget() is self.editor.name_edit:
            self.editor.name_edit.selectAll()
        if self._state is not None:
            self.set_state(self._state)
        self._update_buttons()

    def _on_error(self, error: Exception) -> None:
        self.show_message(str(error))

    def _begin_bench(self, simulated: object = None) -> None:
        """Show a new bench, whose name is typed first; one of another kind begins without the edits of the last one, but with its name."""
        last, typed_name = self.draft, ""
        if simulated is not None and last is not None:
            typed_name = last.config.name if last.config.name != last.saved.name else ""
            self.editor.draft = None
        self.show_bench("", bool(simulated), typed_name)
        if not typed_name:
            self.editor.name_edit.setFocus()

    def _update_buttons(self) -> None:
        draft = self.draft
        edited = draft is not None and draft.edited
        busy = self._state is not None and self._state.busy
        self.save_button.setEnabled(edited and not busy)
        self.discard_button.setEnabled(edited)
        self.show_button.setEnabled(draft is not None and draft.has_file)
        self.connect_button.setText("Save and connect" if edited else "Connect again" if self.is_open else "Connect")
        self.connect_button.setEnabled(draft is not None and not busy)
        if self._state is not None:
            by_role = {status.role: status for status in self._state.instruments} if self.is_open else {}
            for tile in self.editor.tiles:
                tile.set_status(by_role.get(tile.role), self._state.problem, self.connect_button.text())
            self.wiring.set_state(self._state, self.is_open, self._can_run)
        for button in (self.commissioning.start_button, self.live.level_button, self.live.tone_button):
            button.setEnabled(self._can_run)
        if draft is None:
            return
        where = draft.name if draft.has_file else "comes with the program" if draft.name else "not saved yet"
        self.file_label.setText(f"{where}{', edited' if edited and draft.name else ''}")
        self.file_label.setToolTip(where)

    def _show_calibration(self, shown: bool) -> None:
        if shown:
            QTimer.singleShot(0, self, lambda: self._area.ensureWidgetVisible(self.calibration))
            self.calibration.position_edit.setFocus()

    def _show_remedy(self, role: str) -> None:
        """Put the control of one of the remedies into view, and give it the keyboard."""
        self.live_button.setChecked(self.live_button.isChecked() or role == "sensor")
        control = {
            "generator": self.editor.source.address_editor,
            "amplifier": self.wiring.start_button,
            "sensor": self.live_button,
            "card": self.editor.card.form.rows["device"].editor,
        }[role]
        control.setFocus()
        QTimer.singleShot(0, self, lambda: self._area.ensureWidgetVisible(control))

    def _show_wiring(self) -> None:
        """Put the verdict on the wiring into view: its table where there is space, its line in any case."""
        for part in (self.wiring.table, self.wiring.table.caption, self.wiring.status_label):
            self._area.ensureWidgetVisible(part, 0, 6)

    def _build(self) -> None:
        head = row(self.connect_button, self.save_button, self.discard_button, self.show_button, (self.file_label, 1))
        self._area = make_scroll_area(
            self.editor,
            self.live_button,
            self.live,
            self.calibration,
            self.commissioning,
            None,
            margins=(0, 0, 6, 6),
            spacing=6,
            focusPolicy=Qt.FocusPolicy.NoFocus,
        )
        self._area.setMinimumSize(300, 200)
        column(self.benches, head, (self._area, 1), parent=self, spacing=6)
        self.calibrate_button.toggled.connect(self._show_calibration)
        # The table has its place only after the layout, and a check that has ended hides its prompts.
        self.wiring.ended.connect(lambda: QTimer.singleShot(0, self, self._show_wiring))
        self.calibration.applied.connect(self.editor.use_calibration)
        self.benches.selected.connect(self.show_bench)
        self.editor.changed.connect(self._update_buttons)
        self.editor.kind_segments.chosen.connect(self._begin_bench)
        for tile in self.editor.tiles:
            tile.remedy_requested.connect(self._show_remedy)


def _show_file(draft: BenchDraft | None) -> None:
    """Open the folder of a bench's file."""
    if draft is not None and draft.has_file:
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(Path(draft.name).resolve().parent)))
