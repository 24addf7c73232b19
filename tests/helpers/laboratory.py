"""Independent laboratory: runs of a specimen by finite elements, with departures from the model; shares nothing with the fit.

Only the records that hold observations, and the names of shared errors, are the program's. Everything is computed here: Hermite
elements for the beam, the membrane as a strip under tension, the amplifier's two slopes, and each departure by its own law.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

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

G = 9.80665
WEIGHTS_KG = np.array([0.02, 0.05, 0.1, 0.2, 0.5])
MASSES_KG = 1e-3 * np.arange(1.75, 10, 1.0)
LEVELS_V = np.concatenate((np.arange(0.5, 5.01, 0.5), np.arange(4.5, 0.4, -0.5)))
FREQUENCIES_HZ = np.array([25, 50, 75, 100, 125, 150, 155, 160, 165, 170, 175, 180, 185, 190, 195, 200, 225, 250.0])
ELONGATIONS_M = (0.0, 1.27e-3, 2.54e-3, 3.81e-3, 5.08e-3, 6.35e-3)
SWEPT_HZ = np.arange(27.0, 425, 4)
EDGES = 10
STATIC_REPEATS = 3
ELEMENTS = 8
"""Of each segment."""

SENSOR = SharedError("gain of the laser", "displacement", 0.002)
AMPLIFIER = SharedError("gain of the amplifier", "volts", 0.005)
DELAY = SharedError("delay of the laser", "delay", 5e-6)
BALANCE = SharedError("weights", "load", 0.001)
CLAY = SharedError("added masses", "mass", 2e-5)


@dataclass(frozen=True)
class Laboratory:
    """Specimen, membrane and instruments as they really are; the defaults are Table I and perfect instruments.

    Attributes:
        L, L1, L2, h_Al, rho1, rho2, k2, mu, c0, m_add: of the specimen, SI.
        h_m, E_m, c_s_0, c_s_delta: of the membrane, SI.
        contact_m: length over which the skin's point stiffness is distributed.
        mass_fraction, mass_offset_kg: what acts of an added mass, and a mass that is always there with it.
        asymmetry: share by which loads deflect the MFC side more than the mean.
        creep: share of the response gained per decade of time, zero at the time constant of 100 Hz.
        hysteresis: half-width of the Rayleigh loop at full drive, as a share of the stroke.
        clamp: flexibility of the clamp over that of the bare plate, L1 / k1.
        load_offset_kg: tare of pan and hook, not written down.
        zero_drift_m: of the sensor from the first to the last reading of a static run.
        gain_below: relative error of the amplifier's slope below rest.
        stiffening: relative increase of the stiffness at a deflection of 1 mm, with the square of it.
        delay_s: of the displacement, beyond what was corrected.
        gain_drift: share by which the dwells grow from the first to the last.
        elongation_offset_m, elongation_slip: added to every elongation, and share of it that the membrane's clamps lose.
        sensor_gain, load_gain, steps_gain: relative errors of scales, of all displacements, all weights, all steps.
        frequency_error: relative error of the frequency of the free dwell.
        membrane_gain, membrane_slip_m: of the fourth membrane dwell alone.
        bad_static, bad_dwell, bad_mass_kg: error of one point: relative, relative, and of one label.
    """

    L: float = 2.2e-2
    L1: float = 0.8e-2
    L2: float = 1.5e-2
    h_Al: float = 2.0e-4
    rho1: float = 1.13e-2
    rho2: float = 2.50e-2
    k2: float = 7.0e-3
    mu: float = -1.33e-5
    c0: float = 159.0
    m_add: float = 7.73e-3
    h_m: float = 1.4e-3
    E_m: float = 6.95e6
    c_s_0: float = 165.0
    c_s_delta: float = 5.48e4
    contact_m: float = 7e-3
    mass_fraction: float = 1.0
    mass_offset_kg: float = 0.0
    asymmetry: float = 0.0
    creep: float = 0.0
    hysteresis: float = 0.0
    clamp: float = 0.0
    load_offset_kg: float = 0.0
    zero_drift_m: float = 0.0
    gain_below: float = 0.0
    stiffening: float = 0.0
    delay_s: float = 0.0
    gain_drift: float = 0.0
    elongation_offset_m: float = 0.0
    elongation_slip: float = 0.0
    sensor_gain: float = 0.0
    load_gain: float = 0.0
    steps_gain: float = 0.0
    frequency_error: float = 0.0
    membrane_gain: float = 0.0
    membrane_slip_m: float = 0.0
    bad_static: float = 0.0
    bad_dwell: float = 0.0
    bad_mass_kg: float = 0.0

    @property
    def low_v(self) -> float:
        """Lower end of the amplifier's range with the error of its slope, V."""
        return -500 * (1 + self.gain_below)

    def skin(self, elongation_m: float | None) -> tuple[float, float]:
        """Stiffness (N/m^2) and damping (kg/(m s)) of the membrane under the cylinder."""
        if elongation_m is None:
            return 0.0, 0.0
        length, width = 0.17, 0.066
        delta = (elongation_m * (1 - self.elongation_slip) + self.elongation_offset_m) / length
        tension = self.E_m * width * self.h_m * max(delta, 1e-9)
        u = length / 4 * np.sqrt(tension / (self.E_m * width * self.h_m**3 / 12))
        if u < 0.05:
            point = 192 * self.E_m * width * self.h_m**3 / 12 / length**3 * (1 + 0.4 * u * u)
        else:
            point = 4 * tension / length / (1 - np.tanh(u) / u)
        return point / self.contact_m, self.c_s_0 + self.c_s_delta * delta

    def response(
        self,
        f: np.ndarray,
        mass_kg: float | None = None,
        skin: tuple[float, float] = (0.0, 0.0),
        load: bool = False,
        stiffer: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """Deflection of the centre per volt on the specimen or per newton at the centre, (F,), complex."""
        M, C, K, where, k1 = _beam(self.L, self.L1, self.L2, self.h_Al, self.rho1, self.rho2, self.k2)
        third = where.third
        mass = self.m_add if mass_kg is None else mass_kg
        M = M + mass / (2 * (self.L - self.L2)) * third
        C = self.c0 * C + skin[1] * third
        keep = np.setdiff1d(np.arange(len(K)), [0, len(K) - 1] + ([] if self.clamp else [1]))
        K = K.copy()
        if self.clamp:
            K[1, 1] += k1 / self.L1 / self.clamp
        B = np.zeros(len(K))
        if load:
            B[-2] = 0.5
        else:
            B[where.step] = -self.mu
        w = 2 * np.pi * np.atleast_1d(f)[:, None, None]
        s = np.broadcast_to(1 + np.asarray(stiffer), (w.size,))[:, None, None]
        Z = s * K + skin[0] * third - w * w * M + 1j * w * C
        at = int(np.flatnonzero(keep == len(B) - 2)[0])
        return np.linalg.solve(Z[:, keep[:, None], keep], B[keep][:, None])[:, at, 0]

    @lru_cache(maxsize=256)  # noqa: B019
    def vibration(
        self, f: tuple[float, ...], volts: float, mass_kg: float | None, skin: tuple[float, float]
    ) -> np.ndarray:
        """Amplitude (complex, m) under a sine of `volts` on the specimen; stiffening by harmonic balance."""
        w = volts * self.response(np.array(f), mass_kg, skin)
        for _ in range(25 if self.stiffening else 0):
            w = 0.5 * w + 0.5 * volts * self.response(
                np.array(f), mass_kg, skin, stiffer=0.75 * self.stiffening * (abs(w) / 1e-3) ** 2
            )
        return w

    def static(self, linear_m: np.ndarray) -> np.ndarray:
        """Deflection where the linear specimen has `linear_m`."""
        w = linear_m.copy()
        for _ in range(60 if self.stiffening else 0):
            w = 0.5 * w + 0.5 * linear_m / (1 + self.stiffening * (w / 1e-3) ** 2)
        return w

    def crept(self, seconds: float) -> float:
        """Factor of a deflection that was held for some seconds."""
        return 1 + self.creep * float(np.log10(seconds * 2 * np.pi * 100))

    def late(self, f: np.ndarray) -> np.ndarray:
        """Factor of the response to a sine by creep."""
        return 1 - self.creep * (np.log10(f / 100) + (np.euler_gamma + 0.5j * np.pi) / np.log(10))

    def peak_hz(self, mass_kg: float) -> float:
        """Frequency of the largest response, by ever finer scans and a last parabola; NaN for a response that falls from 60 Hz on."""
        low, high = 60.0, 700.0
        for _ in range(4):
            f = np.linspace(low, high, 13)
            y = abs(self.response(f, mass_kg) * self.late(f))
            if low == 60.0 and not y.argmax():
                return float("nan")
            top = int(np.clip(y.argmax(), 1, 11))
            low, high = f[top - 1], f[top + 1]
        a, b, c = y[top - 1 : top + 2]
        return float(f[top] + (f[1] - f[0]) / 2 * (a - c) / (a - 2 * b + c))

    @lru_cache(maxsize=64)  # noqa: B019
    def pole_hz(self) -> complex:
        """First pole over 2 pi, by the secant method on the inverse response at complex frequencies."""
        f, g = 155 + 33j, 155.1 + 33j
        for _ in range(60):
            a, b = (1 / self.response(np.array([x]))[0] for x in (f, g))
            if abs(g - f) < 1e-9:
                break
            f, g = g, g - b * (g - f) / (b - a)
        return complex(1j * g)

    @lru_cache(maxsize=64)  # noqa: B019
    def peaks_hz(self) -> np.ndarray:
        """Resonances with each of the added masses and slopes to the mass, (2, F)."""
        masses = self.mass_fraction * MASSES_KG + self.mass_offset_kg
        f = np.array([self.peak_hz(m) for m in masses])
        return np.array((f, [self.peak_hz(m + 1e-4) for m in masses] - f)) / np.array([[1.0], [1e-4]])


@dataclass(frozen=True)
class _Places:
    third: np.ndarray
    step: int


@lru_cache(maxsize=64)
def _beam(L: float, L1: float, L2: float, h_Al: float, rho1: float, rho2: float, k2: float) -> Any:
    """Matrices of the half beam without added mass, damping of 1 kg/(m s), the third segment's own, and k1."""
    k1 = 69e9 * 2.0e-2 * h_Al**3 / 12
    ends = (0.0, L1, L2, L)
    x = np.concatenate([np.linspace(a, b, ELEMENTS + 1)[:-1] for a, b in pairwise(ends)] + [[L]])
    size = 2 * x.size
    M, C, K, third = (np.zeros((size, size)) for _ in range(4))
    for i in range(x.size - 1):
        h = float(x[i + 1] - x[i])
        bend = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]) / h**3
        even = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]) * h / 420
        turn = np.outer([1, h, 1, h], [1, h, 1, h])
        here = slice(2 * i, 2 * i + 4)
        segment = i // ELEMENTS
        K[here, here] += (k1 if segment == 0 else k2) * bend * turn
        M[here, here] += (rho1 if segment == 0 else rho2) * even * turn
        C[here, here] += even * turn
        if segment == 2:
            third[here, here] += even * turn
    return M, C, K, _Places(third, 2 * ELEMENTS + 1), k1


