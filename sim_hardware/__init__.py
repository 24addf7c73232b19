"""Simulated instruments: the names with which a driver plug-in is tested (docs/how-to-write-a-driver.md).

Each is imported when it is first used, so that the package costs nothing at start-up.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim_hardware.bench import SimulatedBench
    from sim_hardware.clock import VirtualClock
    from sim_hardware.generators.scpi_generator import SimulatedScpiGenerator
    from sim_hardware.plant.parameters import (
        AmplifierParameters,
        CardParameters,
        GeneratorParameters,
        SensorParameters,
        SimulationParameters,
        SupplyParameters,
    )
    from sim_hardware.wires.scpi_engine import ScpiCommand

_MODULES = {
    "sim_hardware.bench": "SimulatedBench",
    "sim_hardware.clock": "VirtualClock",
    "sim_hardware.generators.scpi_generator": "SimulatedScpiGenerator",
    "sim_hardware.plant.parameters": "AmplifierParameters CardParameters GeneratorParameters SensorParameters SimulationParameters SupplyParameters",
    "sim_hardware.wires.scpi_engine": "ScpiCommand",
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = [
    "AmplifierParameters",
    "CardParameters",
    "GeneratorParameters",
    "ScpiCommand",
    "SensorParameters",
    "SimulatedBench",
    "SimulatedScpiGenerator",
    "SimulationParameters",
    "SupplyParameters",
    "VirtualClock",
]

if not TYPE_CHECKING:  # a checker would take any name for one of the package

    def __getattr__(name: str) -> Any:
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value
