"""A card's integers as physical units."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def converted(convert: Callable[[NDArray[np.int16]], Array], raw: NDArray[np.int16]) -> Array:
    """`convert(raw)`; of a long record through a table of all counts: the same numbers in half the time and less."""
    if raw.size < 1 << 18:
        return convert(raw)
    counts = np.arange(1 << 16, dtype=np.uint16)
    return np.asarray(convert(counts.view(np.int16))[raw.view(np.uint16)])
