"""Field types and quality flags that several protocols and point types share."""

from collections.abc import Mapping, Sequence
from typing import Annotated

from annotated_types import Interval, Unit

from protocols.base import Quality, Recording

SampleRate = Annotated[float, Unit("Hz"), Interval(ge=500, le=500_000), "scans per second"]
DriveVpp = Annotated[float, Unit("V"), Interval(gt=0, le=5), "drive at the amplifier's input, peak to peak around rest"]
LevelDuration = Annotated[float, Unit("s"), Interval(ge=0.5, le=60), "of every level that is read"]
FittedFrequency = Annotated[float, Unit("Hz"), "frequency, fitted to the recorded drive"]
NaturalFrequency = Annotated[float, Unit("Hz"), "undamped natural frequency"]
NaturalFrequencyError = Annotated[float, Unit("Hz"), "standard error of the natural frequency"]
DampingRatio = Annotated[float, Unit("1"), "damping ratio"]
DampingRatioError = Annotated[float, Unit("1"), "standard error of the damping ratio"]
RepeatNumber = Annotated[float, Unit("1"), "which repeat, from 1"]
QualityFlags = Annotated[int, Unit("1"), "flags, see protocols.quality"]


def point_quality(recordings: Sequence[Recording], simulated: bool, detected: Mapping[Quality, bool]) -> int:
    """Return the flags of a point: those of its recordings, `SIMULATED`, and the `detected` ones."""
    quality = Quality.SIMULATED if simulated else Quality.GOOD
    for recording in recordings:
        quality |= recording.quality
    for flag, present in detected.items():
        quality |= flag if present else Quality.GOOD
    return int(quality)
