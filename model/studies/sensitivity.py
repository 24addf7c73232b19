"""Global sensitivity: Sobol indices of the response over given ranges of the variables."""

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model import Array, ParameterError
from model.studies.parameter_study import Study, study_responses


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Sobol indices of several outputs; the outputs are named with their units."""

    variables: tuple[str, ...]
    outputs: tuple[str, ...]
    first_order: Array
    """(outputs, variables): share of the variance that the variable explains alone."""
    total_order: Array
    """(outputs, variables): share that would vanish with a fixed variable."""


def sobol_indices_of(
    study: Study,
    ranges: Mapping[str, tuple[float, float]],
    samples: int = 1024,
    seed: int = 1,
    executor: Executor | None = None,
) -> Sensitivity:
    """Sobol indices of the peak amplitude, the frequency of the peak, and the amplitude at each of the study's frequencies.

    `study` gives specimen, frequencies and measure (fundamental or peak_to_peak); its own `vary` is not used. Each variable
    is uniform between its two limits; `samples`, a power of two, costs samples * (len(ranges) + 2) parameter sets.

    Raises:
        ParameterError: an empty range, an unknown variable, a limit that is not physical, or samples not a power of two.
    """
    from scipy.stats import sobol_indices, uniform

    if study.measure == "receptance":
        raise ParameterError("measure is receptance, which is complex: choose fundamental or peak_to_peak")
    if samples < 2 or samples & (samples - 1):
        raise ParameterError(f"samples is {samples}: the Sobol sequence needs a power of two, e.g. 1024")
    for name, (low, high) in ranges.items():
        if not low < high:
            raise ParameterError(
                f"{name} ranges from {low:g} to {high:g}: the first limit must be less than the second"
            )
        study.specimen.coefficients({name: np.array([low, high])})
    names = tuple(ranges)

    def outputs(x: Array) -> Array:
        """(variables, P) -> (outputs, P)."""
        amplitude = chunked_responses(study, dict(zip(names, x, strict=True)), executor)
        peak = amplitude.argmax(1)
        return np.vstack((amplitude.max(1), np.asarray(study.frequency_hz)[peak], amplitude.T))

    dists: Any = [uniform(low, high - low) for low, high in ranges.values()]
    indices = sobol_indices(func=outputs, n=samples, dists=dists, rng=np.random.default_rng(seed))
    labels = ("peak [m]", "frequency of peak [Hz]", *(f"amplitude at {f:g} Hz [m]" for f in study.frequency_hz))
    return Sensitivity(names, labels, np.asarray(indices.first_order), np.asarray(indices.total_order))


def chunked_responses(study: Study, values: Mapping[str, Array], executor: Executor | None = None) -> NDArray[Any]:
    """The study's measure for any number P of sets, arrays of one length, chunk by chunk; shape (P, F)."""
    sets = max(np.size(v) for v in values.values())
    bare = replace(study, vary={})
    starts = range(0, sets, study.chunk_size)
    pieces = [{k: np.broadcast_to(v, sets)[i : i + study.chunk_size] for k, v in values.items()} for i in starts]
    run = map if executor is None else executor.map
    return np.concatenate(list(run(partial(study_responses, bare), pieces)))
