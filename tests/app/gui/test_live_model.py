"""Model curve of the specimen with its band; live estimates and pre-run warnings."""

import math
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PySide6.QtCore import QPointF
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QApplication

from app.common import sentence_case
from app.gui.face import tokens
from app.gui.measure import page as measure_page
from app.gui.plots import RESIDUAL, Layer
from app.identification.active_model import PAPER_MODEL
from app.identification.calibrations import Calibrations, write_calibrations
from app.live.estimates import LiveEstimator
from drivers.sensors.laser_sensor import LaserSensor
from model import quantity_label
from model.amplifier_map import AmplifierMap
from model.identification.fit_options import FitOptions
from model.membrane import skin
from model.parameters import Membrane, Tactor
from model.response.harmonic_response import amplifier_response
from protocols.base import PointMeasured, Quality, RunEnded, RunStatus
from protocols.measurements.membrane_series import MembranePoint, MembraneSeries
from protocols.measurements.sine_dwell import SineDwell, SinePoint
from tests.helpers.calibrations import calibration
from tests.helpers.main_window import Stage, find, until
from tests.helpers.session_events import AT_REST, LIVE, OPENED
from tests.protocols.test_rehearsal import guard

TRUTH = Tactor(m_add=8.2e-3, c0=140.0, mu=-1.2e-5)
FREQUENCIES = (25.0, 75.0, 125.0, 150.0, 160.0, 175.0, 200.0, 250.0)


def measured(noise: float = 0.0, n: int = FitOptions.n) -> list[SinePoint]:
    """Points as a tactor of `n` shapes gives them, each with a stated error of a thousandth, and relative noise of its sizes."""
    driven = amplifier_response(TRUTH, np.array(FREQUENCIES), n=n)
    scatter = 1.0 + noise * np.random.default_rng(3).standard_normal(len(FREQUENCIES))
    flags = int(Quality.GOOD | Quality.SIMULATED)
    return [
        SinePoint(
            f, top, 1e-3 * top, abs(w), 1e-3 * abs(w), float(np.angle(w)), 1e-3, 0.1, (abs(w),), 2.5, 2.5, 0, 0, 5e-7,
            80, flags,
        )
        for f, top, w in zip(FREQUENCIES, scatter * driven.peak_to_peak, scatter * driven.fundamental, strict=True)
    ]  # fmt: skip


def shown_ink(stage: Stage, hz: float, um: float) -> QColor:
    """The colour of the response plot at a place on its axes."""
    chart = stage.window.measure_page.live_pane.plots.chart
    canvas = chart.canvas
    at = canvas.mapFromScene(chart.panels[0].box.mapViewToScene(QPointF(hz, um)))
    return canvas.viewport().grab().toImage().pixelColor(at)


def test_accepted_calibration_updates_curve_and_band_in_open_window(
    stage: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measure_page, "CALIBRATION_POLL_S", 0.0)
    chart = stage.window.measure_page.live_pane.plots.chart
    until(lambda: chart.picture.note == "curve: the paper's values", "for the paper's curve")
    assert all(layer.series.band is None for layer in chart.picture.layers)
    write_calibrations(tmp_path, "T7", Calibrations((calibration(1, {"c0": (159.0, 25.0)}),), 1))
    until(lambda: chart.picture.note == "curve: calibration 1 of T7, SIMULATED", "for the band")
    (layer,) = [each for each in chart.picture.layers if each.name.startswith("max − min")]
    assert layer.series.band is not None
    assert "95 % band" in layer.label
    low, high = layer.series.band
    top = int(high.argmax())
    beside = float((high[top] + (low[top] + high[top]) / 2) / 2)
    assert high[top] - low[top] > 100
    QApplication.processEvents()
    ground = QColor(tokens().surface)
    assert shown_ink(stage, float(layer.x[top]), beside) != ground
    chart.toggle_group("Model")
    assert not any(each.group == "Model" for each in chart.panels[0].layers)


