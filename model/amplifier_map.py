"""The high-voltage amplifier's static map, the only module of the model that drivers import.

The AMT2012-CE3 maps 0..2.5 V at its input to -500..0 V and 2.5..5 V to 0..1500 V (paper, Sec. II): two slopes that
meet at rest. A sine around rest therefore arrives distorted, and 0 V at the input is -500 V on the specimen.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from model.arrays import Array


@dataclass(frozen=True, slots=True)
class AmplifierMap:
    """Two straight lines through (rest_v, 0): `slope_below` for inputs below rest, `slope_above` above it.

    Raises:
        ValueError: a slope is not positive, or rest does not lie inside the input range.
    """

    rest_v: float = 2.5
    low_v: float = 0.0
    high_v: float = 5.0
    slope_below: float = 200.0
    slope_above: float = 600.0

    def __post_init__(self) -> None:
        if not (self.slope_below > 0 and self.slope_above > 0):
            raise ValueError(
                f"amplifier map: slopes must be positive, not {self.slope_below} and {self.slope_above} V/V"
            )
        if not self.low_v < self.rest_v < self.high_v:
            raise ValueError(
                f"amplifier map: rest {self.rest_v} V must lie inside the input range {self.low_v}..{self.high_v} V"
            )

    def specimen_v(self, input_v: ArrayLike) -> Array:
        """Return the volts on the specimen, of the shape of `input_v`, clipped where the amplifier clips."""
        u = np.clip(np.asarray(input_v, float), self.low_v, self.high_v) - self.rest_v
        return np.asarray(np.where(u < 0, self.slope_below * u, self.slope_above * u))

    def slope_at(self, input_v: ArrayLike) -> Array:
        """Return the slope at each input, V/V; at rest the mean of both."""
        u = np.asarray(input_v, float) - self.rest_v
        return np.asarray(
            np.where(
                u < 0, self.slope_below, np.where(u > 0, self.slope_above, (self.slope_below + self.slope_above) / 2)
            )
        )

    def input_v(self, specimen_v: ArrayLike) -> Array:
        """Return the volts at the input, of the shape of `specimen_v`: the inverse of `specimen_v` within the amplifier's range."""
        v = np.asarray(specimen_v, float)
        return self.rest_v + np.where(v < 0, v / self.slope_below, v / self.slope_above)
