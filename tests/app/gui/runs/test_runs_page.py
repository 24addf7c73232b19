"""Runs page: search, open, compare, annotate, export, drag and drop."""

import json
import re
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QPushButton

from app.archive import RunState
from app.archive.catalogue import Catalogue
from app.config.bench_file import BenchConfig
from app.gui.runs.details import EMPTY_TEXT, NO_MATCH_TEXT, READING_TEXT
from app.gui.runs.page import RunsPage
from app.gui.runs.run_table import COLUMNS, THUMBNAIL_COLUMN
from app.live.model_overlay import Overlay
from app.session.state import BenchState
from protocols.base import RunStatus
from protocols.measurements.sweep import Sweep
from protocols.runfile.names import notes_path
from protocols.runfile.reader import Run
from protocols.runfile.record import RunRecord
from protocols.runfile.sidecar import read_notes
from tests.helpers.main_window import OpenPage, OpenStage, Stage, drop_file, find, until
from tests.helpers.run_files import begun_run, crashed_run, finished_run, newer_run
from tests.helpers.session_events import LIVE, OPENED
from tests.helpers.simulated_bench import laboratory, run
from tests.helpers.text_places import faults_of_window


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("written")
    finished_run(folder, "T7", size_m=8e-4)
    finished_run(folder, "T8", size_m=6e-4)
    crashed_run(folder, "T3")
    return folder


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "runs"))


@pytest.fixture
def show(open_page: OpenPage, config: BenchConfig) -> Callable[..., RunsPage]:
    """Shows the page of a folder by itself."""

    def show(folder: Path, count: int = 3) -> RunsPage:
        overlay = Overlay(amplifier=config.amplifier.amplifier_map)
        return listed(open_page(lambda: RunsPage(lambda: folder, lambda: "T7", config.amplifier, overlay)), count)

    return show


@pytest.fixture
def page(show: Callable[..., RunsPage], folder: Path) -> RunsPage:
    return show(folder)


def in_window(stage: Stage, count: int = 3) -> RunsPage:
    stage.press(Qt.Key.Key_4, Qt.KeyboardModifier.ControlModifier)
    return listed(stage.window.tabs.runs, count)


def listed(runs: RunsPage, count: int) -> RunsPage:
    until(lambda: runs.list.folder_model.is_idle and runs.list.model.rowCount() == count, "for the list")
    return runs


def names(page: RunsPage) -> list[str]:
    at = [page.list.model.headerData(c, Qt.Orientation.Horizontal) for c in range(page.list.model.columnCount())].index(
        "Specimen"
    )
    return [page.list.model.index(row, at).data() for row in range(page.list.model.rowCount())]


def choose(page: RunsPage, *specimens: str) -> None:
    page.list.select_paths([e.path for e in page.list.folder_model.summaries if e.specimen in specimens])
    until(lambda: not page._worker.pending, "for the points")


