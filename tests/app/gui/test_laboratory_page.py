"""Laboratory page: specimens, control charts, certificates and audit trail of a folder, read in the background."""

import random
import re
import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt

from app.archive.audit_trail import begin_audit
from app.archive.catalogue import Catalogue
from app.common import Progress, typeset
from app.config.certificate import Certificate, store_certificate
from app.gui.face import LIGHT
from app.gui.laboratory.audit_pane import NO_TRAIL
from app.gui.laboratory.page import AUDIT, CERTIFICATES, CHART, SPECIMENS, TO_BEGIN, LaboratoryPage
from app.gui.laboratory.value_table import ValueTable
from app.gui.plots import Layer
from model import quantity_label
from tests.helpers.fleet_runs import write_run
from tests.helpers.main_window import OpenPage, until
from tests.helpers.messages import assert_names

GOLDEN_VALUES = 14
STEP_AT = 9
"""Number of golden values before laser 2 reads 5 % less."""
BATCHES = {"P0": "A", "P1": "A", "P2": "A", "P3": "B", "P4": "B", "P5": "B"}
ODD = "P5"
"""Its amplitude is far from that of the others."""


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("laboratory")
    draw = random.Random(4)
    for day in range(GOLDEN_VALUES):
        drift = 0.95 if day >= STEP_AT else 1.0
        for number, share in ((1, 1.0), (2, drift)):
            largest = 1e-3 * share * (1 + draw.gauss(0, 0.002))
            write_run(folder, "G", day + 0.1 * number, largest, 160.0, number)
    for at, (specimen, batch) in enumerate(BATCHES.items()):
        for day, share in ((2, 1.0), (GOLDEN_VALUES, 0.95)):
            largest = 1e-3 * (2.0 if specimen == ODD else 1 + 0.01 * at) * share
            write_run(folder, specimen, day + 0.01 * at, largest, 158 + at, 2)
        (folder / f"{specimen}.specimen.toml").write_text(f'specimen = "{specimen}"\nbatch = "{batch}"\n')
    (folder / "limits.toml").write_text('golden = "G"\n[limits.natural_frequency]\nlow = "150 Hz"\nhigh = "161.5 Hz"\n')
    return folder


@pytest.fixture
def page(open_page: OpenPage, laboratory: Path) -> LaboratoryPage:
    shown = open_page(lambda: LaboratoryPage(lambda: laboratory, laboratory / "index.sqlite"))
    assert isinstance(shown, LaboratoryPage)
    until(lambda: is_idle(shown), "for the folder")
    return shown


def is_idle(page: LaboratoryPage) -> bool:
    return page._records is not None and not page._worker.pending and not page.progress_row.running


def rows(table: ValueTable) -> list[list[str]]:
    model = table.model()
    return [[model.index(r, c).data() for c in range(model.columnCount())] for r in range(model.rowCount())]


def choose(page: LaboratoryPage, combo: Any, name: str) -> None:
    combo.setCurrentIndex(combo.findData(name))
    until(lambda: is_idle(page), "for the view")


@pytest.mark.deep
def test_specimens_are_compared_with_the_outlier_marked(page: LaboratoryPage) -> None:
    choose(page, page.fleet.quantity, "amplitude_at_resonance")
    shown = dict(rows(page.fleet.summary))
    assert shown["Specimens"] == "7"
    assert shown["Outliers"] == ODD
    newest = [950.0 * (2.0 if name == ODD else 1 + 0.01 * at) for at, name in enumerate(BATCHES)]
    assert float(shown["Mean"]) == pytest.approx(np.mean([*newest, 950.0]), rel=0.01)
    outliers = page.fleet.plot.layer("outliers")
    assert outliers is not None
    assert list(outliers.y) == pytest.approx([1900.0])
    assert page.simulated_mark.isVisible()
    assert page.fleet.plot.picture.simulated
    ((odd, font),) = [
        (index.data(), index.data(Qt.ItemDataRole.FontRole))
        for r in range(7)
        if (index := page.fleet.specimens.model().index(r, 0)).data(Qt.ItemDataRole.FontRole) is not None
    ]
    assert odd == ODD
    assert font.bold()


