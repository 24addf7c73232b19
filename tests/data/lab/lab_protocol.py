"""A lab's own protocol, written for version 0.1.0 of the program. Not to be adapted: see README.md."""

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval, Len, Unit

from drivers.drive import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, Steps
from drivers.errors import BenchError
from protocols.events import Status
from protocols.protocol import Protocol
from protocols.quality import Quality, usable
from protocols.signals.level import level
from protocols.signals.sine import fit_sine
from protocols.steps import (
    Answer,
    Ask,
    Await,
    Awaited,
    Detector,
    Note,
    Play,
    Prompt,
    Read,
    Record,
    Redo,
    Settle,
    Settled,
    Step,
)
from protocols.values import Array, Column, Curve, Estimate, Planned, Recording

ALSO_USED = (Answer, Array, BenchError, Detector, LinearSweep, PeriodicSweep, Ramp, Read, Status, Steps)
"""Other labs import these."""


@dataclass(frozen=True, slots=True)
class LabPoint:
    """One level held, and the answer to a small sine after it."""

    level: Annotated[float, Unit("V"), "mean of the recorded drive"]
    displacement: Annotated[float, Unit("m"), "mean displacement"]
    displacement_errors: Annotated[float, Unit("m"), "standard uncertainty of the mean"]
    sine: Annotated[float, Unit("m"), "amplitude under the sine"]
    quality: Annotated[int, Unit("1"), "flags, see protocols.quality"]

    @property
    def words(self) -> str:
        return f"{self.level:.3f} V: {1e6 * self.displacement:+.2f} ± {1e6 * self.displacement_errors:.2g} µm"


class Seen:
    """Sees at once whatever moves by more than a micrometre; a `Detector`."""

    def __init__(self) -> None:
        self.first: float | None = None

    def feed(self, drive_v: Any, displacement_m: Any) -> bool:
        if self.first is None and len(displacement_m):
            self.first = float(np.mean(displacement_m))
        return self.first is not None and bool(np.any(np.abs(displacement_m - self.first) > 1e-6))


class LabSteps(Protocol):
    """Held levels with a sine after each, questions before, and one more level at the end."""

    name: ClassVar[str] = "lab-steps"
    title: ClassVar[str] = "Lab steps"
    point_type: ClassVar[type] = LabPoint
    axes: ClassVar[tuple[str, str]] = ("level", "displacement")

    levels_v: Annotated[
        tuple[Annotated[float, Interval(ge=0, le=5)], ...], Unit("V"), Len(1, 50), "levels, in order"
    ] = (3.0, 4.0)
    mass_kg: Annotated[float, Unit("kg"), Interval(gt=0, le=0.5), "mass that is fixed in the cylinder"] = 2e-3
    sample_rate_hz: Annotated[float, Unit("Hz"), Interval(ge=500, le=250_000), "scans per second"] = 5000.0

    begun: ClassVar[list[float]] = []

    @property
    def meters(self) -> tuple[str, ...]:
        return ()

    def plan(self, rest_v: float) -> tuple[Planned, ...]:
        return tuple(self._entry(v, rest_v) for v in self.levels_v)

    def _entry(self, level_v: float, rest_v: float) -> Planned:
        fix = Prompt("fix-mass", "Fix the mass in the cylinder.", {"mass_kg": self.mass_kg}, hands_on=True)
        drives: tuple[Drive, ...] = (Hold(level_v, 60.0), Sine(100.0, 0.5, rest_v, 200))
        return Planned(f"{level_v:g} V", drives, 2.0, (level_v,), setup=fix, prompts=2)

    def more(self, points: Sequence[Any], rest_v: float) -> tuple[Planned, ...]:
        if len(points) > len(self.levels_v):
            return ()
        return (self._entry(round(sum(self.levels_v) / len(self.levels_v), 3), rest_v),)

    def measure(self, entry: Planned, rest_v: float) -> Generator[Step, Any, Redo | None]:
        hold, sine = entry.drives
        first = entry.key[0] not in self.begun
        self.begun.append(float(entry.key[0]))
        looked = yield Await(Prompt("look", "Does the laser meet the centre?", choices=("yes", "no")), Seen())
        assert isinstance(looked, Awaited)
        assert looked.seen or looked.words == "yes"
        answer = yield Ask(Prompt("look", "Is the room quiet?", choices=("quiet", "loud")))
        yield Note(f"the room: {answer}")
        yield Play(hold, 0.3)
        yield Record(0.5)
        settled = yield Settle(sine, 0.1, 0.05, 1.0)
        assert isinstance(settled, Settled)
        recording = yield Record(0.2)
        assert isinstance(recording, Recording)
        if first and entry.key[0] == self.levels_v[0]:
            return Redo.THIS
        return None

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> LabPoint:
        held, shaken = recordings[-2:]
        moved = level(held.displacement_m, held.rate_hz)
        fit = fit_sine(shaken.displacement_m, shaken.rate_hz, 100.0)
        quality = held.quality | shaken.quality | (Quality.SIMULATED if simulated else Quality.GOOD)
        return LabPoint(
            float(held.drive_v.mean()), moved.value, moved.standard_error, float(abs(fit.fundamental)), int(quality)
        )

    def curves(self, key: tuple[float | str, ...], recordings: Sequence[Recording]) -> tuple[Curve, ...]:
        held = recordings[-2]
        time_s = np.arange(len(held.drive_v)) / held.rate_hz
        columns = {
            "time": Column(time_s[::50], "s", "since the level was reached"),
            "displacement": Column(held.displacement_m[::50], "m", "displacement"),
        }
        return (Curve("creep", f"{float(key[0]):g} V", "time", "displacement", columns),)

    def remarks(self, points: Sequence[Any]) -> tuple[str, ...]:
        return ("the lab's own remark",) if len(points) >= 2 else ()

    def estimates(self, points: Iterable[Any]) -> tuple[Estimate, ...]:
        every = list(points)
        good = [p for p, fine in zip(every, usable([p.quality for p in every]), strict=True) if fine]
        if len(good) < 2:
            return ()
        slope = np.polyfit([p.level for p in good], [p.displacement for p in good], 1)[0]
        return (Estimate("displacement per volt", float(slope), 0.0, "m/V", "line through the held levels"),)
