"""Plots: samples are drawn in the right units, axis ranges are stable, a periodic wave is displayed stationary."""

from types import SimpleNamespace

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QPushButton

from app.common import number_text
from app.gui.face import LIGHT
from app.gui.plots import SOLID, Chart, Panel, Picture, Region, Rule, Spot, layer, time_plot
from app.gui.plots.axes import round_step, stable_range
from app.gui.plots.labels import Label
from app.gui.plots.picture import ON_AXIS
from app.gui.plots.time_plot import DRIVE_TITLE, TimePlot, rising_edges
from app.live import feed as live_feed
from app.live.feed import MAX_DELAY_S, SPANS, LiveFeed
from drivers.interfaces import Block
from drivers.sensors.laser_sensor import LaserSensor
from model.amplifier_map import AmplifierMap
from tests.helpers.session_events import SCALES, sine_block
from tests.helpers.text_places import faults_of_plot, plot_texts


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


def test_a_cursor_in_the_traces_reads_time_displacement_and_drive(qt: QApplication) -> None:
    feed = fed(seconds=1.0)
    plot = TimePlot(feed, AmplifierMap())
    plot.resize(800, 400)
    plot.show()
    plot.tick()
    plot.tools.set_cursor(-0.05)
    time_text, moved, drive = plot.tools.label.text().splitlines()
    assert time_text == "−50 ms"
    assert moved.startswith("Displacement: ")
    assert moved.endswith(" µm")
    time_s, drive_v = plot.curves[1].getData()
    at = float(np.interp(-0.05, time_s + plot.curves[1].pos().x(), drive_v))
    assert drive == f"{DRIVE_TITLE.removesuffix(', V')}: {number_text(at, 4)} V"
    feed.add_block(sine_block(5000, 777, 5000.0))
    plot.tick()
    assert plot.tools.label.text().startswith("−50 ms")
    plot.select_span(2)
    plot.tools.set_cursor(-2.0)
    assert plot.tools.label.text().startswith("−2 s")
    plot.deleteLater()


def test_at_rest_a_horizontal_trace_is_drawn_once_and_a_moving_one_with_every_block(
    qt: QApplication, clock: list[float]
) -> None:
    feed = fed(seconds=0.5)
    plot = TimePlot(feed, AmplifierMap())
    plot.resize(800, 400)
    plot.show()
    plot.is_calm = True
    scans = 2500

    def next_drawn(seconds: float, amplitude_v: float = 0.0, ticks: bool = True) -> list[bool]:
        """Let seconds of one drive pass, and return which traces are drawn anew by the last block: displacement, drive."""
        nonlocal scans
        for _ in range(round(seconds / 0.1)):
            moving = sine_block(scans, 500, 5000.0)
            drive = moving.raw[0] if amplitude_v else np.full_like(moving.raw[0], 8192)
            feed.add_block(Block(scans, np.stack((drive, moving.raw[1]))))
            scans += 500
            clock[0] += 0.2
            before = [curve.pos().x() for curve in plot.curves]
            if ticks:
                plot.tick()
        return [bool(curve.pos().x() != x) for curve, x in zip(plot.curves, before, strict=True)]

    assert next_drawn(1.0) == [True, False]
    assert next_drawn(0.1, amplitude_v=2.5) == [True, True]
    assert next_drawn(1.0) == [True, False]
    plot.is_calm = False  # a run, whose end is not seen
    next_drawn(0.5, amplitude_v=2.5)
    next_drawn(2.0, ticks=False)
    plot.is_calm = True
    assert next_drawn(0.1) == [True, True]
    plot.select_span(1)  # the line does not reach from edge to edge yet
    assert next_drawn(0.1) == [True, True]
    plot.deleteLater()


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
def test_a_low_plot_has_one_to_four_intervals(span: float) -> None:
    step = round_step(span, 4)
    assert 1.5 <= span / step <= 4
    assert f"{step:e}"[:3] in {"1.0", "2.0", "2.5", "5.0"}


