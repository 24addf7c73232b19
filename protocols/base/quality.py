"""Quality flags of measured values in files, plots, fits and exports, with the remedies for unusable points."""

from collections.abc import Iterable
from enum import IntFlag
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from model import Mask


class Quality(IntFlag):
    """No flag means good. `SIMULATED` and `IMPORTED` are facts, not faults."""

    GOOD = 0
    CLIPPED = 1
    """The card's converter was at a rail."""
    UNSETTLED = 2
    """The response was still changing when recorded."""
    OUT_OF_RANGE = 4
    """The displacement sensor reported 'out of range'."""
    DROPPED = 8
    """Scans are missing inside the recording."""
    DRIVE_OFF = 16
    """The recorded drive differs from the commanded one."""
    SIMULATED = 32
    CALIBRATION_EXPIRED = 64
    """The displacement sensor's calibration had expired: a warning, the value stays usable."""
    SUPERSEDED = 128
    """The entry was measured again later; the later value counts."""
    NO_RESPONSE = 256
    """The response is less than 5 standard uncertainties."""
    IMPORTED = 512
    """Imported from a table, without raw samples. A fact, not a fault."""
    LEVEL_EXCEEDED = 1024
    """An abort level of the bench was exceeded in this entry: a warning, the value stays usable."""
    INTERFERENCE = 2048
    """Hum or another line measured at rest coincides with the point's frequency: its size is in the uncertainty."""
    FOLDED = 4096
    """The coinciding line lies above half the sample rate and is folded back: sample faster or at another rate, or filter."""
    DISTURBED = 8192
    """The sensor failed or was moved within the recording: it stuck, jumped, dropped out or was cut off, or its noise changed."""
    AIR_UNKNOWN = 16384
    """The bench has a sensor of the air, which gave no reading for this point."""
    FACTS = SIMULATED | CALIBRATION_EXPIRED | IMPORTED | LEVEL_EXCEEDED | INTERFERENCE | FOLDED | AIR_UNKNOWN
    """Flags of a usable value."""

    @property
    def description(self) -> str:
        """The flags as text, e.g. `unsettled, simulated`; `good` if there are none."""
        return ", ".join((flag.name or "").lower().replace("_", " ") for flag in self) or "good"

    @property
    def usable(self) -> bool:
        """Whether fits and summaries may use the value."""
        return not self & ~Quality.FACTS


def point_quality(point: Any) -> Quality:
    """Return the flags of a point; none if its type has no quality."""
    return Quality(int(getattr(point, "quality", 0)))


def usable_mask(flags: Iterable[float]) -> "Mask":
    """Return the mask of values that fits and summaries may use, by their stored flags; (N,)."""
    import numpy as np  # slow to import, and not needed for verdicts

    return np.array([Quality(int(each)).usable for each in flags], bool)


REMEDIES = {
    Quality.OUT_OF_RANGE: "check that the laser is on and bring the target into the sensor's range",
    Quality.NO_RESPONSE: "check that the tactor is under the sensor, and that high voltage is on",
    Quality.DRIVE_OFF: "check the cable from the generator to the amplifier and to the card",
    Quality.CLIPPED: "choose a larger range of the card, or less drive",
    Quality.DISTURBED: "look at the trace, check the sensor's cable, mount, target and range, and measure these points again",
    Quality.UNSETTLED: "allow more time to settle",
    Quality.DROPPED: "close other programs, or lower the sample rate",
}
"""Remedies for unusable points by flag, in the order in which causes mask each other."""


def remedy_for(flags: Iterable[Quality]) -> str:
    """Return the remedy for points with these flags: for the cause that masks the others."""
    together = Quality.GOOD
    for each in flags:
        together |= each
    other = "see the log for the reason, and measure these points again"
    return next((remedy for flag, remedy in REMEDIES.items() if flag & together), other)
