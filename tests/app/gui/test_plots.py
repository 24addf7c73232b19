"""Plots: samples are drawn in the right units, axis ranges are stable, a periodic wave is displayed stationary."""

from types import SimpleNamespace

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtGui import QFontMetricsF
from PySide6.QtWidgets import QApplication

from app.gui.face import LIGHT
from app.gui.plots import time_plot
from app.gui.plots.base import limit_ticks, stable_range, style_axes, tick_spacing
from app.gui.plots.time_plot import TimePlot, rising_edges
from app.live import feed as live_feed
from app.live.feed import MAX_DELAY_S, SPANS, LiveFeed
from drivers.sensors.laser_sensor import LaserSensor
from model.amplifier_map import AmplifierMap
from tests.helpers.session_events import SCALES, sine_block


def fed(rate_hz: float = 5000.0, seconds: float = 2.0) -> LiveFeed:
    feed = LiveFeed()
    feed.start_stream(rate_hz, SCALES, LaserSensor("laser", 1e-4))
    scans = round(0.05 * rate_hz)
    for i in range(round(seconds / 0.05)):
        feed.add_block(sine_block(i * scans, scans, rate_hz))
    return feed


@pytest.mark.parametrize("rate_hz", [5000.0, 500_000.0])
def test_samples_arrive_as_volts_and_micrometres(rate_hz: float) -> None:
    feed = fed(rate_hz)
    assert feed.streamed_s == pytest.approx(2.0)
    for span in SPANS:
        drive, moved = (trace.decimated_curve()[1] for trace in feed.traces(span))
        assert (drive.min(), drive.max()) == pytest.approx((0.0, 5.0), abs=0.02)
        assert (moved.min(), moved.max()) == pytest.approx((-500.0, 500.0), abs=2.0)
        assert moved.size <= 2 * span.columns


def test_a_block_before_the_stream_is_known_is_left_out() -> None:
    feed = LiveFeed()
    feed.add_block(sine_block(0, 100, 5000.0))
    assert feed.streamed_s == 0.0


def test_the_shortest_span_stands_still(qt: QApplication) -> None:
    feed = fed(seconds=1.0)
    plot = TimePlot(feed, AmplifierMap())
    pictures = []
    for i in range(3):
        feed.add_block(sine_block(5000 + 177 * i, 177, 5000.0))
        plot.tick()
        curve = plot.curves[1]
        time_s, drive_v = curve.getData()
        at = np.linspace(-0.09, 0.0, 300)
        pictures.append(np.interp(at, time_s + curve.pos().x(), drive_v))
    plot.deleteLater()
    for picture in pictures[1:]:
        np.testing.assert_allclose(picture, pictures[0], atol=0.25)


def test_a_picture_is_drawn_only_when_there_is_something_new(qt: QApplication) -> None:
    feed = fed()
    plot = TimePlot(feed, AmplifierMap())
    for _ in range(10):
        plot.tick()
    plot.deleteLater()
    assert plot.frames == 1


def test_traces_without_new_samples_turn_grey_and_state_their_age(qt: QApplication, clock: list[float]) -> None:
    feed = fed()
    plot = TimePlot(feed, AmplifierMap())
    live, held = [LIGHT.ink] * 2, [LIGHT.text2] * 2

    def look() -> tuple[str, list[str]]:
        plot.tick()
        return plot.held_label.text(), [curve.opts["pen"].color().name() for curve in plot.curves]

    feed.add_block(sine_block(5000, 100, 5000.0))
    assert look() == ("", live)
    clock[0] += 12.4
    assert look() == ("held: 12 s old", held)
    plot.select_span(2)  # another view of the same samples is no new sample
    assert look() == ("held: 12 s old", held)
    QApplication.setPalette(LIGHT.palette())
    assert look()[1] == held
    feed.add_block(sine_block(5100, 100, 5000.0))
    assert look() == ("", live)
    plot.deleteLater()


