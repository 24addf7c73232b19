"""Slider specifications of the model parameters: label, display unit and range."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class SliderSpec:
    """One slider: label, display unit and range. The text field next to it accepts any admitted value."""

    name: str
    label: str
    unit: str
    factor: float
    """Displayed value per SI value."""
    low: float
    high: float
    log: bool = False

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
    "Skin": (
        SliderSpec("delta", "pre-stretch δ", "%", 1e2, 0.0, 0.1),
        SliderSpec("E_m", "Young modulus E_m", "MPa", 1e-6, 1e3, 1e9, True),
        SliderSpec("k_s", "stiffness k_s", "N/m^2", 1.0, 1.0, 1e7, True),
        SliderSpec("c_s", "damping c_s", "kg/(m s)", 1.0, 0.0, 6000.0),
    ),
    "Tactor": (
        SliderSpec("m_add", "added mass", "g", 1e3, 0.0, 20e-3),
        SliderSpec("c0", "damping c₀", "kg/(m s)", 1.0, 0.0, 1000.0),
        SliderSpec("k2", "stiffness k₂, with MFC", "N mm^2", 1e6, 2e-3, 3e-2, True),
        SliderSpec("mu", "moment per volt μ", "N mm/kV", 1e6, -4e-5, 0.0),
    ),
    "Lag of the MFC": (
        SliderSpec("hysteresis", "hysteresis", "%", 1e2, 0.0, 0.3),
        SliderSpec("creep", "creep a decade", "%", 1e2, 0.0, 0.05),
    ),
    "Clamp and geometry": (
        SliderSpec("L", "clamp to centre L", "mm", 1e3, 16e-3, 40e-3),
        SliderSpec("L1", "clamp to MFC L₁", "mm", 1e3, 1e-3, 14e-3),
        SliderSpec("L2", "clamp to cylinder L₂", "mm", 1e3, 9e-3, 21e-3),
        SliderSpec("clamp_flexibility", "flexibility of the clamp", "%", 1e2, 0.0, 0.2),
        SliderSpec("b_Al", "plate width", "mm", 1e3, 5e-3, 40e-3),
        SliderSpec("h_Al", "plate thickness", "mm", 1e3, 0.05e-3, 0.6e-3),
    ),
    "Materials": (
        SliderSpec("E_Al", "plate modulus E_Al", "GPa", 1e-9, 1e9, 220e9),
        SliderSpec("rho1", "mass per length ρ₁", "g/m", 1e3, 2e-3, 6e-2),
        SliderSpec("rho2", "the same with MFC ρ₂", "g/m", 1e3, 5e-3, 1e-1),
    ),
    "Membrane": (
        SliderSpec("L_m", "free length", "mm", 1e3, 30e-3, 400e-3),
        SliderSpec("b_m", "width", "mm", 1e3, 10e-3, 150e-3),
        SliderSpec("h_m", "thickness", "mm", 1e3, 0.2e-3, 5e-3),
        SliderSpec("c_s_0", "damping unstretched", "kg/(m s)", 1.0, 0.0, 1000.0),
        SliderSpec("c_s_delta", "damping per stretch", "kg/(m s)", 1.0, 0.0, 2e5),
        SliderSpec("contact_length", "contact length", "mm", 1e3, 1e-3, 30e-3),
    ),
}
SLIDERS: Mapping[str, SliderSpec] = {slider.name: slider for group in GROUPS.values() for slider in group}
