"""Aspects of the protocol `sweep`."""

import math
from collections.abc import Iterator

import numpy as np

from model import Array, Complex
from model.identification import FrequencyResponseObservation, Observation
from model.response.lag import loop_share
from protocols.aspects.response_lines import response_lines
from protocols.aspects.run_points import RunPoints
from protocols.aspects.running_sweep import RunningSweepAspects
from protocols.measurements.sweep import Sweep

MAX_SWEPT_CYCLES = 2000
"""Cycles of a period at the highest frequency up to which the loops of a sweep are computed in time: it takes 1 us a sample."""

LINE_TOLERANCE = 0.01
"""Of the distance of lines: how far an excited line, an odd multiple of one over the period, may seem to lie from it."""

SAMPLES_PER_CYCLE = 64
"""Of such a sweep at its highest frequency: turning points are missed by 0.1 % of the amplitude at most."""


class SweepAspects(RunningSweepAspects):
    """Sweep beside its measurement."""

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        """Yield the lines of each sweep as sines of the sweep's amplitude.

        The amplifier's two slopes are their mean and an even part; the sweep is played both ways up, so that only the mean is in
        its lines, as in the fundamental of a sine.
        """
        run, map_ = points.run, points.run.amplifier_map
        curves = {curve.entry: curve for curve in run.series() if curve.name == "frequency response"}
        for i in np.flatnonzero(points.good).tolist():
            curve = curves.get(int(points.columns["entry"][i]))
            if curve is None:
                continue
            lines = response_lines(curve, bool(run.imported))
            seen_v = points.columns["drive_amplitude"][i]
            amplitude_v = float(min(seen_v, map_.high_v - map_.rest_v, map_.rest_v - map_.low_v))
            if lines.frequency_hz.size and amplitude_v > 0:
                yield FrequencyResponseObservation(
                    f"{points.label} {curve.label}".strip(),
                    lines.frequency_hz,
                    lines.response * amplitude_v,
                    lines.errors * amplitude_v,
                    drive_amplitude_v=amplitude_v,
                    drive_offset_v=map_.rest_v,
                    swept=True,
                    loop_share=None if run.imported else _loop_share(points, lines.frequency_hz),
                    **points.common_arguments("displacement", "delay", "volts"),
                )


def _loop_share(points: RunPoints, frequency_hz: Array) -> Complex | None:
    """Return what a hysteresis of 1 adds at the lines of a sweep, (F,): its loops are no sine's where it begins and turns.

    None, as under sines, for a long sweep, for one in pieces, whose bands overlap, and for lines that are averages of others.
    """
    protocol, amplifier = points.read_protocol(), points.run.amplifier_map
    assert isinstance(protocol, Sweep)
    drives = protocol.drives(amplifier.rest_v)
    if len(drives) != 1 or drives[0].period_s * drives[0].stop_hz > MAX_SWEPT_CYCLES:
        return None
    drive = drives[0]
    lines = np.rint(frequency_hz * drive.period_s).astype(int)
    if np.any(lines % 2 == 0) or not np.allclose(lines, frequency_hz * drive.period_s, rtol=0, atol=LINE_TOLERANCE):
        return None
    samples = math.ceil(SAMPLES_PER_CYCLE * drive.period_s * drive.stop_hz)
    volts = drive.volts(np.arange(samples) * drive.period_s / samples)
    return loop_share(np.clip(volts, amplifier.low_v, amplifier.high_v), lines, amplifier)


ASPECTS = SweepAspects()