@pytest.mark.parametrize("height", [110, 160, 300])
@pytest.mark.parametrize("values", [(280.0, 288.0), (-5e-7, 4e-7), (0.0, 123_456.0)])
def test_ticks_and_titles_stay_apart_however_low_a_plot_is(
    qt: QApplication, height: int, values: tuple[float, float]
) -> None:
    chart = Chart("two panels", headed=False)
    chart.resize(400, 2 * height)
    chart.show()
    x = np.array([0.0, 100.0])
    layers = tuple(layer(name=f"{at}", x=x, y=np.array(values), symbol="o", panel=at) for at in (0, 1))
    titles = "A title that is much longer than a low plot is high, µm", "Residual, µm"
    panels = tuple(Panel(title=title, x_labels=at == 1) for at, title in enumerate(titles))
    chart.show_picture(Picture(x_title="Frequency, Hz", panels=panels, layers=layers))
    QApplication.processEvents()
    assert list(faults_of_plot(chart.canvas)) == []
    left = {round(each.box.sceneBoundingRect().left()) for each in chart.panels}
    assert len(left) == 1, "the left edges are one line"
    chart.deleteLater()


def test_labels_avoid_each_other_and_regions_name_themselves_inside(qt: QApplication) -> None:
    chart = Chart("labels", headed=False)
    chart.show()
    x = np.linspace(0.0, 250.0, 60)
    layers = tuple(
        layer(name=name, x=x, y=900 * np.exp(-(((x - 150) / 60) ** 2)) + at, line=SOLID, label=name)
        for at, name in enumerate(("one curve", "another curve", "a third curve"))
    )
    picture = Picture(
        x_title="Frequency, Hz", panels=(Panel(title="Displacement, µm", low=0.0),), layers=layers, x=(0.0, 250.0),
        regions=(Region(low=200.0, high=250.0, tone="sand", label="Tends to be uncomfortable"),),
        rules=(Rule(at=160.0, label="Natural frequency 160.0 Hz", marked=True),),
        spots=(Spot(x=150.0, y=900.0, label="Largest 900 µm at 150 Hz"),),
    )  # fmt: skip
    for width in (320, 500, 1000):
        chart.resize(width, 320)
        chart.show_picture(picture)
        QApplication.processEvents()
        assert list(faults_of_plot(chart.canvas)) == []
    places = {place.text: place for place in plot_texts(chart.canvas)}
    assert {"one curve", "another curve", "a third curve", "Largest 900 µm at 150 Hz"} <= places.keys()
    edge = chart.panels[0].to_pixels(200.0, 0.0)[0][0] + chart.panels[0].box.sceneBoundingRect().left()
    assert places["Tends to be uncomfortable"].area.left() >= edge
    chart.deleteLater()


def test_the_label_of_the_largest_covers_no_point_in_a_low_plot(qt: QApplication) -> None:
    chart = Chart("low", headed=False)
    chart.resize(560, 130)
    chart.show()
    x = np.arange(100.0, 190.0, 10.0)
    y = np.array([780.0, 840.0, 920.0, 1020.0, 1110.0, 1154.0, 1110.0, 1000.0, 849.0])
    points = layer(name="points", x=x, y=y, symbol="o")
    label = "Largest 1154 µm at 150 Hz"
    spots = (Spot(x=150.0, y=1154.0, label=label),)
    chart.show_picture(Picture(panels=(Panel(low=0.0),), layers=(points,), spots=spots, x=(0.0, 190.0)))
    QApplication.processEvents()
    panel = chart.panels[0]
    (item,) = [i for i in panel.box.childItems() if isinstance(i, Label) and i.text() == label and i.isVisible()]
    area = item.mapRectToParent(item.boundingRect())
    assert not any(area.contains(*at) for at in panel.to_pixels(x, y))
    chart.deleteLater()


