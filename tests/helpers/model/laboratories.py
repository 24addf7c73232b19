"""Laboratories whose truth the fit does not expect: own solver, own laws, nonidealities not drawn from the fit's priors.

The physics is that of `tests/helpers/laboratory.py` (Hermite elements, a strip under tension, plays in parallel, lags of creep). Every
laboratory draws how its nonidealities and instruments are distributed (uniform, shifted, heavy-tailed or one-sided), then draws from that.
A departure changes the specimen, the specimen of some runs, what is read, or what is written down.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from app.identification import SheetEntry, SpecimenSheet
from benchmarks.campaigns import staircase
from model.identification.observations import (
    DecayPoleObservation,
    FrequencyResponseObservation,
    MassResonanceObservation,
    MembraneSagObservation,
    Observation,
    ObservationSet,
    SharedError,
    StaticLoadingObservation,
    VoltageStepsObservation,
)
from tests.helpers import laboratory as solver
from tests.helpers.laboratory import G, Laboratory

LOADS_KG = np.array([0.02, 0.05, 0.1, 0.2, 0.5])
MASSES_KG = 1e-3 * np.arange(1.75, 10, 1.0)
LEVELS_V = np.arange(0.5, 5.01, 0.5)
DWELT_HZ = np.array([25, 50, 75, 100, 125, 140, 150, 160, 170, 180, 190, 200, 225, 250.0])
SWEPT_HZ = np.arange(31.0, 401, 6)
ELONGATIONS_M = (0.0, 2.54e-3, 6.35e-3)
REPEATS = 3

SMALL_SETS: dict[str, tuple[str, ...]] = {
    "loads": ("loading",),
    "masses": ("masses",),
    "steps": ("steps",),
    "dwell": ("dwell",),
    "sweep": ("sweep",),
    "decay": ("decay",),
    "sag": ("sag",),
    "loads, masses": ("loading", "masses"),
    "loads, steps": ("loading", "steps"),
    "loads, dwell": ("loading", "dwell"),
    "masses, dwell": ("masses", "dwell"),
    "steps, dwell": ("steps", "dwell"),
    "sweep, decay": ("sweep", "decay"),
    "dwells on the membrane": ("dwell", "membrane"),
    "loads, masses, dwell": ("loading", "masses", "dwell"),
    "loads, steps, dwell": ("loading", "steps", "dwell"),
    "loads, masses, steps, dwell": ("loading", "masses", "steps", "dwell"),
    "loads, dwells, sag": ("loading", "dwell", "membrane", "sag"),
}
"""Where an operator may stop: beginnings of the labels of the runs."""


@dataclass
class Raw:
    """One run before gains and noise: what was set as it is written down, and what the sensor would read.

    Attributes:
        kind: loading, masses, steps, dwell, sweep, decay or sag.
        label: of the run.
        place: among the runs in time.
        x: loads, masses, levels or frequencies as written down, (F,).
        w: displacements, frequencies or poles, (F,).
        errors: standard errors, (F,).
        elongation_m: of the membrane as written down.
        repeat: of each point, (F,).
    """

    kind: str
    label: str
    place: int
    x: np.ndarray
    w: np.ndarray
    errors: np.ndarray
    elongation_m: float | None = None
    repeat: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Departure:
    """One way in which a laboratory is not as it says.

    Attributes:
        name: of the kind.
        size: as text.
        right: titles of causes that are right, as regular expressions.
        fields: of `Laboratory` that are changed.
        run_fields: of the specimen in one run, by its label and place and the specimen of the others.
        read: changes a run in place.
        sheet: shifts of stated values, SI.
        undecidable: whether the runs cannot show it, so that it must be declared instead.
    """

    name: str
    size: str
    right: tuple[str, ...]
    fields: Mapping[str, float] = field(default_factory=dict)
    run_fields: Callable[[str, int, Laboratory], Mapping[str, float]] | None = None
    read: Callable[[Raw, Laboratory], None] | None = None
    sheet: Mapping[str, float] = field(default_factory=dict)
    undecidable: bool = False


UNDISTURBED = Departure("none", "", ())
CENTRES = {
    "creep": 0.016,
    "hysteresis": 0.1,
    "clamp": 0.016,
    "elongation_slip": 0.016,
    "asymmetry": 0.04,
    "mass_loss": 0.15,
}
"""Usual size of each nonideality, around which every laboratory draws in its own way."""


def _one_sided(rng: np.random.Generator, size: float) -> float:
    """Draw a nonideality that has one sign, in one of five ways, none of which is half of a normal distribution."""
    match int(rng.integers(5)):
        case 0:
            return float(rng.uniform(0, 2 * size))
        case 1:
            return float(rng.exponential(0.9 * size))
        case 2:
            return float(0.85 * size * np.exp(0.55 * rng.standard_normal()))
        case 3:
            return float(abs(1.15 * size + 0.25 * size * rng.standard_normal()))
    return float(min(0.75 * size * abs(rng.standard_t(3)), 5 * size))


def _error(rng: np.random.Generator, sigma: float) -> float:
    """Draw an instrument's error of a stated standard uncertainty: uniform, normal, or of two values."""
    match int(rng.integers(3)):
        case 0:
            return float(np.sqrt(3) * sigma * rng.uniform(-1, 1))
        case 1:
            return float(sigma * rng.standard_normal())
    return float(sigma * rng.standard_t(6) / np.sqrt(1.5))


