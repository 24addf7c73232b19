"""Shapes over the points of errors of readings: drift, curvature, slip, roll-off, resonance of a mount, one repeat.

A shape is the relative change of what is read at each usable point for an error of 1, (F,).
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from model import Array
from model.identification import observations as observed
from model.response import crept_response

DRIFT, CURVATURE, SLIP, FALL, LATE, CREEP, REPEAT, WEIGHT = 0.03, 0.05, 0.05, 0.1, 0.2, 0.01, 0.05, 0.05
"""Plausible sizes: over a run; at the largest reading; of the deflection; at 250 Hz, and there in rad; per decade; of one repeat, or weight."""
SETTLED = 4.0
"""Time constants in a run whose gain settles, as a laser's does while it warms up."""
BESIDE_JUMP = 2
"""Intervals from either end of a run in which no jump is tried: one point is a cause of its own."""
MOUNT_MOTION = 0.03
"""Share of a reading that a sensor's mount moves at its resonance."""
MOUNT_HZ = np.geomspace(30.0, 400.0, 56)
MOUNT_Q = (8.0, 20.0)
"""Resonances of a mount that are tried: 5 % apart, half the width of the sharper one."""
ROLL_OFF_HZ = 250.0
FULL_DEFLECTION_M = 1e-3
MIN_MOUNT_POINTS = 8

Shapes = dict[str, Any]
ShapedError = tuple[str, str, str, list[tuple[float, Shapes]]]
"""Kind, run, title, and for each parameter its plausible size and its shapes by run."""


def shaped_errors(runs: Sequence[observed.Observation], predictions: Mapping[str, Any]) -> Iterator[ShapedError]:
    """Yield the errors with shapes that these runs may have; `predictions` of their usable points, by run."""
    driven = [r for r in runs if isinstance(r, observed.FrequencyResponseObservation)]
    loadings = [r for r in runs if isinstance(r, observed.StaticLoadingObservation)]
    for run in runs:
        yield from _shapes_of_run(run, predictions[run.label])
    yield from _loading_shapes(loadings)
    deflections = {r.label: np.abs(predictions[r.label]) for r in (*driven, *loadings, *_steps(runs))}
    for power, order in ((1, "quadratic"), (2, "cubic")):
        share = {label: (w / FULL_DEFLECTION_M) ** power for label, w in deflections.items()}
        if share and max(float(np.ptp(w)) for w in share.values()) > 0:
            yield "sensor curvature", order, "sensor curvature", [(CURVATURE, share)]
    phased = [r for r in driven if np.iscomplexobj(predictions[r.label])]
    if phased and sum(int(r.usable.sum()) for r in phased) >= MIN_MOUNT_POINTS:
        f = {r.label: r.frequency_hz[r.usable] for r in phased}
        yield from _driven_shapes(f, len(phased) < len(runs))
        yield from mount_resonances(f, MOUNT_HZ, MOUNT_Q)


def _steps(runs: Sequence[observed.Observation]) -> list[observed.VoltageStepsObservation]:
    return [r for r in runs if isinstance(r, observed.VoltageStepsObservation)]


def _shapes_of_run(run: observed.Observation, predicted: Any) -> Iterator[ShapedError]:
    count = int(run.usable.sum())
    if count > 3 and not isinstance(run, observed.MassResonanceObservation | observed.DecayPoleObservation):
        place = np.linspace(0, 1, run.usable.size)[run.usable]
        for shape in _drifts(place):
            yield "drift", run.label, f"drift in {run.label}", [(DRIFT, {run.label: shape})]
    if isinstance(run, observed.VoltageStepsObservation) and count > 2:
        share = np.abs(predicted) / max(float(np.abs(predicted).max()), 1e-300)
        for power in (1, 6):
            yield "bend", run.label, f"softening of {run.label}", [(CURVATURE, {run.label: share**power})]
    if isinstance(run, observed.StaticLoadingObservation):
        repeat = _repeats(run.load_n[run.usable])
        for i in range(1 + int(repeat.max())) if repeat.any() else ():
            title = f"repeat {i + 1} of {run.label}"
            yield "repeat", run.label, title, [(REPEAT, {run.label: (repeat == i).astype(float)})]


def _drifts(place: Array) -> Iterator[Array]:
    """Yield drifts that grow by 1 from place 0 to 1, steadily, settling or at once, right at the first or at the last point."""
    jumps = [np.asarray(place > at, float) for at in 0.5 * (place[1:] + place[:-1])[BESIDE_JUMP:-BESIDE_JUMP]]
    for shape in (place, np.expm1(-SETTLED * place) / np.expm1(-SETTLED), *jumps):
        yield from (shape, shape - 1)


def _repeats(loads: Array) -> Array:
    """Return for each reading how often its load was read before, (F,)."""
    return np.array([int(np.isclose(loads[:i], load).sum()) for i, load in enumerate(loads.tolist())])


def _loading_shapes(loadings: Sequence[observed.StaticLoadingObservation]) -> Iterator[ShapedError]:
    loads = {r.label: r.load_n[r.usable] for r in loadings}
    different = np.unique(np.round(np.concatenate([*loads.values(), np.zeros(0)]), 9))
    if different.size < 2:
        return
    top = different.max()
    yield "bend", "the loadings", "softening under load", [(CURVATURE, {k: x / top for k, x in loads.items()})]
    for start in different[:-1].tolist():
        beyond = {k: np.maximum(x - start, 0.0) / x * top / (top - start) for k, x in loads.items()}
        yield "slip", "the loadings", "slip under load", [(SLIP, beyond)]
    for load in different.tolist():
        under = {k: np.isclose(x, load, rtol=1e-6).astype(float) for k, x in loads.items()}
        if sum(float(each.sum()) for each in under.values()) > 1:  # one reading is a point
            yield "weight", f"{load:.3g} N", f"weight of {load:.3g} N", [(WEIGHT, under)]


def _driven_shapes(f: Mapping[str, Array], others: bool) -> Iterator[ShapedError]:
    fall = {k: -((x / ROLL_OFF_HZ) ** 2) + 0j for k, x in f.items()}
    late = {k: -1j * x / ROLL_OFF_HZ for k, x in f.items()}
    yield "roll-off", "what is driven", "roll-off", [(FALL, fall), (LATE, late)]
    if others:
        creep = {k: crept_response(1.0, 2 * np.pi * x) - 1 for k, x in f.items()}
        yield "creep of the dwells", "the dwells", "creep of the dwells", [(CREEP, creep)]


def mount_resonances(f: Mapping[str, Array], hertz: Array, quality: Sequence[float]) -> Iterator[ShapedError]:
    """Yield a mount that moves with what it reads, in phase and out of phase, for each resonance within the frequencies."""
    every, ends = np.concatenate(list(f.values())), np.cumsum([x.size for x in f.values()]).tolist()

    def by_run(shape: Array) -> dict[str, Array]:
        return {k: shape[stop - x.size : stop] for (k, x), stop in zip(f.items(), ends, strict=True)}

    for at in hertz[(hertz > 0.8 * every.min()) & (hertz < 1.25 * every.max())].tolist():
        for q in quality:
            moved = (every / at) ** 2 / (1 - (every / at) ** 2 + 1j * every / at / q) / q
            shapes = [(MOUNT_MOTION, by_run(moved)), (MOUNT_MOTION, by_run(1j * moved))]
            yield "mount", f"{at:.3g} Hz", "stand resonance", shapes
