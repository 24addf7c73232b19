"""Array types: floats, complex numbers, flags."""

import sys
from importlib.util import LazyLoader, find_spec, module_from_spec

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mask = NDArray[np.bool_]

for _name in ("f2py", "ma", "testing"):  # SciPy asks NumPy for each of its modules; these take as long to load as NumPy
    if f"numpy.{_name}" not in sys.modules and (_spec := find_spec(f"numpy.{_name}")) and _spec.loader:
        _spec.loader = LazyLoader(_spec.loader)
        _module = sys.modules[_spec.name] = module_from_spec(_spec)
        setattr(np, _name, _module)
        _spec.loader.exec_module(_module)