def measure(lab: Laboratory, seed: int, small: bool = False, swept: bool = False) -> ObservationSet:
    """Return a campaign with noise and shared errors drawn: all runs of the paper, or loads, masses and a free dwell only.

    `swept` adds a sweep and a free decay of the free tactor; the other runs stay as they are.
    """
    rng = np.random.default_rng(seed)
    drawn = {e.name: e.standard_error * rng.standard_normal() for e in (SENSOR, AMPLIFIER, DELAY, BALANCE, CLAY)}
    scale = (1 + drawn[SENSOR.name]) * (1 + lab.sensor_gain)
    runs: list[Observation] = [
        _loading(lab, side, scale * (1 + drawn[BALANCE.name]), rng) for side in ("mfc", "aluminium")
    ]
    runs.append(_masses(lab, drawn[CLAY.name], rng))
    late, dwell_scale = drawn[DELAY.name], scale * (1 + drawn[AMPLIFIER.name])
    if not small:
        runs.append(_steps(lab, dwell_scale, rng))
    plan: list[tuple[str, float | None]] = [("free", None)]
    if not small:
        plan += [(f"membrane {1e3 * e:.3g} mm", e) for e in ELONGATIONS_M] + [("free again", None)]
    for place, (label, elongation) in enumerate(plan):
        grown = 1 + lab.gain_drift * place / max(len(plan) - 1, 1)
        runs.append(_dwell(lab, label, elongation, place, dwell_scale * grown, late, rng))
    if not small:
        w = _sag(lab.h_m, lab.E_m) * np.ones(5)
        seen = w * (scale + 0.01 * rng.standard_normal(5))
        runs.append(MembraneSagObservation("sag", seen, 0.01 * w, shared_errors=(SENSOR,), simulated=True))
    if swept:
        runs += [_sweep(lab, dwell_scale, late, rng), _decay(lab, rng)]
    return ObservationSet(tuple(runs))


