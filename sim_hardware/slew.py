"""The slew limit of a simulated amplifier."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def slewed(target: Array, start_v: float, step_v: float) -> Array:
    """`target` followed from `start_v` with at most `step_v` per sample; untouched where it is slow enough."""
    rises = target.copy()
    rises[1:] -= target[:-1]
    rises[0] -= start_v
    if rises.max() <= step_v and rises.min() >= -step_v:
        return target
    jumps = np.flatnonzero(np.abs(rises) > step_v)
    out, wanted = target.copy(), target.tolist()
    i, n = int(jumps[0]), target.size
    while True:
        at = float(out[i - 1]) if i else start_v
        while i < n and abs(wanted[i] - at) > step_v:
            at += math.copysign(step_v, wanted[i] - at)
            out[i] = at
            i += 1
        # Caught up: sample i is admissible; go on to the next one that is not.
        later = int(np.searchsorted(jumps, i, side="right"))
        if later >= jumps.size:
            return out
        i = int(jumps[later])
