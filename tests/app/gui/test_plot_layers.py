"""Fit lines, residuals and further layers of result plots: what is drawn below points and curves."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

from app.gui.plots.curve_layers import COHERENCE, LESS_MEAN, RESIDUAL, isolated, layer_series, layers_of
from app.gui.plots.result_plots import ResultPlots
from model import Array
from protocols.base import Protocol, Quality, Series, SeriesAxis
from protocols.measurements.hysteresis import Hysteresis
from protocols.measurements.mass_resonance import MassPoint, MassResonance
from protocols.measurements.membrane_sag import MembraneSag
from protocols.measurements.static_loading import StaticLoading
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.registry import PROTOCOLS
from tests.helpers.main_window import Stage, until
from tests.helpers.run_files import finished_run

TURN = np.linspace(0, 2 * np.pi, 129)


def loop(width_m: float = 5e-6, label: str = "1 Hz") -> Series:
    """A loop much thinner than its stroke."""
    drive = 2.5 + 2.5 * np.sin(TURN)
    moved = 2e-4 * np.sin(TURN) - 0.5 * width_m * np.cos(TURN)
    axes = {"x_axis": SeriesAxis("drive", "V"), "y_axis": SeriesAxis("displacement", "m")}
    return Series(drive, moved, **axes, name="loop", label=label)


def response(label: str = "", fit: Array | None = None) -> Series:
    f = np.linspace(25.0, 525.0, 201)
    axes = {"x_axis": SeriesAxis("frequency", "Hz"), "y_axis": SeriesAxis("response", "m/V")}
    H = 1e-4 / (1 + (f / 200) ** 2) * np.exp(-1j * f / 200)
    return Series(f, H, fit=fit, coherence=np.full(f.size, 0.999), **axes, name="frequency response", label=label)


def points(**columns: Any) -> list[Any]:
    """Points by their columns, usable and simulated."""
    rows = zip(*columns.values(), strict=True)
    return [SimpleNamespace(**dict(zip(columns, row, strict=True)), quality=int(Quality.SIMULATED)) for row in rows]


def residual(line: Any, of: list[Any], x: str, y: str) -> Array:
    return np.array([getattr(of[i], y) - np.interp(getattr(of[i], x), line.x, line.y) for i in line.fitted_rows])


def shown_plots(kind: type[Protocol], measured: Sequence[Any] = (), curves: tuple[Series, ...] = ()) -> ResultPlots:
    plots = ResultPlots()
    plots.resize(900, 500)
    plots.show()
    plots.show_results(kind, measured, curves, entries=tuple(range(len(measured))), curves_first=bool(curves))
    return plots


@pytest.mark.deep
def test_every_protocol_with_estimates_on_its_axes_has_a_line() -> None:
    load = np.array([0.2, 0.5, 1.0, 2.0] * 2)
    side = np.array([1.0] * 4 + [-1.0] * 4)
    moved = load * np.where(side > 0, 1.3e-4, 1.4e-4)
    loaded = points(side=side, load=load, load_errors=0 * load, deflection=moved, deflection_errors=1e-8 + 0 * load)
    for line in (lines := StaticLoading.fit_lines(loaded)):
        assert np.abs(residual(line, loaded, "load", "deflection")).max() < 1e-12
    assert [line.fitted_rows for line in lines] == [(0, 1, 2, 3), (4, 5, 6, 7)]

    level = np.array([0.5, 1.5, 2.5, 3.5, 4.5])
    step = level - 2.5
    bend = np.where(step > 0, 1.4e-4, 5e-5) * step
    stepped = points(level=level, drive_step=step, deflection=bend, deflection_errors=1e-8 + 0 * step)
    for line in VoltageSteps.fit_lines(stepped):
        assert np.abs(residual(line, stepped, "level", "deflection")).max() < 1e-12

    mass = np.array([1.75e-3, 4.75e-3, 6e-3, 9.75e-3])
    resonance = np.sqrt(9000.0 / (mass + 2e-3)) / (2 * np.pi)
    (line,) = MassResonance.fit_lines(points(mass=mass, frequency=resonance, frequency_errors=0.01 + 0 * mass))
    np.testing.assert_allclose(np.interp(mass, line.x, line.y), resonance, rtol=1e-3)

    hertz = np.array([0.1, 0.5, 1.0, 5.0])
    looped = points(frequency=hertz, share=0.02 + 0.003 * hertz, share_errors=1e-5 + 0 * hertz)
    (line,) = Hysteresis.fit_lines(looped)
    assert np.abs(residual(line, looped, "frequency", "share")).max() < 1e-9
    for name in ("sweep", "free-decay", "membrane-sag"):
        kind = PROTOCOLS[name]
        x, y = kind.axes
        (line,) = kind.fit_lines(points(**{x: [1.0, 2.0], y: [3.0, 5.0], f"{y}_errors": [1.0, 1.0]}))
        np.testing.assert_allclose(line.y, 4.0)


@pytest.mark.deep
def test_the_points_have_their_line_and_residual(qt: QApplication) -> None:
    masses = [1.75e-3, 4.75e-3, 9.75e-3]
    measured = [
        MassPoint(m, 4.5 * m**-0.5, 0.1, 1.0, 0.1, 1.0, 0.1, 0.2, 0.1, 1e-4, 1.0, 1.0, int(Quality.SIMULATED))
        for m in masses
    ]
    plots = shown_plots(MassResonance, measured)
    (line,) = [layer for layer in plots.chart.picture.layers if layer.group == "fit"]
    assert "1/f²" in line.label
    assert len(plots.chart.panels) == 2
    (left,) = [layer for layer in plots.chart.picture.layers if layer.panel == 1 and layer.symbol]
    assert left.y.size == 3
    assert plots.chart.picture.panels[1].title == "Residual, Hz"
    plots.lower_button.click()
    assert len(plots.chart.panels) == 1
    plots.lower_button.click()
    plots.resize(900, 200)
    qt.processEvents()
    assert len(plots.chart.panels) == 1, "there is no space for both"
    plots.deleteLater()


@pytest.mark.deep
def test_a_thin_loop_is_seen_less_its_mean_line(qt: QApplication) -> None:
    series = layer_series(loop(), LESS_MEAN)
    assert series is not None
    assert np.ptp(series.y) == pytest.approx(5.0, rel=0.02)
    assert np.abs(series.y).max() < 3.0, "the stroke of 400 µm is taken off"
    plots = shown_plots(Hysteresis, curves=(loop(), loop(1e-5, "5 Hz")))
    assert plots.lower_panel == LESS_MEAN
    assert len([layer for layer in plots.chart.picture.layers if layer.panel == 1]) == 2
    low, high = plots.chart.panels[1].box.viewRange()[1]
    assert high - low < 20.0
    plots.deleteLater()


@pytest.mark.deep
def test_a_response_has_coherence_phase_and_the_residual_of_its_fit(qt: QApplication) -> None:
    curve = response()
    assert layers_of((curve,))[0] == COHERENCE
    assert RESIDUAL not in layers_of((curve,))
    fitted = response(fit=0.99 * curve.plotted)
    left = layer_series(fitted, RESIDUAL)
    assert left is not None
    np.testing.assert_allclose(left.y, 1e4 * curve.plotted)
    plots = shown_plots(PROTOCOLS["sweep"], curves=(fitted,))
    assert plots.chart.picture.panels[1].title == "Coherence"
    plots.choose_lower(RESIDUAL)
    assert plots.chart.picture.panels[1].title == "Residual, µm/V"
    plots.deleteLater()


@pytest.mark.deep
def test_every_curve_has_a_chip_or_one_button_offers_all(qt: QApplication) -> None:
    plots = shown_plots(PROTOCOLS["sweep"], curves=tuple(response(f"with {mass} g") for mass in range(3)))
    chart = plots.chart
    assert [*chart.chips] == [f"with {mass} g" for mass in range(3)]
    assert all(chip.isVisible() for chip in chart.chips.values())
    chart.chips["with 1 g"].click()
    assert {layer.label for layer in chart.panels[0].layers} == {"with 0 g", "with 2 g"}
    plots.resize(400, 500)
    qt.processEvents()
    assert not any(chip.isVisible() for chip in chart.chips.values())
    assert chart.layers_button.text() == "Layers 2 of 3"
    plots.deleteLater()


def test_an_error_that_stands_out_is_no_bow_tie() -> None:
    errors = np.full(30, 1e-3)
    errors[12] = 0.1
    assert np.flatnonzero(isolated(errors)).tolist() == [12]
    errors[10:20] = 0.1
    assert not isolated(errors).any(), "a wide part of a curve has a wide band"


@pytest.mark.deep
def test_left_edges_are_in_line_whatever_their_tick_labels(qt: QApplication) -> None:
    fields = dict.fromkeys(MembraneSag.point_type.__dataclass_fields__, 1.0)
    sags = (3464.40e-6, 3464.41e-6, 3464.43e-6)
    measured = [
        MembraneSag.point_type(**{**fields, "repeat": i, "sag": sag, "sag_errors": 1e-8, "quality": 0})
        for i, sag in enumerate(sags)
    ]
    plots = shown_plots(MembraneSag, measured)
    qt.processEvents()
    widths = {panel.axes["left"].width() for panel in plots.chart.panels}
    assert len(plots.chart.panels) == 2
    assert len(widths) == 1
    assert widths.pop() >= max(panel.axes["left"].needed_width() for panel in plots.chart.panels) > 44
    plots.deleteLater()


def test_recorded_runs_are_added_to_the_plot_of_a_result_and_removed_again(stage: Stage, tmp_path: Path) -> None:
    path, page = finished_run(tmp_path / "elsewhere", "T9", size_m=6e-4), stage.window.measure_page
    plots = page.live_pane.plots
    page.add_runs([path, path])

    def added() -> list[Any]:
        return [layer for layer in plots.chart.picture.layers if layer.group.startswith("T9")]

    until(added, "for the run")
    (layer,) = added()
    np.testing.assert_allclose((layer.x, layer.y), ([100, 160], [600, 600]))
    assert layer.tone != "ink", "the present run is told apart"
    actions = {action.text(): action for action in plots.chart.tools.make_menu().actions()}
    actions["Remove the added runs"].trigger()
    assert not added()
    page.add_runs([tmp_path / "nothing.h5"])
    until(lambda: not page._worker.pending, "for the file that is not there")
    assert not added()
