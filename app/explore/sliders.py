"""Sliders of the model parameters: range and scale; name and unit come from the list of quantities."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from model import QUANTITIES


@dataclass(frozen=True, slots=True)
class SliderSpec:
    """One slider with its range. The text field next to it accepts any admitted value."""

    name: str
    low: float
    high: float
    log: bool = False

    @property
    def label(self) -> str:
        """Name of the quantity for people."""
        return QUANTITIES[self.name].name

    @property
    def unit(self) -> str:
        """Displayed unit."""
        return QUANTITIES[self.name].shown.unit

    @property
    def factor(self) -> float:
        """Displayed value per SI value."""
        return QUANTITIES[self.name].shown.factor

    def position(self, value: float) -> float:
        """Return the position of a value on the slider, clipped to 0..1."""
        a, b = self.low, self.high
        share = np.log(max(value, a) / a) / np.log(b / a) if self.log else (value - a) / (b - a)
        return float(np.clip(share, 0.0, 1.0))

    def value_at(self, position: float) -> float:
        """Return the value at a position, rounded to four significant figures."""
        a, b = self.low, self.high
        value = a * (b / a) ** position if self.log else a + (b - a) * position
        return float(f"{value:.4g}")

    def format_value(self, value: float) -> str:
        """Return the value in the display unit, without the unit."""
        return f"{value * self.factor:.5g}"


GROUPS: Mapping[str, Sequence[SliderSpec]] = {
    "Tactor": (
        SliderSpec("m_add", 0.0, 20e-3),
        SliderSpec("c0", 0.0, 1000.0),
        SliderSpec("k2", 2e-3, 3e-2, True),
        SliderSpec("mu", -4e-5, 0.0),
    ),
    "Lag of the MFC": (SliderSpec("hysteresis", 0.0, 0.3), SliderSpec("creep", 0.0, 0.05)),
    "Clamp and geometry": (
        SliderSpec("L", 16e-3, 40e-3),
        SliderSpec("L1", 1e-3, 14e-3),
        SliderSpec("L2", 9e-3, 21e-3),
        SliderSpec("clamp_flexibility", 0.0, 0.2),
        SliderSpec("b_Al", 5e-3, 40e-3),
        SliderSpec("h_Al", 0.05e-3, 0.6e-3),
    ),
    "Materials": (SliderSpec("E_Al", 1e9, 220e9), SliderSpec("rho1", 2e-3, 6e-2), SliderSpec("rho2", 5e-3, 1e-1)),
    "Skin": (
        SliderSpec("delta", 0.0, 0.1),
        SliderSpec("E_m", 1e3, 1e9, True),
        SliderSpec("k_s", 1.0, 1e7, True),
        SliderSpec("c_s", 0.0, 6000.0),
    ),
    "Membrane": (
        SliderSpec("L_m", 30e-3, 400e-3),
        SliderSpec("b_m", 10e-3, 150e-3),
        SliderSpec("h_m", 0.2e-3, 5e-3),
        SliderSpec("c_s_0", 0.0, 1000.0),
        SliderSpec("c_s_delta", 0.0, 2e5),
        SliderSpec("contact_length", 1e-3, 30e-3),
    ),
}
SLIDERS: Mapping[str, SliderSpec] = {slider.name: slider for group in GROUPS.values() for slider in group}
