"""Explore page: keys and sliders move the curve on the screen."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QPushButton

from app.cli.model_options import read_settings
from app.explore.fit import ExploreFit, fit_runs
from app.gui.explore.page import ExplorePage
from app.gui.plots import SERIES
from model.identification.fit_options import FitCancelled
from model.response import natural_frequencies
from model.response.harmonic_response import amplifier_response
from model.specimen import Specimen, replace_variables
from tests.helpers.main_window import OpenPage, OpenStage, Stage, drop_file, find, until
from tests.helpers.run_files import finished_run
from tests.helpers.text_places import faults_of_window


@pytest.fixture
def page(open_page: OpenPage) -> ExplorePage:
    explore: ExplorePage = open_page(lambda: ExplorePage(fit_runs))
    settled(explore)
    return explore


def settled(page: ExplorePage) -> None:
    """Wait until every requested curve is on the screen."""
    page.tick()
    want = page.model.requested
    until(
        lambda: page.result is not None and page.result.motion is not None and page.shown_request == want,
        "for the curve",
    )
    page.tick()


def on_screen(page: ExplorePage, series: int = 0) -> tuple[np.ndarray, np.ndarray]:
    layer = page.plot.layer(f"Model: {SERIES[series].label}")
    assert layer is not None
    return layer.x, layer.y


def type_into(page: ExplorePage, name: str, text: str) -> None:
    field = page.sliders.rows[name].field
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, text)
    QTest.keyClick(field, Qt.Key.Key_Return)
    settled(page)


def test_the_curve_on_the_screen_is_the_models(page: ExplorePage) -> None:
    f, um = on_screen(page)
    expected = amplifier_response(Specimen().tactor, f).peak_to_peak
    np.testing.assert_allclose(um, 1e6 * expected, rtol=1e-4)
    assert page.plot.picture.spots[0].label == "Largest 1155 µm at 151 Hz"


def test_the_answer_is_the_curves_and_differs_from_the_pinned_one_as_the_curves_do(page: ExplorePage) -> None:
    def text(name: str) -> str:
        return str(find(page, f"explore.answer.{name}").text())

    assert (text("largest"), text("felt")) == ("1155", "1 … 250")
    beam = Specimen().tactor
    assert float(text("natural")) == pytest.approx(natural_frequencies(beam)[0], abs=0.05)
    assert not page.answer.changes_panel.isVisible()
    page.toolbar.keep_button.click()
    type_into(page, "m_add", "5")
    settled(page)
    now = natural_frequencies(replace(beam, m_add=5e-3))[0]
    assert float(text("natural")) == pytest.approx(now, abs=0.05)
    assert f"{100 * (now / natural_frequencies(beam)[0] - 1):+.0f} %" in text("changes")


def test_a_typed_hyphen_is_shown_and_read_as_a_minus(page: ExplorePage) -> None:
    type_into(page, "mu", "-12")
    field = page.sliders.rows["mu"].field
    assert (field.text(), page.model.setting.value("mu")) == ("−12", pytest.approx(-12e-6))
    field.selectAll()
    field.insert("−11")
    QTest.keyClick(field, Qt.Key.Key_Return)
    assert (field.text(), page.model.setting.value("mu")) == ("−11", pytest.approx(-11e-6))


@pytest.mark.deep
def test_arrow_keys_on_a_slider_move_the_curve_and_undo_brings_it_back(page: ExplorePage) -> None:
    before = on_screen(page)[1]
    bar = page.sliders.rows["m_add"].slider_widget
    bar.setFocus()
    for _ in range(10):
        QTest.keyClick(bar, Qt.Key.Key_Left)
    settled(page)
    assert page.model.setting.value("m_add") < 7.7e-3
    assert page.plot.picture.spots[0].label != "Largest 1155 µm at 151 Hz"
    assert on_screen(page)[0][on_screen(page)[1].argmax()] > 155
    QTest.keyClick(page, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    settled(page)
    np.testing.assert_array_equal(on_screen(page)[1], before)
    QTest.keyClick(page, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier)
    settled(page)
    assert page.model.setting.value("m_add") < 7.7e-3
    page.sliders.rows["m_add"].reset_button.click()
    settled(page)
    assert page.model.setting.values == {}
    np.testing.assert_array_equal(on_screen(page)[1], before)


@pytest.mark.deep
def test_fields_understand_units_and_refuse_in_words(page: ExplorePage) -> None:
    type_into(page, "E_Al", "70000 MPa")
    assert page.model.setting.value("E_Al") == pytest.approx(70e9)
    type_into(page, "delta", "3.7")
    assert page.model.setting.value("delta") == pytest.approx(0.037)
    assert page.model.setting.on_skin
    type_into(page, "m_add", "-1")
    assert "at least 0 kg" in page.status_line.text()
    assert page.model.setting.value("m_add") == 7.73e-3
    type_into(page, "L1", "16 mm")
    assert "L1" in page.status_line.text()
    assert page.model.setting.value("L1") == 8e-3


@pytest.mark.deep
def test_a_preset_brings_the_papers_curves(page: ExplorePage) -> None:
    labels = ["E_m = 0.001 MPa", "E_m = 1 MPa"]
    page.toolbar.preset_box.setCurrentIndex(3)
    page.toolbar.preset_box.activated.emit(3)
    settled(page)
    assert [kept.label for kept in page.model.session.kept_curves][:2] == labels
    kept = {layer.group for layer in page.plot.picture.layers} - {"", "Model"}
    assert len(kept) == 5
    assert kept < page.plot.chips.keys()
    page.toolbar.clear_button.click()
    settled(page)
    assert {layer.group for layer in page.plot.picture.layers} == {"Model"}, "the kept curves are gone"
    assert [*page.plot.chips] == ["Model"]


def test_a_run_dropped_on_the_page_lies_over_the_curve_and_says_simulated(page: ExplorePage, tmp_path: Path) -> None:
    path = finished_run(tmp_path / "elsewhere")
    drop_file(page, path)
    until(lambda: page.overlaid.runs, "for the run")
    (layer,) = [each for each in page.plot.picture.layers if each.name == page.overlaid.runs[0].title]
    np.testing.assert_allclose((layer.x, layer.y), ([100.0, 160.0], [1000.0, 1000.0]))
    assert page.plot.picture.simulated
    type_into(page, "peak_to_peak_v", "4")
    page._show_overlaid()
    assert "at 5 V; the curve is for 4 V" in page.status_line.text()
    page.toolbar.run_chips[path].click()
    until(page.card.isVisible, "for the result of the run")
    assert find(page, "explore.card.verdict").text() == "– Not judged"
    assert find(page, "explore.card.file").text() == path.name
    assert find(page, "explore.card.simulated").isVisible()
    page.toolbar.run_chips[path].click()
    assert not page.card.isVisible()
    page.toolbar.run_chips[path].click()
    next(each for each in page.findChildren(QPushButton) if each.text() == "✕").click()
    assert page.overlaid.runs == ()
    assert not page.card.isVisible()
    assert not page.plot.picture.simulated


def test_a_damaged_run_is_told(page: ExplorePage, tmp_path: Path) -> None:
    (tmp_path / "bad.h5").write_text("nothing of the kind")
    page.overlaid.add([tmp_path / "bad.h5"])
    until(lambda: "bad.h5" in page.status_line.text(), "for the sentence")


@pytest.mark.deep
def test_the_beam_moves_and_its_envelope_is_the_curves_amplitude(page: ExplorePage) -> None:
    page.plot.tools.set_cursor(80.0)
    settled(page)
    assert page.toolbar.frequency.text() == "80"
    envelope = page.shape_plot.layer("envelope")
    assert envelope is not None
    assert envelope.series.band is not None
    lower, upper = envelope.series.band
    middle = len(upper) // 2
    f, um = on_screen(page)
    assert upper[middle] - lower[middle] == pytest.approx(np.interp(80.0, f, um), rel=0.01)
    frames = page.shape_plot.frames
    until(lambda: page.shape_plot.frames > frames + 2, "for the beam to move")


@pytest.mark.deep
def test_copied_parameters_are_on_the_clipboard(page: ExplorePage) -> None:
    type_into(page, "m_add", "5")
    page.toolbar.copy_json_button.click()
    got = replace_variables(Specimen(), read_settings([QGuiApplication.clipboard().text()]))
    assert got.tactor.m_add == 5e-3


@pytest.mark.deep
def test_a_study_is_saved(page: ExplorePage, tmp_path: Path) -> None:
    from protocols.runfile.study_file import read_study

    type_into(page, "delta", "1")
    page.model.save_study(tmp_path / "study.h5", page.result)
    until(lambda: "study.h5: max" in page.status_line.text(), "for the study")
    assert [axis.name for axis in read_study(tmp_path / "study.h5").axes] == ["delta", "frequency"]


@pytest.mark.deep
def test_phase_and_logarithm_on_request(page: ExplorePage) -> None:
    assert len(page.plot.panels) == 1
    page.toolbar.series[2].click()
    page.toolbar.series[3].click()
    settled(page)
    assert len(page.plot.panels) == 2
    phase = page.plot.layer("Model: phase")
    assert phase is not None
    assert phase.y[-1] < -90
    drawn = page.plot.panels[0].drawn_layer("Model: max − min").line.getData()[1]
    assert drawn.max() == pytest.approx(np.log10(1155), abs=0.01)


def test_a_fit_moves_the_sliders_and_tells_its_errors(page: ExplorePage, tmp_path: Path) -> None:
    page.overlaid.fit_with = lambda runs, setting, _: ExploreFit(
        setting.with_value("k2", 8e-3), "stiffness 8.00 ± 0.05 N mm^2"
    )
    page.overlaid.fit(page.model.setting)
    assert "lay a measured run" in page.status_line.text()
    page.overlaid.add([finished_run(tmp_path)])
    until(lambda: page.overlaid.runs, "for the run")
    page.toolbar.fit_button.click()
    until(lambda: page.model.setting.value("k2") == 8e-3, "for the fit")
    assert page.status_line.text() == "Fitted: stiffness 8.00 ± 0.05 N mm^2"
    assert page.toolbar.fit_button.text() == "Fit to the runs"


@pytest.mark.deep
def test_a_fit_is_cancelled_by_its_own_button_and_moves_nothing(page: ExplorePage, tmp_path: Path) -> None:
    def endless(_runs: Any, _setting: Any, cancelled: Callable[[], bool]) -> ExploreFit:
        while not cancelled():
            time.sleep(0.001)
        raise FitCancelled

    page.overlaid.fit_with = endless
    page.overlaid.add([finished_run(tmp_path)])
    until(lambda: page.overlaid.runs, "for the run")
    before = page.model.setting
    page.toolbar.fit_button.click()
    assert page.toolbar.fit_button.text() == "Cancel the fit"
    page.toolbar.fit_button.click()
    until(lambda: "cancelled" in page.status_line.text(), "for the end of it")
    assert page.model.setting == before
    assert page.toolbar.fit_button.text() == "Fit to the runs"


@pytest.mark.deep
def test_sliders_come_back_after_a_restart(open_stage: OpenStage) -> None:
    first = open_stage()
    first.window.tabs.explore.model.set_value("m_add", 5e-3)
    first.window.tabs.explore.model.set_value("delta", 0.01)
    first.window.close_session(force=True)
    until(lambda: not first.window.isVisible(), "for the window to close")
    again = open_stage().window.tabs.explore
    assert again.model.setting.values == {"m_add": 5e-3, "delta": 0.01}
    assert again.model.setting.on_skin


@pytest.mark.deep
def test_the_page_fits_a_small_screen(stage: Stage) -> None:
    stage.press(Qt.Key.Key_3, Qt.KeyboardModifier.ControlModifier)
    page = stage.window.tabs.explore
    assert page.isVisible()
    settled(page)
    stage.window.look.set_appearance("dark")
    assert page.minimumSizeHint().width() <= 1260
    assert page.mapTo(page.window(), QPoint(0, page.height())).y() <= page.window().height()


@pytest.mark.deep
def test_the_response_is_200_px_high_in_every_window_and_shares_a_small_one_with_one_other_part(
    stage: Stage,
) -> None:
    stage.press(Qt.Key.Key_3, Qt.KeyboardModifier.ControlModifier)
    page, window = stage.window.tabs.explore, stage.window
    settled(page)
    side = page.toolbar.side
    parts = {"Parameters": page.left, "Answer": page.answer_area, "Motion": page.shape_plot}
    for width, height in ((1280, 720), (900, 560), (1280, 720), (1366, 600), (1093, 614), (1280, 720)):
        window.resize(width, height)
        until(lambda small=height < 720: side.isVisible() is small, "for the layout")
        for chosen, button in side.buttons.items():
            button.click()
            QApplication.processEvents()
            assert page.plot.panels[0].box.height() >= 200, (width, height, chosen)
            shown = [name for name, part in parts.items() if part.isVisible()]
            assert shown == ([chosen] if side.isVisible() else [*parts])
            assert list(faults_of_window(window)) == []


def test_the_threshold_of_another_body_site_is_drawn_and_bounds_what_is_felt(page: ExplorePage) -> None:
    assert any(rule.along_y for rule in page.plot.picture.rules)
    page.toolbar.site_box.setCurrentText("forearm")  # all is felt on both: the drawing changes all the same
    settled(page)
    assert not any(rule.along_y for rule in page.plot.picture.rules)
    (curve,) = [layer for layer in page.plot.picture.layers if "forearm" in layer.label]
    f, um = curve.x, curve.y
    assert np.interp(55.0, f, um) / np.interp(110.0, f, um) == pytest.approx(10 ** (12 / 20), rel=1e-2)
    type_into(page, "peak_to_peak_v", "0.5")
    assert page.result is not None
    ((low, high),) = page.result.felt_bands
    shown_f, shown_um = on_screen(page)
    assert np.interp(0.99 * low, shown_f, shown_um) < np.interp(0.99 * low, f, um)
    assert np.interp(0.5 * (low + high), shown_f, shown_um) > np.interp(0.5 * (low + high), f, um)
