"""Aspects of the protocol `sweep`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from model import Array, Complex, identification
from protocols import measurements, signals
from protocols.aspects.running_sweep import RunningSweepAspects
from protocols.base import ImportedSamples, Quality, RunOfSamples, Series

if TYPE_CHECKING:
    from model.identification import Observation
    from protocols.aspects.run_points import RunPoints

MAX_SWEPT_CYCLES = 2000
"""Largest number of cycles per period at the highest frequency for loops computed in time, which takes 1 us per sample."""

LINE_TOLERANCE = 0.01
"""Largest apparent distance of an excited line from an odd multiple of one over the period, as a share of the distance of lines."""

SAMPLES_PER_CYCLE = 64
"""Samples per cycle of such a sweep at its highest frequency: turning points are missed by at most 0.1 % of the amplitude."""

MIN_CROSSINGS = 40
"""Fewest crossings of the middle of the drive's range by a sweep."""

MIN_FREQUENCY_RATIO = 1.5
"""Smallest ratio of the highest to the lowest frequency of a sweep."""

MIN_MONOTONY = 0.98
"""Smallest rank correlation of time and frequency."""

LINEAR_TOLERANCE = 0.05
"""Deviation of the frequency from a straight line over time, as a share of the band, above which a caution is given."""

BLOCK_HZ = 1.0
"""Width over which closer lines are averaged; at a damping of 0.2 this lowers the resonance by less than 1e-4."""

SHARE_OF_SPACING = 0.25
"""Distance to a harmonic of the mains, as a share of the distance of lines, below which a line is left out: hum repeats with
every period."""


class SweepAspects(RunningSweepAspects):
    """Sweep beside its measurement."""

    def series_fault(self, series: ImportedSamples) -> str | None:
        single = series.drive_v is not None and sweep_frequencies(series.drive_v, series.rate_hz) is not None
        return "" if single else "the drive is not a single sweep"

    def series_runs(self, series: Sequence[ImportedSamples]) -> Iterator[RunOfSamples]:
        """Yield a run of each series."""
        yield from map(_series_run, series)

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        """Yield the lines of each sweep as sines of the sweep's amplitude.

        The amplifier's two slopes are their mean and an even part; the sweep is played with both signs, so that only the mean is
        in its lines, as in the fundamental of a sine.
        """
        run, map_ = points.run, points.run.setup.amplifier_map
        curves = {curve.entry: curve for curve in run.series() if curve.name == signals.FREQUENCY_RESPONSE}
        for i in np.flatnonzero(points.good).tolist():
            curve = curves.get(int(points.columns["entry"][i]))
            if curve is None:
                continue
            seen_v = points.columns["drive_amplitude"][i]
            amplitude_v = float(min(seen_v, map_.high_v - map_.rest_v, map_.rest_v - map_.low_v))
            lines = response_lines(curve, bool(run.setup.imported)).scaled(1.0, amplitude_v)
            if lines.x.size and amplitude_v > 0:
                yield identification.FrequencyResponseObservation(
                    f"{points.label} {curve.label}".strip(),
                    lines.x,
                    lines.y,
                    lines.errors,
                    drive_amplitude_v=amplitude_v,
                    drive_offset_v=map_.rest_v,
                    swept=True,
                    order=points.start_s,
                    loop_share=None if run.setup.imported else _loop_share(points, lines.x),
                    **points.common_arguments("displacement", "delay", "volts"),
                )


def response_lines(curve: Series, overlaps: bool) -> Series:
    """Return the usable lines of a frequency response; `overlaps` if neighbours share half of their samples."""
    lines = curve.at(np.argsort(curve.x)[:: 2 if overlaps else 1])
    f, errors = lines.x, lines.errors
    assert errors is not None
    good = np.isfinite(lines.y) & np.isfinite(errors) & (errors > 0) & (f > 0)
    if f.size > 1:
        spacing = float(np.median(np.diff(f)))
        for mains in signals.MAINS_HZ:
            good &= np.abs(f - np.maximum(np.round(f / mains), 1) * mains) > SHARE_OF_SPACING * spacing
    return _averaged(lines.at(good))


