"""Shapes over the points of errors of readings: drift, curvature, cut readings, zero, slip, roll-off, coupling, hum, resonance of a mount, one repeat.

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
MASS_G, ZERO, COUPLING, COUPLING_SQUARE, HUM, SOFTER = 0.3, 0.01, 0.1, 0.03, 0.02, 0.03
"""Plausible sizes: in g; of the largest reading; of `COUPLING_HZ`, and its square; of the largest reading; of the stiffness."""
SETTLED = 4.0
"""Time constants in a run whose gain settles, as a laser's does while it warms up."""
BESIDE_JUMP = 2
"""Intervals from either end of a run in which no jump is tried: one point is a cause of its own."""
MOUNT_MOTION = 0.03
"""Share of a reading that a sensor's mount moves at its resonance."""
MOUNT_HZ = np.geomspace(30.0, 400.0, 56)
MOUNT_Q = (8.0, 20.0)
"""Resonances of a mount that are tried: 5 % apart, half the width of the sharper one."""
ROLL_OFF_HZ, COUPLING_HZ = 250.0, 10.0
MAINS_HZ, BESIDE_MAINS_HZ = (50.0, 60.0, 100.0, 120.0, 150.0, 180.0), 0.5
CUT_AT = (0.5, 0.6, 0.7, 0.8, 0.9)
"""Limits of what an instrument can read that are tried, as shares of the largest reading."""
FULL_DEFLECTION_M = 1e-3
MIN_MOUNT_POINTS = 8

Shapes = dict[str, Any]
ShapedError = tuple[str, str, str, list[tuple[float, Shapes]]]
"""Kind, run, title, and for each parameter its plausible size and its shapes by run."""


def relative_to(change: Any, values: Any) -> Any:
    """Return a change over the values, 0 where they are."""
    there = np.abs(values) > 1e-9 * np.abs(values).max(initial=0.0)
    return np.divide(change, values, out=np.zeros_like(values), where=there)


def shaped_errors(
    runs: Sequence[observed.Observation], predictions: Mapping[str, Any], softening: Mapping[str, Any], rest_v: float
) -> Iterator[ShapedError]:
    """Yield the errors with shapes that these runs may have.

    `predictions` of their usable points, by run, and `softening`, their relative changes for a relative fall of the stiffness, (F,);
    `rest_v` is the input of the amplifier at rest.
    """
    driven = [r for r in runs if isinstance(r, observed.FrequencyResponseObservation)]
    loadings = [r for r in runs if isinstance(r, observed.StaticLoadingObservation)]
    for run in runs:
        yield from _shapes_of_run(run, predictions[run.label], softening.get(run.label), rest_v)
    if softening and len(runs) > 2:
        places = np.linspace(0, 1, len(runs)).tolist()
        shapes = {r.label: softening[r.label] * place for r, place in zip(runs, places, strict=True)}
        yield "stiffness", "all runs", "stiffness over the runs", [(SOFTER, shapes)]
    yield from _loading_shapes(loadings)
    for run in (*driven, *_steps(runs), *(loadings if len(loadings) > 1 else ())):  # a lone loading has a load_offset
        label, predicted = run.label, predictions[run.label]
        if predicted.size > 2:
            for shape in _bends(np.abs(predicted), run in driven):
                yield "bend", label, f"softening of {label}", [(CURVATURE, {label: shape})]
            if run not in driven:
                yield "zero", label, f"zero of {label}", [(ZERO, {label: _constant(predicted)})]
    deflections = {r.label: np.abs(predictions[r.label]) for r in (*driven, *loadings, *_steps(runs))}
    for power, order in ((1, "quadratic"), (2, "cubic")):
        share = {label: (w / FULL_DEFLECTION_M) ** power for label, w in deflections.items()}
        if share and max(float(np.ptp(w)) for w in share.values()) > 0:
            yield "sensor curvature", order, "sensor curvature", [(CURVATURE, share)]
    phased = [r for r in driven if np.iscomplexobj(predictions[r.label])]
    if phased and sum(int(r.usable.sum()) for r in phased) >= MIN_MOUNT_POINTS:
        f = {r.label: r.frequency_hz[r.usable] for r in phased}
        yield from _driven_shapes(f, len(phased) < len(runs))
        yield from _hum({r.label: predictions[r.label] for r in phased}, f)
        yield from mount_resonances(f, MOUNT_HZ, MOUNT_Q)


def _steps(runs: Sequence[observed.Observation]) -> list[observed.VoltageStepsObservation]:
    return [r for r in runs if isinstance(r, observed.VoltageStepsObservation)]