def _loading(lab: Laboratory, side: Any, scale: float, rng: np.random.Generator) -> StaticLoadingObservation:
    kg = np.concatenate([rng.permutation(WEIGHTS_KG) for _ in range(STATIC_REPEATS)])
    per_newton = lab.response(np.zeros(1), load=True)[0].real
    force = G * (kg + lab.load_offset_kg) * (1 + lab.load_gain)
    sign = 1 if side == "mfc" else -1
    w = lab.static(force * per_newton) * (1 + sign * lab.asymmetry) * lab.crept(10.0) * scale
    nominal = G * kg * per_newton
    errors = 0.005 * nominal + 2e-7
    w = w + lab.zero_drift_m * np.linspace(0, 1, kg.size) + errors * rng.standard_normal(kg.size)
    if lab.bad_static and side == "mfc":
        w[int(np.flatnonzero(kg == 0.1)[1])] *= 1 + lab.bad_static
    return StaticLoadingObservation(
        f"loading {side}", G * kg, w, errors, side, shared_errors=(SENSOR, BALANCE), simulated=True
    )


def _masses(lab: Laboratory, offset: float, rng: np.random.Generator) -> MassResonanceObservation:
    f, per_kg = lab.peaks_hz()
    f = f + per_kg * offset
    labels = MASSES_KG.copy()
    labels[4] += lab.bad_mass_kg
    errors = np.full(f.size, 0.3)
    return MassResonanceObservation(
        "masses", labels, f + errors * rng.standard_normal(f.size), errors, shared_errors=(CLAY,), simulated=True
    )


