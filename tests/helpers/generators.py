"""Function generators that have a driver, each with its simulated instrument, and the timeout of a broken connection."""

from functools import cache

from drivers.generators.burst import BurstGenerator
from drivers.generators.keysight import Keysight33200, Keysight33500
from drivers.generators.rigol import RigolDg, RigolDg800
from drivers.generators.siglent import SiglentSdg
from drivers.generators.tektronix import TektronixAfg
from drivers.transport.visa import VisaLink
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.parameters import SimulationParameters
from tests.helpers.simulated_bench import simulated

BOXES: dict[str, type[BurstGenerator]] = {
    "33511B": Keysight33500,
    "33220A": Keysight33200,
    "DG1032Z": RigolDg,
    "DG812": RigolDg800,
    "SDG1032X": SiglentSdg,
    "AFG3022C": TektronixAfg,
    "AFG1022": TektronixAfg,
}

IMPATIENT_S = 0.2
"""Timeout in seconds while a wire is broken on purpose: the answer will not come, however long the wait."""


@cache
def truth(model: str) -> SimulationParameters:
    return simulated(generator={"model": model}).simulation_parameters


def impatient_while_broken(link: VisaLink, bench: SimulatedBench, impatient_s: float = IMPATIENT_S) -> None:
    """Wait for an answer as long as a busy computer needs while the wire is whole, and briefly while it is broken."""
    patient_s = link.timeout_s

    def follow() -> None:
        broken = any(name.startswith("scpi-") for name in bench.faults.active_faults())
        link.timeout_s = impatient_s if broken else patient_s
        if link._session is not None:
            link._session.timeout = 1000 * link.timeout_s

    bench.add_fault_listener(follow)
