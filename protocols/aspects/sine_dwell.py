"""Aspects of the protocol `sine-dwell`; those of dwells under a membrane build on them."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from model import AmplifierMap, Array
from model.identification import FrequencyResponseObservation, Observation
from protocols.aspects.run_points import RunPoints
from protocols.base import Aspects, RunFigure
from protocols.runfile.overview import RunOverview

CARD_READBACK_MARGIN_V = 0.02
"""How far a recorded drive may lie beyond the amplifier's range."""


class SineDwellAspects(Aspects):
    """Sine dwell beside its measurement."""

    short_name = "dwell"

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        yield dwell_observation(points, points.label, None)

    def run_figures(self, run: RunOverview, estimates: Sequence[RunFigure]) -> Iterable[RunFigure]:
        """Yield the estimates, the largest max - min of the usable points, and its margin over the abdomen's threshold of perception."""
        from model.response import perception_margin  # slow to import

        yield from estimates
        if (top := run.largest) is None:
            return
        y, error, gain = top.peak_to_peak_m, top.error_m, run.sensor.gain_relative_uncertainty
        condition = f"{2 * top.median_drive_v:.2g} V"
        yield RunFigure.with_gain("largest max - min", y, error, "m", gain, condition)
        margin = float(perception_margin(np.array([top.frequency_hz]), np.array([y]))[0])
        error = margin * error / y if y else math.nan
        yield RunFigure.with_gain("margin at the largest", margin, error, "1", gain, condition)._replace(
            frequency_hz=top.frequency_hz
        )


def dwell_observation(points: RunPoints, label: str, elongation_m: float | None) -> FrequencyResponseObservation:
    """Return the response to sines, free or under a membrane."""
    columns, imported = points.columns, points.run.imported
    sine, width = (
        points.good & np.isfinite(columns[name]) & (columns[f"{name}_errors"] > 0)
        for name in ("fundamental", "peak_to_peak")
    )
    good = sine if sine.any() else width  # an imported table may have one of them only
    phase = columns["phase"]
    measured: dict[str, Any] = {}
    if sine.any():
        size, errors = columns["fundamental"], columns["fundamental_errors"]
        phase_errors = columns["phase_errors"]
        has_phase = np.isfinite(phase[good]).all()
        if imported and has_phase and (phase_errors[good] > 0).all():
            measured["phase_errors_rad"] = phase_errors
        elif not imported:  # the phase has the noise of the drive channel, too, which the ratio to the drive shares
            measured["harmonic_errors_m"] = errors
            errors = np.fmax(errors, size * phase_errors)
        measured |= {"fundamental_m": size * (np.exp(1j * phase) if has_phase else 1.0), "errors_m": errors}
    if width[good].all():
        measured["peak_to_peak_m"] = columns["peak_to_peak"]
        measured["peak_to_peak_errors_m"] = columns["peak_to_peak_errors"]
    if np.isfinite(columns["harmonics"]).any():
        measured["harmonics_m"] = columns["harmonics"]
    common = points.common_arguments("displacement", "delay", "volts")
    common["shared_errors"] += points.input_errors("frequency", "frequency", good, f"{label}, {{}} Hz")
    if elongation_m is not None:
        common["shared_errors"] += points.input_errors("elongation", "elongation", good, f"{label}, {{}} m")
    offset_v = columns["drive_offset"]
    return FrequencyResponseObservation(
        label,
        columns["frequency"],
        drive_amplitude_v=_within_range(columns["drive_amplitude"], offset_v, points.run.amplifier_map),
        drive_offset_v=offset_v,
        elongation_m=elongation_m,
        good=good,
        **measured,
        **common,
    )


def _within_range(amplitude_v: Array, offset_v: Array, amplifier: AmplifierMap) -> Array:
    """Return the recorded amplitudes: no admitted drive leaves the amplifier's range, so that a value beyond is the card's error."""
    room_v = np.minimum(offset_v - amplifier.low_v, amplifier.high_v - offset_v)
    return np.where(amplitude_v < room_v + CARD_READBACK_MARGIN_V, np.minimum(amplitude_v, room_v), amplitude_v)


ASPECTS = SineDwellAspects()