def _volts(lab: Laboratory, level: np.ndarray) -> np.ndarray:
    u = level - 2.5
    return np.where(u < 0, 200 * (1 + lab.gain_below), 600) * u


def _steps(lab: Laboratory, scale: float, rng: np.random.Generator) -> VoltageStepsObservation:
    V = _volts(lab, LEVELS_V)
    rising = np.arange(LEVELS_V.size) < LEVELS_V.size // 2 + 1
    acting = staircase(V, lab.hysteresis, lab.creep, 1 / (200 * np.pi), lab.low_v)
    per_volt = lab.response(np.zeros(1))[0].real
    w = lab.static(per_volt * acting) * scale * (1 + lab.steps_gain)
    errors = 0.005 * abs(per_volt * V) + 2e-7
    return VoltageStepsObservation(
        "steps", LEVELS_V, w + errors * rng.standard_normal(w.size), errors, rising, np.ones(w.size),
        shared_errors=(SENSOR, AMPLIFIER), simulated=True,
    )  # fmt: skip


def _dwell(
    lab: Laboratory, label: str, elongation: float | None, place: int, scale: float, late: float, rng: Any
) -> FrequencyResponseObservation:
    f = FREQUENCIES_HZ * (1 + (lab.frequency_error if label == "free" else 0.0))
    fourth = elongation == ELONGATIONS_M[3]
    skin = lab.skin(None if elongation is None else elongation + (lab.membrane_slip_m if fourth else 0.0))
    w, errors = _driven(lab, f, late, skin)
    w = w * scale * (1 + (lab.membrane_gain if fourth else 0.0))
    w = w + errors * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    if lab.bad_dwell and label == "free":
        w[10] *= 1 + lab.bad_dwell
    return FrequencyResponseObservation(
        label, FREQUENCIES_HZ, w, errors, 2.5, 2.5, elongation, order=float(place),
        shared_errors=(SENSOR, AMPLIFIER, DELAY), simulated=True,
    )  # fmt: skip


