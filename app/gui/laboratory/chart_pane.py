"""Pane of control charts: a golden specimen over time on each displacement sensor, and causes of drifts."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QSpinBox

from app.common import Table, typeset
from app.fleet import BASELINE, MIN_BASELINE, ChartView, DriftCause, Fleet, golden_candidates, view_charts
from app.gui.laboratory.chart_plot import ControlChartPlot
from app.gui.laboratory.value_table import ValueTable
from app.gui.laboratory.view_pane import ViewPane, make_filter_combo
from app.gui.widgets import (
    BackgroundWorker,
    WrappedRow,
    column,
    configure,
    fill_combo,
    make_label,
    make_splitter,
    set_style_kind,
)
from model import quantity_label

VERDICTS = {
    DriftCause.NOTHING: ("✓ In control: no value breaks a rule", "caption"),
    DriftCause.NO_LASTING_CHANGE: ("A rule is broken, but nothing changed to stay", "caution"),
    DriftCause.UNDECIDED: ("✕ Something changed to stay, bench or specimen is not decided", "danger"),
}
"""Text and kind of style of a cause that is neither bench nor specimen."""
DEFAULT_QUANTITY = "amplitude_at_resonance"
MAX_BASELINE = 1000
BASELINE_TEXT = (
    "The baseline, the first values, sets centre and limits. Let it end before the drift: a baseline that includes the drift flags good "
    "early values."
)


class ChartPane(ViewPane):
    """Charts a golden specimen of the folder that was read."""

    FILE_STEM, EXPORTED = "control_chart", "the values of the control charts"
    BUTTON_NAME, PROBLEM = "laboratory.chart.export", "No control chart: {}"
    view: ChartView | None

    def __init__(self, worker: BackgroundWorker, show_message: Callable[[str, bool], object]) -> None:
        super().__init__(worker, show_message)
        self.golden, self.quantity, self.sensor = (
            make_filter_combo(f"laboratory.chart.{name}", name)
            for name in ("golden specimen", "quantity of the chart", "sensor")
        )
        self.baseline = configure(
            QSpinBox(),
            "laboratory.chart.baseline",
            accessibleName="number of values of the baseline",
            toolTip=f"{BASELINE_TEXT} At least {MIN_BASELINE}.",
            keyboardTracking=False,
            prefix="baseline: first ",
            suffix=" values",
        )
        self.baseline.setRange(MIN_BASELINE, MAX_BASELINE)
        self.baseline.setValue(BASELINE)
        self.verdict_label = make_label(kind="caption", name="laboratory.chart.verdict")
        self.notes_label = make_label(kind="note", name="laboratory.chart.notes")
        self.plot = ControlChartPlot()
        self.broken = ValueTable("laboratory.chart.broken", "values that break a rule")
        bar = WrappedRow(
            make_label("Golden specimen", wrap=False),
            self.golden,
            self.quantity,
            self.sensor,
            self.baseline,
            self.export_button,
            spacing=6,
        )
        parts = make_splitter("laboratory/chart", (self.plot, 4), (self.broken, 1), orientation=Qt.Orientation.Vertical)
        column(bar, self.verdict_label, self.notes_label, (parts, 1), parent=self, spacing=4)
        for combo in (self.golden, self.quantity):
            combo.currentIndexChanged.connect(lambda _: self.update_view())
        self.baseline.valueChanged.connect(lambda _: self.update_view())
        self.sensor.currentIndexChanged.connect(lambda _: self._show_chart())
        self.broken.row_opened.connect(self._open_run)

    def show_fleet(self, folder: Path, fleet: Fleet | None, golden: str) -> None:
        """Chart a specimen of a folder; `golden`: the golden specimen of the file of limits, if any."""
        self._folder, self._fleet = folder, fleet
        if fleet is None:
            self._show_view(None)
            return
        fill_combo(self.golden, [(typeset(name), name) for name in golden_candidates(fleet)], golden)
        fill_combo(self.quantity, [(typeset(quantity_label(name)), name) for name in fleet.names], DEFAULT_QUANTITY)
        self.update_view()

    def update_view(self) -> None:
        """Compute the charts in the background, and show them."""
        fleet, golden, quantity = self._fleet, self.golden.currentData(), self.quantity.currentData()
        if fleet is None or not golden or not quantity:
            return
        baseline = self.baseline.value()
        self._worker.submit(
            lambda: view_charts(fleet, golden, quantity, baseline),
            self._show_view,
            self._on_error,
            latest_only="charts",
        )

    @property
    def exported_table(self) -> Table:
        assert self.view is not None
        return self.view.points

    def _show_view(self, view: ChartView | None) -> None:
        self.view = view
        charts = () if view is None else view.charts
        drifted = next((chart.sensor for chart in charts if chart.cause.is_drift), None)
        fill_combo(self.sensor, [(chart.sensor or "unknown sensor", chart.sensor) for chart in charts], drifted)
        self.export_button.setEnabled(view is not None)
        for widget in (self.sensor, self.plot, self.broken):
            widget.setVisible(view is not None)
        self._show_chart()
        if view is not None:
            self._show_message("", False)

    def _show_chart(self) -> None:
        view, at = self.view, self.sensor.currentIndex()
        if view is None or at < 0:
            self.verdict_label.setText("")
            self.notes_label.setText("")
            return
        chart = view.charts[at]
        first = chart.first_signal
        since = "" if first is None else f", first signal on {chart.values[first].start_time[:10]}"
        text, kind = VERDICTS.get(chart.cause, (f"✕ Drift of the {chart.cause}", "danger"))
        self.verdict_label.setText(f"{text}{since if chart.cause.is_drift else ''}")
        set_style_kind(self.verdict_label, kind)
        self.notes_label.setText(typeset("\n".join((*view.notes, BASELINE_TEXT))))
        name = typeset(view.selection.label)
        title = f"{view.golden} on {chart.sensor or 'an unknown sensor'}: {name}, {view.selection.about}"
        self.plot.show_chart(chart, view.selection.unit, title, view.simulated)
        self.broken.set_table(view.broken[at])

    def _open_run(self, row: int) -> None:
        if self.view is not None and (at := self.sensor.currentIndex()) >= 0:
            number = self.view.broken[at].columns[0].values[row]
            self.run_open_requested.emit(self.view.charts[at].values[number - 1].path)
