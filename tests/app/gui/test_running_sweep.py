"""Sweeps are drawn while they run: response of the samples so far, piece after piece, until the measured curve arrives."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from app.live.running_curve import RunningCurve
from drivers.drive_shapes import Drive, LinearSweep, PeriodicSweep
from drivers.interfaces import Block
from drivers.sensors.laser_sensor import LaserSensor
from protocols.base import BlockStored, DriveStarted, EntryStarted, RunStarted, Series, SeriesReady
from tests.helpers.main_window import Stage, until
from tests.helpers.session_events import LIVE, OPENED, SCALES, STOPPED

RATE_HZ, BLOCK = 5000.0, 250
SENSOR = LaserSensor("laser", gain_m_per_v=100e-6)
COUNTS_PER_V = 3276.8
SENSOR_V_PER_V = 0.8
"""Sensor's volts over the drive's: 80 µm/V."""


@pytest.fixture
def running() -> Iterator[RunningCurve]:
    made = RunningCurve(pause_s=0.0)
    made.start_stream(RATE_HZ, SCALES, SENSOR)
    made.observe(RunStarted("sweep", "run.h5", 10.0, 1, simulated=True))
    yield made
    made.close()


def play(observe: Callable[[object], object], drive: Drive, seconds: float) -> None:
    """Start a drive and store the first seconds of it, block by block, with a displacement that follows it at once."""
    observe(DriveStarted(drive))
    for start in range(0, round(seconds * RATE_HZ), BLOCK):
        volts = drive.volts((start + np.arange(BLOCK)) / RATE_HZ)
        raw = np.round(np.stack([volts, SENSOR_V_PER_V * (volts - 2.5)]) * COUNTS_PER_V).astype(np.int16)
        observe(BlockStored(Block(start, raw), start))


def moduli(curve: Series | None) -> tuple[np.ndarray, np.ndarray]:
    assert curve is not None
    return curve.x, 1e6 * curve.plotted


@pytest.mark.deep
def test_a_periodic_sweep_has_a_response_from_its_third_period_on(running: RunningCurve) -> None:
    running.observe(EntryStarted(0, "sweep 1", (1,)))
    play(running.observe, PeriodicSweep(25.0, 525.0, 0.5, 9, 1.0, 2.5), 3.5)
    until(lambda: running.latest is not None and running.latest.label == "running, 3 of 9 periods", "for the response")
    frequency, response = moduli(running.latest)
    assert frequency.size > 200
    np.testing.assert_allclose(response[np.isfinite(response)], 80.0, rtol=0.02)
    running.observe(SeriesReady(running.latest))  # type: ignore[arg-type]
    assert running.latest is None, "the measured curve takes its place"


@pytest.mark.deep
def test_pieces_of_a_slow_sweep_follow_each_other(running: RunningCurve) -> None:
    running.observe(EntryStarted(0, "1.75 g", (1.75e-3,)))
    play(running.observe, LinearSweep(25.0, 275.0, 5.0, 1.0, 2.5), 5.0)
    play(running.observe, LinearSweep(260.0, 525.0, 5.0, 1.0, 2.5), 2.5)
    until(lambda: running.latest is not None and "at 39" in running.latest.label, "for half of the second piece")
    frequency, response = moduli(running.latest)
    measured = frequency[np.isfinite(response)]
    assert (np.diff(frequency) > 0).all()
    assert measured.min() < 60.0
    assert 300.0 < measured.max() < 400.0
    assert frequency[-1] == 525.0, "the axis has the whole band of the running piece"
    np.testing.assert_allclose(response[np.isfinite(response)], 80.0, rtol=0.05)


@pytest.mark.deep
def test_a_running_sweep_is_shown_until_its_run_ends(stage: Stage) -> None:
    window, feed = stage.window, stage.window.adapter.feed
    stage.happen(OPENED)
    window.start_run()
    stage.happen(*LIVE)
    plots = window.measure_page.live_pane.plots
    feed.running_curve._pause_s = 0.0  # all samples come at once here
    feed.start_stream(RATE_HZ, SCALES, SENSOR)
    feed.running_curve.observe(RunStarted("sweep", "run.h5", 10.0, 1, simulated=True))
    play(stage.happen, PeriodicSweep(25.0, 525.0, 0.5, 9, 1.0, 2.5), 3.5)

    def drawn() -> bool:
        window.tick()
        return plots.shows_curves

    until(drawn, "for the running sweep")
    assert any("running" in layer.label for layer in plots.chart.picture.layers)
    stage.happen(*STOPPED)
    assert feed.running_curve.latest is None
    assert not plots.shows_curves
