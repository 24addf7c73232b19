"""True admittance of a simulated specimen, from its parameters: dielectric with loss, leakage and bending."""

import numpy as np

from model import Array, Complex
from model.response import frequency_response
from sim_hardware.plant.creep import LAGS_PER_DECADE, REFERENCE_S, TIME_CONSTANTS_S
from sim_hardware.plant.parameters import SimulationParameters
from sim_hardware.plant.specimen_current import reciprocal_charge_c_per_m


def true_admittance(parameters: SimulationParameters, frequency_hz: Array) -> Complex:
    """Return the admittance of a connected specimen without creep and hysteresis of its bending, S, (F,)."""
    load, f = parameters.electrical, np.asarray(frequency_hz, float)
    jw = 2j * np.pi * f
    begin = np.log10(TIME_CONSTANTS_S[0]) - 0.5 / LAGS_PER_DECADE
    instant = 1 + load.loss_per_decade * (begin - np.log10(REFERENCE_S) - np.euler_gamma / np.log(10))
    lags = load.loss_per_decade / LAGS_PER_DECADE * (1 / (1 + np.multiply.outer(jw, TIME_CONSTANTS_S))).sum(axis=-1)
    c_per_m = load.coupling * load.bending * reciprocal_charge_c_per_m(parameters.tactor, parameters.modes)
    bent = c_per_m * load.bending * frequency_response(parameters.tactor, f, parameters.skin, parameters.modes)
    return np.asarray(jw * (load.capacitance_f * (instant + lags) + bent) + 1 / load.leakage_ohm)


def true_capacitance(parameters: SimulationParameters, frequency_hz: Array) -> Array:
    """Return the parallel capacitance, F, (F,)."""
    f = np.asarray(frequency_hz, float)
    return np.asarray(true_admittance(parameters, f).imag / (2 * np.pi * f))


def true_loss(parameters: SimulationParameters, frequency_hz: Array) -> Array:
    """Return the loss factor, (F,)."""
    y = true_admittance(parameters, frequency_hz)
    return np.asarray(y.real / y.imag)


def true_energy(parameters: SimulationParameters, frequency_hz: float, drive_vpp: float) -> float:
    """Return the energy per cycle under a sine around rest at the amplifier's input, J, its harmonics on the specimen included."""
    characteristic = parameters.amplifier.map
    turns = np.arange(4096) / 4096
    volts = characteristic.specimen_v(characteristic.rest_v + 0.5 * drive_vpp * np.sin(2 * np.pi * turns))
    amplitudes = 2 * np.abs(np.fft.rfft(volts))[1:17] / turns.size
    conductance = true_admittance(parameters, frequency_hz * np.arange(1, 17)).real
    return float(0.5 * np.sum(amplitudes**2 * conductance) / frequency_hz)
