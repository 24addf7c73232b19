"""Measurement protocols: the names that a lab's protocol file imports (docs/how-to-write-a-protocol.md).

Each is imported when it is first used, so that the package costs nothing at start-up.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from protocols.base import (
        Array,
        Ask,
        CurveColumn,
        DetectionResult,
        Detector,
        EstimatedQuantity,
        Log,
        PlanEntry,
        Play,
        Prompt,
        Protocol,
        Quality,
        ReadMeter,
        Record,
        Recording,
        Repeat,
        ResultCurve,
        Settle,
        SettlingResult,
        Step,
        StepResult,
        WaitForDetection,
        usable_mask,
    )

_MODULES = {
    "protocols.base.protocol": "Protocol",
    "protocols.base.quality": "Quality usable_mask",
    "protocols.base.records": "Array CurveColumn EstimatedQuantity PlanEntry Recording ResultCurve",
    "protocols.base.steps": "Ask DetectionResult Detector Log Play Prompt ReadMeter Record Repeat Settle SettlingResult Step StepResult WaitForDetection",
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = [
    "Array",
    "Ask",
    "CurveColumn",
    "DetectionResult",
    "Detector",
    "EstimatedQuantity",
    "Log",
    "PlanEntry",
    "Play",
    "Prompt",
    "Protocol",
    "Quality",
    "ReadMeter",
    "Record",
    "Recording",
    "Repeat",
    "ResultCurve",
    "Settle",
    "SettlingResult",
    "Step",
    "StepResult",
    "WaitForDetection",
    "usable_mask",
]

if not TYPE_CHECKING:  # a checker would take any name for one of the package

    def __getattr__(name: str) -> Any:
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value
