"""Live strips of further channels in the window."""

import numpy as np
from PySide6.QtCore import QCoreApplication, QEvent
from PySide6.QtWidgets import QApplication

from app.config.bench_file import load_bench
from app.gui.face import DARK
from app.gui.plots.time_plot import TimePlot
from app.live import LiveFeed
from drivers import Block, InputChannel, Scale


def test_each_further_channel_has_a_strip_in_its_unit(qt: QApplication) -> None:
    config, feed = load_bench("ideal"), LiveFeed()
    plot = TimePlot(feed, config.amplifier.amplifier_map)
    plot.resize(600, 500)
    plot.show()
    assert len(plot.panels) == 2
    inputs = (InputChannel("amplifier_voltage", "ai2", "V", 1000.0), InputChannel("current", "ai3", "A", 0.01))
    feed.start_stream(1000.0, (Scale((0.0, 1e-3)),) * 4, config.sensor.laser_sensor, inputs)
    feed.add_block(Block(0, np.tile(np.arange(1000, dtype=np.int16), (4, 1))))
    plot.tick()
    assert [panel.panel.title for panel in plot.panels[2:]] == ["Amplifier_voltage, V", "Current, mA"]
    volts, milliamperes = (curve.getData()[1] for curve in plot.curves[2:])
    assert (volts.max(), milliamperes.max()) == (999.0, 9.99)
    QApplication.setPalette(DARK.palette())
    feed.start_stream(1000.0, (Scale((0.0, 1e-3)),) * 2, config.sensor.laser_sensor)
    for start in (0, 1000):
        feed.add_block(Block(start, np.zeros((2, 1000), np.int16)))
    plot.tick()
    assert len(plot.panels) == 2
    plot.deleteLater()
    QCoreApplication.sendPostedEvents(plot, QEvent.Type.DeferredDelete)
