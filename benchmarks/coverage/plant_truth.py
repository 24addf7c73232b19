"""True values of the numbers that the protocols report, from the parameters of a plant without creep, hysteresis and sides."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from model import Array, Complex, linear_young_modulus, sag, skin
from model.response import (
    damping_ratios,
    frequency_response,
    load_compliance,
    poles,
    square_wave_response,
    voltage_gain,
)
from model.response.harmonic_response import amplifier_response
from protocols.base import Protocol
from sim_hardware.plant.parameters import SimulationParameters
from tests.helpers.electrical.truth import true_capacitance, true_energy, true_loss
from tests.helpers.latency_truth import true_sine, true_step

Truth = dict[str, float]
PEAK_STEP_HZ = 0.1
PEAK_GRID_HZ = np.arange(100.0, 220.0, PEAK_STEP_HZ)


def true_values(protocol: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    """Return the true values by the name of a number; `point COLUMN #I` for the columns of points."""
    return TRUTHS[type(protocol).__name__](protocol, parameters, points)


def true_response(parameters: SimulationParameters, frequency_hz: Array, points: Sequence[Any]) -> Complex:
    """Return the response per volt at the amplifier's input, with the mass of the first point if it has one; (F,)."""
    tactor = replace(parameters.tactor, m_add=getattr(points[0], "mass", parameters.tactor.m_add))
    return _slope(parameters) * frequency_response(tactor, frequency_hz, n=parameters.modes)


def _mode(parameters: SimulationParameters, m_add: float | None = None) -> tuple[float, float]:
    """Return natural frequency and damping ratio of the first mode."""
    tactor = parameters.tactor if m_add is None else replace(parameters.tactor, m_add=m_add)
    s = poles(tactor, parameters.skin, parameters.modes)[:1]
    return float(np.abs(s[0])) / (2 * math.pi), float(damping_ratios(s)[0])