@pytest.mark.deep
def test_membrane_points_use_colour_and_curve_of_their_elongation(stage: Stage) -> None:
    plots, rubber = stage.window.measure_page.live_pane.plots, Membrane()
    plots.resize(900, 500)

    def curves() -> dict[str, Layer]:
        return {each.label: each for each in plots.chart.picture.layers if each.group == "Model" and each.label}

    stage.window.measure_page.run_panel.set_protocol(
        MembraneSeries(elongations_m=(0.0, 5.08e-3), frequencies_hz=(50, 150))
    )
    until(lambda: [*curves()] == ["free", "0 mm", "5.08 mm"], "for the curves of the form")
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE)
    at = (math.nan, 0.0, 5.08e-3)
    for i, elongation in enumerate(at):
        pressed = None if math.isnan(elongation) else skin(rubber, elongation / rubber.L_m)
        driven = amplifier_response(Tactor(), np.array([150.0]), skin=pressed)
        like, (size,), (w,) = measured()[3], driven.peak_to_peak, driven.fundamental
        stage.happen(PointMeasured(i, MembranePoint(
            **{f.name: getattr(like, f.name) for f in fields(like)} | {
                "peak_to_peak": size, "fundamental": abs(w), "phase": float(np.angle(w)),
            },
            elongation=elongation, part=float(i),
        ), i))  # fmt: skip
    shown = [each for each in plots.chart.picture.layers if each.name.startswith("max − min, measured")]
    for layer, curve in zip(shown, curves().values(), strict=True):
        assert layer.y[0] == pytest.approx(np.interp(150.0, curve.x, curve.y), rel=1e-3)
        assert layer.tone == curve.tone
    assert len({layer.tone for layer in shown}) == 3
    plots.choose_lower(RESIDUAL)
    residual = plots.chart.layer(RESIDUAL)
    assert residual is not None
    assert residual.y == pytest.approx([0, 0, 0], abs=0.1), "per cent from its own curve"
    stage.happen(AT_REST, RunEnded(RunStatus.COMPLETED, "done", "run.h5"))
    before = curves()
    stage.window.measure_page.run_panel.set_protocol(SineDwell())
    until(lambda: any("next" in each.label for each in plots.chart.picture.layers), "for the curve of the next run")
    assert curves().keys() == before.keys(), "the finished run keeps its curves"


def test_estimates_and_their_errors_follow_the_points(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE)
    panel = stage.window.measure_page.run_panel
    card = panel.result_card
    assert not find(panel, "measure.rehearsal").isVisible()
    points = measured(
        1e-3, n=7
    )  # as the window's bench; without noise their fit has an error of no size, and its value as many digits
    for at, point in enumerate(points):
        stage.happen(PointMeasured(at, point, at))
    natural, *others = SineDwell().estimates(points)
    # An update of the fit of the last point still has the figures of the point before.
    until(lambda: card._update.points == 8 and [*card._update.results] == [natural, *others], "for the fit")
    assert card.isVisible()
    assert find(card, "result.verdict").text() == "● Preliminary"
    assert find(card, "result.name").text() == quantity_label(natural.name).capitalize(), "as of the finished run"
    assert float(find(card, "result.figure").text()) == pytest.approx(natural.value, rel=1e-4)
    (mass,) = (value for name, value in card._rows if name == sentence_case(quantity_label("m_add")))
    number, error = (float(word) for word in mass.removesuffix(" g").split(" ± "))
    assert abs(number - 8.2) < 4 * error < 0.2
    assert PAPER_MODEL.description in card.note_label.text()
    assert card.minimumSizeHint().width() < 270, "a window of 800 points would cut the column"
    stage.happen(RunEnded(RunStatus.COMPLETED, "done", "run.h5"))
    assert find(card, "result.verdict").text() != "● Preliminary"


@pytest.mark.deep
def test_points_that_no_fit_may_use_or_that_were_measured_again_are_left_out() -> None:
    live = LiveEstimator(AmplifierMap())
    points = measured()
    *_, all_of_them = live.fit_new_points((tuple(points), PAPER_MODEL, SineDwell))
    bad = replace(points[3], quality=int(Quality.CLIPPED))
    *_, without = live.fit_new_points(((*points[:3], bad, *points[4:]), PAPER_MODEL, SineDwell))
    assert (all_of_them.points, without.points) == (8, 7)
    # The points have no noise; the priors of the effects with one sign shift the values by less than a thousandth.
    assert {e.name: e.value for e in without.estimates} == pytest.approx(
        {"m_add": TRUTH.m_add, "c0": TRUTH.c0, "mu": TRUTH.mu}, rel=1e-3
    )


@pytest.mark.deep
def test_a_stroke_beyond_the_sensors_range_is_foreseen_beside_the_rehearsal(stage: Stage) -> None:
    near = LaserSensor("laser", 1e-4, valid_low_v=-3, valid_high_v=3)
    stage.session.bench = SimpleNamespace(amplifier=guard(), sensor=near, meters={}, configuration={}, channels=())
    stage.happen(OPENED)
    panel = stage.window.measure_page.run_panel
    until(lambda: "leave the sensor's range" in find(panel, "measure.warnings").text(), "for the caution")
    assert find(panel, "measure.warnings").isVisible()
    assert "Foreseen with the paper's values" in find(panel, "measure.warnings").text()
    assert panel.can_start, "a caution is no refusal"
    panel.form.rows["peak_to_peak_v"].set_value("0.5 V")
    until(
        lambda: find(panel, "measure.warnings").text() and "sensor" not in find(panel, "measure.warnings").text(),
        "for another rehearsal",
    )
