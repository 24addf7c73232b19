"""What is wrong with a measured value, as flags that travel with it into files, plots, fits and exports."""

from collections.abc import Iterable
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from drivers.deprecated import renamed


@renamed(words="description")
class Quality(IntFlag):
    """No flag set means good. `SIMULATED` and `IMPORTED` are facts, not faults."""

    GOOD = 0
    CLIPPED = 1
    """The card's converter stood at a rail."""
    UNSETTLED = 2
    """The response still changed when it was recorded."""
    OUT_OF_RANGE = 4
    """The displacement sensor said 'out of range'."""
    DROPPED = 8
    """Scans are missing inside the recording."""
    DRIVE_OFF = 16
    """The drive read back is not the drive commanded."""
    SIMULATED = 32
    CALIBRATION_EXPIRED = 64
    """The displacement sensor's calibration was past its day: a warning, the value stays usable."""
    SUPERSEDED = 128
    """The same entry was measured again later; that value counts."""
    NO_RESPONSE = 256
    """What was measured lies within 5 standard uncertainties of nothing."""
    IMPORTED = 512
    """Taken over from somebody's table: no raw samples stand behind it here. A fact, not a fault."""

    @property
    def description(self) -> str:
        """The flags in words, e.g. `unsettled, simulated`; `good` where there are none."""
        return ", ".join((flag.name or "").lower().replace("_", " ") for flag in self) or "good"

    @property
    def usable(self) -> bool:
        """Whether fits and summaries may use the value."""
        return not self & ~(Quality.SIMULATED | Quality.CALIBRATION_EXPIRED | Quality.IMPORTED)


def usable_mask(flags: Iterable[float]) -> NDArray[np.bool_]:
    """Which of many values, told by their flags as a file keeps them, fits and summaries may use; (N,)."""
    return np.array([Quality(int(each)).usable for each in flags], bool)
