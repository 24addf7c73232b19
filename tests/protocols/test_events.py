"""Event kinds as stored and printed."""

from dataclasses import fields
from typing import get_args

from app.session.session import SessionEvent
from protocols.base import EVENTS, Event, events

IN_FILES = {
    "RunStarted",
    "StreamStarted",
    "Armed",
    "EntryBegan",
    "InterferenceMeasured",
    "BlockTaken",
    "BlockSeen",
    "CyclesInterrupted",
    "Playing",
    "SettleEnded",
    "Recorded",
    "PointMeasured",
    "SeriesReady",
    "Paused",
    "Resumed",
    "Progressed",
    "Asked",
    "Answered",
    "Noted",
    "FaultSwitched",
    "LevelExceeded",
    "DriveReadback",
    "GoingToRest",
    "MayBeLive",
    "Mounted",
    "AtRest",
    "RunEnded",
    "StopOffered",
    "StopRequested",
}
"""Text in run files, exports and `--json`: a name is never changed or used again, whatever its class is called."""


def test_kinds_in_files_never_change_and_every_event_has_its_own() -> None:
    assert set(EVENTS) == IN_FILES
    defined = (each for each in vars(events).values() if isinstance(each, type) and issubclass(each, Event))
    assert {each for each in defined if each is not Event} == set(EVENTS.values()), "no two have the same kind"


def test_every_event_of_a_session_has_a_kind_of_its_own() -> None:
    kinds = [*EVENTS, *(event.kind for event in get_args(SessionEvent) if event is not Event)]
    assert set(kinds) == IN_FILES | {
        "InstrumentAwaited",
        "BenchOpened",
        "BenchFailed",
        "Refused",
        "MonitorStarted",
        "BlockMonitored",
        "MonitorFailed",
    }
    assert len(kinds) == len(set(kinds))


def test_a_kind_is_no_field_so_that_no_record_of_an_event_holds_it() -> None:
    every = (*EVENTS.values(), *(event for event in get_args(SessionEvent) if event is not Event))
    assert all("kind" not in [field.name for field in fields(event)] for event in every)
