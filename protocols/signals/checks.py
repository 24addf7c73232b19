"""Input checks of the estimators, and the coverage factor of an interval."""

import numpy as np
from numpy.typing import ArrayLike

from model import Array


def check_samples(name: str, samples: ArrayLike, min_size: int) -> Array:
    """One row of finite samples, (N,).

    Raises:
        ValueError: not one row, fewer than `least`, or not all finite.
    """
    x = np.asarray(samples, float)
    if x.ndim != 1:
        raise ValueError(f"{name} has {x.ndim} axes: give one row of samples")
    if x.size < min_size:
        raise ValueError(f"{name} has {x.size} samples, at least {min_size} are needed: record longer")
    if not np.isfinite(x.sum()):  # one pass without a mask; the count is only for the message
        bad = x.size - int(np.count_nonzero(np.isfinite(x)))
        raise ValueError(f"{name}: {bad} of {x.size} samples are not finite numbers; cut them away or measure again")
    return x


def check_positive(**values: float) -> None:
    """Reject a value that is not a positive finite number.

    Raises:
        ValueError: the value is not positive and finite; the message names it.
    """
    for name, value in values.items():
        if not (value > 0 and np.isfinite(value)):
            raise ValueError(f"{name} must be positive and finite, not {value}")


def check_pair(drive: ArrayLike, displacement: ArrayLike, min_size: int, rate_hz: float) -> tuple[Array, Array]:
    """Drive and displacement of the same scans, (N,) each.

    Raises:
        ValueError: they differ in length, have fewer than `least` samples, or one that is not a finite number.
    """
    check_positive(rate_hz=rate_hz)
    x, y = check_samples("the drive", drive, min_size), check_samples("the displacement", displacement, min_size)
    if x.size != y.size:
        raise ValueError(
            f"the drive has {x.size} samples and the displacement {y.size}: they must be of the same scans"
        )
    return x, y