@dataclass(frozen=True)
class World:
    """One laboratory: the truth by the fit's names, the specimen, its sheet, instruments and noise."""

    truth: Mapping[str, float]
    specimen: Laboratory
    sheet: SpecimenSheet
    instruments: Mapping[str, tuple[SharedError, float]]
    noise: float
    from_rest: bool
    spare: bool
    """Whether there is a sweep and a free decay."""


def draw(seed: int, departure: Departure = UNDISTURBED, stream: int = 28) -> World:
    """Draw one laboratory; a departure changes nothing else of it."""
    rng = np.random.default_rng((stream, seed))
    own = {
        "k2": 7e-3 * rng.uniform(0.8, 1.2), "mu": -1.33e-5 * rng.uniform(0.75, 1.3), "c0": 159 * rng.uniform(0.6, 1.4),
        "m_add": 7.73e-3 * rng.uniform(0.6, 1.3), "E_m": 6.95e6 * rng.uniform(0.8, 1.2), "c_s_0": 165 * rng.uniform(0.7, 1.3),
        "c_s_delta": 5.48e4 * rng.uniform(0.7, 1.3),
    }  # fmt: skip
    side = rng.integers(3)
    asymmetry = (rng.uniform(-1.7, 1.7), rng.standard_t(3) / 1.7, 0.8 + 0.4 * rng.standard_normal())[side]
    beyond = {name: _one_sided(rng, CENTRES[name]) for name in ("creep", "hysteresis", "clamp", "elongation_slip")}
    beyond["asymmetry"] = float(np.clip(CENTRES["asymmetry"] * asymmetry, -0.15, 0.15))
    beyond["mass_fraction"] = max(1 - _one_sided(rng, CENTRES["mass_loss"]), 0.45)
    beyond["gain_below"] = _error(rng, 0.005) - _error(rng, 0.005)
    stated = SpecimenSheet().values
    sizes = {n: stated[n].value for n in stated} | {"L_m": 0.17, "b_m": 0.066}
    entries = {}
    for name, each in stated.items():
        true = sizes[name]
        entries[name] = SheetEntry(name, true + _error(rng, each.uncertainty), each.uncertainty)
    sensor, delay, balance = (float(rng.choice(x)) for x in ((0.002, 0.004), (3e-6, 6e-6), (0.0005, 0.002)))
    instruments = {
        "sensor": (SharedError("gain of the laser", "displacement", sensor), _error(rng, sensor)),
        "slopes": (SharedError("slopes of the amplifier", "volts", 0.005), _error(rng, 0.005)),
        "delay": (SharedError("delay of the laser", "delay", delay), _error(rng, delay)),
        "weights": (SharedError("weights", "load", balance), _error(rng, balance)),
        "masses": (SharedError("added masses", "mass", 2e-5), _error(rng, 2e-5)),
    }
    noise, from_rest, spare = (
        float(np.exp(rng.uniform(np.log(0.4), np.log(2)))),
        bool(rng.integers(2)),
        bool(rng.integers(2)),
    )
    # b_m and L_m are constants of the solver: what was read is off, not they
    entries = {
        n: (replace(e, value=e.value + departure.sheet[n]) if n in departure.sheet else e) for n, e in entries.items()
    }
    specimen = Laboratory(**(own | beyond | {"h_m": sizes["h_m"]} | dict(departure.fields)))
    names = {"clamp": "clamp_flexibility", "gain_below": "gain_below_rest"}
    truth = own | {names.get(n, n): v for n, v in beyond.items()} | {n: sizes[n] for n in stated}
    truth |= {names.get(n, n): float(v) for n, v in departure.fields.items() if names.get(n, n) in truth}
    truth |= {error.name: drawn for error, drawn in instruments.values()}
    return World(truth, specimen, SpecimenSheet("blind", entries), instruments, noise, from_rest, spare)