def _driven(lab: Laboratory, f: np.ndarray, late: float, skin: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Fundamental under 5 V peak to peak as the sensor tells it, and the standard error of each of its components."""
    volts = 2.5 * (600 + 200 * (1 + lab.gain_below)) / 2
    w = lab.vibration(tuple(f), volts, None, skin)
    errors = 0.003 * abs(w) + 2e-7
    w = w * lab.late(f)
    return w * (1 + lab.hysteresis * _loop(lab.low_v)) * np.exp(-2j * np.pi * f * (late + lab.delay_s)), errors


def _sweep(lab: Laboratory, scale: float, late: float, rng: Any) -> FrequencyResponseObservation:
    w, errors = _driven(lab, SWEPT_HZ, late, (0.0, 0.0))
    w = w * scale + errors * (rng.standard_normal(w.size) + 1j * rng.standard_normal(w.size))
    return FrequencyResponseObservation(
        "sweep", SWEPT_HZ, w, errors, swept=True, shared_errors=(SENSOR, AMPLIFIER, DELAY), simulated=True
    )


def _decay(lab: Laboratory, rng: Any) -> DecayPoleObservation:
    """Edges so small that the specimen is linear; no gain and no delay acts on them."""
    pole, errors_hz, errors = lab.pole_hz(), np.full(EDGES, 0.3), np.full(EDGES, 2e-3)
    f = abs(pole) + errors_hz * rng.standard_normal(EDGES)
    damping = -pole.real / abs(pole) + errors * rng.standard_normal(EDGES)
    return DecayPoleObservation("decay", f, errors_hz, damping, errors, simulated=True)


@lru_cache(maxsize=64)
def _loop(low_v: float) -> complex:
    """Fundamental of a Rayleigh loop over that of the volts, which the amplifier's two slopes bend: 1 - 0.371j, of a sine 1 - 0.424j."""
    turn = np.exp(2j * np.pi * np.arange(3600) / 3600)
    V = np.where(turn.imag < 0, -low_v, 1500) * turn.imag
    late = np.where(turn.real > 0, (V - low_v) ** 2, (1500 - low_v) ** 2 - (1500 - V) ** 2) / (1500 - low_v)
    return complex((late / turn).sum() / (V / turn).sum())


@lru_cache(maxsize=64)
def _sag(h_m: float, E_m: float) -> float:
    """Sag of a clamped strip under its weight, carried by bending and by the tension of its own elongation."""
    length, width, density = 0.17, 0.066, 0.906 / (G * 0.066 * 1.4e-3)
    q, EI, EA = density * G * width * h_m, E_m * width * h_m**3 / 12, E_m * width * h_m
    x = np.linspace(0, length, 2001)

    def shape(T: float) -> np.ndarray:
        k = np.sqrt(T / EI)  # clamped at both ends: w = q/(2T) x (L - x) - q L/(2 T k) (coth - cosh / sinh)
        half = k * length / 2
        return q / (2 * T) * x * (length - x) - q * length / (2 * T * k) * (
            1 / np.tanh(half) - np.cosh(k * (x - length / 2)) / np.sinh(half)
        )

    low, high = 1e-6, 1e4
    for _ in range(100):
        T = np.sqrt(low * high)
        w = shape(T)
        slope = np.gradient(w, x)
        stretch = EA * float(((slope[1:] ** 2 + slope[:-1] ** 2) / 2 * np.diff(x)).sum()) / (2 * length)
        low, high = (T, high) if stretch > T else (low, T)
    return float(shape(T)[1000])
