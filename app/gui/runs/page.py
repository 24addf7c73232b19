"""The Runs page: every run of the folder, found by a few words, opened with Enter, compared, noted, exported, dragged."""

from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtGui import QDragEnterEvent, QDropEvent, QGuiApplication
from PySide6.QtWidgets import QStackedWidget

from app.archive.export import Format
from app.archive.replay import Measured, Reopened, Traces, look_closer, reopen
from app.archive.run_summary import Entry
from app.archive.transfer import measured_of
from app.config.tables import AmplifierTable
from app.gui.runs.details import RunSide
from app.gui.runs.filter_bar import RunFilter
from app.gui.runs.folder_model import RunsFolder
from app.gui.runs.table import RunsList, RunsModel, RunsTable
from app.gui.runs.transfers import Transfers
from app.gui.runs.viewer import RunView
from app.gui.widgets.background import Jobs
from app.gui.widgets.dropped_files import run_urls, table_urls
from app.gui.widgets.file_dialog import Mode, ask_for_files
from app.gui.widgets.shortcuts import HERE, bind
from app.gui.widgets.theme import Theme
from app.live.overlay import Overlay, Question, elongations_of
from app.session.state import View

MOST_COMPARED = 24


class RunsPage(QStackedWidget):
    """One page of the window: the list, and in its place a run that was opened.

    Args:
        folder: where the runs are, asked whenever the page is looked at.
        specimen: whose tables are dropped here, asked when some are.
        amplifier: through which they were driven.
    """

    title = "Runs"
    explore_asked = Signal(object)
    """Paths of runs to be laid over the model's curve."""

    def __init__(
        self,
        folder: Callable[[], Path],
        specimen: Callable[[], str],
        amplifier: AmplifierTable,
        overlay: Overlay,
        theme: Theme,
        index: Path | None = None,
    ) -> None:
        super().__init__()
        self._overlay = Overlay(amplifier=overlay.amplifier)
        self._reads = Jobs("run files", self)
        self._folder = folder
        self.known = RunsFolder(folder, index, self)
        self.model = RunsModel(theme)
        self.table = RunsTable(self.model)
        self.filter, self.side, self.opened = RunFilter(), RunSide(theme), RunView(theme)
        self.transfers = Transfers(self.side.going, folder, specimen, amplifier, self)
        self.addWidget(RunsList(self.filter, self.table, self.side))
        self.addWidget(self.opened)
        self.setAcceptDrops(True)
        self._connect()

    # -- what the window does with a page ------------------------------------------------------------------------------

    def show_view(self, view: View) -> None:
        """A run that ended is news; one that is being written is left alone."""
        self.known.show_busy(view.busy)

    def writing(self, path: Path | None) -> None:
        """The file that this program is writing."""
        self.known.writing(path)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.model.set_theme(theme)
        self.side.set_theme(theme)
        self.opened.set_theme(theme)

    def enter(self) -> None:
        """Take the keyboard."""
        (self.opened.back if self.currentWidget() is self.opened else self.table).setFocus()

    def refresh(self) -> None:
        """Called at every tick while the page is seen."""
        self.known.refresh()
        if self.currentWidget() is self.opened and (curve := self._overlay.ready()) is not None:
            self.opened.show_curve(curve)

    def end(self) -> None:
        """End what works beside the window."""
        self.transfers.end()
        self.known.end()
        self._reads.close()
        self._overlay.close()

    # -- what a person wants -------------------------------------------------------------------------------------------

    def open(self) -> None:
        """The chosen run, as it was."""
        chosen = self.chosen
        if not chosen:
            return
        if not chosen[0].readable:
            self.side.say(chosen[0].reason, fault=True)
            return
        self.open_path(self._path(chosen[0]))

    def open_path(self, path: Path) -> None:
        """A run, as it was."""
        self.side.say("opening …")
        self._reads.do(lambda: reopen(path), self._reopened, self._failed)

    def back(self) -> bool:
        """From an opened run to the list, from a search to all; whether there was somewhere to go."""
        if self.currentWidget() is self.opened:
            self.setCurrentIndex(0)
            self.table.setFocus()
            return True
        if self.filter.clear():
            return True
        self.table.setFocus()
        return False

    def annotate(self, tags: str, note: str) -> None:
        """Tags and a note for what is chosen; with several, the tags are added to each and notes stay."""
        chosen = [(self._path(e), e.tags, e.note) for e in self.chosen]
        self.known.annotate(chosen, tags, note)

    def export(self, folder: Path, kind: Format, chosen: Sequence[Entry] | None = None) -> None:
        """What is chosen, or what was, as files for other programs."""
        entries = self.chosen if chosen is None else chosen
        self.transfers.export([self._path(e) for e in entries if e.readable], folder, kind)

    def explore(self) -> None:
        """Lay what is chosen, or opened, over the model's curve."""
        if self.currentWidget() is self.opened and self.opened.run is not None:
            self.explore_asked.emit([self.opened.run.path])
        elif paths := [self._path(e) for e in self.chosen if e.readable]:
            self.explore_asked.emit(paths)

    @property
    def chosen(self) -> list[Entry]:
        """The entries that are selected, in the list's order."""
        return self.table.chosen

    def choose(self, paths: Sequence[str]) -> None:
        """Select runs by their paths."""
        self.table.choose(paths)

    # -- inside --------------------------------------------------------------------------------------------------------

    def _path(self, entry: Entry) -> Path:
        return self.model.folder / entry.path

    def _listed(self) -> None:
        self.filter.offer(self.known.entries)
        self._list()

    def _list(self) -> None:
        chosen = [entry.path for entry in self.chosen]
        found = self.filter.wanted.among(self.known.entries)
        self.model.show(self.known.path, found)
        self.choose(chosen)
        if not self.chosen and found:
            self.table.setCurrentIndex(self.model.index(0, 0))
        self.filter.count(len(found), len(self.known.entries))
        self._chosen()

    def _chosen(self) -> None:
        chosen = self.chosen
        self.side.show_entries(chosen)
        paths = [self._path(e) for e in chosen if e.readable][:MOST_COMPARED]
        self._reads.do(lambda: (chosen, measured_of(paths)), self._compared, self._failed)

    def _compared(self, answer: tuple[list[Entry], list[Measured]]) -> None:
        chosen, runs = answer
        if chosen == self.chosen:  # else it was overtaken
            self.side.show_runs(runs, len(chosen))

    def _reopened(self, run: Reopened) -> None:
        self.side.say("")
        self.opened.show_run(run)
        peak_to_peak = run.parameters.get("peak_to_peak_v", 5.0)
        amplitude_v, elongations = float(peak_to_peak) / 2, elongations_of(run.points)
        self._overlay.ask(Question(1.05 * run.top_hz, amplitude_v, run.path.parent, run.specimen, elongations))
        self.setCurrentWidget(self.opened)
        self.opened.back.setFocus()

    def _look_closer(self, from_s: float, to_s: float) -> None:
        """What is looked at closely is read from the file; only where it is still looked at when its turn comes."""
        run, traces = self.opened.run, self.opened.traces
        if run is None:
            return

        def show(part: Traces) -> None:
            if self.opened.run is run and traces.seen == (from_s, to_s):
                traces.show_part(part)

        self._reads.do(lambda: look_closer(run.path, from_s, to_s), show, self._failed)

    def _failed(self, error: Exception) -> None:
        self.side.say(str(error), fault=True)

    def _ask_to_export(self, kind: Format) -> None:
        if chosen := self.chosen:
            ask_for_files(
                self, "Folder for the exported files", lambda paths: self.export(paths[0], kind, chosen),
                start=str(self._folder()), mode=Mode.Directory,
            )  # fmt: skip

    def _copy_paths(self) -> None:
        QGuiApplication.clipboard().setText("\n".join(str(self._path(e).resolve()) for e in self.chosen))

    def _search(self) -> None:
        if self.currentWidget() is not self.opened:
            self.filter.search.setFocus()
            self.filter.search.selectAll()

    def _connect(self) -> None:
        self.filter.changed.connect(self._list)
        self.filter.stop_pressed.connect(self.known.stop)
        self.known.emptied.connect(self._list)
        self.known.listed.connect(self._listed)
        self.known.progressed.connect(self.filter.progressed)
        self.known.scanned.connect(self.filter.scanned)
        self.known.failed.connect(self._failed)
        self.filter.to_list.connect(self.table.setFocus)
        self.table.selectionModel().selectionChanged.connect(lambda *_: self._chosen())
        self.table.opened.connect(self.open)
        self.table.doubleClicked.connect(lambda _: self.open())
        self.transfers.came.connect(self.known.look)
        self.transfers.said.connect(self.side.say)
        self.side.noted.connect(self.annotate)
        self.side.open_pressed.connect(self.open)
        self.side.explore_pressed.connect(self.explore)
        self.side.export_pressed.connect(self._ask_to_export)
        self.opened.traces.looked_at.connect(self._look_closer)
        self.opened.back_pressed.connect(self.back)
        self.opened.explore_pressed.connect(self.explore)
        for words, do, keys in (
            ("Search", self._search, ("/", "Ctrl+F")),
            ("Lay what is chosen over the model's curve", self.explore, ("E",)),
            ("Export what is chosen", lambda: self._ask_to_export("csv"), ("Ctrl+E",)),
            ("Tags and note", self.side.tags.setFocus, ("F2",)),
            ("Copy the paths of what is chosen", self._copy_paths, ("Ctrl+C",)),
        ):
            bind(self, words, do, *keys, context=HERE, repeats=True)

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if (run_urls(event) or table_urls(event)) and event.source() is None:
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        if runs := run_urls(event):
            self.transfers.take_in(runs)
        if tables := table_urls(event):
            self.transfers.bring_in(tables)
        event.acceptProposedAction()
