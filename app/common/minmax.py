"""Min/max decimation: the smallest and largest value of each column, which draw like the whole signal."""

import numpy as np

from model import Array


def minmax_pairs(values: Array, samples_per_column: int) -> Array:
    """Return low, high, low, high ... of successive columns of `values`, (N,); the last column may be shorter."""
    edges = np.arange(0, values.size, samples_per_column)
    return np.stack((np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)), axis=1).ravel()


def minmax_decimate(x: Array, y: Array, samples_per_column: int) -> tuple[Array, Array]:
    """Return the min/max decimation of a curve: the first x of each column, twice, and its `minmax_pairs`."""
    return np.repeat(x[::samples_per_column], 2), minmax_pairs(y, samples_per_column)
