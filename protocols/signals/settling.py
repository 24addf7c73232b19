"""Settling detector: detects when the response to a sine has become steady."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from model import Array
from protocols.signals.sine import fit_sine


@dataclass
class SettlingDetector:
    """Detects when the response to a sine has become steady.

    Successive windows of whole cycles are fitted; the response is displacement over drive, a complex number, so that amplitude
    and phase are observed together and the source's phase cancels. It is steady when two successive changes are below
    `tolerance`, or below the changes by noise alone, and the drive is the commanded one.

    Args:
        window_samples: number of samples in a window.
        drive_amplitude_v: the commanded amplitude.
        tolerance: relative change of the response between windows.
    """

    rate_hz: float
    frequency_hz: float
    window_samples: int
    drive_amplitude_v: float
    tolerance: float
    drive_seen_v: float = 0.0
    """Recorded amplitude of the drive in the latest window."""

    _drive: Array = field(default_factory=lambda: np.empty(0))
    _displacement: Array = field(default_factory=lambda: np.empty(0))
    _responses: deque[complex] = field(default_factory=lambda: deque(maxlen=3))
    _noise: float = 0.0

    DRIVE_TOLERANCE = 0.05

    @property
    def drive_is_on(self) -> bool:
        """Whether the card sees the commanded drive to within 5 %."""
        return abs(self.drive_seen_v - self.drive_amplitude_v) <= self.DRIVE_TOLERANCE * self.drive_amplitude_v

    def feed(self, drive_v: Array, displacement: Array) -> bool:
        """Process more samples; return True for a steady response."""
        self._drive = np.concatenate([self._drive, drive_v])
        self._displacement = np.concatenate([self._displacement, displacement])
        while len(self._drive) >= self.window_samples:
            if self._window_is_steady():
                return True
            self._drive = self._drive[self.window_samples :]
            self._displacement = self._displacement[self.window_samples :]
        return False

    def _window_is_steady(self) -> bool:
        drive = fit_sine(self._drive[: self.window_samples], self.rate_hz, self.frequency_hz)
        response = fit_sine(self._displacement[: self.window_samples], self.rate_hz, self.frequency_hz, 3)
        self.drive_seen_v = abs(drive.fundamental)
        if not self.drive_is_on:
            self._responses.clear()
            return False
        self._responses.append(response.fundamental / drive.fundamental)
        if len(self._responses) < 3:
            return False
        first, second, third = self._responses
        # Noise alone makes two windows differ by sqrt(2) standard errors; a change is significant above three times that.
        allowed = max(self.tolerance * abs(third), 3 * 1.414 * response.standard_error / self.drive_seen_v)
        return abs(third - second) <= allowed and abs(second - first) <= allowed
