"""Perception threshold as a line of a plot over frequency, and the range that is uncomfortable."""

import numpy as np

from app.plotting.panels import ShadedRange
from model import Array, Role, Series
from model.response import UNCOMFORTABLE_HZ, PerceptionThreshold

UNCOMFORTABLE = ShadedRange(*UNCOMFORTABLE_HZ, "uncomfortable")


def threshold_line(threshold: PerceptionThreshold, frequency_hz: Array) -> Series:
    """Return the line of a threshold in µm over rising frequencies; one value if it is level."""
    f = frequency_hz[frequency_hz > 0]
    places = f[:1] if len(threshold.frequency_hz) == 1 else f
    y_um = 1e6 * np.atleast_1d(threshold.amplitude_at(places))
    return Series(places, y_um, label=threshold.line_label, role=Role.REFERENCE)
