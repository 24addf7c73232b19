"""Which simulated function generator a bench has: the model named in its truth, over the one `Generator`."""

from collections.abc import Callable
from typing import Protocol

from sim_hardware.generators.generator import Generator
from sim_hardware.generators.keysight_33200 import Keysight33200
from sim_hardware.generators.keysight_33500 import Keysight33500
from sim_hardware.generators.rigol_dg import RigolDg
from sim_hardware.generators.siglent_sdg import SiglentSdg
from sim_hardware.generators.tektronix_afg import TektronixAfg
from sim_hardware.plant.parameters import GENERATORS, GeneratorTruth
from sim_hardware.wires.scpi_engine import Instrument, ScpiError


class Box(Instrument, Protocol):
    """A model of a box, which may put errors into its engine's queue."""

    report: Callable[[ScpiError], None]


def box(truth: GeneratorTruth, core: Generator, now: Callable[[], float]) -> Box:
    """The model of the box that the truth names."""
    family = next(name for name in GENERATORS if truth.model.upper().startswith(name))
    maker = GENERATORS[family]
    identity = f"{maker},{truth.model},{truth.serial},{truth.firmware}"
    match maker.split()[0]:
        case "Keysight":
            return Keysight33500(core, now, identity)
        case "Agilent":
            return Keysight33200(core, now, identity)
        case "Rigol":
            return RigolDg(core, now, identity)
        case "TEKTRONIX":
            return TektronixAfg(core, now, identity, high_z=truth.high_z_by_hand)
        case _:
            return SiglentSdg(core, now, identity)
