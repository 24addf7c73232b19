"""Resonance frequency and damping ratio from the points of a sine dwell."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from protocols.signals.mode import fit_mode
from protocols.values import Estimate

SOURCE = "complex fit of one mode and what higher modes leave to the fundamentals of this run"


def fit_resonance(points: Sequence[Any]) -> tuple[Estimate, ...]:
    """One resonant mode and what the modes above it leave, by least squares; see `fit_mode`.

    Args:
        points: with `frequency`, `fundamental`, `phase`, `drive_amplitude` (see SinePoint); all usable.

    Returns:
        Resonance frequency in hertz and damping ratio; empty where the points do not span a resonance.
    """
    f = np.array([p.frequency for p in points])
    response = np.array([p.fundamental / p.drive_amplitude * np.exp(1j * p.phase) for p in points])
    try:
        mode = fit_mode(f, response)
    except ValueError:
        return ()
    return (
        Estimate("resonance frequency", mode.natural_hz, mode.natural_error_hz, "Hz", SOURCE),
        Estimate("damping ratio", mode.damping_ratio, mode.damping_error, "1", SOURCE),
    )
