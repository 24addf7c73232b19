"""Protocol interface: steps, records, events, quality flags."""

from typing import TYPE_CHECKING, Any

from protocols.base.channels import ChannelCalibration
from protocols.base.event_bus import EventBus
from protocols.base.events import (
    EVENTS,
    BenchArmed,
    BlockDiscarded,
    BlockStored,
    CurveReady,
    DriveStarted,
    EntryStarted,
    Event,
    InjectedFaultChanged,
    LogMessage,
    PointMeasured,
    ProgressUpdated,
    PromptAnswered,
    PromptShown,
    RecordingFinished,
    RestMeasured,
    RunEnded,
    RunPaused,
    RunResumed,
    RunStarted,
    RunStatus,
    SettlingFinished,
    ShutdownStarted,
    StreamStarted,
    event_record,
)
from protocols.base.jsonable import to_jsonable
from protocols.base.operator import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE, Operator
from protocols.base.quality import Quality, usable_mask
from protocols.base.records import (
    MAX_RECORDING_SCANS,
    STREAMED_RECORDING_SCANS,
    Array,
    CurveColumn,
    EstimatedQuantity,
    PlanEntry,
    Recording,
    ResultCurve,
    StreamedRecording,
    recording_too_long_message,
)
from protocols.base.rounding import format_with_uncertainty
from protocols.base.steps import (
    Ask,
    DetectionResult,
    Detector,
    Log,
    Play,
    Prompt,
    ReadMeter,
    Record,
    Repeat,
    Settle,
    SettlingResult,
    Step,
    StepResult,
    WaitForDetection,
)

if TYPE_CHECKING:
    from protocols.base.protocol import Protocol, extend_plan

__all__ = [
    "DISABLE_HIGH_VOLTAGE",
    "ENABLE_HIGH_VOLTAGE",
    "EVENTS",
    "MAX_RECORDING_SCANS",
    "STREAMED_RECORDING_SCANS",
    "Array",
    "Ask",
    "BenchArmed",
    "BlockDiscarded",
    "BlockStored",
    "ChannelCalibration",
    "CurveColumn",
    "CurveReady",
    "DetectionResult",
    "Detector",
    "DriveStarted",
    "EntryStarted",
    "EstimatedQuantity",
    "Event",
    "EventBus",
    "InjectedFaultChanged",
    "Log",
    "LogMessage",
    "Operator",
    "PlanEntry",
    "Play",
    "PointMeasured",
    "ProgressUpdated",
    "Prompt",
    "PromptAnswered",
    "PromptShown",
    "Protocol",
    "Quality",
    "ReadMeter",
    "Record",
    "Recording",
    "RecordingFinished",
    "Repeat",
    "RestMeasured",
    "ResultCurve",
    "RunEnded",
    "RunPaused",
    "RunResumed",
    "RunStarted",
    "RunStatus",
    "Settle",
    "SettlingFinished",
    "SettlingResult",
    "ShutdownStarted",
    "Step",
    "StepResult",
    "StreamStarted",
    "StreamedRecording",
    "WaitForDetection",
    "event_record",
    "extend_plan",
    "format_with_uncertainty",
    "recording_too_long_message",
    "to_jsonable",
    "usable_mask",
]


def __getattr__(name: str) -> Any:
    """Import the protocol class when it is first used: pydantic is slow to load and most commands do without it."""
    if name in ("Protocol", "extend_plan"):
        from protocols.base import protocol

        return getattr(protocol, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
