"""Comparison workspace: plot of up to 20 runs, their layers with cursor values, peaks, what differs, views and exports."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from app.archive import FORMAT_NAMES, FORMATS, Format
from app.common import typeset
from app.comparison import (
    ORDERS,
    VIEW_SUFFIX,
    Comparison,
    ComparisonError,
    ComparisonView,
    export_comparison,
    open_comparison,
    read_view,
    save_view,
    views_in,
)
from app.gui.plots import axis_title
from app.gui.runs.compare.differences import DifferencesPane
from app.gui.runs.compare.layer_table import LAYER_ACTIONS, LayerTable
from app.gui.runs.compare.plot import ComparisonPlot
from app.gui.widgets import (
    BackgroundWorker,
    Menu,
    Mode,
    Segments,
    choose_file,
    column,
    fill_combo,
    fill_table,
    give_menu,
    make_button,
    make_combo,
    make_label,
    make_pane,
    make_read_only_table,
    make_scroll_area,
    make_splitter,
    row,
    show_text,
    tooltip,
)
from model import Relation, Series

RELATIONS = (
    ("Values", Relation.VALUES),
    ("Normalised", Relation.NORMALISED),
    ("Difference", Relation.DIFFERENCE),
    ("Ratio", Relation.RATIO),
)
TABLES = (("Peaks", 0), ("What differs", 1))
LAYERS_WIDTH = 430


class ComparisonWorkspace(QWidget):
    """Shows a comparison; every change makes another view of the same runs.

    Attributes:
        comparison: what is shown; None before the first one.
    """

    opened = Signal()
    """Runs or a saved view have been read and are shown."""
    failed = Signal(object)
    """An exception with a message."""
    model_asked = Signal(object)
    """The comparison that wants the model's curve and does not have it yet."""

    def __init__(self) -> None:
        super().__init__()
        self.comparison: Comparison | None = None
        self._folder = Path()
        self._worker = BackgroundWorker("comparison", self)
        self.plot, self.layers, self.differences = ComparisonPlot(), LayerTable(), DifferencesPane()
        self.plot.tools.follows = True
        self.plot.tools.places_changed.connect(self.layers.show_values)
        self.heading = make_label(kind="heading", wrap=False, name="compare.heading")
        self.note_label = make_label(kind="note", name="compare.note", visible=False)
        self.back_button = make_button("Back", name="compare.back", key="Esc")
        self.views_button = make_button("Views", None, "choice", "Saved views of this folder", "compare.views")
        self.export_button = make_button("Export", None, "choice", "Picture, or data in every format", "compare.export")
        self.quantity = make_combo("compare.quantity", "quantity", [("", "")])
        self.relation = Segments("compare.relation", "shown as", RELATIONS)
        self.over = make_combo(
            "compare.over",
            "waterfall over",
            [(f"waterfall over {each}" if each else "on one axis", each) for each in ORDERS],
        )
        tip = "The model's curve with its band"
        self.model = make_button("Model", None, "choice", tip, "compare.model", checkable=True)
        self.tables = Segments("compare.tables", "table", TABLES)
        self.tables.select(0)
        self.peaks = make_read_only_table((), "compare.peaks", "peaks", stretched="none")
        self._build()
        self._connect()

    def _build(self) -> None:
        give_menu(self.views_button, self._fill_views)
        give_menu(self.export_button, self._fill_exports)
        keys = [
            make_button(
                text, partial(self.layers.perform, what), "choice", tooltip(f"compare.{what}"), f"compare.{what}"
            )
            for what, text in LAYER_ACTIONS.items()
        ]
        left = make_pane(column((self.layers, 1), row(*keys, None, spacing=4), spacing=4))
        self.stack = QStackedWidget()
        self.stack.addWidget(self.peaks)
        self.stack.addWidget(make_scroll_area(self.differences, focusPolicy=Qt.FocusPolicy.NoFocus))
        lower = make_pane(column(row(self.tables, None), (self.stack, 1), spacing=4))
        right = make_splitter(
            "compare/rows", (self.plot, 3), (lower, 2), orientation=Qt.Orientation.Vertical, sizes=[480, 200]
        )
        self.plot.setMinimumSize(320, 160)
        lower.setMinimumHeight(80)
        columns = make_splitter("compare/columns", (left, 1), (right, 2), sizes=[LAYERS_WIDTH, 900])
        left.setMinimumWidth(300)
        head = row(self.back_button, (self.heading, 1), self.views_button, self.export_button)
        controls = row(self.quantity, self.relation, self.over, self.model, None, spacing=8)
        column(head, controls, self.note_label, (columns, 1), parent=self, margins=(0, 2, 8, 0), spacing=4)

    def _connect(self) -> None:
        self.quantity.currentIndexChanged.connect(lambda _: self._change(quantity=self.quantity.currentData() or ""))
        self.over.currentIndexChanged.connect(lambda _: self._change(over=self.over.currentData()))
        self.relation.chosen.connect(lambda relation: self._change(relation=relation))
        self.model.clicked.connect(lambda on: self._change(model=on))
        self.tables.chosen.connect(lambda at: self.stack.setCurrentIndex(int(str(at))))
        self.layers.requested.connect(self._change_layer)

    def open_runs(self, paths: Sequence[Path], view: ComparisonView | None = None) -> None:
        """Read runs in the background and show them."""
        self._read(lambda: open_comparison(paths, view), paths[0].parent)

    def open_view(self, path: Path) -> None:
        """Read a saved view and its runs in the background and show them."""

        def read() -> Comparison:
            view = read_view(path)
            return open_comparison([path.parent / name for name in view.runs], view)

        self._read(read, path.parent)

    def _read(self, read: Callable[[], Comparison], folder: Path) -> None:
        def show(comparison: Comparison) -> None:
            self.show_comparison(comparison, folder)
            self.opened.emit()

        self._worker.submit(read, show, self._on_error, latest_only="comparison")

    def export(self, folder: Path, kind: Format) -> None:
        """Write the shown values in a format, in the background."""
        if self.comparison is not None:
            write = partial(export_comparison, self.comparison, folder, kind)
            self._worker.submit(
                write, lambda files: self.show_note(f"{len(files)} files written to {folder}"), self._on_error
            )

    def _on_error(self, error: Exception) -> None:
        self.show_note(str(error))
        self.failed.emit(error)

    def show_comparison(self, comparison: Comparison, folder: Path) -> None:
        """Show a comparison; views are saved in the folder."""
        self._folder = folder
        self._show(comparison)
        self.plot.set_cursors(comparison.view.cursors)

    def show_model(self, model: dict[str, Series]) -> None:
        """Add the model's curves, by quantity."""
        if self.comparison is not None:
            self._show(Comparison(self.comparison.runs, self.comparison.view, model))

    def show_note(self, text: str) -> None:
        """Show a message; empty: none."""
        show_text(self.note_label, text)

    @property
    def view(self) -> ComparisonView:
        """What is shown, with the cursors."""
        assert self.comparison is not None
        return self.comparison.view.model_copy(update={"cursors": tuple(self.plot.tools.cursors)})

    def save(self, path: Path) -> None:
        """Save the view."""
        path = path.with_name(path.name.removesuffix(VIEW_SUFFIX) + VIEW_SUFFIX)
        try:
            save_view(self.view, path)
        except ComparisonError as error:
            self.show_note(str(error))
        else:
            self.show_note(f"The view is saved as {path.name}.")

    def _change(self, **changes: Any) -> None:
        if self.comparison is None or all(
            getattr(self.comparison.view, name) == value for name, value in changes.items()
        ):
            return
        self._show(self.comparison.with_view(self.comparison.view.model_copy(update=changes)))

    def _change_layer(self, what: str, name: str) -> None:
        """Hide or show a run, make it the reference, or move it up or down."""
        assert self.comparison is not None
        if what == "hide":
            hidden = self.comparison.view.hidden
            kept = tuple(each for each in hidden if each != name)
            self._change(hidden=kept if name in hidden else (*kept, name))
        elif what == "reference":
            self._change(reference=name)
        else:
            names = [run.path.name for run in self.comparison.runs]
            at = names.index(name)
            names.insert(max(at - 1, 0) if what == "up" else at + 1, names.pop(at))
            self._change(runs=tuple(names))

    def _show(self, comparison: Comparison) -> None:
        previous, self.comparison = self.comparison, comparison
        view = comparison.view
        for combo, value in ((self.quantity, comparison.quantity), (self.over, view.over)):
            combo.blockSignals(True)
            if combo is self.quantity:
                fill_combo(combo, [(each.capitalize(), each) for each in comparison.quantities])
            combo.setCurrentIndex(max(combo.findData(value), 0))
            combo.blockSignals(False)
        self.relation.select(view.relation)
        self.model.setChecked(view.model)
        self.heading.setText(f"{len(comparison.runs)} runs compared" if len(comparison.runs) > 1 else "1 run")
        self.show_note("; ".join(comparison.left_out))
        self.plot.show_comparison(comparison)
        self.layers.show_layers(comparison)
        paths, before = ([] if each is None else [run.path for run in each.runs] for each in (comparison, previous))
        if previous is None or before != paths or previous.quantity != comparison.quantity:
            self._fill_peaks(comparison)
            self.differences.show_runs([run.summary for run in comparison.runs])
        if view.model and not comparison.model:
            self.model_asked.emit(comparison)

    def _fill_peaks(self, comparison: Comparison) -> None:
        columns = [each for each in comparison.peaks.columns if each.displayed]
        self.peaks.setColumnCount(len(columns))
        titles = [axis_title(each.displayed_name, typeset(each.displayed_unit.removeprefix("1"))) for each in columns]
        self.peaks.setHorizontalHeaderLabels(titles)
        texts = [[each.format_value(cell) for cell in each.cells] for each in columns]
        fill_table(self.peaks, list(zip(*texts, strict=True)), right_aligned=range(2, len(columns)))

    # -- menus -------------------------------------------------------------------------------------------------------

    def _fill_views(self, menu: Menu) -> None:
        for name in views_in(self._folder):
            menu.addAction(name, partial(self.open_view, self._folder / f"{name}{VIEW_SUFFIX}"))
        menu.addSeparator()
        ask = partial(
            choose_file, self, "Save the view", self.save, f"Views (*{VIEW_SUFFIX})", str(self._folder / f"comparison{VIEW_SUFFIX}"), Mode.AnyFile
        )  # fmt: skip
        menu.addAction("Save the view …", ask)

    def _fill_exports(self, menu: Menu) -> None:
        menu.addAction("Picture (PNG, SVG, PDF) …", self.plot.tools.files.choose_picture)
        menu.addSeparator()
        for kind in FORMATS:
            menu.addAction(FORMAT_NAMES[kind], partial(self._choose_folder, kind))

    def _choose_folder(self, kind: Format) -> None:
        choose_file(
            self, "Folder for the exported data", lambda path: self.export(path, kind), start=str(self._folder), mode=Mode.Directory
        )  # fmt: skip
