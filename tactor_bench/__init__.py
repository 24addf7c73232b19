"""Public Python API of Tactor Bench for notebooks and scripts.

Example:
    >>> import tactor_bench as tb
    >>> print(f"{tb.response([160.0]).peak_to_peak[0] * 1e6:.0f} um")
    1116 um

Reading: `open_run`, `runs`. Model: `Tactor`, `Membrane`, `Skin`, `response`. Identification: `identify`, `calibration`.
Measuring: `connect`. All values are in SI units. What is imported takes time only when it is first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from tactor_bench._packages import import_own_packages

if TYPE_CHECKING:
    from app.identification.calibrations import CalibrationError
    from app.identification.observations import ObservationError
    from drivers.errors import BenchError, UnsafeError
    from model.amplifier_map import AmplifierMap
    from model.identification.calibration import Calibration
    from model.identification.fit_options import IdentificationError
    from model.parameter_spec import ParameterError
    from model.parameters import Membrane, Tactor
    from model.skin import Skin
    from protocols.base import Quality
    from protocols.runfile.open import RunReadError
    from tactor_bench._bench import BenchSession, RunFailedError, connect
    from tactor_bench._catalogue import CatalogueEntry, runs
    from tactor_bench._identification import Identification, calibration, identify
    from tactor_bench._model import Response, response
    from tactor_bench._run import MeasuredRun, Samples, open_run
    from tactor_bench._tables import CurveTable, EstimateTable, Points

__all__ = [
    "AmplifierMap",
    "BenchError",
    "BenchSession",
    "Calibration",
    "CalibrationError",
    "CatalogueEntry",
    "CurveTable",
    "EstimateTable",
    "Identification",
    "IdentificationError",
    "MeasuredRun",
    "Membrane",
    "ObservationError",
    "ParameterError",
    "Points",
    "Quality",
    "Response",
    "RunFailedError",
    "RunReadError",
    "Samples",
    "Skin",
    "Tactor",
    "UnsafeError",
    "calibration",
    "connect",
    "identify",
    "open_run",
    "response",
    "runs",
]

_MODULES = {
    "AmplifierMap": "model.amplifier_map",
    "BenchError": "drivers.errors",
    "BenchSession": "tactor_bench._bench",
    "Calibration": "model.identification.calibration",
    "CalibrationError": "app.identification.calibrations",
    "CatalogueEntry": "tactor_bench._catalogue",
    "CurveTable": "tactor_bench._tables",
    "EstimateTable": "tactor_bench._tables",
    "Identification": "tactor_bench._identification",
    "IdentificationError": "model.identification.fit_options",
    "MeasuredRun": "tactor_bench._run",
    "Membrane": "model.parameters",
    "ObservationError": "app.identification.observations",
    "ParameterError": "model.parameter_spec",
    "Points": "tactor_bench._tables",
    "Quality": "protocols.base",
    "Response": "tactor_bench._model",
    "RunReadError": "protocols.runfile.open",
    "RunFailedError": "tactor_bench._bench",
    "Samples": "tactor_bench._run",
    "Skin": "model.skin",
    "Tactor": "model.parameters",
    "UnsafeError": "drivers.errors",
    "calibration": "tactor_bench._identification",
    "connect": "tactor_bench._bench",
    "identify": "tactor_bench._identification",
    "open_run": "tactor_bench._run",
    "response": "tactor_bench._model",
    "runs": "tactor_bench._catalogue",
}
"""Module of each public name; imported on first use."""

import_own_packages()


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'tactor_bench' has no attribute {name!r}")
    value = globals()[name] = getattr(importlib.import_module(_MODULES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
