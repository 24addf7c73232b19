"""One weight on one side of a tactor, from the three recordings of it: zero, weight on, zero again."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Unit

from drivers.drive import Hold
from drivers.rest import REST_TOLERANCE_V
from protocols.compliance import SIDES
from protocols.quality import Quality
from protocols.signals.level import Level
from protocols.values import Recording
from protocols.weights import grams


@dataclass(frozen=True, slots=True)
class LoadPoint:
    """One weight on one side. Errors are standard and statistical; the sensor's gain is common to all."""

    side: Annotated[float, Unit("1"), "1 with the MFC up, -1 with the aluminium up"]
    mass: Annotated[float, Unit("kg"), "mass of the weight, besides the offset"]
    repeat: Annotated[float, Unit("1"), "which repeat, from 1"]
    load: Annotated[float, Unit("N"), "its weight"]
    load_errors: Annotated[float, Unit("N"), "standard uncertainty of its weight; the same in every repeat"]
    deflection: Annotated[
        float, Unit("m"), "displacement under the weight against the mean of the zeros before and after"
    ]
    deflection_errors: Annotated[float, Unit("m"), "standard uncertainty of the deflection, the zero's move included"]
    zero_before: Annotated[float, Unit("m"), "displacement before, as the sensor tells it"]
    zero_after: Annotated[float, Unit("m"), "displacement after the weight was taken off"]
    drift: Annotated[float, Unit("m"), "zero after - zero before"]
    creep: Annotated[float, Unit("m/s"), "slope of the displacement under the weight, while it was read"]
    noise: Annotated[float, Unit("m"), "standard deviation of what line and mains leave under the weight"]
    quality: Annotated[int, Unit("1"), "flags, see protocols.quality"]

    @property
    def words(self) -> str:
        """The point in a line, for a log."""
        moved = f"deflection {1e6 * self.deflection:+.2f} ± {1e6 * self.deflection_errors:.2g} µm"
        return (
            f"{SIDES.get(self.side, 'either side')}, {grams(self.mass)} ({self.repeat:.0f}): {moved} under {self.load:.4f} N, "
            f"zero moved {1e6 * self.drift:+.2f} µm"
        )


def load_point(
    key: Sequence[float],
    recordings: Sequence[Recording],
    read: Callable[[Recording], Level],
    load_n: tuple[float, float],
    zero_limit_m: float,
    simulated: bool,
) -> LoadPoint:
    """The point of one weight; the last three recordings count.

    Args:
        key: side (1: MFC up, -1: aluminium up), mass in kg, which repeat.
        recordings: what was recorded for it.
        read: the level of a recording.
        load_n: the weight's force and its standard uncertainty.
        zero_limit_m: a zero that moved further makes the point unsettled.
        simulated: whether the bench was.

    Raises:
        ValueError: there are fewer than three recordings.
    """
    side, mass_kg, repeat = key
    if len(recordings) < 3:
        raise ValueError("a weight needs three recordings: zero, weight on, zero again")
    parts = recordings[-3:]
    before, under, after = (read(part) for part in parts)
    drift = after.value - before.value
    deflection = under.value - (before.value + after.value) / 2
    zero_error = math.hypot(before.standard_error, after.standard_error) / 2
    # When the zero moved in between nobody knows: anywhere from one to the other, a rectangle.
    error = math.hypot(under.standard_error, zero_error, drift / math.sqrt(12))
    quality = Quality.SIMULATED if simulated else Quality.GOOD
    for part in parts:
        quality |= part.quality
        if isinstance(part.drive, Hold) and abs(float(part.drive_v.mean()) - part.drive.level_v) > REST_TOLERANCE_V:
            quality |= Quality.DRIVE_OFF
    if abs(drift) > zero_limit_m:
        quality |= Quality.UNSETTLED
    if abs(deflection) <= 5 * error:
        quality |= Quality.NO_RESPONSE
    load, load_error = load_n
    return LoadPoint(
        side=side,
        mass=mass_kg,
        repeat=repeat,
        load=load,
        load_errors=load_error,
        deflection=deflection,
        deflection_errors=error,
        zero_before=before.value,
        zero_after=after.value,
        drift=drift,
        creep=under.drift_per_s,
        noise=under.noise,
        quality=int(quality),
    )
