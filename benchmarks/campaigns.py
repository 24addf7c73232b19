"""Simulated campaigns of one specimen, from solutions that share nothing with the fit's own.

`closed_form` solves the twelve interface conditions at every frequency (no Galerkin); `elements` is a beam of Hermite finite
elements, the only one that knows a clamp that gives. Statics come from the elements too, not from Eqs. (7) and (8). What lies
outside the model (hysteresis, creep, a clamp that gives, drift) is put in here, and only here.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import pairwise

import numpy as np

from model.amplifier_map import AmplifierMap
from model.identification.observations import (
    FrequencyResponseObservation,
    MassResonanceObservation,
    MembraneSagObservation,
    Observation,
    ObservationSet,
    SharedError,
    StaticLoadingObservation,
    VoltageStepsObservation,
)
from model.membrane import sag, skin
from model.parameters import Membrane, Skin, Tactor
from model.response.closed_form import exact_response

G = 9.80665
LOADS_N = G * np.array([0.02, 0.05, 0.1, 0.2, 0.5])
MASSES_KG = 1e-3 * np.arange(1.75, 10, 1.0)
LEVELS_V = np.arange(0.5, 5.01, 0.5)
FREQUENCIES_HZ = np.array([25, 50, 75, 100, 125, 150, 155, 160, 165, 170, 175, 180, 185, 190, 195, 200, 225, 250.0])
ELONGATIONS_M = (0.0, 1.27e-3, 2.54e-3, 3.81e-3, 5.08e-3, 6.35e-3)

SENSOR = SharedError("gain of the displacement sensor", "displacement", 0.002)
AMPLIFIER = SharedError("gain of the amplifier", "volts", 0.005)
DELAY = SharedError("delay of the sensor", "delay", 5e-6)
WEIGHTS = SharedError("weights", "load", 0.001)
GLUE = SharedError("mass of glue and cylinder", "mass", 5e-5)
SHARED = (SENSOR, AMPLIFIER, DELAY, WEIGHTS, GLUE)


@dataclass(frozen=True)
class Noise:
    """Standard errors: relative to the value, and in metres, of one point; hertz of a resonance."""

    loading: float = 0.005
    steps: float = 0.005
    dwell: float = 0.003
    floor_m: float = 2e-7
    resonance_hz: float = 0.3
    sag: float = 0.01


@dataclass(frozen=True)
class World:
    """What is measured, and how it departs from the model (all zero: not at all).

    Attributes:
        clamp: rotational stiffness of the clamp over k1 / L1; infinite is rigid.
        creep: share of the response gained per decade of time, as a complex compliance around 10 Hz.
        hysteresis: share of the response at full drive that comes late, in proportion to the drive (Rayleigh).
        drift: share by which the response grows from the first run to the last.
        by_elements: whether the free response is that of finite elements.
        elongations_m: of the membrane, in the dwells on it.
    """

    tactor: Tactor = field(default_factory=Tactor)
    membrane: Membrane = field(default_factory=Membrane)
    clamp: float = np.inf
    creep: float = 0.0
    hysteresis: float = 0.0
    drift: float = 0.0
    by_elements: bool = False
    elongations_m: tuple[float, ...] = ELONGATIONS_M

    def response(self, tactor: Tactor, f: np.ndarray, on: Skin | None = None) -> np.ndarray:
        if self.by_elements or np.isfinite(self.clamp):
            return elements(tactor, f, on, self.clamp)
        return exact_response(tactor, f, on)

    def late(self, f: np.ndarray) -> np.ndarray:
        """Creep as a factor of the response at f (creep laws of log time have a constant loss angle)."""
        return 1 - self.creep * (np.log10(f / 10) + 1j * np.pi / 2 / np.log(10))


def elements(tactor: Tactor, f: np.ndarray, on: Skin | None, clamp: float, load: bool = False) -> np.ndarray:
    """Deflection of the centre per volt (or per newton), Hermite elements, ten a segment."""
    t, on = tactor, on or Skin()
    x = np.unique(np.concatenate([np.linspace(a, b, 11) for a, b in ((0, t.L1), (t.L1, t.L2), (t.L2, t.L))]))
    size = 2 * x.size
    M, C, K = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    for i, (a, b) in enumerate(pairwise(x)):
        h, mid = b - a, (a + b) / 2
        bend = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h]])
        bend = np.vstack((bend, [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h])) / h**3
        mass = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h]])
        mass = np.vstack((mass, [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h])) * h / 420
        third = mid > t.L2
        here = slice(2 * i, 2 * i + 4)
        K[here, here] += (t.k1 if mid < t.L1 else t.k2) * bend + (on.k_s * mass if third else 0)
        M[here, here] += (t.rho1 if mid < t.L1 else t.rho2 + (t.eta if third else 0)) * mass
        C[here, here] += (t.c0 + (on.c_s if third else 0)) * mass
    if np.isfinite(clamp):
        K[1, 1] += clamp * t.k1 / t.L1
    keep = np.setdiff1d(np.arange(size), [0, size - 1] + ([] if np.isfinite(clamp) else [1]))
    B = np.zeros(size)
    if load:
        B[-2] = 0.5
    else:
        B[2 * int(np.argmin(abs(x - t.L1))) + 1] = -t.mu
    centre = int(np.flatnonzero(keep == size - 2)[0])
    M, C, K = (A[np.ix_(keep, keep)] for A in (M, C, K))
    w = 2 * np.pi * np.asarray(f)[:, None, None]
    return np.linalg.solve(K - w * w * M + 1j * w * C, B[keep][:, None])[:, centre, 0]


def peak_hz(call: Callable[[np.ndarray], np.ndarray]) -> float:
    """Frequency of the largest response, by ever finer scans."""
    low, high = 20.0, 700.0
    for _ in range(5):
        f = np.linspace(low, high, 17)
        top = int(np.clip(abs(call(f)).argmax(), 1, 15))
        low, high = f[top - 1], f[top + 1]
    a, b, c = abs(call(np.array([low, (low + high) / 2, high])))
    return (low + high) / 2 + (high - low) / 4 * (a - c) / (a - 2 * b + c)


@lru_cache(maxsize=32)
def perfect(
    world: World, noise: Noise, common: tuple[SharedError, ...], amplitudes_v: tuple[float, ...] = (2.5,)
) -> ObservationSet:
    """Every run of the paper without noise, with the errors that `noise` says; the free dwell is done first and last."""
    runs = _perfect_runs(world, noise, amplitudes_v)
    return ObservationSet(
        tuple(replace(r, shared_errors=tuple(e for e in r.shared_errors if e in common)) for r in runs)
    )


@lru_cache(maxsize=32)
def _perfect_runs(world: World, noise: Noise, amplitudes_v: tuple[float, ...]) -> tuple[Observation, ...]:
    """Compute the runs of `perfect` with every shared error."""
    t, m = world.tactor, world.membrane
    still = np.zeros(1)
    per_newton = elements(t, still, None, world.clamp, load=True)[0].real
    per_volt = elements(t, still, None, world.clamp)[0].real

    w = per_newton * LOADS_N
    runs: list = [
        StaticLoadingObservation(
            side,
            LOADS_N,
            w,
            noise.loading * w + noise.floor_m,
            side,
            shared_errors=(SENSOR, WEIGHTS),
            simulated=True,
        )
        for side in ("mfc", "aluminium")
    ]
    heavy = [replace(t, m_add=mass) for mass in MASSES_KG]
    f = np.array([peak_hz(partial(world.response, loaded)) for loaded in heavy])
    runs.append(
        MassResonanceObservation(
            "masses", MASSES_KG, f, np.full(f.size, noise.resonance_hz), shared_errors=(GLUE,), simulated=True
        )
    )
    levels = np.concatenate((LEVELS_V, LEVELS_V[-2::-1]))
    rising = np.arange(levels.size) < LEVELS_V.size
    V = AmplifierMap().specimen_v(levels)
    w = per_volt * staircase(V, world.hysteresis, world.creep, 0.1)  # read after 1 s, a decade later than 10 Hz
    runs.append(
        VoltageStepsObservation(
            "steps", levels, w, noise.steps * abs(per_volt * V) + noise.floor_m, rising,
            shared_errors=(SENSOR, AMPLIFIER), simulated=True,
        )
    )  # fmt: skip
    for elongation in (None, *world.elongations_m):
        on = None if elongation is None else skin(m, elongation / m.L_m, tactor=t)
        for a in amplitudes_v if elongation is None else amplitudes_v[:1]:
            name = "free" if a == amplitudes_v[0] else f"free {a:g} V"
            runs += [_dwell(world, noise, name, elongation, on, a)]
    dwells = sum(isinstance(r, FrequencyResponseObservation) for r in runs)
    runs.append(replace(_dwell(world, noise, "free again", None, None, amplitudes_v[0]), order=float(dwells)))
    place = 0
    for i, run in enumerate(runs):
        if isinstance(run, FrequencyResponseObservation):
            runs[i] = replace(
                run, order=float(place), fundamental_m=run.fundamental_m * (1 + world.drift * place / dwells)
            )
            place += 1
    hang = np.full(5, sag(m).centre_m)
    runs.append(MembraneSagObservation("sag", hang, noise.sag * hang, shared_errors=(), simulated=True))
    return tuple(runs)


def staircase(
    volts: np.ndarray, hysteresis: float, creep: float, reference_s: float, low_v: float = -500.0
) -> np.ndarray:
    """Volts that act, (F,), of levels one after the other from rest, a second each, with the creep of every step by itself.

    Hysteresis is that of plays of all widths between `low_v` and 1500 V, which came to rest from the lower end.
    """
    width = np.arange(round(1500 - low_v)) + 0.5
    play, loop = np.maximum(low_v, 0.0 - width), []
    at_rest = play.sum()
    for v in volts:
        play = np.minimum(np.maximum(play, v - width), v)
        loop.append(play.sum() - at_rest)
    steps = np.diff(volts + hysteresis * np.array(loop) / ((1500 - low_v) / 2), prepend=0.0)
    read = np.arange(volts.size)
    ages_s = np.maximum(read[:, None] - read, 0) + 1.0
    return np.tril(1 + creep * np.log10(ages_s / reference_s)) @ steps


def _loop_orders() -> np.ndarray:
    """Orders of a Rayleigh loop over the fundamental of the volts, which the amplifier's two slopes bend, (5,)."""
    turn = np.exp(2j * np.pi * np.arange(3600) / 3600)
    V = np.where(turn.imag < 0, 500, 1500) * turn.imag
    late = np.where(turn.real > 0, (V + 500) ** 2, 2000**2 - (1500 - V) ** 2) / 2 / 1000
    return np.array([(late * turn**-k).sum() for k in range(5)]) / (V / turn).sum()


