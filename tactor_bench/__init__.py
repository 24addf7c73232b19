"""Public Python API of Tactor Bench for notebooks and scripts.

Example:
    >>> import tactor_bench as tb
    >>> print(f"{tb.response([160.0]).peak_to_peak[0] * 1e6:.0f} um")
    1113 um

Reading: `open_run`, `runs`. Model: `Tactor`, `Membrane`, `Skin`, `response`. Identification: `identify`, `calibration`.
Measuring: `connect`. All values are in SI units. Modules are imported when they are first used.
"""

import lazy_loader

from tactor_bench._packages import import_own_packages

import_own_packages()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