def _modal(parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    f, zeta = _mode(parameters)
    names = {
        "natural_frequency": f,
        "damped_frequency": f * math.sqrt(1 - zeta**2),
        "damping_ratio": zeta,
        "quality_factor": 0.5 / zeta,
        "decay_time": 1 / (2 * math.pi * f * zeta),
    }
    for i in range(len(points)):
        names |= {f"point natural_frequency #{i}": f, f"point damping #{i}": zeta}
    return names


def _slope(parameters: SimulationParameters) -> float:
    """Return the fundamental of the specimen's volts per volt of a sine about rest."""
    map_ = parameters.amplifier.map
    return 0.5 * (map_.slope_below + map_.slope_above)


def _peak_hz(parameters: SimulationParameters, m_add: float | None = None) -> float:
    tactor = parameters.tactor if m_add is None else replace(parameters.tactor, m_add=m_add)
    return _peak(tactor, parameters.modes)


@lru_cache
def _peak(tactor: Any, modes: int) -> float:
    modulus = np.abs(frequency_response(tactor, PEAK_GRID_HZ, n=modes))
    top = int(modulus.argmax())
    low, middle, high = modulus[top - 1 : top + 2]
    return float(PEAK_GRID_HZ[top] + 0.5 * PEAK_STEP_HZ * (low - high) / (low - 2 * middle + high))


def _static_loading(_: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    c = float(load_compliance(parameters.tactor))  # the plant adds the compliance of the shapes that it leaves out
    names = {f"compliance, {side}": c for side in ("MFC up", "aluminium up", "mean of both sides")}
    names |= {"side_difference": 0.0, "nonlinearity, MFC up": 0.0, "nonlinearity, aluminium up": 0.0}
    for i, p in enumerate(points):
        actual = parameters.beyond.actual_mass_kg(p.mass, parameters.seed) / p.mass
        names[f"point deflection #{i}"] = c * p.load * actual
        names[f"point load #{i}"] = p.load * actual
    return names


def _mass_resonance(_: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    names = {}
    for i, p in enumerate(points):
        (f, zeta), peak = _mode(parameters, p.mass), _peak_hz(parameters, p.mass)
        names |= {f"peak_frequency, {1e3 * p.mass:g} g": peak, f"point frequency #{i}": peak}
        names |= {f"point spectrum_peak #{i}": peak}
        names |= {f"point natural_frequency #{i}": f, f"point damping #{i}": zeta}
    return names


def _voltage_steps(_: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    gain, map_ = float(voltage_gain(parameters.tactor)), parameters.amplifier.map
    names = {
        "static_gain_above_rest": gain * map_.slope_above,
        "static_gain_below_rest": gain * map_.slope_below,
        "creep_per_decade": 0.0,
        "loop_width": 0.0,
        "zero_drift": 0.0,
    }
    for i, p in enumerate(points):
        names[f"point deflection #{i}"] = gain * float(map_.specimen_v(p.level))
        names[f"point creep #{i}"] = 0.0
    return names


def _free_mode(_: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    return _modal(parameters, points)


def _hysteresis(_: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    H = frequency_response(parameters.tactor, [0.01], n=parameters.modes)[0]
    static = float(voltage_gain(parameters.tactor))
    lag_s = -float(np.angle(H / np.sign(static))) / (2 * math.pi * 0.01)
    names = {"loop_hysteresis": 0.0, "loop_width_per_frequency": 2 * math.pi * lag_s}
    for i, p in enumerate(points):
        names[f"point share #{i}"] = 2 * math.pi * lag_s * p.frequency
        there = amplifier_response(
            parameters.tactor, [p.frequency], 2.5, 2.5, parameters.amplifier.map, n=parameters.modes
        )
        # At the extremes of the drive, not its own; even harmonics are equal there, and the slopes about rest make no odd ones.
        names[f"point stroke #{i}"] = 2 * abs(float(there.fundamental[0].real))
    return names


def _latency(_: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    names: Truth = {}
    for i, p in enumerate(points):
        truth = _onset(parameters.tactor, p.frequency, p.level, parameters.modes)
        onset = f"from the onset of {p.frequency:g} Hz" if p.frequency else f"after a step to {p.level:g} V"
        names |= {
            f"latency, 50 µm, {onset}": truth.latency,
            f"rise_time, {onset}": truth.rise,
            f"overshoot, {onset}": truth.overshoot,
            f"settling_time, {onset}": truth.settling,
        }
        for column in ("overshoot", "final"):  # the errors of a point's times lack the sensor's gain and delay
            names[f"point {column} #{i}"] = getattr(truth, column)
    return names


@lru_cache
def _onset(tactor: Any, frequency_hz: float, level_v: float, modes: int) -> Any:
    ideal = replace(SimulationParameters(), tactor=tactor, modes=modes)
    return true_sine(ideal, frequency_hz) if frequency_hz else true_step(ideal, level_v, before=2)


def _membrane_sag(_: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    true_m = sag(parameters.membrane).centre_m
    against_reference_m = true_m - parameters.hands.reference_m  # the errors of points exclude the reference's
    names = {f"point sag #{i}": against_reference_m for i in range(len(points))}
    linear = linear_young_modulus(parameters.membrane, true_m)
    return names | {"sag": true_m, "E_m": parameters.membrane.E_m, "linear_young_modulus": linear}


def _dwell(parameters: SimulationParameters, points: Sequence[Any], skins: Sequence[Any]) -> Truth:
    names: Truth = {}
    for i, (p, under) in enumerate(zip(points, skins, strict=True)):
        there = amplifier_response(
            parameters.tactor, [p.frequency], 2.5, 2.5, parameters.amplifier.map, under, n=parameters.modes
        )
        names |= {f"point fundamental #{i}": abs(there.fundamental[0]), f"point phase #{i}": float(there.phase[0])}
        names |= {f"point peak_to_peak #{i}": float(there.peak_to_peak[0])}
    return names


def _sine_dwell(_: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    names = _modal(parameters, ()) | {"peak_frequency": _peak_hz(parameters)}
    names |= _dwell(parameters, points, [None] * len(points))
    top = max(range(len(points)), key=lambda i: names[f"point peak_to_peak #{i}"])
    return names | {"amplitude_at_resonance": names[f"point peak_to_peak #{top}"]}


def _membrane_series(_: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    membrane, tactor = parameters.membrane, parameters.tactor
    skins = [
        None if math.isnan(p.elongation) else skin(membrane, p.elongation / membrane.L_m, tactor=tactor) for p in points
    ]
    return _dwell(parameters, points, skins) | {"free_response_drift": 0.0}


def _square_dwell(protocol: Any, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    names: Truth = {}
    half, map_, n = 0.5 * protocol.peak_to_peak_v, parameters.amplifier.map, parameters.modes
    for i, p in enumerate(points):
        square = square_wave_response(
            parameters.tactor, [p.frequency], half, 2.5, duty=protocol.duty, edge_s=protocol.edge_s, amplifier=map_, n=n
        )
        sine = amplifier_response(parameters.tactor, [p.frequency], half, 2.5, map_, n=n)
        wide, sine_wide = float(square.peak_to_peak[0]), float(sine.peak_to_peak[0])
        names |= {f"point peak_to_peak #{i}": wide, f"point sine_peak_to_peak #{i}": sine_wide}
        names |= {f"point ratio #{i}": wide / sine_wide, f"point fundamental #{i}": abs(square.fundamental[0])}
        names |= {f"point linearity #{i}": 1.0}
        names |= {f"point sine_fundamental #{i}": abs(sine.fundamental[0])}
    return names | {"square_wave_amplitude": max(names[f"point peak_to_peak #{i}"] for i in range(len(points)))}


def _electrical(_: Protocol, parameters: SimulationParameters, points: Sequence[Any]) -> Truth:
    names: Truth = {}
    for i, p in enumerate(points):
        if p.frequency:
            f = np.array([p.frequency])
            c, loss = float(true_capacitance(parameters, f)[0]), float(true_loss(parameters, f)[0])
            energy = true_energy(parameters, p.frequency, p.drive)
            names |= {f"point capacitance #{i}": c, f"point loss #{i}": loss, f"point energy #{i}": energy}
            where = f"20 Hz at {p.drive:g} V"
            if round(p.frequency) == 20:
                names |= {
                    f"capacitance, {where}": c,
                    f"loss_factor, {where}": loss,
                    f"energy_per_cycle, {where}": energy,
                }
    return names


TRUTHS: Mapping[str, Callable[[Any, SimulationParameters, Sequence[Any]], Truth]] = {
    "StaticLoading": _static_loading,
    "MassResonance": _mass_resonance,
    "VoltageSteps": _voltage_steps,
    "Sweep": _free_mode,
    "FreeDecay": _free_mode,
    "Hysteresis": _hysteresis,
    "OnsetLatency": _latency,
    "Electrical": _electrical,
    "Endurance": lambda *_: {},
    "MembraneSag": _membrane_sag,
    "SineDwell": _sine_dwell,
    "MembraneSeries": _membrane_series,
    "SquareDwell": _square_dwell,
}