def _dwell(
    world: World, noise: Noise, name: str, elongation, on: Skin | None, a: float
) -> FrequencyResponseObservation:
    H = world.response(world.tactor, FREQUENCIES_HZ, on) * world.late(FREQUENCIES_HZ)
    F = 400 * a * H
    h = world.hysteresis * a / 2.5
    loop = h * _loop_orders()
    F = F * (1 + loop[1])  # Rayleigh: softer and later with amplitude
    harmonics = np.full((F.size, 4), np.nan)
    harmonics[:, 0] = abs(F)
    for k in (2, 3, 4):
        V = ({2: -212.2066, 3: 0.0, 4: -42.4413}[k] - 1000j * loop[k]) * a / 2.5
        harmonics[:, k - 1] = abs(V * world.response(world.tactor, k * FREQUENCIES_HZ, on))
    errors = noise.dwell * abs(400 * a * world.response(world.tactor, FREQUENCIES_HZ, on)) + noise.floor_m
    label = name if elongation is None else f"membrane {1e3 * elongation:.3g} mm"
    return FrequencyResponseObservation(
        label, FREQUENCIES_HZ, F, errors, a, 2.5, elongation, harmonics_m=harmonics, harmonic_errors_m=0 * errors + noise.floor_m / 10,
        shared_errors=(SENSOR, AMPLIFIER, DELAY), simulated=True,
    )  # fmt: skip