def test_a_file_that_another_program_puts_into_the_folder_appears(
    page: RunsPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.gui.runs.folder_model.LOOK_INTERVAL_S", 0.0)

    def ticked(count: int) -> bool:
        page.tick()
        return page.list.model.rowCount() == count

    added = finished_run(folder, "T9")
    until(lambda: ticked(4), "for the new one")
    added.unlink()
    until(lambda: ticked(3), "for the list without it")
    until(lambda: page.list.folder_model.is_idle, "for the last look")


def test_the_run_that_is_being_written_is_not_opened(
    page: RunsPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = begun_run(folder, "T9", (100.0,), 5000.0)
    read = list[Path]()
    monkeypatch.setattr("app.gui.runs.page.load_run", lambda path, **_: read.append(path))
    page.set_active_file(written.path)
    page.list.folder_model.rescan()
    listed(page, 4)
    choose(page, "T9")
    page.open_selected()
    assert written.path not in read
    assert not find(page, "runs.open").isEnabled()
    assert page.details.message_label.isVisible()
    assert "\n" not in page.details.empty_label.text(), "it does not offer to open it"
    written.finish(RunStatus.COMPLETED, "")
    page.set_active_file(None)
    page.list.folder_model.rescan()
    until(lambda: written.path in read, "for the run after its end")
    assert find(page, "runs.open").isEnabled()


def test_every_run_is_listed_for_what_it_is(page: RunsPage, folder: Path) -> None:
    assert sorted(names(page)) == ["T3", "T7", "T8"]
    newer_run(folder, "T5")
    (folder / "20260101T000000Z_half_sine-dwell.h5").write_bytes(b"cut")
    page.list.folder_model.rescan()
    until(lambda: page.list.model.rowCount() == 5, "for the new ones")
    status = {e.specimen: e.state for e in page.list.model.summaries}
    assert (status["T3"], status["T5"], status["half"]) == (RunState.CRASHED, RunState.NEWER, RunState.DAMAGED)
    choose(page, "half")
    page.open_selected()
    assert "half" in find(page, "runs.message").text()
    assert page.currentIndex() == 0


def test_a_field_of_the_search_is_a_chip_that_takes_it_away(page: RunsPage) -> None:
    bar, search = page.list.filter_bar, find(page, "runs.search")
    everything = names(page)
    search.setText("specimen:T8 tag:")
    assert [button.text() for button in bar.chips.findChildren(QPushButton)] == ["specimen: T8 ×"]
    assert names(page) == ["T8"]
    find(page, "runs.chip.0").click()
    assert (search.text(), names(page), bar.chips.isHidden()) == ("", everything, True)


def test_a_search_without_a_hit_says_so_and_is_cleared_by_its_button(open_stage: OpenStage, folder: Path) -> None:
    stage = open_stage(folder=folder)
    page = in_window(stage)
    stage.window.resize(900, 560)
    clear, everything = page.details.clear_button, names(page)
    assert not clear.isVisible()
    find(page, "runs.search").setText("nothing of the kind")
    QApplication.processEvents()
    assert page.details.empty_label.text() == NO_MATCH_TEXT
    assert page.list.table.horizontalScrollBar().maximum() == 0
    clear.click()
    assert (find(page, "runs.search").text(), names(page)) == ("", everything)
    for column in range(len(COLUMNS)):
        page.list.table.sortByColumn(column, Qt.SortOrder.AscendingOrder)
        QApplication.processEvents()
        assert page.list.table.horizontalScrollBar().maximum() == 0, COLUMNS[column]


@pytest.mark.deep
def test_found_by_keys_alone(open_stage: OpenStage, folder: Path) -> None:
    page = in_window(open_stage(folder=folder))
    page.list.table.setFocus()
    QTest.keyClick(page.list.table, Qt.Key.Key_Slash)
    assert find(page, "runs.search").hasFocus()
    QTest.keyClicks(find(page, "runs.search"), "t8 natural")
    assert names(page) == ["T8"]
    QTest.keyClick(find(page, "runs.search"), Qt.Key.Key_Down)
    assert page.list.table.hasFocus()
    QTest.keyClick(page.list.table, Qt.Key.Key_Return)
    until(lambda: page.currentWidget() is page.viewer, "for the run")
    window = page.window()
    QTest.keyClick(window, Qt.Key.Key_Escape)
    assert page.currentIndex() == 0
    assert names(page) == ["T8"]
    QTest.keyClick(window, Qt.Key.Key_Escape)
    assert len(names(page)) == 3


@pytest.mark.deep
def test_escape_stops_a_run_and_nothing_else(open_stage: OpenStage, folder: Path) -> None:
    stage = open_stage(folder=folder)
    page = in_window(stage)
    choose(page, "T7")
    page.open_selected()
    until(lambda: page.currentWidget() is page.viewer, "for the run")
    for width in (900, 1600):
        stage.window.resize(width, 900)
        until(lambda width=width: stage.window.width() == width, "for the size")
        QApplication.processEvents()
    assert page.viewer.card.width() > 400 - 24, "the design's width of a result"
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE)
    before = stage.session.stops
    stage.press(Qt.Key.Key_Escape)
    assert stage.session.stops == before + 1
    assert stage.window.state.bench_state is BenchState.GOING_TO_REST
    assert page.currentWidget() is page.viewer


@pytest.mark.deep
def test_a_low_viewer_shows_one_part_of_a_run_and_cuts_nothing(open_stage: OpenStage, folder: Path) -> None:
    stage = open_stage(folder=folder)
    page = in_window(stage)
    choose(page, "T7")
    page.open_selected()
    view = page.viewer
    until(lambda: page.currentWidget() is view, "for the run")
    parts = {"Response": view.plots, "Traces": view.trace_plot, "Log": view.log}
    for size, is_low in (((1366, 840), False), ((900, 560), True), ((1366, 840), False)):
        stage.window.resize(*size)
        until(lambda is_low=is_low: view.part.isVisible() is is_low, "for the layout")
        for chosen, button in view.part.buttons.items():
            button.click()
            QApplication.processEvents()
            assert [name for name, part in parts.items() if part.isVisible()] == ([chosen] if is_low else [*parts])
            assert list(faults_of_window(view)) == []
        view.part.buttons["Response"].click()
        QApplication.processEvents()
        assert view.plots.chart.panels[0].box.height() >= 200


def test_a_run_is_reopened_as_it_was(page: RunsPage, folder: Path) -> None:
    choose(page, "T7")
    page.open_selected()
    until(lambda: page.currentWidget() is page.viewer, "for the run")
    view = page.viewer
    measured = view.plots.chart.layer("max − min, measured")
    assert measured is not None
    np.testing.assert_allclose((measured.x, measured.y), ([100, 160], [800, 800]))
    with Run(next(folder.glob("*_T7_*.h5"))) as run:
        drive, length = run.trace.drive_v(), run.trace.time_s()[-1]
    _, traces = view.trace_plot.picture.layers
    t, v = traces.x, traces.y
    assert (np.nanmin(v), np.nanmax(v)) == (drive.min(), drive.max())
    assert t[-1] == pytest.approx(length, abs=0.01)
    gap = np.flatnonzero(np.isnan(v))
    assert t[gap - 1] == pytest.approx(
        [0.2], abs=0.01
    )  # nothing was kept from 0.2 to 0.4 s, and nothing is drawn there
    assert [find(view.card, f"run.card.{part}").text() for part in ("figure", "unit", "statistical")] == [
        "158.35", "Hz", "± 0.010 Hz statistical",
    ]  # fmt: skip
    assert view.card.simulated_label.isVisible()
    assert "Armed" in view.log.toPlainText()
    until(lambda: page._overlay.result() is not None, "for the curve")
    page.tick()
    assert any(layer.group == "Model" and layer.x.size > 100 for layer in view.plots.chart.picture.layers)


@pytest.mark.deep
def test_looked_at_closely_a_run_shows_every_sample_of_its_file(
    page: RunsPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.archive.replay.TRACE_COLUMNS", 100)
    choose(page, "T7")
    page.open_selected()
    until(lambda: page.currentWidget() is page.viewer, "for the run")
    traces = page.viewer.trace_plot
    whole_s, whole_um = traces.picture.layers[0].x, traces.picture.layers[0].y
    assert np.isfinite(whole_s).sum() == 200
    for _ in range(4):
        QTest.keyClick(page.window(), Qt.Key.Key_Minus, Qt.KeyboardModifier.ControlModifier)
    traces.show_range(0.1, 0.13)
    until(lambda: len(traces.picture.layers[0].x) < 190, "for the samples")
    seen_s, seen_um = traces.picture.layers[0].x, traces.picture.layers[0].y
    with Run(next(folder.glob("*_T7_*.h5"))) as run:
        at = (run.trace.time_s() > 0.0999) & (run.trace.time_s() < 0.1301)
        times, moved = run.trace.time_s()[at], 1e6 * run.trace.displacement_m()[at]
    np.testing.assert_allclose(np.interp(times, seen_s, seen_um), moved)
    assert set(times.round(6)) <= set(seen_s.round(6))
    assert "every sample" in traces.picture.note
    QTest.keyClick(page.window(), Qt.Key.Key_0, Qt.KeyboardModifier.ControlModifier)
    until(lambda: np.isfinite(traces.picture.layers[0].x).sum() == 200, "for the whole")
    np.testing.assert_array_equal(traces.picture.layers[0].y, whole_um)


def test_several_are_compared(page: RunsPage) -> None:
    choose(page, "T7", "T8")
    heights = sorted(float(layer.y[0]) for layer in page.details.plot.picture.layers)
    assert heights == pytest.approx([600.0, 800.0])
    assert page.details.plot.picture.simulated
    assert page.details.heading.text() == "2 runs chosen"


@pytest.mark.deep
def test_tags_and_a_note_are_kept_beside_the_run(page: RunsPage, folder: Path) -> None:
    choose(page, "T7")
    QTest.keyClick(page.list.table, Qt.Key.Key_F2)
    QTest.keyClicks(find(page, "runs.tags"), "good, glued")
    QTest.keyClick(find(page, "runs.tags"), Qt.Key.Key_Return)
    run = next(folder.glob("*_T7_*.h5"))
    until(lambda: read_notes(notes_path(run)).tags != (), "for the notes")
    assert read_notes(notes_path(run)).tags == ("good", "glued")
    until(lambda: any(e.tags == "good, glued" for e in page.list.folder_model.summaries), "for the list")
    find(page, "runs.search").setText("glued")
    assert names(page) == ["T7"]


@pytest.mark.deep
def test_a_note_that_is_being_typed_survives_a_list_that_comes_meanwhile(page: RunsPage, folder: Path) -> None:
    choose(page, "T7")
    find(page, "runs.tags").setFocus()
    QTest.keyClicks(find(page, "runs.tags"), "good")
    QTest.keyClick(find(page, "runs.tags"), Qt.Key.Key_Tab)
    QTest.keyClicks(find(page, "runs.note"), "glued ")
    until(lambda: any(e.tags == "good" for e in page.list.folder_model.summaries), "for the list")
    QTest.keyClicks(find(page, "runs.note"), "twice")
    page.list.table.setFocus()
    run = next(folder.glob("*_T7_*.h5"))
    until(lambda: read_notes(notes_path(run)).note == "glued twice", "for the notes")
    assert read_notes(notes_path(run)).tags == ("good",)


@pytest.mark.deep
def test_run_without_response_shows_text_and_shortens_long_reason(page: RunsPage) -> None:
    page.details.show_runs(None, 1)
    assert page.details.empty_label.isVisible()
    assert not page.details.plot.isVisible()
    page.details.show_selection(
        [page.list.folder_model.summaries[0]._replace(record_json=RunRecord(reason="word " * 400).to_json())]
    )
    assert len(page.details.facts_label.text()) < 500


@pytest.mark.deep
def test_what_is_chosen_is_exported(page: RunsPage, tmp_path: Path) -> None:
    choose(page, "T7", "T8")
    page.export_selected(tmp_path / "sheets", "csv")
    until(lambda: "10 files written" in find(page, "runs.message").text(), "for the files")
    assert find(page, "runs.message").textFormat() is Qt.TextFormat.AutoText, "the folder is a link, not its markup"
    assert len(list((tmp_path / "sheets").glob("*_SIMULATED_points.csv"))) == 2


@pytest.mark.deep
def test_an_export_is_whole_though_the_reading_of_the_folder_was_stopped(page: RunsPage, tmp_path: Path) -> None:
    page.list.filter_bar.stop_pressed.emit()
    choose(page, "T7", "T8")
    page.export_selected(tmp_path / "sheets", "csv")
    until(lambda: "files written" in find(page, "runs.message").text(), "for the files")
    assert find(page, "runs.message").text().startswith("10 files")


@pytest.mark.deep
def test_a_file_dropped_is_copied_and_never_replaces_another(page: RunsPage, folder: Path, tmp_path: Path) -> None:
    new = finished_run(tmp_path / "stick", "T9")

    drop_file(page, new)
    until(lambda: "T9" in names(page), "for the copy")
    assert (folder / new.name).read_bytes() == new.read_bytes()
    kept = (folder / new.name).read_bytes()
    new.write_bytes(b"another")
    drop_file(page, new)
    until(lambda: "already there" in find(page, "runs.message").text(), "for the sentence")
    assert (folder / new.name).read_bytes() == kept


@pytest.mark.deep
def test_import_shows_progress_and_leaves_nothing_when_cancelled(
    page: RunsPage, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.archive.backup.COPY_CHUNK_BYTES", 4096)
    whole, half = (finished_run(tmp_path / "stick", name) for name in ("T8a", "T9a"))
    going, go_on, begun = page.details.progress_row, threading.Event(), threading.Event()
    update = going.progress.update

    def slowly(share: float, text: str = "") -> None:
        update(share)
        if share > 0.6:
            begun.set()
            assert go_on.wait(60)

    monkeypatch.setattr(going.progress, "update", slowly)
    page.transfers.copy_in([whole, half])
    until(begun.is_set, "for the second file")
    until(going.isVisible, "for the bar")
    assert going.label.text() == "taking in 2 runs …"
    until(lambda: going.bar.value() > 600, "for the share")
    page.export_selected(tmp_path / "sheets", "csv")
    assert find(page, "runs.message").text().startswith(f"{going.label.text()} Wait ")
    assert not (tmp_path / "sheets").exists()
    choose(page, "T7")
    page.open_selected()
    until(lambda: page.currentWidget() is page.viewer, "for a run that is opened meanwhile")
    page.go_back()
    QTest.mouseClick(going.cancel_button, Qt.MouseButton.LeftButton)
    go_on.set()
    until(lambda: "stopped" in find(page, "runs.message").text(), "for its end")
    assert find(page, "runs.message").text() == "stopped; 1 run copied"
    assert going.isHidden()
    assert (folder / whole.name).read_bytes() == whole.read_bytes()
    assert not list(folder.glob(f"*{half.name}*")), "nothing half done"
    page.transfers.copy_in([half, tmp_path / "gone.h5"])
    until(lambda: "there is no file" in find(page, "runs.message").text(), "for the sentence")
    assert going.isHidden()


@pytest.mark.deep
def test_tables_dropped_become_runs_of_the_specimen_and_what_is_odd_is_said(
    page: RunsPage, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = tmp_path / "fig4.csv"
    table.write_text("frequency [Hz],pp [um],drive_pp [V]\n100,760.1,5\n150,1154.2,5\n")
    before = set(folder.glob("*.h5"))
    drop_file(page, table)
    until(lambda: "imported" in find(page, "runs.message").text(), "for the import")
    (made,) = set(folder.glob("*.h5")) - before
    with Run(made) as run:
        assert (run.record.specimen, run.record.state, run.record.simulated) == ("T7", "imported", False)
        np.testing.assert_allclose(run.points()["peak_to_peak"], (760.1e-6, 1154.2e-6))
    assert find(page, "runs.message").text().startswith("fig4.csv: 1 run of T7 imported\n")
    assert "the uncertainty of the values is not given" in find(page, "runs.message").text()
    until(lambda: len(page.list.model.summaries) == len(before) + 1, "for the list")
    table.write_text("time [s],drive [V],displacement [um]\n0,2.5,0\n0.1,2.6,1\n0.2,2.4,0\n")
    page.transfers.import_tables([table])
    until(lambda: "--as voltage-steps or --as raw" in find(page, "runs.message").text(), "for the sentence")
    assert "--help" in find(page, "runs.message").text()
    table.write_text("frequency [Hz],pp [um],drive_pp [V]\n100,760.1,5\n150,1154.2,5\n")
    progress = page.details.progress_row.progress
    monkeypatch.setattr(progress, "update", lambda *_: setattr(progress, "cancelled", True))  # as the button does
    page.transfers.import_tables([table])
    until(lambda: find(page, "runs.message").text() == "stopped; nothing was written", "for the end")
    assert len(list(folder.glob("*.h5"))) == len(before) + 1


@pytest.mark.deep
def test_rows_dragged_away_carry_their_files(page: RunsPage, folder: Path) -> None:
    indexes = [page.list.model.index(row, 0) for row in (0, 1)]
    dragged = [Path(url.toLocalFile()) for url in page.list.model.mimeData(indexes).urls()]
    assert all(path.exists() and path.parent == folder.resolve() for path in dragged)
    assert len(dragged) == 2


@pytest.mark.deep
def test_a_run_is_laid_over_the_models_curve(open_stage: OpenStage, folder: Path) -> None:
    stage = open_stage(folder=folder)
    page = in_window(stage)
    choose(page, "T7")
    page.list.table.setFocus()
    QTest.keyClick(page.list.table, Qt.Key.Key_E)
    assert stage.window.tabs.current_page is stage.window.tabs.explore
    until(lambda: stage.window.tabs.explore.overlaid.runs, "for the points")


@pytest.mark.deep
def test_ten_thousand_are_listed_filtered_and_sorted(page: RunsPage, folder: Path) -> None:
    catalogue = Catalogue(folder)
    catalogue.scan()
    one = catalogue.entries()[0]
    made = [
        one._replace(path=f"{i:05d}.h5", specimen=f"T{i % 50}", search_text=f" t{i % 50}\n t{i % 50}")
        for i in range(10_000)
    ]
    page.list.folder_model._on_listed(made)
    assert page.list.model.rowCount() == 10_000
    assert "10 000 runs" in find(page, "runs.count").text()
    find(page, "runs.search").setText("t33")
    assert set(names(page)) == {"T33"}
    assert len(names(page)) == 200


def test_an_empty_folder_says_what_to_do(show: Callable[..., RunsPage], tmp_path: Path) -> None:
    page = show(tmp_path / "none", 0)
    assert "dropped here" in page.details.empty_label.text()
    assert find(page, "runs.count").text() == "0 runs"
    assert not page.details.open_button.isEnabled()


@pytest.mark.deep
def test_a_run_of_another_protocol_is_reopened_in_its_own_plot(show: Callable[..., RunsPage], tmp_path: Path) -> None:
    with laboratory() as lab:
        run(Sweep(sweep_s=0.1, periods=2), tmp_path / "runs", lab)
    page = show(tmp_path / "runs", 1)
    page.open_selected()
    until(lambda: page.currentWidget() is page.viewer, "for the run")
    view = page.viewer
    with Run(next((tmp_path / "runs").glob("*.h5"))) as file:
        (kept,) = file.series()
    (curve,) = [layer for layer in view.plots.chart.picture.layers if layer.name == kept.title and not layer.panel]
    np.testing.assert_allclose(curve.y, 1e6 * kept.plotted)
    view.plots.curves_button.click()
    points = view.plots.chart.layer(view.plots.kind.title)
    assert points is not None
    assert points.x.size == 1
    assert "Asked: " in view.log.toPlainText()


@pytest.mark.deep
def test_a_run_is_moved_to_the_trash_with_its_notes_and_taken_out_of_it(page: RunsPage, folder: Path) -> None:
    note = "the one"
    choose(page, "T7")
    page.list.annotate("good", note)
    until(lambda: page.list.folder_model.is_idle, "for the notes")
    (run,) = [folder / e.path for e in page.list.selected]
    assert notes_path(run).exists()
    page.list.table.setFocus()
    QTest.keyClick(page.list.table, Qt.Key.Key_Delete)
    until(lambda: names(page).count("T7") == 0 and page.list.folder_model.is_idle, "for the list")
    assert not run.exists()
    assert not notes_path(run).exists()
    assert (folder / ".trash" / run.name).exists(), "nothing measured is lost"
    assert "1 run moved to the trash" in page.window().told[-1].text
    page.window().told[-1].undo()
    until(lambda: names(page).count("T7") == 1 and page.list.folder_model.is_idle, "for the list")
    notes = read_notes(notes_path(run))
    assert (notes.tags, notes.note) == (("good",), note)


@pytest.mark.deep
def test_a_stopped_run_is_continued_only_on_a_bench_of_its_kind(open_stage: OpenStage, folder: Path) -> None:
    stage = open_stage(folder=folder)
    page = in_window(stage)
    choose(page, "T3")
    button = page.details.continue_button
    assert button.isVisible()
    assert not button.isEnabled(), "there is no bench"
    stage.happen(OPENED)
    (run,) = [folder / e.path for e in page.list.selected]
    page.continue_selected()
    assert stage.session.again == [(run, (), folder)]


@pytest.mark.deep
def test_the_menu_of_the_runs_has_what_can_be_done_with_them(page: RunsPage) -> None:
    choose(page, "T7")
    texts = [action.text() for action in page.list.make_menu(page).actions()]
    assert "Move the selected runs to the trash" in texts
    assert "Continue the selected run, which was stopped" in texts
    assert "Export the selected runs" in texts


@pytest.mark.deep
def test_a_run_without_frequencies_is_plotted_beside_the_list(show: Callable[..., RunsPage], tmp_path: Path) -> None:
    from protocols.measurements.wiring_check import WiringCheck

    with laboratory() as lab:
        run(WiringCheck(record_s=0.5, wait_s=0.2), tmp_path / "runs", lab)
    page = show(tmp_path / "runs", 1)
    until(page.details.result_plots.isVisible, "for the plot")
    assert page.details.empty_label.isHidden()


def test_a_row_shows_the_points_of_its_run(page: RunsPage) -> None:
    thumbnails, folder = page.list.model.thumbnails, page.list.model.folder
    runs = {run.specimen: run for run in page.list.model.summaries}

    def ink(run: Any) -> int:
        image = thumbnails.pixmap(folder, run).toImage()
        return sum(image.pixelColor(x, y).alpha() > 0 for x in range(image.width()) for y in range(image.height()))

    until(lambda: ink(runs["T7"]) > 0, "for the thumbnail")
    line, high = ink(runs["T3"]), ink(runs["T7"])
    assert high > line, "the run that crashed has too few points for a curve"
    index = page.list.model.index(0, THUMBNAIL_COLUMN)
    assert index.data(Qt.ItemDataRole.DecorationRole).width() > 0
    damaged = runs["T7"]._replace(path="nothing.h5", modified_ns=1)
    assert ink(damaged) == 0
    until(lambda: not thumbnails._wanted and not thumbnails._worker.pending, "for the reading")
    assert ink(damaged) == 0, "a file that cannot be read is listed all the same"


def test_what_differs_between_two_runs_is_listed_and_the_rest_is_folded(page: RunsPage) -> None:
    pane, drive = page.details.differences, "Peak to peak"
    choose(page, "T7")
    assert pane.isHidden()
    choose(page, "T7", "T8")
    assert pane.isVisible()

    def rows() -> dict[str, list[str]]:
        table = pane.table
        texts = [[table.item(at, c).text() for c in range(table.columnCount())] for at in range(table.rowCount())]
        return {name: values for name, *values in texts}

    shown = rows()
    assert sorted(shown["Specimen"][:2]) == ["T7", "T8"]
    assert drive not in shown, "the drive is the same"
    largest = next(values for name, values in shown.items() if "displacement" in name)
    numbers = sorted(float(text.removesuffix(" µm")) for text in largest[:2])
    assert numbers[1] / numbers[0] == pytest.approx(8 / 6, rel=0.01)
    assert re.fullmatch(r"[+−]\d+(\.\d)? %(, [\d.]+ σ)?", largest[2]), largest
    find(pane, "runs.differences.True").click()
    assert drive in rows(), "everything is listed"
    assert len(rows()) > len(shown)


def test_runs_stand_under_their_days_with_their_values_and_the_letters_of_compared_ones(
    page: RunsPage, folder: Path
) -> None:
    model, table = page.list.model, page.list.table
    titles = [model.headerData(c, Qt.Orientation.Horizontal) for c in range(model.columnCount())]
    assert len(model.days) == 1
    assert model.days[0].endswith("3 runs")
    assert table.rowHeight(0) > table.rowHeight(1), "the day stands above its first run"
    figures = [["natural_frequency", 159.83, 0.2, 0.6, "Hz"], ["amplitude_at_resonance", 1.147e-3, 4e-7, 1.1e-5, "m"]]
    with_figures = model.summaries[0]._replace(figures_json=json.dumps(figures), protocol="sine-dwell")
    model.set_summaries(folder, [with_figures, *model.summaries[1:]])
    row = {title: model.index(0, at).data() for at, title in enumerate(titles)}
    assert (row["Natural fr., Hz"], row["Largest, µm"]) == ("159.83 ± 0.60", "1147 ± 11")
    page.list.select_paths([entry.path for entry in model.summaries[:2]])
    assert model.letters == {0: "A", 1: "B"}
    until(lambda: not page._worker.pending, "for the points")
    assert [each.label[0] for each in page.details.plot.picture.layers] == ["A", "B"]
    page.list.select_paths([model.summaries[0].path])
    assert model.letters == {}
    table.sortByColumn(titles.index("Specimen"), Qt.SortOrder.AscendingOrder)
    assert model.days == {}
    assert table.rowHeight(0) == table.rowHeight(1)


def test_an_empty_list_says_whether_the_folder_is_still_being_read(
    open_page: OpenPage, config: BenchConfig, tmp_path: Path
) -> None:
    overlay = Overlay(amplifier=config.amplifier.amplifier_map)
    page = open_page(lambda: RunsPage(lambda: tmp_path / "none", lambda: "T7", config.amplifier, overlay))
    page.list.folder_model.rescan()
    assert page.details.empty_label.text() == READING_TEXT
    until(lambda: page.list.folder_model.is_idle, "for the list")
    assert page.details.empty_label.text() == EMPTY_TEXT


def test_a_narrow_list_shows_the_natural_frequency_without_scrolling(page: RunsPage) -> None:
    table = page.list.table
    wide = table.horizontalHeader().sectionSize(COLUMNS.index("verdict"))
    page.resize(860, 400)
    until(lambda: table.horizontalHeader().sectionSize(COLUMNS.index("verdict")) < wide, "for the columns")
    last = COLUMNS.index("natural fr., Hz")
    assert table.columnViewportPosition(last) + table.columnWidth(last) <= table.viewport().width()
