"""State of the bench: its words, the lamps of its instruments, and the instruments' last answers."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from drivers import CardReading


class BenchState(StrEnum):
    """State of the bench in a word that can be read from two metres."""

    CONNECTING = "connecting"
    IDLE = "not armed"
    """The instruments answer; rest has not been measured yet."""
    ARMING = "arming"
    LIVE = "live"
    PAUSING = "pausing"
    """Live until the pause begins."""
    DRIVE_LOST = "drive lost"
    """The card sees another voltage at the amplifier's input than the drive, or than rest where rest is wanted."""
    PAUSED = "paused"
    """At measured rest, high voltage still on."""
    HV_OFF = "hv off"
    """Rest is measured and the operator has switched high voltage off: the specimen may be touched."""
    GOING_TO_REST = "going to rest"
    AT_REST = "at rest"
    UNSAFE = "unsafe"
    NO_BENCH = "no bench"


class Lamp(StrEnum):
    """Status of an instrument."""

    WAITING = "connecting"
    READY = "ready"
    SUSPECT = "see the message"
    MISSING = "not connected"


@dataclass(frozen=True, slots=True)
class InstrumentStatus:
    """One instrument of the status bar; `remark` is why it is suspect, empty where a message says it."""

    role: str
    identity: str
    lamp: Lamp
    remark: str = ""


@dataclass(frozen=True, slots=True)
class Observation:
    """What the instruments answered last: the card's reading, and by role the time (time.monotonic) of the last reply."""

    card: CardReading | None = None
    answered_s: Mapping[str, float] = field(default_factory=dict)


UNSEEN = Observation()
"""Before anything was answered."""