def _shapes_of_run(run: observed.Observation, predicted: Any, softening: Any, rest_v: float) -> Iterator[ShapedError]:
    match run:
        case observed.DecayPoleObservation():
            return
        case observed.MassResonanceObservation():
            yield from _masses_lost(run, predicted)
            return
        case observed.StaticLoadingObservation():
            yield from _repeats(run, predicted)
        case observed.VoltageStepsObservation():
            constant = _constant(predicted)
            for side in (run.input_v[run.usable] < rest_v, run.input_v[run.usable] > rest_v):
                yield "rest", run.label, f"rest of {run.label}", [(ZERO, {run.label: constant * side})]
    if predicted.size > 3:
        yield from _changes_of_readings(run, predicted, softening)


def _changes_of_readings(run: observed.Observation, predicted: Any, softening: Any) -> Iterator[ShapedError]:
    """Yield changes of displacements with time or size."""
    label, driven = run.label, isinstance(run, observed.FrequencyResponseObservation)
    place = np.linspace(0, 1, run.usable.size)[run.usable]
    jumps = _jumps(place)
    for shape in (*_grown(place), *jumps):
        for each in (shape, shape - 1):  # right at the first point, or at the last
            yield "drift", label, f"drift in {label}", [(DRIFT, {label: each})]
    if driven and softening is not None:
        for grown in _grown(place):
            yield "softening", label, f"stiffness within {label}", [(SOFTER, {label: softening * grown})]
    constant = _constant(predicted)
    for shape in () if driven else (*_grown(place), *jumps):
        yield "zero", label, f"zero of {label}", [(ZERO, {label: constant * shape})]


def _masses_lost(run: observed.MassResonanceObservation, predicted: Array) -> Iterator[ShapedError]:
    mass = run.mass_kg[run.usable]
    if mass.size > 3 and np.unique(mass).size == mass.size:
        order = np.argsort(mass)
        per_kg = np.gradient(predicted[order], mass[order])[np.argsort(order)] / predicted
        place = np.linspace(0, 1, run.usable.size)[run.usable]
        for shape in (place, *_jumps(place)):
            yield "mass within", run.label, f"drift in {run.label}", [(MASS_G, {run.label: 1e-3 * per_kg * shape})]


def _bends(size: Array, sine: bool) -> Iterator[Array]:
    """Yield relative changes of readings that grow with their size (F,) to 1 at the largest: gradual, and cut at a limit."""
    share = size / max(float(size.max()), 1e-300)
    yield from (share, share**6)
    for limit in CUT_AT:
        r = np.minimum(limit / np.maximum(share, limit), 1.0)
        lost = 1 - 2 / np.pi * (np.arcsin(r) + r * np.sqrt(1 - r**2)) if sine else 1 - r
        if np.count_nonzero(lost) > 1:  # one reading is a point
            yield lost / lost.max()


def _constant(predicted: Any) -> Any:
    """Return the relative change by the same displacement at each point, as large as the largest, (F,)."""
    return relative_to(np.full(predicted.size, np.abs(predicted).max()), predicted)


def _grown(place: Array) -> tuple[Array, Array]:
    return place, np.expm1(-SETTLED * place) / np.expm1(-SETTLED)


def _jumps(place: Array) -> list[Array]:
    return [np.asarray(place > at, float) for at in 0.5 * (place[1:] + place[:-1])[BESIDE_JUMP:-BESIDE_JUMP]]


def _repeats(run: observed.StaticLoadingObservation, predicted: Array) -> Iterator[ShapedError]:
    """Yield a wrong scale and a wrong zero of each repeat."""
    loads, label = run.load_n[run.usable], run.label
    repeat = np.array([int(np.isclose(loads[:i], load).sum()) for i, load in enumerate(loads.tolist())])
    constant = _constant(predicted)
    for i in range(1 + int(repeat.max())) if repeat.any() else ():
        for size, shape in ((REPEAT, 1.0), (ZERO, constant)):
            yield "repeat", label, f"repeat {i + 1} of {label}", [(size, {label: shape * (repeat == i)})]


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
    above = {k: 1j * COUPLING_HZ / x for k, x in f.items()}
    square = {k: -((COUPLING_HZ / x) ** 2) + 0j for k, x in f.items()}
    yield "coupling", "what is driven", "high-pass", [(COUPLING, above), (COUPLING_SQUARE, square)]
    if others:
        creep = {k: crept_response(1.0, 2 * np.pi * x) - 1 for k, x in f.items()}
        yield "creep of the dwells", "the dwells", "creep of the dwells", [(CREEP, creep)]


def _hum(predictions: Mapping[str, Any], f: Mapping[str, Array]) -> Iterator[ShapedError]:
    largest = max(float(np.abs(w).max()) for w in predictions.values())
    for hertz in MAINS_HZ:
        added = {k: relative_to(largest * (np.abs(x - hertz) < BESIDE_MAINS_HZ), predictions[k]) for k, x in f.items()}
        if sum(map(np.count_nonzero, added.values())) > 1:  # one reading is a point
            turned = {k: 1j * each for k, each in added.items()}
            yield "hum", f"{hertz:g} Hz", f"hum at {hertz:g} Hz", [(HUM, added), (HUM, turned)]


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
