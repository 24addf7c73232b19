"""Session events for tests."""

import math

import numpy as np

from app.session.session import BenchOpened, Observation
from drivers.bench.card_reading import CardReading
from drivers.drive_shapes import Sine
from drivers.interfaces import Block, Scale
from protocols.base import (
    BenchArmed,
    DriveStarted,
    PointMeasured,
    Quality,
    RestMeasured,
    RunEnded,
    RunStarted,
    RunStatus,
    ShutdownStarted,
)
from protocols.measurements.sine_dwell import SinePoint

OPENED = BenchOpened(
    "simulated bench",
    True,
    {"generator": "Keysight 33511B #1", "amplifier": "AMT2012-CE3", "card": "NI USB-6341 #2", "sensor": "laser"},
)
STARTED = RunStarted("sine-dwell", "run.h5", 27.0, 18, True)
LIVE = (STARTED, BenchArmed(), DriveStarted(Sine(160.0, 2.5, 2.5, 1000)))
AT_REST = RestMeasured(True, 2.5, "the card sees 2.500 V at the amplifier's input: rest")
STOPPED = (ShutdownStarted(), AT_REST, RunEnded(RunStatus.STOPPED, "stopped by the operator", "run.h5"))
LOST = (
    ShutdownStarted(),
    RestMeasured(False, 0.0, "the card sees 0.000 V"),
    RunEnded(RunStatus.UNSAFE, "UNSAFE: switch the high voltage OFF by hand", "run.h5"),
)

SEEN_AT_REST = Observation(CardReading((2.5, 2.5), (2.5, 2.5), math.inf))
"""What a card that sees rest measured last; it does not age."""

SCALES = (Scale((0.0, 10 / 32768)), Scale((0.0, 10 / 32768)))


def point(index: int, frequency_hz: float, quality: Quality = Quality.GOOD) -> PointMeasured:
    flags = int(quality | Quality.SIMULATED)
    size = 1e-3 - 1e-6 * frequency_hz
    return PointMeasured(
        index,
        SinePoint(frequency_hz, size, 2e-6, 0.48 * size, 1e-8, 0, 1e-4, 0.1, (size,), 2.5, 2.5, 0, 0, 5e-7, 80, flags),
        index,
    )


def sine_block(start: int, scans: int, rate_hz: float, frequency_hz: float = 160.0) -> Block:
    """Drive 2.5 +- 2.5 V and displacement +- 5 V, as the card's integers."""
    wave = np.sin(2 * np.pi * frequency_hz * (start + np.arange(scans)) / rate_hz)
    return Block(start, np.round(np.stack([2.5 + 2.5 * wave, 5 * wave]) * 3276.8).astype(np.int16))
