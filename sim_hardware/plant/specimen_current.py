"""Current into the simulated specimen: dielectric charge with loss, leakage, and the charge of the bending; current monitor, sense capacitor.

The dielectric loss is that of a charge that creeps: a sum of lags gives the same loss factor at all frequencies.
"""

import numpy as np

from model import Array, Tactor
from model.response import system_matrices
from sim_hardware.plant.creep import CreepModel
from sim_hardware.plant.parameters import SimulationParameters
from sim_hardware.plant.stepper import linear_recursion


def reciprocal_charge_c_per_m(tactor: Tactor, shapes: int) -> float:
    """Return the charge at the electrodes per displacement of the centre, C/m, by reciprocity of the bending by a constant voltage.

    The work of the bending moment is the same in both directions: a moment of `mu` per volt gives a charge of `mu` per angle.
    """
    m = system_matrices(tactor, None, shapes)
    bent = np.linalg.solve(m.K, m.B)
    return float(m.B @ bent / (m.B_F @ bent))


class SpecimenCurrent:
    """Output of the current monitor, in amperes, and charge on a sense capacitor, on the plant's grid. A copy continues independently.

    Args:
        parameters: parameters of the bench.
        volts: volts on the specimen before the first step.
    """

    def __init__(self, parameters: SimulationParameters, volts: float = 0.0) -> None:
        load = parameters.electrical
        self._step_s = 1 / parameters.plant_rate_hz
        connected = load.electrodes not in ("open", "damaged")
        self._farads = self._new_farads = load.connected_f
        self._siemens = {"open": 0.0, "damaged": 1 / load.breakdown_ohm}.get(load.electrodes, 1 / load.leakage_ohm)
        reciprocal = reciprocal_charge_c_per_m(parameters.tactor, parameters.modes)
        self._c_per_m = load.coupling * load.bending * reciprocal if connected else 0.0
        self._dielectric = CreepModel(load.loss_per_decade if connected else 0.0, self._step_s)
        self._dielectric.advance(volts, 1e9)
        self._previous_v, self._previous_c, self._before_a = volts, np.nan, 0.0
        self._outputs = np.zeros(2)
        step = 2 * np.pi * parameters.amplifier.current_monitor_hz * self._step_s
        self._bleed_s, self._sense_f = load.sense_f * load.sense_ohm, load.sense_f
        self._advance, self._gain = (
            np.array([(2 - step) / (2 + step), np.exp(-self._step_s / self._bleed_s)]),
            step / (2 + step),
        )

    def __copy__(self) -> "SpecimenCurrent":
        other = object.__new__(type(self))
        vars(other).update(vars(self))
        dielectric = other._dielectric = object.__new__(CreepModel)
        vars(dielectric).update(vars(self._dielectric))
        return other

    def age(self, share: float) -> None:
        """Change the capacitance to a share of the new specimen's, without a step of the charge."""
        if self._farads != share * self._new_farads:
            self._farads, self._previous_c = share * self._new_farads, np.nan

    def process(self, volts: Array, displacement_m: Array) -> Array:
        """Return the outputs of whole blocks, (2, n): monitored current, A, the mean over the step before each grid point, and charge, C.

        The sense capacitor takes its share of the volts, and is emptied by its bleed resistor.

        Args:
            volts: volts at the electrodes, (n,).
            displacement_m: displacement of the centre with the MFC up, (n,).
        """
        charge = self._farads * self._dielectric.process(volts, self._previous_v) + self._c_per_m * displacement_m
        before = charge[0] if np.isnan(self._previous_c) else self._previous_c
        current = np.diff(charge, prepend=before) / self._step_s + self._siemens * volts
        self._previous_v, self._previous_c = float(volts[-1]), float(charge[-1])
        driven = self._gain * (current + np.concatenate(([self._before_a], current[:-1])))
        self._before_a = float(current[-1])
        sensed = self._step_s * self._sensed_share * current
        states = linear_recursion(self._advance, self._outputs, np.stack((driven, sensed), axis=1))
        self._outputs = states[-1].copy()
        return states[1:].T

    def advance(self, volts: float, gap_s: float) -> None:
        """Advance by an unobserved gap of constant volts; the current begins with the leakage."""
        self._dielectric.advance(volts, gap_s)
        leakage = self._siemens * volts
        held = self._bleed_s * leakage * self._sensed_share
        moved = self._outputs[1] + self._farads * self._sensed_share * (volts - self._previous_v)
        self._previous_v, self._previous_c, self._before_a = volts, np.nan, leakage
        self._outputs = np.array([leakage, held + (moved - held) * np.exp(-gap_s / self._bleed_s)])

    @property
    def _sensed_share(self) -> float:
        return 1 / (1 + self._farads / self._sense_f)
