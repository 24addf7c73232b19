"""Result curves in the live plot as soon as they are measured, with their errors and the model."""

import numpy as np
import pytest

from app.gui.plots import Layer
from app.gui.plots.results import MAX_DRAWN_POINTS, CurvesView
from drivers.drive_shapes import PeriodicSweep
from model.parameters import Tactor
from model.response.harmonic_response import amplifier_response
from protocols.base import BenchArmed, DriveStarted, RunStarted, Series, SeriesAxis, SeriesReady
from tests.helpers.main_window import Stage, find, until
from tests.helpers.session_events import OPENED

FREQUENCIES = np.linspace(25.0, 525.0, 501)


def response(scale: float, entry: int = 0, label: str = "") -> Series:
    """The paper's tactor, `scale` times as responsive, with errors of a twentieth."""
    modulus = scale * np.abs(amplifier_response(Tactor(), FREQUENCIES, 1.0).fundamental)
    return Series(
        FREQUENCIES,
        modulus,
        0.05 * modulus,
        x_axis=SeriesAxis("frequency", "Hz"),
        y_axis=SeriesAxis("response", "m/V"),
        name="frequency response",
        label=label,
        entry=entry,
    )


def drawn_curves(stage: Stage) -> list[Layer]:
    """The lines of the curves of the run."""
    layers = stage.window.measure_page.live_pane.plots.chart.picture.layers
    return [each for each in layers if each.line is not None and each.group != "Model" and not each.panel]


def begin(stage: Stage, protocol: str) -> None:
    panel = stage.window.measure_page.run_panel
    find(panel, "measure.protocol").setCurrentIndex(find(panel, "measure.protocol").findData(protocol))
    stage.happen(OPENED)
    stage.window.start_run()
    drive = PeriodicSweep(25.0, 525.0, 1.0, 9, 1.0, 2.5)
    stage.happen(RunStarted(protocol, "run.h5", 9.0, 1, True), BenchArmed(), DriveStarted(drive))


def test_a_sweep_is_drawn_with_its_errors_on_the_models_line(stage: Stage) -> None:
    begin(stage, "sweep")
    pane = stage.window.measure_page.live_pane
    assert not pane.plots.shows_curves
    stage.happen(SeriesReady(response(1.0)))
    assert pane.plots.shows_curves
    (line,) = drawn_curves(stage)
    truth = 1e6 * np.abs(amplifier_response(Tactor(), FREQUENCIES, 1.0).fundamental)
    np.testing.assert_allclose(line.y, truth)
    assert line.series.band is not None
    np.testing.assert_allclose(line.series.band[1] - line.series.band[0], 0.2 * truth)
    assert pane.plots.chart.picture.simulated
    name = "Model: the paper's values"
    until(lambda: pane.plots.chart.layer(name) is not None, "for the model")
    model = pane.plots.chart.layer(name)
    assert model is not None
    np.testing.assert_allclose(np.interp(FREQUENCIES, model.x, model.y), truth, rtol=0.01)


@pytest.mark.deep
def test_a_loop_is_drawn_whole_as_it_arrives_with_its_errors(stage: Stage) -> None:
    begin(stage, "hysteresis")
    pane, turn = stage.window.measure_page.live_pane, np.linspace(0, 2 * np.pi, 129)
    drive, moved = 2.5 + 2.5 * np.sin(turn), 2e-4 * np.sin(turn - 0.1)
    axes = {"x_axis": SeriesAxis("drive", "V"), "y_axis": SeriesAxis("displacement", "m")}
    stage.happen(SeriesReady(Series(drive, moved, np.full(129, 1e-6), **axes, name="loop", label="1 Hz")))
    assert pane.plots.shows_curves
    assert pane.plots.chart.picture.title == "Loop"
    line = drawn_curves(stage)[0]
    np.testing.assert_allclose(line.x, drive)
    np.testing.assert_allclose(line.y, 1e6 * moved)
    assert line.series.band is not None
    np.testing.assert_allclose(line.series.band[1] - line.series.band[0], 4.0)
    (x_low, x_high), (y_low, y_high) = pane.plots.chart.panels[0].box.viewRange()
    assert x_low <= 0.0 < 5.0 <= x_high
    assert y_low < -200.0
    assert y_high > 200.0, "what lies below rest is seen as well"
    assert all(layer.group != "Model" for layer in pane.plots.chart.picture.layers)


@pytest.mark.deep
def test_repeated_curve_replaces_the_old_one_and_a_button_shows_points(stage: Stage) -> None:
    begin(stage, "sweep")
    pane = stage.window.measure_page.live_pane
    stage.happen(SeriesReady(response(1.0, 0)), SeriesReady(response(1.0, 1, "second")))
    stage.happen(SeriesReady(response(2.0, 0)))
    assert len(drawn_curves(stage)) == 2
    tops = sorted(line.y.max() for line in drawn_curves(stage))
    assert tops[1] == pytest.approx(2 * tops[0])
    pane.plots.curves_button.click()
    assert not pane.plots.shows_curves
    stage.happen(SeriesReady(response(1.5, 0)))
    assert not pane.plots.shows_curves, "who looks at the points is not taken away from them"
    pane.plots.curves_button.click()
    assert pane.plots.shows_curves
    stage.window.start_run()


def test_many_lines_are_drawn_as_extremes() -> None:
    x = np.arange(100_001.0)
    y = np.zeros_like(x)
    y[77_777], y[5] = 3.0, -2.0
    places, drawn = CurvesView([Series(x, y)]).picture().layers[0].drawn or (x, y)
    assert drawn.size <= MAX_DRAWN_POINTS + 2
    assert (drawn.min(), drawn.max()) == (-2.0, 3.0)
    assert abs(places[drawn.argmax()] - 77_777) < 60
