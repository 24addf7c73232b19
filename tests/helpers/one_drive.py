"""Protocol file of the double faults: plays one drive of a chosen kind and records it until it is stopped."""

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Interval, Unit

from drivers import Hold, LinearSweep, Sine, Steps
from protocols import EstimatedQuantity, PlanEntry, Play, Protocol, Record, Recording

DRIVES = {
    "level": lambda s: Hold(4.0, s - 1.0),
    "ramp": lambda s: Hold(4.6, s - 1.0),
    "full": lambda s: Sine(160.0, 2.5, 2.5, int(160 * s)),
    "sine": lambda s: Sine(20.0, 1.5, 2.5, int(20 * s)),
    "sweep": lambda s: LinearSweep(10.0, 30.0, s, 1.5, 2.5, 0.1),
    "arbitrary": lambda s: Steps((2.5, 3.4, 4.0, 3.0, 2.0, 1.0, 1.6, 2.5), s / 8 - 0.1, 0.1),
}
"""Drives by name, each for so many seconds. A ramp is the way to a level, on a bench whose `ramp_v_per_s` is small."""


@dataclass(frozen=True, slots=True)
class Volts:
    """What was read back."""

    level: Annotated[float, Unit("V"), "mean of the drive"]
    highest: Annotated[float, Unit("V"), "highest of the drive"]
    quality: Annotated[int, Unit("1"), "flags, see protocols.Quality"] = 0


class OneDrive(Protocol):
    """One drive, recorded until it is stopped."""

    name = "one-drive"
    rest_record_s = 0.0
    title = "One drive"
    point_type = Volts
    axes = ("level", "highest")

    drive: Annotated[Literal["level", "ramp", "full", "sine", "sweep", "arbitrary"], "what is played"] = "level"
    drive_s: Annotated[float, Unit("s"), Interval(gt=2, le=600), "how long"] = 60.0
    sample_rate_hz: Annotated[float, Unit("Hz"), Interval(ge=500, le=5000), "scans per second"] = 1000.0

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        return (PlanEntry(self.drive, (DRIVES[self.drive](self.drive_s),), self.drive_s, (1.0,)),)

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Any, Any, None]:
        yield Play(entry.drives[0], 0.1)
        yield Record(self.drive_s - 1.5)

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> Volts:
        drive_v = recordings[-1].drive_v
        return Volts(float(drive_v.mean()), float(drive_v.max()))

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        return ()
