"""Predicted travel: displacement range of the model under the drives of a plan, without skin."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, SquareWave, Steps
from model import AmplifierMap, Array, Complex, Tactor
from model.response import amplifier_response, poles, samples_per_period, square_wave_response, voltage_gain
from protocols.base import PlanEntry

SWEEP_POINTS = 101
"""Number of frequencies of an evaluated sweep, which is slow enough to be quasi-stationary."""


@dataclass(frozen=True, slots=True)
class PredictedTravel:
    """Lowest and highest displacement from rest under one drive, m, and its label."""

    label: str
    low_m: float
    high_m: float


def predict_travel(
    planned_drives: Sequence[tuple[PlanEntry, Drive]], tactor: Tactor, amplifier: AmplifierMap
) -> Iterator[PredictedTravel]:
    """Yield the predicted displacement range of every drive; a mass of the set-up is on the tactor.

    Raises:
        ParameterError: the model rejects the tactor or frequency.
    """
    sines: dict[tuple[float, float, float], list[tuple[str, float]]] = {}
    for entry, drive in planned_drives:
        mass = entry.setup.values.get("mass_kg") if entry.setup and entry.setup.action == "fix-mass" else None
        loaded = tactor if mass is None else replace(tactor, m_add=mass)
        match drive:
            case Sine(f, a, offset_v, _):
                sines.setdefault((loaded.m_add, a, offset_v), []).append((entry.label, f))
            case LinearSweep(start, stop, _, a, offset_v) | PeriodicSweep(start, stop, _, _, a, offset_v):
                swept = np.linspace(start, stop, SWEEP_POINTS).tolist()
                sines.setdefault((loaded.m_add, a, offset_v), []).extend((entry.label, f) for f in swept)
            case Hold(level_v, _):  # the guard ramps to a level too slowly to excite a vibration
                moved = float(voltage_gain(loaded) * amplifier.specimen_v(level_v))
                yield PredictedTravel(entry.label, min(moved, 0.0), max(moved, 0.0))
            case SquareWave(f, a, offset_v, duty, edge_s, _):
                response = square_wave_response(loaded, f, a, offset_v, duty=duty, edge_s=edge_s, amplifier=amplifier)
                low, high = _range_of(response.harmonics)
                yield PredictedTravel(entry.label, float(low[0]), float(high[0]))
            case Ramp() | Steps():
                yield _step_travel(entry.label, drive, loaded, amplifier)
    for (mass, amplitude_v, offset_v), requests in sines.items():
        frequency = np.array([f for _, f in requests])
        low, high = _extremes(replace(tactor, m_add=mass), frequency, amplitude_v, offset_v, amplifier)
        for (label, f), at_low, at_high in zip(requests, low, high, strict=True):
            yield PredictedTravel(
                label if f"{f:g}" in label else f"{label} at {f:.0f} Hz", float(at_low), float(at_high)
            )


def _extremes(
    tactor: Tactor, frequency: Array, amplitude_v: float, offset_v: float, amplifier: AmplifierMap
) -> tuple[Array, Array]:
    """Return lowest and highest displacement of a period with all the amplifier's harmonics, each (F,)."""
    harmonics = amplifier_response(tactor, frequency, amplitude_v, offset_v, amplifier).harmonics
    return _range_of(harmonics)


def _range_of(harmonics: Complex) -> tuple[Array, Array]:
    """Return lowest and highest value of a period of each response, (F,), from its harmonics (F, K + 1)."""
    points = samples_per_period(harmonics.shape[1])
    spectrum = harmonics / 2j
    spectrum[:, 0] = harmonics[:, 0].real
    w = np.fft.irfft(spectrum, points, axis=1) * points
    return w.min(axis=1), w.max(axis=1)


def _step_travel(label: str, drive: Ramp | Steps, tactor: Tactor, amplifier: AmplifierMap) -> PredictedTravel:
    """Return the range of the levels and the overshoot of a rise shorter than half a resonance period."""
    levels_v = drive.levels_v if isinstance(drive, Steps) else (drive.start_v, drive.stop_v)
    rise_s = drive.rise_s if isinstance(drive, Steps) else drive.duration_s
    levels = voltage_gain(tactor) * amplifier.specimen_v(levels_v)
    first = poles(tactor)[0]
    zeta = float(-first.real / abs(first))
    rings = zeta < 1 and rise_s < math.pi / abs(first)
    overshoot = math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2)) if rings else 0.0
    reached = np.concatenate((levels, levels[1:] + overshoot * np.diff(levels)))
    return PredictedTravel(label, float(min(reached.min(), 0.0)), float(max(reached.max(), 0.0)))
