"""Drive watch: compares each block of the card with the present drive, so that a lost drive is shown at once."""

from drivers import Drive, LinearSweep, PeriodicSweep, Sine

AWAY_FROM_REST_V = 0.25
"""A block closer to rest than this may be a pause between two drives."""

FLAT_SHARE = 0.05
"""A block that swings less than this share of the amplitude is no sine."""

LEAST_CYCLES = 0.25
"""Share of a cycle that a block must contain: a sine swings by more than a quarter of its amplitude then."""


class DriveWatch:
    """Detects blocks in which the amplifier's input does not follow the drive.

    Args:
        rest_v: rest level of the amplifier.
    """

    def __init__(self, rest_v: float) -> None:
        self._rest_v = rest_v
        self._drive: Drive | None = None
        self._last_range_v = self._range_v = (rest_v, rest_v)
        self._blocks = self._outside = 0
        self.lost = False

    def start_drive(self, drive: Drive) -> None:
        """Set the drive of the following blocks; the next block may contain its beginning."""
        self._drive, self._last_range_v, self._range_v = drive, self._range_v, (drive.low_v, drive.high_v)
        self._blocks = self._outside = 0

    def check_block(self, low_v: float, high_v: float, duration_s: float) -> bool:
        """Check the range of a block; return whether `lost` has changed."""
        self._blocks += 1
        if self._drive is None or self._blocks < 2:
            return False
        lost = self._is_flat(self._drive, low_v, high_v, duration_s) or self._stays_outside(low_v, high_v)
        changed, self.lost = lost != self.lost, lost
        return changed

    def _is_flat(self, drive: Drive, low_v: float, high_v: float, duration_s: float) -> bool:
        """Return whether a block of a sine or a sweep is a level away from rest."""
        match drive:
            case Sine(frequency_hz=slowest_hz):
                pass
            case LinearSweep(start_hz=start_hz, stop_hz=stop_hz) | PeriodicSweep(start_hz=start_hz, stop_hz=stop_hz):
                slowest_hz = min(start_hz, stop_hz)
            case _:
                return False
        away = min(abs(low_v - self._rest_v), abs(high_v - self._rest_v)) > AWAY_FROM_REST_V
        amplitude_v = (drive.high_v - drive.low_v) / 2
        return away and slowest_hz * duration_s >= LEAST_CYCLES and high_v - low_v < FLAT_SHARE * amplitude_v

    def _stays_outside(self, low_v: float, high_v: float) -> bool:
        """Return whether the second block in turn lies outside what this drive, the last one and rest span."""
        spans = (*self._last_range_v, *self._range_v, self._rest_v)
        outside = low_v > max(spans) + AWAY_FROM_REST_V or high_v < min(spans) - AWAY_FROM_REST_V
        self._outside = self._outside + 1 if outside else 0
        return self._outside > 1
