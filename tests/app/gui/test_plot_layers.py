"""Fit lines, residuals and further layers of result plots: what is drawn below points and curves."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import QPointF
from PySide6.QtWidgets import QApplication

from app.gui.plots.base import TracePlotBase, needed_axis_width
from app.gui.plots.curve_layers import COHERENCE, LESS_MEAN, RESIDUAL, isolated, layer_series, layers_of
from app.gui.plots.curves_plot import CurvesPlot
from app.gui.plots.points_plot import PointsPlot
from model import Array
from protocols.base import Quality, Series, SeriesAxis
from protocols.measurements.hysteresis import Hysteresis
from protocols.measurements.mass_resonance import MassPoint, MassResonance
from protocols.measurements.membrane_sag import MembraneSag
from protocols.measurements.static_loading import StaticLoading
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.registry import PROTOCOLS

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
    plot = PointsPlot()
    plot.resize(900, 500)
    plot.show()
    plot.set_protocol(MassResonance)
    masses = [1.75e-3, 4.75e-3, 9.75e-3]
    measured = [
        MassPoint(m, 4.5 * m**-0.5, 0.1, 1.0, 0.1, 1.0, 0.1, 0.2, 0.1, 1e-4, 1.0, 1.0, int(Quality.SIMULATED))
        for m in masses
    ]
    plot.show_points(measured, (0, 1, 2), False)
    assert len(plot.line_items) == 1
    assert "1/f²" in plot.fit_label.text()
    assert plot.strip.isVisible()
    assert plot.strip.series[0].y.size == 3
    assert plot.strip.plot.getAxis("left").labelText == "residual (Hz)"
    plot.strip_box.setCurrentIndex(1)
    assert not plot.strip.isVisible()
    plot.strip_box.setCurrentIndex(0)
    plot.resize(900, 200)
    qt.processEvents()
    assert not plot.strip.isVisible(), "there is no space for both"
    plot.deleteLater()


@pytest.mark.deep
def test_a_thin_loop_is_seen_less_its_mean_line(qt: QApplication) -> None:
    series = layer_series(loop(), LESS_MEAN)
    assert series is not None
    assert np.ptp(series.y) == pytest.approx(5.0, rel=0.02)
    assert np.abs(series.y).max() < 3.0, "the stroke of 400 µm is taken off"
    plot = CurvesPlot()
    plot.resize(900, 500)
    plot.show()
    plot.show_curves((loop(), loop(1e-5, "5 Hz")), bare_tactor=False)
    assert plot.layer == LESS_MEAN
    assert plot.strip.isVisible()
    assert len(plot.strip.series) == 2
    low, high = plot.strip.plot.getViewBox().viewRange()[1]
    assert high - low < 20.0
    plot.deleteLater()


@pytest.mark.deep
def test_a_response_has_coherence_phase_and_the_residual_of_its_fit(qt: QApplication) -> None:
    curve = response()
    assert layers_of((curve,))[0] == COHERENCE
    assert RESIDUAL not in layers_of((curve,))
    fitted = response(fit=0.99 * curve.plotted)
    left = layer_series(fitted, RESIDUAL)
    assert left is not None
    np.testing.assert_allclose(left.y, 1e4 * curve.plotted)
    plot = CurvesPlot()
    plot.resize(900, 500)
    plot.show()
    plot.show_curves((fitted,), bare_tactor=False)
    assert plot.strip.plot.getAxis("left").labelText == "coherence"
    plot.layer_box.setCurrentIndex(plot.layer_box.findData(RESIDUAL))
    plot.layer_box.activated.emit(plot.layer_box.currentIndex())
    assert plot.strip.plot.getAxis("left").labelText == "residual (µm/V)"
    plot.deleteLater()


@pytest.mark.deep
def test_the_legend_lies_above_the_curves(qt: QApplication) -> None:
    plot = CurvesPlot()
    plot.resize(900, 500)
    plot.show()
    plot.show_curves(tuple(response(f"with {mass} g") for mass in range(9)), bare_tactor=False)
    qt.processEvents()
    assert len(plot.legend.items) == 9
    box = plot.plot.getViewBox()
    lowest_of_legend = box.mapSceneToView(plot.legend.mapToScene(plot.legend.boundingRect().bottomLeft())).y()
    assert lowest_of_legend > max(line.getData()[1].max() for line, _ in plot.drawn_curves)
    plot.show_curves(tuple(response(f"with {mass} g") for mass in range(5)), bare_tactor=False)
    plot.resize(500, 500)
    qt.processEvents()
    places = {(sample.pos().x(), sample.pos().y()) for sample, _ in plot.legend.items}
    assert len(places) == 5, "no entry lies on another, also after other curves and in a narrower plot"
    plot.deleteLater()


def test_an_error_that_stands_out_is_no_bow_tie() -> None:
    errors = np.full(30, 1e-3)
    errors[12] = 0.1
    assert np.flatnonzero(isolated(errors)).tolist() == [12]
    errors[10:20] = 0.1
    assert not isolated(errors).any(), "a wide part of a curve has a wide band"


@pytest.mark.deep
def test_no_tick_label_is_printed_over_the_name_of_the_axis(qt: QApplication) -> None:
    plot = PointsPlot()
    plot.resize(900, 400)
    plot.show()
    plot.set_protocol(MembraneSag)
    fields = dict.fromkeys(MembraneSag.point_type.__dataclass_fields__, 1.0)
    sags = (3464.40e-6, 3464.41e-6, 3464.43e-6)
    measured = [
        MembraneSag.point_type(**{**fields, "repeat": i, "sag": sag, "sag_errors": 1e-8, "quality": 0})
        for i, sag in enumerate(sags)
    ]
    plot.show_points(measured, (0, 1, 2), False)
    qt.processEvents()
    width = plot.plot.getAxis("left").width()
    assert width >= needed_axis_width(plot.plot, plot.fontMetrics()) > 62
    assert plot.strip.plot.getAxis("left").width() == width, "both left edges are in line"
    plot.strip.plot.setYRange(0.0, 1e6)  # whose ticks have the spacing of micrometres until it is painted
    assert plot.strip.plot.getAxis("left").width() < 150
    plot.deleteLater()


@pytest.mark.deep
def test_one_cursor_goes_through_displacement_and_drive(qt: QApplication) -> None:
    plot = TracePlotBase()
    plot._add_head()
    plot.resize(800, 400)
    plot.show()
    times = np.linspace(0, 1, 101)
    plot.curves[0].setData(times, 100 * times)
    plot.curves[1].setData(times, 5 * times)
    for each in plot._plots:
        each.setXRange(0, 1, padding=0)
        each.setYRange(0, 100, padding=0)
    qt.processEvents()
    box = plot._plots[1].getViewBox()
    tools = plot.tools[0]
    tools._on_mouse_moved(box.mapViewToScene(QPointF(0.5, 50.0)))
    assert [line.isVisible() for line in tools.cursors] == [True, True]
    assert [round(line.value(), 2) for line in tools.cursors] == [0.5, 0.5]
    assert tools.label.text() == "0.5 s,  50 µm,  2.5 V"
    tools._on_mouse_moved(QPointF(-10.0, -10.0))
    assert not any(line.isVisible() for line in tools.cursors)
    plot.deleteLater()
