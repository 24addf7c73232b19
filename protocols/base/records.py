"""Records of a run: its conditions, plan entry, recording, series."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np

from drivers import Drive
from model import Array as Array
from model import EstimatedQuantity as EstimatedQuantity
from model import Role as Role
from model import Series as Series
from model import SeriesAxis as SeriesAxis
from protocols.base.channels import FurtherInputs
from protocols.base.quality import Quality
from protocols.base.steps import Prompt

MAX_RECORDING_SCANS = 50_000_000
"""Largest recording whose analysis holds it in memory: a gigabyte."""

PART_SCANS = 4_000_000
"""Number of scans analysed together in an analysis by parts: a hundred megabytes."""

SIGNIFICANT_LINE_SIGMAS = 5.0
"""Standard uncertainties above which an interference line is significant."""

STREAMED_RECORDING_SCANS = 1 << 15
"""Number of scans above which a recording stays in the run file."""


SAMPLES = ("drive_v", "displacement_m")


def recording_too_long_message(scans: float) -> str:
    """Return the error message for a recording that is too long."""
    return (
        f"a recording of {scans / 1e6:.0f} million scans does not fit into memory (limit {MAX_RECORDING_SCANS / 1e6:.0f} million); "
        "record for a shorter time or lower sample_rate_hz"
    )


@dataclass(frozen=True, slots=True)
class RunConditions:
    """Operator, and the air in the laboratory.

    Attributes:
        operator: name of the operator; empty if unknown.
        operator_origin: origin of the name, e.g. `given` or `login of the computer`.
        temperature_c: air temperature, degrees Celsius; None if unknown.
        humidity: relative humidity of the air, 0 to 1; None if unknown.
        origin: origin of both: a sensor's identity, or the time of typing.
    """

    operator: str = ""
    operator_origin: str = ""
    temperature_c: float | None = None
    humidity: float | None = None
    origin: str = ""

    @property
    def air_text(self) -> str:
        """Temperature and humidity as text with their origin; empty without both."""
        parts = [
            "" if self.temperature_c is None else f"{self.temperature_c:.1f} °C",
            "" if self.humidity is None else f"{100 * self.humidity:.0f} % relative humidity",
        ]
        text = ", ".join(filter(None, parts))
        return f"{text} ({self.origin})" if text and self.origin else text


@dataclass(frozen=True, slots=True)
class InterferenceLine:
    """A spectral line of the displacement at rest: hum of the mains, or another oscillation independent of the drive.

    Attributes:
        frequency_hz: frequency after sampling.
        amplitude_m: peak amplitude, less the share of the noise.
        error_m: standard uncertainty of the amplitude.
        frequency_error_hz: standard uncertainty of the frequency; NaN if not measured: a harmonic of the mains within noise.
        folded_from_hz: true frequency of a line above half the sample rate; NaN for other lines.
        phase_rad: phase of its sine at the first sample of the recording at rest.
    """

    frequency_hz: float
    amplitude_m: float
    error_m: float
    frequency_error_hz: float = math.nan
    folded_from_hz: float = math.nan
    phase_rad: float = math.nan

    @property
    def significant(self) -> bool:
        """Whether the amplitude is significant."""
        return self.amplitude_m > SIGNIFICANT_LINE_SIGMAS * self.error_m

    @property
    def folded(self) -> bool:
        """Whether its true frequency lies above half the sample rate."""
        return math.isfinite(self.folded_from_hz)


@dataclass(frozen=True, slots=True)
class CycleStatistics:
    """Displacement of a block of cycles, from all its samples that were read and are valid; NaN without any.

    Attributes:
        cycles: number of cycles driven.
        scans: number of samples.
        square_m2: mean of the squares, m^2.
    """

    cycles: int = 0
    scans: int = 0
    low_m: float = math.nan
    high_m: float = math.nan
    mean_m: float = math.nan
    square_m2: float = math.nan

    def with_samples(self, displacement_m: Array) -> "CycleStatistics":
        """Return the statistics with further samples, (samples,)."""
        size, scans = displacement_m.size, self.scans + displacement_m.size
        sums = [float(displacement_m.sum()), float(displacement_m @ displacement_m)]
        if self.scans:
            sums = [sums[0] + self.scans * self.mean_m, sums[1] + self.scans * self.square_m2]
        if not size:
            return self
        low, high = float(displacement_m.min()), float(displacement_m.max())
        return CycleStatistics(
            self.cycles, scans, float(np.fmin(low, self.low_m)), float(np.fmax(high, self.high_m)), sums[0] / scans, sums[1] / scans
        )  # fmt: skip

    @property
    def rms_m(self) -> float:
        """Root mean square about the mean."""
        return math.sqrt(max(self.square_m2 - self.mean_m**2, 0.0)) if self.scans else math.nan

    @classmethod
    def from_record(cls, record: Mapping[str, float | None]) -> "CycleStatistics":
        """Return the statistics that an event in a run file has as a JSON object."""
        values = {name: math.nan if value is None else value for name, value in record.items()}
        return cls(int(values.pop("cycles")), int(values.pop("scans")), **values)


@dataclass(frozen=True, slots=True)
class Recording:
    """Samples recorded under one drive, in SI units, and their quality.

    `rows` are the first and one past the last row of the run file's raw data. `drive_v` is at the amplifier's input,
    `displacement_m` the tactor's centre as measured by the sensor, both (samples,). `sensor_delay_s` is the delay of the
    displacement against the drive: the sensor's delay less the time between the card's conversions of the two.
    """

    index: int
    rows: tuple[int, int]
    rate_hz: float
    drive: Drive
    drive_v: Array
    displacement_m: Array
    quality: Quality
    sensor_delay_s: float = 0.0
    entry: int = 0
    """Its entry of the plan."""
    interference: tuple[InterferenceLine, ...] = ()
    """Lines of the displacement, measured at rest before the first drive."""
    start_s: float = 0.0
    """Time of the first sample since the begin of the stream."""
    rest_noise_m: float = math.nan
    """Noise of the displacement at rest before the first drive, by the errors of its prediction; NaN if not measured."""
    rested_s: float = math.nan
    """Time at which the drive before this one, such as rest, was reached, since the begin of the stream; read from a file, the value of its point."""
    inputs: FurtherInputs | None = None
    """Further inputs of the card; None for a recording of imported samples."""
    velocity_corner_hz: float | None = None
    """Corner of the high pass of a vibrometer, whose velocity, in m/s, stands for the displacement; None for a displacement."""
    cycles: CycleStatistics | None = None
    """Statistics of a block of cycles (`Cycle`), of which the samples are a part; None for other recordings, and in a file."""
    air: Mapping[str, float] = field(default_factory=dict)
    """Air temperature and humidity, by point column; read from a file, the values of the entry. Empty if the bench has no air sensor."""

    def parts(self, longest: int = PART_SCANS) -> "tuple[Recording, ...]":
        """Return the recording in parts of about equal length, of `longest` scans at most."""
        first, stop = self.rows
        count = math.ceil((stop - first) / longest)
        if count < 2:
            return (self,)
        ends = [first + at * (stop - first) // count for at in range(count + 1)]
        return tuple(self._part(rows) for rows in pairwise(ends))

    def _part(self, rows: tuple[int, int]) -> "Recording":
        here = slice(rows[0] - self.rows[0], rows[1] - self.rows[0])
        start_s = self.start_s + here.start / self.rate_hz
        return replace(
            self, rows=rows, start_s=start_s, drive_v=self.drive_v[here], displacement_m=self.displacement_m[here]
        )


class StreamedRecording(Recording):
    """A recording whose samples are read from the run file at each access, so that a long entry needs no memory.

    Args:
        read_channel: function that returns the samples of a channel in rows of the run file, SI, (samples,): drive for True,
            displacement for False.
        values: the other fields.
    """

    __slots__ = ("_read",)
    _read: Callable[[tuple[int, int], bool], Array]

    def __init__(self, read_channel: Callable[[tuple[int, int], bool], Array], **values: Any) -> None:
        for name, value in {"cycles": None, "velocity_corner_hz": None, **values, "_read": read_channel}.items():
            object.__setattr__(self, name, value)

    @property
    def drive_v(self) -> Array:
        """(samples,), volts at the amplifier's input."""
        return self._read(self.rows, True)

    @property
    def displacement_m(self) -> Array:
        """(samples,), metres as measured by the sensor."""
        return self._read(self.rows, False)

    def _part(self, rows: tuple[int, int]) -> "Recording":
        kept = {each.name: getattr(self, each.name) for each in fields(self) if each.name not in SAMPLES}
        start_s = self.start_s + (rows[0] - self.rows[0]) / self.rate_hz
        return StreamedRecording(self._read, **kept | {"rows": rows, "start_s": start_s})


@dataclass(frozen=True, slots=True)
class PlanEntry:
    """One entry of a protocol's plan: gives one point and is measured completely or not at all.

    Attributes:
        label: short description.
        drives: all drives of the entry; empty if nothing moves.
        expected_s: approximate duration without the operator's time.
        key: identifies the entry by plain values: a frequency, a mass, a repeat. Stored in the file.
        setup: set-up by the operator; prompted if it differs from the previous entry's.
        prompts: number of further prompts.
        stored_s: duration of its stored samples, if they are fewer than those of its whole duration.
    """

    label: str
    drives: tuple[Drive, ...]
    expected_s: float
    key: tuple[float | str, ...] = ()
    setup: Prompt | None = None
    prompts: int = 0
    stored_s: float | None = None
