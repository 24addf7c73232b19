"""Instrument drivers: the names that a driver plug-in imports (docs/how-to-write-a-driver.md).

Each is imported when it is first used, so that the package costs nothing at start-up.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drivers.clock import Clock, WallClock
    from drivers.drive import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, Steps
    from drivers.errors import AcquisitionError, BenchError, DriveRejectedError, InstrumentError, LinkError, UnsafeError
    from drivers.generators.arbitrary_waveform import SINE_CYCLE, Points, definite_length_block, render_waveform
    from drivers.generators.burst_generator import IDLE_AMPLITUDE_VPP, BurstGenerator
    from drivers.generators.expected_setting import ExpectedSetting, expect_keyword, expect_range, expect_value
    from drivers.generators.keysight_33200 import Keysight33200
    from drivers.generators.keysight_33500 import Keysight33500
    from drivers.generators.rigol_dg import RigolDg
    from drivers.generators.scpi_burst_generator import ScpiBurstGenerator
    from drivers.generators.siglent_sdg import SiglentSdg
    from drivers.generators.tektronix_afg import TektronixAfg
    from drivers.interfaces import Block, Digitizer, DriveChecker, Identity, Meter, Reading, Scale, Source, Stream
    from drivers.nidaq.analog_input import NiDigitizer
    from drivers.transport.safe_ramp_down import RampDown
    from drivers.transport.scpi import Link, ScpiSession

_MODULES = {
    "drivers.clock": "Clock WallClock",
    "drivers.drive": "Drive Hold LinearSweep PeriodicSweep Ramp Sine Steps",
    "drivers.errors": "AcquisitionError BenchError DriveRejectedError InstrumentError LinkError UnsafeError",
    "drivers.generators.arbitrary_waveform": "SINE_CYCLE Points definite_length_block render_waveform",
    "drivers.generators.burst_generator": "IDLE_AMPLITUDE_VPP BurstGenerator",
    "drivers.generators.expected_setting": "ExpectedSetting expect_keyword expect_range expect_value",
    "drivers.generators.keysight_33200": "Keysight33200",
    "drivers.generators.keysight_33500": "Keysight33500",
    "drivers.generators.rigol_dg": "RigolDg",
    "drivers.generators.scpi_burst_generator": "ScpiBurstGenerator",
    "drivers.generators.siglent_sdg": "SiglentSdg",
    "drivers.generators.tektronix_afg": "TektronixAfg",
    "drivers.interfaces": "Block Digitizer DriveChecker Identity Meter Reading Scale Source Stream",
    "drivers.nidaq.analog_input": "NiDigitizer",
    "drivers.transport.safe_ramp_down": "RampDown",
    "drivers.transport.scpi": "Link ScpiSession",
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = [
    "IDLE_AMPLITUDE_VPP",
    "SINE_CYCLE",
    "AcquisitionError",
    "BenchError",
    "Block",
    "BurstGenerator",
    "Clock",
    "Digitizer",
    "Drive",
    "DriveChecker",
    "DriveRejectedError",
    "ExpectedSetting",
    "Hold",
    "Identity",
    "InstrumentError",
    "Keysight33200",
    "Keysight33500",
    "LinearSweep",
    "Link",
    "LinkError",
    "Meter",
    "NiDigitizer",
    "PeriodicSweep",
    "Points",
    "Ramp",
    "RampDown",
    "Reading",
    "RigolDg",
    "Scale",
    "ScpiBurstGenerator",
    "ScpiSession",
    "SiglentSdg",
    "Sine",
    "Source",
    "Steps",
    "Stream",
    "TektronixAfg",
    "UnsafeError",
    "WallClock",
    "definite_length_block",
    "expect_keyword",
    "expect_range",
    "expect_value",
    "render_waveform",
]

if not TYPE_CHECKING:  # a checker would take any name for one of the package

    def __getattr__(name: str) -> Any:
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value