def measure(world: World, seed: int, departure: Departure = UNDISTURBED) -> ObservationSet:
    """Measure every run of a laboratory."""
    rng = np.random.default_rng((29, seed))
    runs: list[Observation] = []
    for raw in _raw_runs(world, departure, rng):
        if departure.read is not None:
            departure.read(raw, world.specimen)
        runs.append(_noted(raw, world, rng))
    return ObservationSet(tuple(runs))


def subset(observations: ObservationSet, kinds: tuple[str, ...]) -> ObservationSet | None:
    """Return the runs whose labels begin so; None where a kind is not there."""
    if any(not any(run.label.startswith(kind) for run in observations.runs) for kind in kinds):
        return None
    return ObservationSet(tuple(run for run in observations.runs if run.label.startswith(kinds)))


def _raw_runs(world: World, departure: Departure, rng: np.random.Generator) -> Any:
    plan: list[tuple[str, str, float | None]] = [
        ("loading", "loading mfc", None),
        ("loading", "loading aluminium", None),
    ]
    plan += [("masses", "masses", None), ("steps", "steps", None), ("dwell", "dwell", None)]
    plan += [("dwell", f"membrane {1e3 * e:.3g} mm", e) for e in ELONGATIONS_M]
    plan += [("dwell", "dwell again", None), ("sag", "sag", None)]
    plan += [("sweep", "sweep", None), ("decay", "decay", None)] if world.spare else []
    for place, (kind, label, elongation) in enumerate(plan):
        changed = departure.run_fields(label, place, world.specimen) if departure.run_fields else {}
        lab = replace(world.specimen, **changed)
        yield _MAKERS[kind](lab, world, label, place, elongation, rng)


