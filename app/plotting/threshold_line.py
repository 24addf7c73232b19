"""Perception threshold as a line of a plot over frequency, with the band that is uncomfortable."""

import numpy as np

from app.plotting.panels import ReferenceLine
from model import Array
from model.response import UNCOMFORTABLE_HZ, PerceptionThreshold

UNCOMFORTABLE_LABEL = "uncomfortable"


def threshold_line(threshold: PerceptionThreshold, frequency_hz: Array) -> ReferenceLine:
    """Return the line of a threshold in µm over rising frequencies."""
    f = frequency_hz[frequency_hz > 0]
    flat = len(threshold.frequency_hz) == 1
    y_um = 1e6 * np.atleast_1d(threshold.amplitude_at(f[:1] if flat else f))
    return ReferenceLine(None if flat else f, y_um, threshold.line_label, UNCOMFORTABLE_HZ, UNCOMFORTABLE_LABEL)
