"""What a watchdog is told when it is sent out: one line of JSON, the first that it reads."""

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from drivers.bench.amplifier import DriveLimits
from model.amplifier_map import AmplifierMap


@dataclass(frozen=True, slots=True)
class WatchdogConfig:
    """What the watchdog must know to do its work without the program.

    Args:
        source: `module:Class` of the source's driver, called with (link, clock, **options).
        resource: VISA resource string of the source; empty for one without a link, called with (clock=clock, **options).
        timeout_s: how long the source may take to answer.
        baud: of a serial line.
        speed: of a simulated bench, times real.
        silence_s: how long the run thread may say nothing while live.
        own_connection: whether the source takes a second connection beside the program's. Where it does not, the
            watchdog ends a program that hangs, and opens the wire then.
        patience_s: how long it goes on trying.
    """

    source: str
    resource: str
    timeout_s: float
    baud: int = 9600
    options: dict[str, Any] = field(default_factory=dict)
    map: AmplifierMap = field(default_factory=AmplifierMap)
    limits: DriveLimits = field(default_factory=DriveLimits)
    speed: float = 1.0
    silence_s: float = 0.4
    own_connection: bool = True
    patience_s: float = 30.0

    def as_line(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_line(cls, line: str) -> "WatchdogConfig":
        record = json.loads(line)
        return cls(**{**record, "map": AmplifierMap(**record["map"]), "limits": DriveLimits(**record["limits"])})
