"""Which values of a run a fit compares with the model's, and the same run with the model's in their place."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.identification.observations import FrequencyResponse, MassResonance, Observation

Array = NDArray[np.float64]


def observed(run: Observation) -> tuple[Any, Array]:
    """What a fit compares, real or complex, and its standard error, both (F,): usable points only."""
    values, errors = _columns(run)
    return getattr(run, values)[run.use], getattr(run, errors)[run.use]


def replaced(run: Observation, values: Any) -> Observation:
    """The run with `values` (F,) in place of what was observed at its usable points."""
    name, _ = _columns(run)
    column = np.array(getattr(run, name), dtype=np.result_type(getattr(run, name), values))
    column[run.use] = values
    more: Any = {name: column}
    return replace(run, **more)


def _columns(run: Observation) -> tuple[str, str]:
    match run:
        case MassResonance():
            return "frequency_hz", "errors_hz"
        case FrequencyResponse(fundamental_m=None):
            return "peak_to_peak_m", "peak_to_peak_errors_m"
        case FrequencyResponse():
            return "fundamental_m", "errors_m"
    return "deflection_m", "errors_m"
