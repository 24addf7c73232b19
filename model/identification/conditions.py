"""Different conditions of a set of dwells: each point that several runs share is computed once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.identification.observations import FrequencyResponseObservation, ObservationSet


@dataclass(frozen=True, eq=False)
class Condition:
    """One condition of dwells with a fundamental.

    Attributes:
        run: a run with every different point once; all are usable.
        places: by label of a run, the point of `run` for each of its usable points, (F,).
    """

    run: FrequencyResponseObservation
    places: dict[str, NDArray[np.intp]]


def conditions_of(observations: ObservationSet, effects: Sequence[str] = ()) -> list[Condition]:
    """Return the conditions of all dwells with a fundamental, in order.

    Points are equal if they have one frequency and drive, and one measured amplitude and time where the `effects` "stiffening" and
    "gain_drift" depend on them. Errors of a reading are no part of a condition.
    """
    same: dict[Any, list[FrequencyResponseObservation]] = {}
    for run in observations.of_type(FrequencyResponseObservation):
        if run.fundamental_m is not None:
            errors = tuple(e for e in run.shared_errors if e.acts_on != "reading")
            known = run.loop_share is None, run.order is None, np.iscomplexobj(run.fundamental_m)
            key = errors, run.elongation_m, run.added_mass_kg, run.temperature_c, known
            same.setdefault(key, []).append(run)
    return [_condition(runs, key[0], effects) for key, runs in same.items()]


def _condition(runs: list[FrequencyResponseObservation], errors: Any, effects: Sequence[str]) -> Condition:
    first = runs[0]
    stacked = {
        name: np.concatenate([getattr(run, name)[run.usable] for run in runs])
        for name in ("frequency_hz", "fundamental_m", "errors_m", "drive_amplitude_v", "drive_offset_v")
    }
    if first.loop_share is not None:
        stacked["loop_share"] = np.concatenate([np.asarray(run.loop_share)[run.usable] for run in runs])
    if first.order is not None:
        stacked["order"] = np.concatenate([np.broadcast_to(run.order, run.usable.shape)[run.usable] for run in runs])  # type: ignore[arg-type]
    keys = [stacked[name] for name in ("frequency_hz", "drive_amplitude_v", "drive_offset_v")]
    if "loop_share" in stacked:
        keys += [stacked["loop_share"].real, stacked["loop_share"].imag]
    if "stiffening" in effects:
        keys.append(np.abs(stacked["fundamental_m"]))
    if "gain_drift" in effects and "order" in stacked:
        keys.append(stacked["order"])
    _, at, where = np.unique(np.stack(keys, axis=-1), axis=0, return_index=True, return_inverse=True)
    ends = np.cumsum([int(run.usable.sum()) for run in runs])[:-1]
    merged = replace(
        first, good=None, shared_errors=errors, shapes={}, peak_to_peak_m=None, peak_to_peak_errors_m=None, harmonics_m=None,
        harmonic_errors_m=None, phase_errors_rad=None, **{name: column[at] for name, column in stacked.items()},
    )  # fmt: skip
    places = np.split(where.ravel(), ends)
    return Condition(merged, {run.label: place for run, place in zip(runs, places, strict=True)})