def test_limits_filter_grouping_sorting_and_export(page: LaboratoryPage, tmp_path: Path) -> None:
    choose(page, page.fleet.quantity, "natural_frequency")
    shown = dict(rows(page.fleet.summary))
    assert shown["Outside"] == "2"  # P4 and P5 have 162 and 163 Hz
    assert "Cpk, 95 %" in shown
    assert [row[0] for row in rows(page.fleet.groups)] == ["A", "B", "no batch"]
    choose(page, page.fleet.batch, "A")
    assert [row[0] for row in rows(page.fleet.specimens)] == ["P0", "P1", "P2"]
    header = [page.fleet.specimens.model().headerData(c, Qt.Orientation.Horizontal) for c in range(5)]
    page.fleet.specimens.sortByColumn(header.index("Natural frequency"), Qt.SortOrder.DescendingOrder)
    assert [row[0] for row in rows(page.fleet.specimens)] == ["P2", "P1", "P0"]
    page.fleet.export(tmp_path / "specimens.csv")
    until(lambda: is_idle(page))
    assert (tmp_path / "specimens.csv").read_text().splitlines()[1].startswith("P0,A,")
    page.fleet.search_edit.setText("no such specimen")
    until(lambda: page.fleet.view is None)
    assert_names(page.message_label.text(), "selection")


def test_the_control_chart_shows_the_laser_that_drifts(page: LaboratoryPage, tmp_path: Path) -> None:
    page.show_view(CHART)
    until(lambda: is_idle(page) and page.chart.view is not None)
    assert page.chart.golden.currentText() == "G"
    assert page.chart.sensor.currentText() == "laser #L2"
    # The step lies within the baseline, and is found nevertheless.
    assert page.chart.verdict_label.text() == "! Drift of the bench"
    assert page.chart.finding_label.text().startswith("Laser #L2 reads too little, since ")
    assert page.chart.figure_label.text().startswith("−5")
    assert "G on laser #L1" in page.chart.evidence_label.text()

    def drawn(name: str) -> Layer:
        layer = page.chart.plot.layer(name)
        assert layer is not None
        return layer

    y = drawn("value").y
    assert y[:STEP_AT] == pytest.approx([1000.0] * STEP_AT, rel=0.01)
    assert y[STEP_AT:] == pytest.approx([950.0] * (GOLDEN_VALUES - STEP_AT), rel=0.01)
    assert STEP_AT + 0.5 in {rule.at for rule in page.chart.plot.picture.rules if rule.label == "Lasting change"}
    broken = {int(row[0]) for row in rows(page.chart.broken)}
    assert broken == {*drawn("signal").x.tolist(), *drawn("beyond the limits").x.tolist()}
    page.chart.sensor.setCurrentText("laser #L1")
    assert page.chart.verdict_label.text() == "✓ In control"
    assert page.chart.figure_label.isHidden()
    assert drawn("value").y == pytest.approx([1000.0] * GOLDEN_VALUES, rel=0.01)
    page.chart.export(tmp_path / "chart.csv")
    until(lambda: is_idle(page))
    assert len((tmp_path / "chart.csv").read_text().splitlines()) == 2 * GOLDEN_VALUES + 1


def test_the_baseline_of_the_chart_ends_before_the_drift(page: LaboratoryPage) -> None:
    page.show_view(CHART)
    until(lambda: is_idle(page) and page.chart.view is not None)
    assert page.chart.baseline.value() == 20
    page.chart.baseline.setValue(STEP_AT)
    until(lambda: is_idle(page))
    assert page.chart.view is not None
    drifted = next(each for each in page.chart.view.charts if each.sensor == "laser #L2").chart
    assert drifted.baseline == STEP_AT
    assert drifted.centre == pytest.approx(1e-3, rel=0.005)
    assert {signal.index for signal in drifted.signals} >= set(range(STEP_AT, GOLDEN_VALUES))
    assert "baseline that includes the drift" in page.chart.notes_label.text()
    name = "amplitude_at_resonance"
    assert page.chart.quantity.currentData() == name
    assert page.chart.quantity.currentText() == typeset(quantity_label(name))


