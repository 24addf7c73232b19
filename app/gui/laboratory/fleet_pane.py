"""Pane of many specimens: filter, plot over time, statistics of a quantity, and the table of the specimens."""

from collections.abc import Callable, Mapping
from pathlib import Path

from PySide6.QtCore import Qt, QTimer

from app.common import Table, typeset
from app.fleet import CALIBRATION, GROUPS, Bounds, Fleet, FleetQuery, FleetView, view_fleet
from app.gui.laboratory.fleet_plot import FleetPlot
from app.gui.laboratory.value_table import ValueTable
from app.gui.laboratory.view_pane import ViewPane, make_filter_combo
from app.gui.widgets import (
    BackgroundWorker,
    WrappedRow,
    column,
    fill_combo,
    make_label,
    make_line_edit,
    make_pane,
    make_splitter,
)
from model import quantity_label

SINCE = (("any time", ""), ("30 days", "30d"), ("90 days", "90d"), ("a year", "365d"))
SEARCH_DELAY_MS = 150


class FleetPane(ViewPane):
    """Compares the specimens of the folder that was read."""

    FILE_STEM, EXPORTED, BUTTON_NAME = "specimens", "the table of the specimens", "laboratory.export"
    view: FleetView | None

    def __init__(self, worker: BackgroundWorker, show_message: Callable[[str, bool], object]) -> None:
        super().__init__(worker, show_message)
        self._limits: Mapping[str, Bounds] = {}
        self._golden = ""
        self.quantity = make_filter_combo("laboratory.quantity", "quantity")
        self.batch = make_filter_combo("laboratory.batch", "batch", ("any batch", ""))
        self.since = make_filter_combo("laboratory.since", "since", *SINCE)
        self.group_by = make_filter_combo("laboratory.group by", "group by", *((f"by {name}", name) for name in GROUPS))
        self.search_edit = make_line_edit(
            "laboratory.search",
            "search",
            placeholderText="specimen, sensor or bench",
            clearButtonEnabled=True,
            minimumWidth=170,
        )
        self.plot = FleetPlot()
        self.summary = ValueTable("laboratory.summary", "statistics of the quantity", sortable=False)
        self.groups = ValueTable("laboratory.groups", "mean and spread of each group")
        self.specimens = ValueTable("laboratory.specimens", "specimens")
        self.outlier_label = make_label(
            "bold: possible outlier, modified z-score above 3.5; ± is the total standard uncertainty; Enter opens the newest run",
            "note",
        )
        tables = make_splitter(
            "laboratory/tables", (self.summary, 3), (self.groups, 2), orientation=Qt.Orientation.Vertical
        )
        upper = make_splitter("laboratory/columns", (self.plot, 3), (tables, 2), sizes=[560, 330])
        lower = make_pane((self.specimens, 1), self.outlier_label, spacing=2)
        rows = make_splitter("laboratory/rows", (upper, 3), (lower, 2), orientation=Qt.Orientation.Vertical)
        bar = WrappedRow(
            self.quantity, self.batch, self.since, self.group_by, self.search_edit, self.export_button, spacing=6
        )
        column(bar, (rows, 1), parent=self, spacing=6)
        self._search_timer = QTimer(self, singleShot=True, interval=SEARCH_DELAY_MS)
        self._search_timer.timeout.connect(self.update_view)
        self.search_edit.textChanged.connect(lambda _: self._search_timer.start())
        for combo in (self.quantity, self.batch, self.since, self.group_by):
            combo.currentIndexChanged.connect(lambda _: self.update_view())
        self.specimens.row_selected.connect(lambda row: self.plot.show_specimen(self._specimen_at(row)))
        self.specimens.row_opened.connect(self._open_newest)

    def show_fleet(self, folder: Path, fleet: Fleet | None, limits: Mapping[str, Bounds], golden: str = "") -> None:
        """Show the specimens of a folder; None: there are none."""
        self._folder, self._fleet, self._limits, self._golden = folder, fleet, limits, golden
        if fleet is None:
            self._show_view(None)
            return
        fill_combo(self.quantity, [(typeset(quantity_label(name)), name) for name in fleet.names])
        batches = sorted({v.batch for v in fleet.values})
        fill_combo(self.batch, [("any batch", ""), *((typeset(name), name) for name in batches)])
        self.update_view()

    def update_view(self) -> None:
        """Compute the selection of the filter in the background, and show it."""
        fleet, limits, golden = self._fleet, self._limits, self._golden
        if fleet is None:
            return
        query = FleetQuery(
            self.quantity.currentData() or "",
            self.batch.currentData() or "",
            self.search_edit.text(),
            self.since.currentData(),
            self.group_by.currentData(),
        )
        self._worker.submit(
            lambda: view_fleet(fleet, query, limits, golden), self._show_view, self._on_error, latest_only="fleet view"
        )

    def _show_view(self, view: FleetView | None) -> None:
        self.view, self.exported_table = view, None if view is None else view.specimens
        self.export_button.setEnabled(view is not None)
        self.plot.show_view(view)
        tables = (Table("", "", ()),) * 3 if view is None else (view.summary, view.by_group, view.specimens)
        for shown, table in zip((self.summary, self.groups, self.specimens), tables, strict=True):
            shown.set_table(table)
        if view is not None:
            self._show_message("", False)

    def _specimen_at(self, row: int) -> str:
        return "" if row < 0 or self.view is None else str(self.view.specimens.columns[0].values[row])

    def _open_newest(self, row: int) -> None:
        specimen = self._specimen_at(row)
        runs = [] if self.view is None else [v for v in self.view.selection.values if v.specimen == specimen]
        measured = [v for v in runs if v.protocol != CALIBRATION]
        if measured:
            self.run_open_requested.emit(measured[-1].path)
