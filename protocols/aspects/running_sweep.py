"""Frequency response of a running sweep, from its present samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers import LinearSweep, PeriodicSweep
from protocols import measurements, signals
from protocols.base import Aspects, Recording, Series

if TYPE_CHECKING:
    from protocols.signals import FrequencyResponse


class RunningSweepAspects(Aspects):
    """Aspects of a protocol with live curves of its sweeps."""

    live_drives = (PeriodicSweep, LinearSweep)

    def live_part(self, recording: Recording) -> FrequencyResponse | None:
        """Return the present response; None while the samples are insufficient."""
        drive, rate, delay_s = recording.drive, recording.rate_hz, recording.sensor_delay_s
        volts, metres = recording.drive_v, recording.displacement_m
        assert isinstance(drive, PeriodicSweep | LinearSweep)
        band = drive.start_hz, drive.stop_hz
        try:
            if isinstance(drive, LinearSweep):
                response = signals.estimate_swept_response(volts, metres, rate, band, delay_s=delay_s)
            else:
                # Samples before the drive belong to the dropped periods.
                used = round(_periods(recording, drive) * drive.period_s * rate)
                dropped = max(math.ceil(measurements.SETTLED_S / drive.period_s), 1)
                response = signals.estimate_periodic_response(
                    volts[-used:], metres[-used:], rate, drive.period_s, band, dropped, delay_s
                )
        except ValueError:
            return None
        return response if response.x.size else None

    def live_curve(self, parts: Sequence[FrequencyResponse], running: Recording) -> Series:
        """Return the present response of the entry; its axis has the whole band of the running sweep."""
        assert isinstance(running.drive, PeriodicSweep | LinearSweep)
        curve = replace(_joined(parts), label=_progress(running))
        return _over_the_band(curve, running.drive.start_hz, running.drive.stop_hz)


def _progress(recording: Recording) -> str:
    """Return the progress of the sweep as text."""
    drive = recording.drive
    if isinstance(drive, LinearSweep):
        share = min(recording.drive_v.size / recording.rate_hz / drive.duration_s, 1.0)
        return f"running, at {drive.start_hz + share * (drive.stop_hz - drive.start_hz):.0f} Hz"
    assert isinstance(drive, PeriodicSweep)
    return f"running, {min(_periods(recording, drive), drive.periods)} of {drive.periods} periods"


def _periods(recording: Recording, drive: PeriodicSweep) -> int:
    return int(recording.drive_v.size / recording.rate_hz / drive.period_s)


def _joined(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Return consecutive sweeps' responses as one, each up to the begin of the next."""
    parts = sorted(parts, key=lambda part: float(part.x[0]))
    starts = [float(part.x[0]) for part in parts[1:]]
    kept = [part.within(0.0, math.nextafter(start, 0.0)) for part, start in zip(parts, starts, strict=False)]
    return signals.concatenate_responses([*kept, parts[-1]])


def _over_the_band(curve: Series, *ends_hz: float) -> Series:
    """Return the curve with empty lines at the ends of the running sweep's band, so that its axis does not grow with it."""
    low, high = [end for end in ends_hz if end < curve.x[0]], [end for end in ends_hz if end > curve.x[-1]]
    padded: dict[str, Any] = {
        name: np.pad(values, (len(low), len(high)), constant_values=np.nan)
        for name in ("y", "errors", "coherence")
        if (values := getattr(curve, name)) is not None
    }
    return replace(curve, x=np.concatenate((low, curve.x, high)), **padded)
