"""True latency of a simulated plant: its noise-free motion under ideal steps and sines, evaluated on a fine grid."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from model import Array
from sim_hardware.plant.parameters import SimulationParameters
from sim_hardware.plant.plant import Plant
from sim_hardware.plant.segments import ConstantSegment, PeriodicSegment
from sim_hardware.plant.voltage_history import VoltageHistory

GRID_HZ = 1e6
SPAN_S = 0.1
"""How long each step lasts, as in the protocol by default."""
SPACING_S = 0.6
"""From the begin of a step to the next: a specimen that creeps recovers between them."""


class TrueLatency(NamedTuple):
    """Times in s, final value in m; see `protocols.measurements.latency`."""

    latency: float
    rise: float
    overshoot: float
    settling: float
    final: float


def true_step(
    parameters: SimulationParameters, level_v: float, before: int = 1, threshold_m: float = 50e-6
) -> TrueLatency:
    """Return what an ideal step from rest to `level_v` does, after `before` equal steps that condition the hysteresis."""
    history, plant = _plant(parameters)
    rest_v, first_s = parameters.amplifier.map.rest_v, 0.5
    for i in range(before + 1):
        history.append(first_s + i * SPACING_S, ConstantSegment(level_v))
        history.append(first_s + i * SPACING_S + SPAN_S, ConstantSegment(rest_v))
    begin_s = first_s + before * SPACING_S
    time, moved = _motion(plant, begin_s, SPAN_S - 1e-3)
    time = time + 0.5 / GRID_HZ  # the plant's step on the grid is half a grid step early
    final = float(moved[time > 0.8 * SPAN_S].mean())
    moved = moved * np.sign(final)
    final = abs(final)
    rise = _first(time, moved, 0.9 * final) - _first(time, moved, 0.1 * final)
    settling = _last(time, np.abs(moved - final), 0.02 * final)
    return TrueLatency(_first(time, moved, threshold_m), rise, float(moved.max()) / final - 1, settling, final)


def true_sine(parameters: SimulationParameters, frequency_hz: float, amplitude_v: float = 2.5) -> TrueLatency:
    """Return what a sine that begins at rest does, after an equal one that conditions the hysteresis."""
    history, plant = _plant(parameters)
    rest_v, first_s, span_s = parameters.amplifier.map.rest_v, 0.5, 0.2
    begin_s = first_s + SPACING_S
    for at_s in (first_s, begin_s):
        cycles = round(span_s * frequency_hz)
        history.append(at_s, PeriodicSegment(at_s, frequency_hz, amplitude_v, rest_v, 0.0, rest_v, cycles))
        history.append(at_s + span_s, ConstantSegment(rest_v))
    time, moved = _motion(plant, begin_s, span_s)
    # A period is no whole number of grid steps: the steady state is a Fourier series, fitted to the last fifth.
    turns = np.exp(2j * np.pi * frequency_hz * np.outer(time, np.arange(1, 21)))
    series = np.hstack([np.ones((time.size, 1)), turns.real, turns.imag])
    late = slice(-time.size // 5, None)
    steady = series @ np.linalg.lstsq(series[late], moved[late], rcond=None)[0]
    final = float(np.abs(steady).max())
    deviation = np.abs(moved - steady)
    deviation[time <= 0] = 0.0
    moved = np.abs(moved)
    return TrueLatency(
        _first(time, moved, 50e-6),
        _first(time, moved, 0.9 * final),
        float(moved.max()) / final - 1,
        _last(time, deviation, 0.02 * final),
        final,
    )


def _plant(parameters: SimulationParameters) -> tuple[VoltageHistory, Plant]:
    amplifier = replace(parameters.amplifier, slew_v_per_s=1e12, enabled=True)
    ideal = replace(parameters, plant_rate_hz=GRID_HZ, window_s=3.0, amplifier=amplifier)
    history = VoltageHistory(0.0)
    history.append(0.0, ConstantSegment(amplifier.map.rest_v))
    history.switch_high_voltage(0.1, hv=True)
    return history, Plant(ideal, history)


def _motion(plant: Plant, begin_s: float, span_s: float) -> tuple[Array, Array]:
    """Return times since the begin, and the motion against rest."""
    for watched_s in np.arange(0.4, begin_s - 0.02, 0.01):  # the plant skips what is not observed, with its hysteresis
        plant.displacement(np.array([watched_s]))
    time = np.arange(round(-0.01 * GRID_HZ), round(span_s * GRID_HZ)) / GRID_HZ
    moved = np.concatenate([plant.displacement(begin_s + part) for part in np.array_split(time, 8)])
    return time, moved - moved[: round(0.009 * GRID_HZ)].mean()


def _first(time: Array, moved: Array, level: float) -> float:
    above = np.flatnonzero(moved >= level)
    if not above.size:
        return float("nan")
    around = slice(above[0] - 1, above[0] + 1)
    return float(np.interp(level, moved[around], time[around]))


def _last(time: Array, deviation: Array, level: float) -> float:
    return float(time[np.flatnonzero((deviation > level) & (time > 0))[-1]])