def _loading(lab: Laboratory, world: World, label: str, place: int, _: Any, rng: np.random.Generator) -> Raw:
    kg = np.concatenate([rng.permutation(LOADS_KG) for _ in range(REPEATS)])
    per_newton = lab.response(np.zeros(1), load=True)[0].real
    force = G * (kg + lab.load_offset_kg) * (1 + lab.load_gain)
    sign = 1 if "mfc" in label else -1
    w = lab.static(force * per_newton) * (1 + sign * lab.asymmetry) * lab.crept(10.0)
    w = w + lab.zero_drift_m * np.linspace(0, 1, kg.size)
    errors = world.noise * (0.004 * G * kg * per_newton + 2e-7)
    return Raw("loading", label, place, G * kg, w, errors, repeat=np.arange(kg.size) // LOADS_KG.size)


def _masses(lab: Laboratory, world: World, label: str, place: int, _: Any, rng: np.random.Generator) -> Raw:
    offset = world.instruments["masses"][1]
    true = lab.mass_fraction * (MASSES_KG + offset) + lab.mass_offset_kg
    f = np.array([lab.peak_hz(m) for m in true])
    seen = np.isfinite(f)
    return Raw("masses", label, place, MASSES_KG[seen], f[seen], np.full(seen.sum(), 0.3 * world.noise))


def _steps(lab: Laboratory, world: World, label: str, place: int, _: Any, rng: np.random.Generator) -> Raw:
    if world.from_rest:
        levels = rng.permutation(LEVELS_V[LEVELS_V != 2.5])
        path = np.stack((np.full(levels.size, 2.5), levels), axis=1).ravel()
        acting = staircase(solver._volts(lab, path), lab.hysteresis, 0.0, 1.0, lab.low_v)
        acting = (acting[1::2] - acting[::2]) * (1 + lab.creep * np.log10(200 * np.pi))
    else:
        levels = np.concatenate((LEVELS_V, LEVELS_V[-2::-1]))
        acting = staircase(solver._volts(lab, levels), lab.hysteresis, lab.creep, 1 / (200 * np.pi), lab.low_v)
    per_volt = lab.response(np.zeros(1))[0].real
    w = lab.static(per_volt * acting) * (1 + lab.steps_gain)
    errors = world.noise * (0.003 * abs(per_volt * solver._volts(lab, levels)) + 2e-7)
    return Raw("steps", label, place, levels, w, errors)


def _dwell(
    lab: Laboratory, world: World, label: str, place: int, elongation: float | None, rng: Any, swept: bool = False
) -> Raw:
    f = SWEPT_HZ if swept else DWELT_HZ
    f = f * (1 + lab.frequency_error)
    skin = lab.skin(elongation)
    w = lab.vibration(tuple(f), 2.5 * (600 + 200 * (1 + lab.gain_below)) / 2, None, skin)
    errors = world.noise * (0.002 * abs(w) + 1e-7)
    w = w * lab.late(f) * (1 + lab.hysteresis * solver._loop(lab.low_v)) * np.exp(-2j * np.pi * f * lab.delay_s)
    return Raw(
        "sweep" if swept else "dwell",
        label,
        place,
        SWEPT_HZ.copy() if swept else DWELT_HZ.copy(),
        w,
        errors,
        elongation,
    )


def _sweep(lab: Laboratory, world: World, label: str, place: int, _: Any, rng: np.random.Generator) -> Raw:
    return _dwell(lab, world, label, place, None, rng, swept=True)


def _decay(lab: Laboratory, world: World, label: str, place: int, _: Any, rng: np.random.Generator) -> Raw:
    pole = np.full(solver.EDGES, lab.pole_hz())
    return Raw("decay", label, place, np.arange(solver.EDGES) + 1.0, pole, np.full(pole.size, 0.3 * world.noise))


def _sag(lab: Laboratory, world: World, label: str, place: int, _: Any, rng: np.random.Generator) -> Raw:
    w = solver._sag(lab.h_m, lab.E_m) * np.ones(5)
    return Raw("sag", label, place, np.arange(5.0), w, 0.008 * world.noise * w)


_MAKERS: dict[str, Any] = {
    "loading": _loading, "masses": _masses, "steps": _steps, "dwell": _dwell, "sweep": _sweep, "decay": _decay, "sag": _sag,
}  # fmt: skip


def _noted(raw: Raw, world: World, rng: np.random.Generator) -> Observation:
    """Return a run with its instruments' errors and noise, as it is written down."""
    errors = {name: error for name, (error, _) in world.instruments.items()}
    drawn = {name: value for name, (_, value) in world.instruments.items()}
    scale = (1 + drawn["sensor"]) * (1 + world.specimen.sensor_gain)
    noise = raw.errors * rng.standard_normal(raw.w.size)
    match raw.kind:
        case "loading":
            side: Any = "mfc" if "mfc" in raw.label else "aluminium"
            w = raw.w * scale * (1 + drawn["weights"]) + noise
            shared = (errors["sensor"], errors["weights"])
            return StaticLoadingObservation(raw.label, raw.x, w, raw.errors, side, shared_errors=shared, simulated=True)
        case "masses":
            return MassResonanceObservation(
                raw.label, raw.x, raw.w + noise, raw.errors, shared_errors=(errors["masses"],), simulated=True
            )
        case "steps":
            w = raw.w * scale * (1 + drawn["slopes"]) + noise
            order = np.arange(raw.x.size)
            rising = None if world.from_rest else order < LEVELS_V.size
            shared = (errors["sensor"], errors["slopes"])
            return VoltageStepsObservation(
                raw.label, raw.x, w, raw.errors, rising, np.ones(w.size), shared_errors=shared, simulated=True
            )
        case "decay":
            turned = 2e-3 * world.noise
            damping = -raw.w.real / abs(raw.w) + turned * rng.standard_normal(raw.w.size)
            return DecayPoleObservation(
                raw.label, abs(raw.w) + noise, raw.errors, damping, np.full(raw.w.size, turned), simulated=True
            )
        case "sag":
            return MembraneSagObservation(
                raw.label, raw.w * scale + noise, raw.errors, shared_errors=(errors["sensor"],), simulated=True
            )
    w = raw.w * scale * (1 + drawn["slopes"]) * np.exp(-2j * np.pi * raw.x * drawn["delay"])
    w = w + noise + 1j * raw.errors * rng.standard_normal(raw.w.size)
    shared = (errors["sensor"], errors["slopes"], errors["delay"])
    return FrequencyResponseObservation(
        raw.label, raw.x, w, raw.errors, 2.5, 2.5, raw.elongation_m, order=float(raw.place), swept=raw.kind == "sweep",
        shared_errors=shared, simulated=True,
    )  # fmt: skip