def _averaged(lines: Series) -> Series:
    """Return weighted means over blocks of `BLOCK_HZ`; lines farther apart are unchanged."""
    f, errors = lines.x, lines.errors
    if errors is None or f.size < 2 or np.median(np.diff(f)) > 0.5 * BLOCK_HZ:
        return lines
    block = np.floor((f - f[0]) / BLOCK_HZ).astype(int)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    weights = errors**-2
    total = np.add.reduceat(weights, starts)
    real, imaginary = (np.add.reduceat(weights * part, starts) / total for part in (lines.y.real, lines.y.imag))
    centre = np.add.reduceat(weights * f, starts) / total
    return Series(centre, real + 1j * imaginary, total**-0.5, x_axis=lines.x_axis, y_axis=lines.y_axis)


def _loop_share(points: RunPoints, frequency_hz: Array) -> Complex | None:
    """Return the addition of a hysteresis of 1 at the lines of a sweep, (F,): its loops differ from a sine's at begin and turns.

    None, as under sines, for a long sweep, for a sweep in pieces, whose bands overlap, and for averaged lines.
    """
    from model.response import loop_share  # slow to import

    protocol, amplifier = points.read_protocol(), points.run.setup.amplifier_map
    assert isinstance(protocol, measurements.Sweep)
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


def sweep_frequencies(drive: Array, rate_hz: float) -> tuple[Array, Array] | None:
    """Return times (s) and frequencies (Hz) of a single sweep from its zero crossings; None for another drive."""
    centred = drive - 0.5 * (drive.max() + drive.min())
    at = np.flatnonzero(np.diff(np.signbit(centred)))
    if at.size < MIN_CROSSINGS:
        return None
    crossings = (at + centred[at] / (centred[at] - centred[at + 1])) / rate_hz
    # Whole cycles, so that an offset has no effect, averaged over five.
    cycles = crossings[2:] - crossings[:-2]
    time = 0.5 * (crossings[2:] + crossings[:-2])
    parts = max(cycles.size // 5, 8)
    time, f = (np.array([each.mean() for each in np.array_split(x, parts)]) for x in (time, 1 / cycles))
    order = np.argsort(np.argsort(f))
    monotony = float(np.corrcoef(order, np.arange(parts))[0, 1]) if np.ptp(order) else 0.0
    if abs(monotony) < MIN_MONOTONY or f.max() < MIN_FREQUENCY_RATIO * f.min():
        return None
    return time, f


def _series_run(series: ImportedSamples) -> RunOfSamples:
    """Return the run of one swept time series.

    Raises:
        TableImportError: there is no response, or the sweep is too short.
    """
    drive = np.asarray(series.drive_v)
    swept = sweep_frequencies(drive, series.rate_hz)
    assert swept is not None
    at, f = swept
    if series.elongation_m is not None:
        raise series.refusal(
            " is a sweep, and a run of a sweep has no elongation; omit --membrane-elongation if the tactor was free, "
            "else give a table of frequency and receptance"
        )
    low, high = float(np.percentile(f, 1)), float(np.percentile(f, 99))
    amplitude_v = 0.5 * float(np.ptp(drive))
    quality = Quality.IMPORTED | (Quality.SIMULATED if series.simulated else Quality.GOOD)
    try:
        response = signals.estimate_swept_response(
            drive, series.displacement_m, series.rate_hz, (low, high), delay_s=series.delay_s
        )
        measurements.check_response_present(response)
        point = measurements.sweep_point(1.0, response, amplitude_v, int(quality))
    except ValueError as error:
        raise series.refusal(f": {error}") from None
    warnings = [f"{series.name} is taken for one sweep from {f[0]:.4g} to {f[-1]:.4g} Hz"]
    bent = float(np.abs(f - np.polyval(np.polyfit(at, f, 1), at)).max()) / (high - low)
    if bent > LINEAR_TOLERANCE:
        warnings.append(
            f"the sweep's frequency does not rise or fall evenly (by {100 * bent:.2g} % of its band): lines are given only where it was slow"
        )
    stored = response, *series.as_series(series.name)
    return RunOfSamples(
        (series,), (point,), stored, {"peak_to_peak_v": 2 * amplitude_v}, tuple(warnings), has_phases=True
    )


ASPECTS = SweepAspects()
