"""Pane of control charts: a golden specimen over time on each displacement sensor, and causes of drifts."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QSpinBox

from app.common import Severity, round_figure, sentence_case, typeset
from app.fleet import BASELINE, MIN_BASELINE, ChartView, DriftCause, Fleet, GoldenChart, golden_candidates, view_charts
from app.gui.face import class_of, px
from app.gui.laboratory.chart_plot import ControlChartPlot
from app.gui.laboratory.value_table import ValueTable
from app.gui.laboratory.view_pane import ViewPane, make_filter_combo
from app.gui.results import rich_table
from app.gui.widgets import (
    UPRIGHT,
    BackgroundWorker,
    WrappedRow,
    column,
    configure,
    fill_combo,
    make_label,
    make_pane,
    make_panel,
    make_scroll_area,
    row,
    set_tone,
    show_text,
)
from model import quantity_label

VERDICTS = {
    DriftCause.NOTHING: ("✓ In control", Severity.SUCCESS, "No value breaks a rule"),
    DriftCause.NO_LASTING_CHANGE: ("! Signal", Severity.WARNING, "A rule is broken, but nothing changed to stay"),
    DriftCause.UNDECIDED: ("! Drift", Severity.WARNING, "Something changed to stay; bench or specimen is not decided"),
    DriftCause.BENCH: ("! Drift of the bench", Severity.WARNING, "{sensor} reads too {little}, since {day}"),
    DriftCause.SPECIMEN: ("! Drift of the specimen", Severity.WARNING, "{golden} gives too {little}, since {day}"),
}
"""Verdict, severity and sentence of the finding, by cause."""
WHY = {DriftCause.BENCH: "Why the bench, not the specimen", DriftCause.SPECIMEN: "Why the specimen, not the bench"}
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
        self.verdict_label = make_label(kind="pill", wrap=False, name="laboratory.chart.verdict")
        self.count_label = make_label(kind="note", name="laboratory.chart.count")
        self.finding_label = make_label(kind="large", name="laboratory.chart.finding")
        self.figure_label = make_label(kind="answer", wrap=False, name="laboratory.chart.figure")
        self.unit_label = make_label("%", "unit", wrap=False)
        self.error_label = make_label(kind="note", name="laboratory.chart.error")
        self.evidence_label = make_label(name="laboratory.chart.evidence", textFormat=Qt.TextFormat.RichText)
        self.notes_label = make_label(kind="note", name="laboratory.chart.notes")
        self.plot = ControlChartPlot()
        self.broken = ValueTable("laboratory.chart.broken", "values that break a rule")
        self.broken.setMinimumHeight(px(160))
        bar = WrappedRow(
            make_label("Golden specimen", wrap=False), self.golden, self.quantity, self.sensor, self.baseline,
            self.export_button, spacing=6,
        )  # fmt: skip
        bottom = Qt.AlignmentFlag.AlignBottom
        finding = make_panel(
            WrappedRow(self.verdict_label, self.count_label, spacing=8), self.finding_label,
            row((self.figure_label, 0, bottom), (self.unit_label, 0, bottom), None, spacing=8), self.error_label,
            self.evidence_label, spacing=8,
        )  # fmt: skip
        signals = make_panel(make_label("Signals", "heading"), (self.broken, 1), self.notes_label, spacing=8)
        self._side = make_scroll_area(finding, (signals, 1), spacing=8, **UPRIGHT)
        self._shown = make_pane(row((make_panel(self.plot, margins=(1, 1, 1, 1)), 1), self._side, spacing=8))
        column(bar, (self._shown, 1), parent=self, spacing=6)
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

    def _show_view(self, view: ChartView | None) -> None:
        self.view, self.exported_table = view, None if view is None else view.points
        charts = () if view is None else view.charts
        drifted = next((chart.sensor for chart in charts if chart.cause.is_drift), None)
        fill_combo(self.sensor, [(chart.sensor or "unknown sensor", chart.sensor) for chart in charts], drifted)
        self.export_button.setEnabled(view is not None)
        for widget in (self.sensor, self._shown):
            widget.setVisible(view is not None)
        self._show_chart()
        if view is not None:
            self._show_message("", False)

    def _show_chart(self) -> None:
        view, at = self.view, self.sensor.currentIndex()
        if view is None or at < 0:
            return
        chart = view.charts[at]
        self._show_finding(chart, view.golden)
        self.notes_label.setText(typeset("\n".join((*view.notes, BASELINE_TEXT))))
        title = f"{view.golden} on {chart.sensor or 'an unknown sensor'}"
        name = typeset(view.selection.label)
        self.plot.show_chart(chart, view.selection.unit, title, name, view.selection.about, view.simulated)
        self.broken.set_table(view.broken[at])

    def _show_finding(self, chart: GoldenChart, golden: str) -> None:
        """Show the finding: its size, its begin and the evidence for the cause."""
        text, severity, finding = VERDICTS[chart.cause]
        self.verdict_label.setText(text)
        set_tone(self.verdict_label, severity)
        self.count_label.setText(f"{len(chart.chart.rules)} of {len(chart.values)} values give a signal")
        first, change = chart.first_signal, chart.change
        day = "" if first is None else chart.values[first].start_time[:10]
        little = "much" if change is not None and change.relative > 0 else "little"
        sensor = sentence_case(chart.sensor or "the sensor")
        self.finding_label.setText(finding.format(sensor=sensor, golden=golden, little=little, day=day))
        for part in (self.figure_label, self.unit_label):
            part.setVisible(change is not None)
        figure = "" if change is None else round_figure(100 * change.relative, 100 * change.error)
        self.figure_label.setText(typeset(figure))
        show_text(self.error_label, "" if change is None else f"{typeset(change.figure)}, statistical")
        compared = [(sentence_case(each.subject), each.figure) for each in chart.compared]
        told = rich_table(compared, (WHY.get(chart.cause, "At the same time"), "")) or "; ".join(chart.evidence[1:])
        show_text(self.evidence_label, typeset(told))

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._side.setFixedWidth(px(class_of(self).finding))

    def _open_run(self, at_row: int) -> None:
        if self.view is not None and (at := self.sensor.currentIndex()) >= 0:
            number = self.view.broken[at].columns[0].values[at_row]
            self.run_open_requested.emit(self.view.charts[at].values[number - 1].path)