def test_certificates_are_warned_of_before_and_after_their_date(open_page: OpenPage, tmp_path: Path) -> None:
    today = datetime.now(UTC).date()
    for number, days in (("K1", -1), ("K2", 30), ("K3", 31)):
        due = (today + timedelta(days=days)).isoformat()
        store_certificate(tmp_path, Certificate(number, "PTB", "2025-01-02", serial=number, role="sensor", due=due))
    page = open_page(lambda: LaboratoryPage(lambda: tmp_path, tmp_path / "index.sqlite"))
    page.show_view(CERTIFICATES)
    until(lambda: is_idle(page))
    assert [row[1] for row in rows(page.certificates.table)] == ["✕ expired", "! due soon", "✓ valid"]
    colors = [page.certificates.table.model().index(r, 1).data(Qt.ItemDataRole.ForegroundRole).name() for r in range(3)]
    assert colors == [LIGHT.red_text, LIGHT.amber_text, LIGHT.text]
    assert page.views.buttons[CERTIFICATES].text() == "Certificates   1 expired"


def test_a_changed_file_is_found_by_verify(open_page: OpenPage, tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    path = write_run(folder, "T7", 1.0, 1e-3, 160.0, 1)
    (folder / "T7.specimen.toml").write_text('specimen = "T7"\n')
    page = open_page(lambda: LaboratoryPage(lambda: folder, tmp_path / "index.sqlite"))
    page.show_view(AUDIT)
    until(lambda: is_idle(page))
    assert page.audit.result_label.text() == NO_TRAIL
    page.audit.begin_button.click()
    until(lambda: is_idle(page) and not page.audit.progress_row.running)
    assert [row[3] for row in rows(page.audit.table)] == ["start"]
    page.audit.verify()
    until(lambda: not page.audit.progress_row.running)
    assert page.audit.result_label.text().startswith("✓ 1 line and all files are unchanged")
    (folder / "T7.specimen.toml").write_text('specimen = "T8"\n')
    path.unlink()
    page.audit.verify()
    until(lambda: not page.audit.progress_row.running)
    text = page.audit.result_label.text()
    assert "T7.specimen.toml was changed since entry 1" in text
    assert_names(text.partition(f"{path.name} ")[2].splitlines()[0], "missing")


def test_a_folder_is_read_in_the_background_and_reading_can_be_stopped(
    open_page: OpenPage, tmp_path: Path, laboratory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads, released = [], threading.Event()
    scan: Callable[..., Any] = Catalogue.scan

    def wait(self: Catalogue, progress: Progress, excluded: tuple[Path, ...]) -> Any:
        threads.append(threading.current_thread())
        assert released.wait(60)
        return scan(self, progress, excluded)

    monkeypatch.setattr(Catalogue, "scan", wait)
    page = open_page(lambda: LaboratoryPage(lambda: laboratory, tmp_path / "index.sqlite"))
    until(page.progress_row.isVisible, "for the progress of the scan")
    page.progress_row.cancel_button.click()
    released.set()
    until(lambda: is_idle(page))
    assert threads
    assert threading.main_thread() not in threads
    assert "stopped" in page.message_label.text() or "No specimens" in page.empty_label.text()
    assert page.view == SPECIMENS


def test_a_folder_without_runs_says_so(open_page: OpenPage, tmp_path: Path) -> None:
    begin_audit(tmp_path)
    page = open_page(lambda: LaboratoryPage(lambda: tmp_path, tmp_path / "index.sqlite"))
    until(lambda: is_idle(page))
    for view in (SPECIMENS, CHART):
        page.show_view(view)
        assert re.match("No specimens: no (real|simulated) run in", page.empty_label.text())
        assert TO_BEGIN in page.empty_label.text()
        assert page.empty_label.isVisible()
        assert not page.message_label.isVisible(), "an empty folder is no error"
    page.show_view(AUDIT)
    assert not page.empty_label.isVisible()


def test_a_message_belongs_to_its_view_and_an_unchanged_folder_is_not_shown_again(page: LaboratoryPage) -> None:
    page.show_view(CHART)
    until(lambda: is_idle(page) and page.chart.view is not None)
    page.chart.golden.setCurrentText("P0")
    until(lambda: page.message_label.text().startswith("No control chart: P0 on"), "for the reason")
    page.show_view(SPECIMENS)
    assert not page.message_label.isVisible()
    page.show_view(CHART)
    assert page.message_label.text().startswith("No control chart: P0 on")
    before, view = page._records, page.fleet.view
    page.reload()
    until(lambda: is_idle(page) and not page.progress_row.running)
    page.show_view(SPECIMENS)
    assert page._records is before
    assert page.fleet.view is view
