"""Field types, quality flags and estimates that several protocols and point types share."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

from annotated_types import Interval, Unit

from model import QUANTITIES
from protocols.base import EstimatedQuantity, Quality, Recording

if TYPE_CHECKING:
    from protocols.signals import DecayFit, ModalFit

SampleRate = Annotated[float, Unit("Hz"), Interval(ge=500, le=500_000), "scans per second"]
DriveVpp = Annotated[float, Unit("V"), Interval(gt=0, le=5), QUANTITIES["peak_to_peak_v"].definition]
LevelDuration = Annotated[float, Unit("s"), Interval(ge=0.5, le=60), "duration of each recording"]
FittedFrequency = Annotated[float, Unit("Hz"), "frequency, fitted to the recorded drive"]
NaturalFrequency = Annotated[float, Unit("Hz"), QUANTITIES["natural_frequency"].definition]
NaturalFrequencyError = Annotated[float, Unit("Hz"), "standard error of the natural frequency"]
DampingRatio = Annotated[float, Unit("1"), QUANTITIES["damping_ratio"].definition]
DampingRatioError = Annotated[float, Unit("1"), "standard error of the damping ratio"]
RepeatNumber = Annotated[float, Unit("1"), "number of the repeat, from 1"]
QualityFlags = Annotated[int, Unit("1"), "quality flags (protocols.Quality)"]


def point_quality(recordings: Sequence[Recording], simulated: bool, detected: Mapping[Quality, bool]) -> int:
    """Return the flags of a point: the flags of its recordings, each judged as a whole, `SIMULATED`, and the `detected` ones."""
    from protocols.signals import judge_recording

    quality = Quality.SIMULATED if simulated else Quality.GOOD
    for recording in recordings:
        quality |= judge_recording(recording)
    for flag, present in detected.items():
        quality |= flag if present else Quality.GOOD
    return int(quality)


def modal_columns(mode: "ModalFit | DecayFit | None", by_noise: bool = False) -> dict[str, float]:
    """Return the columns of a fitted mode in a point, its errors of a `ModalFit` by noise alone if so wished; NaN without one."""
    errors = ("natural_noise_hz", "damping_noise") if by_noise else ("natural_error_hz", "damping_error")
    fields = ("natural_hz", errors[0], "damping_ratio", errors[1])
    columns = ("natural_frequency", "natural_frequency_errors", "damping", "damping_errors")
    return {column: getattr(mode, field, math.nan) for column, field in zip(columns, fields, strict=True)}


def check_sample_rate(sample_rate_hz: float, needed_hz: float, purpose: str) -> None:
    """Raise ValueError for a sample rate that is too low; `purpose` continues the message, e.g. `for loops at 250 Hz`."""
    if sample_rate_hz < needed_hz:
        raise ValueError(
            f"sample_rate_hz of {sample_rate_hz:g} Hz is too low {purpose}; at least {needed_hz:g} Hz is needed"
        )


def modal_estimates(
    natural_hz: float, natural_error_hz: float, damping: float, damping_error: float, source: str
) -> tuple[EstimatedQuantity, ...]:
    """Return natural frequency, damped frequency (where the mode oscillates) and damping ratio of a mode."""
    damped: tuple[EstimatedQuantity, ...] = ()
    if damping < 1:
        share = math.sqrt(1 - damping**2)
        error = math.hypot(share * natural_error_hz, natural_hz * damping / share * damping_error)
        damped = (EstimatedQuantity.listed("damped_frequency", share * natural_hz, error, source),)
    return (
        EstimatedQuantity.listed("natural_frequency", natural_hz, natural_error_hz, source),
        *damped,
        EstimatedQuantity.listed("damping_ratio", damping, damping_error, source),
    )
