"""Watchdog configuration, sent to the process as its first line (JSON)."""

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from drivers.bench import DriveLimits
from model import AmplifierMap


@dataclass(frozen=True, slots=True)
class WatchdogConfig:
    """Configuration with which the watchdog brings the source to rest without the program.

    Args:
        source: `module:Class` of the source's driver, called with (link, clock, **options).
        resource: VISA resource string of the source; empty for one without a link, called with (clock=clock, **options).
        timeout_s: longest wait for a reply of the source.
        baud: bits per second of a serial line.
        backend: the VISA library.
        options: keyword arguments of the driver.
        map: input range and rest level of the amplifier.
        limits: drive limits of the ramp to rest.
        speed: bench seconds per wall second of a simulated bench.
        time_file: file of the bench time shared by a simulated bench and its program, or empty.
        silence_s: longest silence of the run thread while live.
        own_connection: whether the source accepts a second connection in addition to the program's. If not, the watchdog kills a
            hung program before it connects.
        patience_s: duration of the retries.
        lock_key: key of the program's lock in the source itself, which the watchdog shares; empty if it has none.
        locks: lock files of the instruments; they stay locked until the watchdog has also ended.
        measured_stop_s: duration of Stop, from the commissioning record of the source; 0 if unknown.
        measured_reply_s: longest time from a message to its reply, from the same record; 0 if unknown.
    """

    source: str
    resource: str
    timeout_s: float
    baud: int = 9600
    backend: str = "@py"
    options: dict[str, Any] = field(default_factory=dict)
    map: AmplifierMap = field(default_factory=AmplifierMap)
    limits: DriveLimits = field(default_factory=DriveLimits)
    speed: float = 1.0
    time_file: str = ""
    silence_s: float = 0.4
    own_connection: bool = True
    patience_s: float = 30.0
    lock_key: str = ""
    locks: tuple[str, ...] = ()
    measured_stop_s: float = 0.0
    measured_reply_s: float = 0.0

    @property
    def longest_reply_s(self) -> float:
        """Longest wait of the program for a reply without counting as dead: the timeout, or the measured time if longer."""
        return max(self.timeout_s, self.measured_reply_s)

    def retry_time_s(self, assumed_s: float) -> float:
        """Return the duration of retries of a failed way to rest: long enough for a second attempt with the measured Stop."""
        return max(assumed_s, 2 * self.measured_stop_s)

    def as_line(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_line(cls, line: str) -> "WatchdogConfig":
        record = json.loads(line)
        return cls(**{**record, "map": AmplifierMap(**record["map"]), "limits": DriveLimits(**record["limits"])})
