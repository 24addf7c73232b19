"""Age of the simulated specimen: cycles so far, and what they have done to the tactor and its capacitance."""

import numpy as np

from model import Array, Tactor
from sim_hardware.plant.parameters import NEW, AgeingParameters
from sim_hardware.plant.room import Room
from sim_hardware.plant.specimen_current import SpecimenCurrent
from sim_hardware.plant.voltage_history import VoltageHistory


class SpecimenAge:
    """The age at the last simulated step.

    Args:
        parameters: ageing of the specimen.
        history: volts at the amplifier's input, whose cycles are counted.
        room: temperature, by which the capacitance changes.
    """

    def __init__(self, parameters: AgeingParameters, history: VoltageHistory, room: Room) -> None:
        self._parameters, self._history, self._room = parameters, history, room
        history.counted_from_v = parameters.from_v
        self.value = NEW

    def reach(self, t: float, earlier_cycles: float, current: SpecimenCurrent | None) -> None:
        """Set the age at a time; the capacitance follows."""
        ageing = self._parameters
        if ageing.crack_cycles or ageing.wear_per_decade:
            self.value = ageing.age(earlier_cycles + self._history.cycles_until(t))
        if current is not None:
            current.age((1 - ageing.crack_capacitance * self.value[0]) * self._room.capacitance_share(t))

    def tactor(self, new: Tactor) -> Tactor:
        """Return a tactor at this age."""
        return self._parameters.aged(new, self.value)

    def displacement(self, displacement_m: Array) -> Array:
        """Return the displacement of an open crack, same shape: it is larger in one direction."""
        if not self.value[0]:
            return displacement_m
        return np.where(displacement_m < 0, 1 + self._parameters.crack_harmonics, 1.0) * displacement_m