@pytest.mark.parametrize("symbol", ["o", ""], ids=["points", "lines"])
@pytest.mark.parametrize("gap", [30.0, -30.0, 60.0])
def test_a_label_stands_nearer_to_its_own_curve_than_to_any_other(qt: QApplication, gap: float, symbol: str) -> None:
    chart = Chart("close curves", headed=False)
    chart.show()
    x = np.array([100.0, 130.0, 150.0, 170.0, 200.0])
    y = np.array([580.0, 790.0, 900.0, 800.0, 490.0])
    drawn = {"symbol": symbol} if symbol else {"line": SOLID}
    close, crossing = (y + np.array([gap, *each]) for each in ((3.0, 1.0, 1.0, 1.0), (gap / 2, 0.0, -gap / 2, -gap)))
    for other in (close, crossing):
        curves = {"this curve": y, "the other curve": other}
        layers = tuple(layer(name=name, x=x, y=each, label=name, **drawn) for name, each in curves.items())
        chart.show_picture(Picture(panels=(Panel(title="Displacement, µm", low=0.0),), layers=layers, x=(0.0, 225.0)))
        for width, height in ((320, 240), (500, 320), (900, 320)):
            chart.resize(width, height)
            QApplication.processEvents()
            panel = chart.panels[0]
            grid = np.linspace(x[0], x[-1], 2001) if not symbol else x
            pixels = {name: panel.to_pixels(grid, np.interp(grid, x, each)) for name, each in curves.items()}
            labels = [item for item in panel.box.childItems() if isinstance(item, Label) and item.isVisible()]
            assert {item.text() for item in labels} == set(curves)
            for item in labels:
                area = item.mapRectToParent(item.boundingRect())
                corners = (area.left(), area.top()), (area.right(), area.bottom())
                apart = {n: np.hypot(*(p - np.clip(p, *corners)).T).min() for n, p in pixels.items()}
                assert apart[item.text()] <= min(apart.values()) + 1.0, (item.text(), width)
    chart.deleteLater()


@pytest.mark.deep
@pytest.mark.parametrize("alarming", [False, True])
def test_chips_are_whole_or_one_button_at_every_width(qt: QApplication, alarming: bool) -> None:
    chart, x = Chart("chips"), np.arange(2.0)
    chart.show()
    layers = [layer(name=each, x=x, y=x, line=SOLID, tone="model", group=each) for each in ("Model", "Run before, 5 V")]
    chart.show_picture(Picture(title="Response", note="the note of a plot", alarming=alarming, layers=tuple(layers)))
    seen = set()
    for width in range(300, 700, 7):
        chart.resize(width, 200)
        QApplication.processEvents()
        shown = [each for each in chart.head.findChildren(QPushButton) if each.isVisible()]
        assert all(each.width() >= each.sizeHint().width() for each in shown), width
        seen.add(chart.layers_button.isVisible())
    assert seen == {True, False}
    chart.deleteLater()


def test_a_label_that_would_lie_over_a_curve_is_its_letter(qt: QApplication) -> None:
    chart = Chart("low")
    chart.resize(340, 180)
    chart.show()
    x = np.arange(18.0)
    for y, text in ((x, "A  T7 29 Nov 09:34"), (x % 2, "A")):
        curve = layer(name="run", x=x, y=y, symbol="o", line=SOLID, label="A  T7 29 Nov 09:34")
        chart.show_picture(Picture(layers=(curve,)))
        QApplication.processEvents()
        labels = [each for each in chart.canvas.scene().items() if isinstance(each, Label) and each.isVisible()]
        assert [each.text() for each in labels if each.text()] == [text]
    chart.deleteLater()


def test_two_cursors_read_the_difference(qt: QApplication) -> None:
    chart = Chart("cursors", headed=False)
    chart.resize(500, 320)
    chart.show()
    x = np.array([100.0, 150.0, 200.0])
    moved = layer(name="moved", x=x, y=np.array([400.0, 900.0, 450.0]), errors=np.full(3, 2.0), symbol="o")
    chart.show_picture(Picture(x_title="Frequency, Hz", panels=(Panel(title="Displacement, µm"),), layers=(moved,)))
    QApplication.processEvents()
    for second, at in enumerate((1, 2)):
        place = chart.canvas.mapFromScene(
            chart.panels[0].box.mapToScene(*chart.panels[0].to_pixels(x[at], moved.y[at])[0])
        )
        keys = Qt.KeyboardModifier.ShiftModifier if second else Qt.KeyboardModifier.NoModifier
        QTest.mouseClick(chart.canvas.viewport(), Qt.MouseButton.LeftButton, keys, place)
    rows = chart.tools.label.text().splitlines()
    assert rows[:2] == ["150 Hz", "moved: 900.0 ± 2.0 µm"]
    assert rows[2:] == ["Δ −50 Hz", "Δ moved: 450 µm, ratio 2"]
    chart.deleteLater()


