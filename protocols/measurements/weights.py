"""Weight classes: maximum permissible errors of calibrated weights (OIML R 111-1, Table 1)."""

import math
from typing import Literal, get_args

import numpy as np

WeightClass = Literal["F1", "F2", "M1", "M2", "M3", "own"]
"""`own`: the uncertainties are given, as in a calibration certificate."""

NOMINAL_KG = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
MAX_ERROR_MG = {
    "F1": (0.10, 0.12, 0.16, 0.20, 0.25, 0.3, 0.5, 1.0, 2.5, 5.0, 10.0),
    "F2": (0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.6, 3.0, 8.0, 16.0, 30.0),
    "M1": (1.0, 1.2, 1.6, 2.0, 2.5, 3.0, 5.0, 10.0, 25.0, 50.0, 100.0),
    "M2": (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 16.0, 30.0, 80.0, 160.0, 300.0),
    "M3": (10.0, 12.0, 16.0, 20.0, 25.0, 30.0, 50.0, 100.0, 250.0, 500.0, 1000.0),
}
"""Largest admissible error of a weight in use, by class and nominal mass."""

assert set(get_args(WeightClass)) == {*MAX_ERROR_MG, "own"}


def uncertainty_kg(mass_kg: float, weight_class: str) -> float:
    """Standard uncertainty of a weight of a class: its largest error as a rectangle; between nominal masses, a power law."""
    largest = np.interp(math.log(mass_kg), np.log(NOMINAL_KG), np.log(MAX_ERROR_MG[weight_class]))
    return 1e-6 * math.exp(float(largest)) / math.sqrt(3)
