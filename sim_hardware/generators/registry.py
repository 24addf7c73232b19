"""Registry of simulated function generators: the model named in the simulation parameters."""

from collections.abc import Callable
from functools import partial
from typing import Protocol

from sim_hardware.generators.generator import SimulatedGenerator
from sim_hardware.generators.keysight_33200 import SimulatedKeysight33200
from sim_hardware.generators.keysight_33500 import SimulatedKeysight33500
from sim_hardware.generators.rigol_dg import SimulatedRigolDg
from sim_hardware.generators.rigol_dg800 import SimulatedRigolDg800
from sim_hardware.generators.siglent_sdg import SimulatedSiglentSdg
from sim_hardware.generators.tektronix_afg import SimulatedTektronixAfg
from sim_hardware.generators.traits import draw_traits
from sim_hardware.plant import GENERATOR_MAKERS, GeneratorParameters
from sim_hardware.wires.scpi_engine import ScpiError, ScpiInstrument


class GeneratorModel(ScpiInstrument, Protocol):
    """A simulated generator, which may put errors into its engine's queue."""

    queue_error: Callable[[ScpiError], None]


def make_generator(
    parameters: GeneratorParameters, generator: SimulatedGenerator, now: Callable[[], float], seed: int = 0
) -> GeneratorModel:
    """Return the simulated generator that the parameters name; its traits that are not known are drawn from the seed."""
    family = next(name for name in GENERATOR_MAKERS if parameters.model.upper().startswith(name))
    maker = GENERATOR_MAKERS[family]
    identity = f"{maker},{parameters.model},{parameters.serial},{parameters.firmware}"
    traits = draw_traits(parameters.model, seed, parameters.traits)
    generator.deviate(traits)
    models: dict[str, Callable[..., GeneratorModel]] = {
        "Keysight": SimulatedKeysight33500,
        "Agilent": SimulatedKeysight33200,
        "Picotest": SimulatedKeysight33200,
        "Rigol": SimulatedRigolDg if family == "DG10" else SimulatedRigolDg800,
        "TEKTRONIX": partial(SimulatedTektronixAfg, high_z=parameters.high_z_by_hand),
        "Siglent": partial(SimulatedSiglentSdg, seed=seed),
    }
    return models[maker.split()[0]](generator, now, identity, traits=traits)