def test_the_labels_of_a_vertical_axis_have_place_at_every_size(qt: QApplication) -> None:
    chart = Chart("width", headed=False)
    sag = layer(name="sag", x=np.arange(1.0, 6.0), y=3519.1 + 0.01 * np.arange(5), symbol="o")
    chart.resize(300, 200)
    chart.show()
    chart.show_picture(Picture(x_title="Repeat", panels=(Panel(title="Sag, µm"),), layers=(sag,)))
    for size in ((900, 700), (300, 200), (700, 900)):
        chart.resize(*size)
        QApplication.processEvents()
        axis = chart.panels[0].axes["left"]
        assert axis.width() >= axis.needed_width() > 0
    chart.deleteLater()


def test_unusable_points_and_their_error_bars_set_no_range(qt: QApplication) -> None:
    chart = Chart("range", headed=False)
    usable = np.array([True, True, False])
    points = layer(
        name="points", x=np.arange(3.0), y=np.array([900.0, 1000.0, 0.0]), errors=np.array([1.0, 1.0, 90.0]),
        symbol="o", usable=usable,
    )  # fmt: skip
    for low, least in ((0.0, 0.0), (None, 850.0)):
        panel = Panel(title="Displacement, µm", low=low)
        chart.show_picture(Picture(x_title=f"Frequency, {low}, Hz", panels=(panel,), layers=(points,)))
        assert least <= chart.panels[0].axes["left"].range[0] <= 900.0 * bool(least)
    chart.deleteLater()


def test_the_numbers_of_an_axis_have_their_places_after_a_resize(qt: QApplication) -> None:
    chart = Chart("resized", headed=False)
    chart.resize(300, 200)
    chart.show()
    line = layer(name="line", x=np.arange(2.0), y=np.array([0.0, 1150.0]), line=SOLID)
    chart.show_picture(Picture(panels=(Panel(title="Displacement, µm", low=0.0),), layers=(line,)))
    QApplication.processEvents()
    chart.grab()
    chart.resize(300, 500)
    QApplication.processEvents()
    resized = chart.grab().toImage()
    chart.show_picture(chart.picture, force=True)
    assert resized == chart.grab().toImage()
    chart.deleteLater()


def test_a_title_takes_no_number_from_its_axis(qt: QApplication) -> None:
    chart = Chart("test")
    title = "Time from rising edge, ms"
    axis_range = (-100.0, 0.0)
    for width in (240, 500, 1000):
        chart.resize(width, 300)
        x = np.linspace(*axis_range, 50)
        panel = Panel(title="Drive, V")
        chart.show_picture(
            Picture(x_title=title, panels=(panel,), layers=(layer(name="drive", x=x, y=x, line=SOLID),), x=axis_range)
        )
        chart.grab()
        QApplication.processEvents()
        axis = chart.panels[0].axes["bottom"]
        assert axis.heading.text() == title
        shown = [text for *_, text in axis.generateDrawSpecs(None)[2]]
        assert shown == [text for _, text in axis.places()]
        assert shown[0] == "−100"
        assert list(faults_of_plot(chart.canvas)) == []
    chart.deleteLater()


def test_marks_on_the_axis_are_whole_and_the_ticks_are_few(qt: QApplication) -> None:
    chart = Chart("marks")
    chart.resize(1200, 700)
    chart.show()

    def dark_pixels(y: float) -> int:
        marks = layer(name="coming", x=np.array([160.0]), y=np.array([y]), tone="ink", symbol=ON_AXIS, size=40)
        chart.show_picture(Picture(panels=(Panel(low=0.0, high=1400.0),), layers=(marks,), x=(0.0, 275.0)))
        qt.processEvents()
        gray = chart.canvas.grab().toImage().convertToFormat(QImage.Format.Format_Grayscale8)
        return int((np.frombuffer(gray.constBits(), np.uint8) < 60).sum())

    assert dark_pixels(0.0) == pytest.approx(dark_pixels(700.0), abs=8)
    assert dark_pixels(700.0) > dark_pixels(np.nan) + 50
    assert {side: len(axis.places()) for side, axis in chart.panels[0].axes.items()} == {"left": 8, "bottom": 12}
    chart.deleteLater()
