"""Field types that several protocols and point types share: unit, limits and description."""

from typing import Annotated

from annotated_types import Interval, Unit

SampleRate = Annotated[float, Unit("Hz"), Interval(ge=500, le=500_000), "scans per second"]
DriveVpp = Annotated[float, Unit("V"), Interval(gt=0, le=5), "drive at the amplifier's input, peak to peak around rest"]
LevelDuration = Annotated[float, Unit("s"), Interval(ge=0.5, le=60), "of every level that is read"]
FittedFrequency = Annotated[float, Unit("Hz"), "frequency, fitted to the recorded drive"]
RepeatNumber = Annotated[float, Unit("1"), "which repeat, from 1"]
QualityFlags = Annotated[int, Unit("1"), "flags, see protocols.quality"]
