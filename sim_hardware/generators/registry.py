"""Registry of simulated function generators: the model named in the simulation parameters."""

from collections.abc import Callable
from typing import Protocol

from sim_hardware.generators.generator import SimulatedGenerator
from sim_hardware.generators.keysight_33200 import SimulatedKeysight33200
from sim_hardware.generators.keysight_33500 import SimulatedKeysight33500
from sim_hardware.generators.rigol_dg import SimulatedRigolDg
from sim_hardware.generators.siglent_sdg import SimulatedSiglentSdg
from sim_hardware.generators.tektronix_afg import SimulatedTektronixAfg
from sim_hardware.plant.parameters import GENERATOR_MAKERS, GeneratorParameters
from sim_hardware.wires.scpi_engine import ScpiError, ScpiInstrument


class GeneratorModel(ScpiInstrument, Protocol):
    """A simulated generator, which may put errors into its engine's queue."""

    queue_error: Callable[[ScpiError], None]


def make_generator(
    parameters: GeneratorParameters, generator: SimulatedGenerator, now: Callable[[], float]
) -> GeneratorModel:
    """Return the simulated generator that the parameters name."""
    family = next(name for name in GENERATOR_MAKERS if parameters.model.upper().startswith(name))
    maker = GENERATOR_MAKERS[family]
    identity = f"{maker},{parameters.model},{parameters.serial},{parameters.firmware}"
    match maker.split()[0]:
        case "Keysight":
            return SimulatedKeysight33500(generator, now, identity)
        case "Agilent":
            return SimulatedKeysight33200(generator, now, identity)
        case "Rigol":
            return SimulatedRigolDg(generator, now, identity)
        case "TEKTRONIX":
            return SimulatedTektronixAfg(generator, now, identity, high_z=parameters.high_z_by_hand)
        case _:
            return SimulatedSiglentSdg(generator, now, identity)