def test_edges_are_found_between_two_columns() -> None:
    time_s = np.arange(1000) / 10_000.0
    drive_v = np.repeat(2.5 + 2.5 * np.sin(2 * np.pi * 50.0 * time_s - 1.0), 2)
    edges_s = rising_edges(np.repeat(time_s, 2), drive_v, 2.5)
    np.testing.assert_allclose(edges_s, (1.0 / (2 * np.pi) + np.arange(5)) / 50.0, atol=1e-6)
    assert not rising_edges(np.repeat(time_s, 2), np.full(2000, 2.5), 2.5).size


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time of feed and plot."""
    now = [100.0]
    for module in (time_plot, live_feed):
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now[0]))
    return now


def arrive(feed: LiveFeed, clock: list[float], plot: TimePlot, times_s: list[float], end_s: float) -> list[float]:
    """Feed blocks of 50 ms at given times and tick 60 times a second; return the bench time at the right edge, tick by tick."""
    waiting, right_s = list(times_s), []
    while clock[0] < end_s:
        clock[0] += 1 / 60
        while waiting and waiting[0] <= clock[0]:
            moment, clock[0] = clock[0], waiting.pop(0)
            feed.add_block(sine_block(round(feed.streamed_s * 5000.0), 250, 5000.0))
            clock[0] = moment
        plot.tick()
        right_s.append(-float(plot.curves[1].pos().x()))
        assert right_s[-1] <= feed.streamed_s
    return right_s


@pytest.mark.parametrize("span", [0, 1])
def test_traces_move_at_every_tick_although_samples_arrive_in_blocks(
    qt: QApplication, clock: list[float], span: int
) -> None:
    feed = LiveFeed()
    feed.start_stream(5000.0, SCALES, LaserSensor("laser", 1e-4))
    plot = TimePlot(feed, AmplifierMap())
    plot.select_span(span)
    times_s = [100.05 + 0.05 * i + (0.01 if i % 3 else 0.0) for i in range(60)]
    right_s = np.array(arrive(feed, clock, plot, times_s, 103.0))
    steps_s = np.diff(right_s[60:])
    assert (steps_s > 0).all()  # the drive has 100 rising edges a second
    assert steps_s.max() < 0.04
    assert feed.streamed_s - right_s[-1] < 0.15  # a block, its jitter and the smoothing behind
    arrive(feed, clock, plot, [], 104.0)
    drawn = plot.frames
    plot.tick()
    assert plot.frames == drawn  # all is shown
    assert -plot.curves[1].pos().x() == pytest.approx(feed.streamed_s, abs=0.011)
    plot.deleteLater()


def test_a_change_of_the_drive_in_which_no_block_is_read_does_not_stop_the_traces(
    qt: QApplication, clock: list[float]
) -> None:
    feed = LiveFeed()
    feed.start_stream(5000.0, SCALES, LaserSensor("laser", 1e-4))
    plot = TimePlot(feed, AmplifierMap())
    due_s = [100.05 + 0.05 * i for i in range(100)]
    times_s = [due + max(0.25 - due % 1.0, 0.0) for due in due_s]  # the first five of a second arrive together
    steps_s = np.diff(arrive(feed, clock, plot, times_s, 105.0))[120:]
    assert (steps_s > 0).all()
    assert feed.streamed_s + plot.curves[1].pos().x() < MAX_DELAY_S
    plot.deleteLater()


def test_a_virtual_clock_is_followed(qt: QApplication, clock: list[float]) -> None:
    feed = LiveFeed()
    feed.start_stream(5000.0, SCALES, LaserSensor("laser", 1e-4))
    plot = TimePlot(feed, AmplifierMap())
    arrive(feed, clock, plot, [100.0 + 0.001 * i for i in range(2000)], 102.0)
    assert feed.streamed_s == pytest.approx(100.0)
    assert feed.streamed_s + plot.curves[1].pos().x() < MAX_DELAY_S + 0.1
    plot.deleteLater()


@pytest.mark.parametrize(
    ("low", "high", "present", "expected"),
    [
        (-500, 500, None, (-600, 600)),
        (-500, 500, (-600, 600), (-600, 600)),
        (-450, 480, (-600, 600), (-600, 600)),
        (-50, 50, (-600, 600), (-60, 60)),
        (float("nan"), 1.0, (-1.0, 2.0), (-1.0, 2.0)),
        (float("nan"), 1.0, None, (-1.0, 1.0)),
    ],
)
def test_ranges_change_only_when_they_must(
    low: float, high: float, present: tuple[float, float] | None, expected: tuple[float, float]
) -> None:
    assert stable_range(low, high, present) == pytest.approx(expected)


@pytest.mark.parametrize("span", [0.013, 1.0, 7.0, 1200.0, 99_000.0])
def test_a_low_plot_has_two_to_four_intervals(span: float) -> None:
    assert 1.5 <= span / tick_spacing(0.0, span) <= 4


@pytest.mark.parametrize("height", [30, 60, 120, 300])
def test_ticks_stay_apart_and_no_name_is_cut_off_however_low_a_plot_is(qt: QApplication, height: int) -> None:
    canvas = pg.PlotWidget()
    plot, font = canvas.getPlotItem(), canvas.font()
    plot.setLabel("left", "a name of some length")
    style_axes(plot, font)
    limit_ticks(plot, font)
    canvas.resize(300, height + 60)
    canvas.show()
    plot.setYRange(280, 288, padding=0)
    QApplication.processEvents()
    axis, box = plot.getAxis("left"), plot.getViewBox()
    ticks = axis.tickValues(280, 288, box.height())[0][1]
    assert len(ticks) < 2 or (ticks[1] - ticks[0]) / 8 * box.height() >= 0.85 * QFontMetricsF(font).height()
    assert axis.label.isVisible() == (axis.label.boundingRect().width() <= box.height())
    canvas.close()
    canvas.deleteLater()
