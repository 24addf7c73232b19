"""Identification by the steps of the paper, Sec. IV: the reference method.

1 k2 from static loading and mass resonance, 2 mu from voltage steps, 3 effective mass from the free resonance, 4 c0 from
the free peak, 5 E_m from the membrane's sag, 6 c_s per pre-stretch from the peak in 100..250 Hz, 7 the line through c_s(0),
8 Pearson's r of every curve. Each step takes the results of the previous steps as exact; `linearized_errors` propagates the
errors of all data through all steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.special import betainc

from model import AmplifierMap, Array, Mask, Membrane, ParameterError, Tactor, point_stiffness, young_modulus_from_sag
from model.identification import observations as observed
from model.identification.forward_model import equation_factors
from model.identification.nonidealities import specimen_harmonic
from model.identification.parameters import elongation_parameter
from model.identification.receptance import Factors, ReceptanceSolver
from model.response import load_compliance, voltage_gain

DampingTreatment = Literal["counted", "neglected"]


class PaperChainError(ValueError):
    """A step cannot be done with these runs; the message names step, run and remedy."""


@dataclass(frozen=True, slots=True)
class IdentificationStep:
    """One step: its name, the runs it used, its results (SI, by name), and a summary."""

    name: str
    runs: tuple[str, ...]
    values: dict[str, float]
    summary: str


@dataclass(frozen=True, slots=True)
class CurveValidation:
    """How well a curve's shape is predicted: Pearson's r of measured and predicted amplitudes, its p value, points."""

    label: str
    r: float
    p: float
    points: int


@dataclass(frozen=True, slots=True)
class PaperChainResult:
    """Result of the chain."""

    steps: tuple[IdentificationStep, ...]
    tactor: Tactor
    membrane: Membrane
    c_s: dict[float, float]
    """Elongation (m) -> c_s, kg/(m s)."""
    r_squared: float | None
    """Of the line c_s_delta delta + c_s(0), intercept fixed; None without a line."""
    validation: tuple[CurveValidation, ...]

    @property
    def values(self) -> dict[str, float]:
        """All results, by the names of `model.identification.parameters`."""
        return {name: value for step in self.steps for name, value in step.values.items()}


@dataclass(frozen=True)
class PaperChainOptions:
    """Options that the paper leaves open.

    Attributes:
        tactor, membrane: values of parameters that are not identified.
        contact_length: as in `model.skin`.
        static_weight: weight of static loading in step 1; mass resonance has 1 minus this weight. Each of the two distances is
            the sum of squares over the sum of squares of the measured values; the paper does not state its weights, and these are
            independent of units and numbers of points. One half by default.
        damping: "counted" compares measured peaks with the damped model's peaks, like with like, and repeats the steps until c0
            no longer changes k2. "neglected" is the paper's treatment, C = 0: every peak counts as undamped frequency, an error
            of 5 % at a damping ratio of 0.21.
        amplitude: "fundamental" of the sine fit, or half of "peak_to_peak" as in the paper. A run with only one of them is used
            with it.
        amplifier, n: the amplifier's map, and the number of shape functions.
    """

    tactor: Tactor = field(default_factory=Tactor)
    membrane: Membrane = field(default_factory=Membrane)
    contact_length: float | None = None
    static_weight: float = 0.5
    damping: DampingTreatment = "counted"
    amplitude: Literal["fundamental", "peak_to_peak"] = "fundamental"
    amplifier: AmplifierMap = field(default_factory=AmplifierMap)
    n: int = 7

    def __post_init__(self) -> None:
        if not 0 <= self.static_weight <= 1:
            raise ParameterError(f"static_weight is {self.static_weight:g}: it must lie between 0 and 1")
        if self.damping not in ("counted", "neglected") or self.amplitude not in ("fundamental", "peak_to_peak"):
            raise ParameterError(
                "damping is counted or neglected, amplitude fundamental or peak_to_peak: choose of these"
            )


def amplitudes(t: Tactor, f: Array, volts: Array, k_s: float = 0.0, c_s: float = 0.0, n: int = 7) -> Array:
    """Peak amplitude (m) of the fundamental at f (Hz) under `volts` on the specimen, all (F,)."""
    one = np.ones_like(f)
    H = ReceptanceSolver(t.L1 / t.L, t.L2 / t.L, n).response(
        tactor_factors(t, t.m_add * one, k_s * one, c_s * one), 2 * np.pi * f
    )[0]
    return np.asarray(np.abs(t.mu / t.L * H) * volts)


def resonance_frequencies(t: Tactor, mass: Array, damped: Mask, n: int) -> tuple[Array, Array]:
    """Resonance frequencies (Hz) for each added mass, of the peak if `damped`, and their slopes to k2."""
    if not mass.size:
        return np.zeros(0), np.zeros(0)
    a = tactor_factors(t, mass, np.zeros_like(mass), np.zeros_like(mass))
    dense = ReceptanceSolver(t.L1 / t.L, t.L2 / t.L, n)
    omega, square = dense.undamped_resonance(a)
    slope = square[:, 4:].sum(-1) / (2 * omega)
    if damped.any():
        peak, s, *_ = dense.resonance_peak(a)
        omega, slope = np.where(damped, peak, omega), np.where(damped, s.K[:, 4:].sum(-1), slope)
    return omega / (2 * np.pi), slope / t.L**3 / (2 * np.pi)


def tactor_factors(t: Tactor, mass: Array, k_s: Array, c_s: Array) -> Factors:
    """Factors of Eq. (14), one row for each added mass (kg) and skin (N/m^2, kg/(m s)), all (R,)."""
    return equation_factors(t.beam._replace(eta=mass / (2 * (t.L - t.L2))), (k_s, c_s), mass.size)


def measured_amplitudes(run: observed.FrequencyResponseObservation, prefer_peak_to_peak: bool) -> tuple[Array, Array]:
    """Frequencies (Hz), rising, and amplitudes (m) of the usable points, (F,); `prefer_peak_to_peak` uses half of max - min."""
    prefer_peak_to_peak = run.fundamental_m is None or (prefer_peak_to_peak and run.peak_to_peak_m is not None)
    A = np.asarray(run.peak_to_peak_m) / 2 if prefer_peak_to_peak else np.abs(np.asarray(run.fundamental_m))
    order = np.argsort(run.frequency_hz[run.usable])
    return run.frequency_hz[run.usable][order], A[run.usable][order]


def average_deflections(runs: Sequence[observed.StaticLoadingObservation]) -> tuple[Array, Array]:
    """Loads (N) and deflections (m), (N,) each: repeats averaged per side and then over the sides (Sec. IV-1)."""
    means: dict[float, dict[str, list[float]]] = {}
    for run in runs:
        for F, w in zip(run.load_n[run.usable], run.deflection_m[run.usable], strict=True):
            means.setdefault(round(float(F), 9), {}).setdefault(run.side, []).append(float(w))
    loads = np.array(list(means))
    return loads, np.array([np.mean([np.mean(v) for v in sides.values()]) for sides in means.values()])


def parabola_vertex(x: Array, y: Array) -> tuple[float, float]:
    """Abscissa and height of the parabola through three points, (3,) each; the middle point if the parabola has no maximum."""
    u = x - x[1]
    a, b, c = np.linalg.solve(np.stack((u * u, u, np.ones(3)), axis=-1), y)
    if not a < 0:
        return float(x[1]), float(y[1])
    shift = float(-b / (2 * a))
    return float(x[1] + shift), float(c + b * shift + a * shift * shift)


PEAK_BAND_HZ = (100.0, 250.0)
"""Band in which the paper searches for the peak on the membrane."""


def identify_by_paper_chain(
    observations: observed.ObservationSet, options: PaperChainOptions | None = None, validated: bool = True
) -> PaperChainResult:
    """Perform the steps that the runs allow; a step without runs keeps the value of `options`.

    `validated` adds the comparison of the curves, the last step.

    Raises:
        PaperChainError: the runs of a step do not determine its parameter.
    """
    return _PaperIdentification(observations, options or PaperChainOptions()).run(validated)


class _PaperIdentification:
    def __init__(self, observations: observed.ObservationSet, options: PaperChainOptions) -> None:
        self.observations, self.options = observations, options
        self.tactor, self.membrane = options.tactor, options.membrane
        self.steps: dict[str, IdentificationStep] = {}
        responses = observations.of_type(observed.FrequencyResponseObservation)
        self.free_runs = [r for r in responses if r.elongation_m is None and r.added_mass_kg is None]
        self.membrane_runs = sorted(
            (r for r in responses if r.elongation_m is not None), key=lambda r: r.elongation_m or 0
        )

    def run(self, validated: bool) -> PaperChainResult:
        peaks = any(m.meaning == "peak" for m in self.observations.of_type(observed.MassResonanceObservation))
        for _ in range(30):
            k2 = self.tactor.k2
            self.identify_stiffness()
            self.identify_coupling()
            self.identify_mass_and_damping()
            # Only with damped peaks does a later step, c0, change the first step.
            if not (peaks and self.options.damping == "counted") or abs(self.tactor.k2 / k2 - 1) < 1e-8:
                break
        self.identify_modulus()
        c_s = self.identify_skin_damping()
        r_squared = self.fit_skin_damping_line(c_s)
        curves = self.validate_curves(c_s) if validated else ()
        return PaperChainResult(tuple(self.steps.values()), self.tactor, self.membrane, c_s, r_squared, curves)

    def record_step(self, name: str, runs: Sequence[str], values: dict[str, float], summary: str) -> None:
        self.steps[name] = IdentificationStep(name, tuple(runs), values, summary)

    def identify_stiffness(self) -> None:
        """Step 1: the weighted sum of both distances is least; Gauss-Newton in log k2."""
        loads, masses = (
            self.observations.of_type(observed.StaticLoadingObservation),
            self.observations.of_type(observed.MassResonanceObservation),
        )
        if not loads and not masses:
            return
        load, w = average_deflections(loads)
        mass = np.concatenate([m.mass_kg[m.usable] for m in masses] or [np.zeros(0)])
        f = np.concatenate([m.frequency_hz[m.usable] for m in masses] or [np.zeros(0)])
        damped = np.concatenate(
            [np.full(int(m.usable.sum()), m.meaning == "peak") for m in masses] or [np.zeros(0, bool)]
        )
        if self.options.damping == "neglected":
            damped = np.zeros_like(damped)
        share = self.options.static_weight if loads and masses else 0.5
        ws, wf = np.sqrt(share) / np.linalg.norm(w) if w.size else 1.0, 1.0
        if f.size:
            wf = np.sqrt(1 - share) / np.linalg.norm(f)
        k2 = self.tactor.k2
        for _ in range(60):
            t = replace(self.tactor, k2=k2)
            C = load_compliance(t)
            dC = (load_compliance(replace(t, k2=k2 * 1.00001)) - load_compliance(replace(t, k2=k2 * 0.99999))) / 2e-5
            resonances, df = resonance_frequencies(t, mass, damped, self.options.n)
            r = np.concatenate((ws * (C * load - w), wf * (resonances - f)))
            J = np.concatenate((ws * dC * load, wf * df * k2))
            step = float(np.clip(-(J @ r) / (J @ J), -1, 1))
            k2 *= np.exp(step)
            if abs(step) < 1e-12:
                break
        else:
            raise PaperChainError(
                "step 1, k2: static loading and mass resonance do not settle on a stiffness; look at both runs"
            )
        self.tactor = replace(self.tactor, k2=float(k2))
        message = f"k2 = {k2:.4g} N m² from {load.size} loads and {f.size} masses"
        message += f", {100 * share:g} % of the weight on the loads" if loads and masses else ""
        self.record_step("k2", [r.label for r in (*loads, *masses)], {"k2": float(k2)}, message)

    def identify_coupling(self) -> None:
        """Step 2: least squares through the origin, Eq. (8)."""
        runs = self.observations.of_type(observed.VoltageStepsObservation)
        if not runs:
            return
        V = np.concatenate([self.options.amplifier.specimen_v(r.input_v[r.usable]) for r in runs])
        w = np.concatenate([r.deflection_m[r.usable] for r in runs])
        if not V.any():
            raise PaperChainError("step 2, mu: every level is rest, so nothing moves; measure at other voltages")
        per_mu = voltage_gain(replace(self.tactor, mu=1.0))
        mu = float(w @ V / (V @ V) / per_mu)
        self.tactor = replace(self.tactor, mu=mu)
        self.record_step("mu", [r.label for r in runs], {"mu": mu}, f"mu = {mu:.4g} N m/V from {V.size} levels")

    def identify_mass_and_damping(self) -> None:
        """Steps 3 and 4: the free peak's frequency and amplitude, of the parabola through its three highest points."""
        if not self.free_runs:
            return
        run = self.free_runs[0]
        f, A = self.measured_amplitudes(run)
        top = int(A.argmax())
        if not 0 < top < A.size - 1:
            raise PaperChainError(
                f"step 3, m_add: the largest amplitude of {run.label!r} is at {f[top]:g} Hz, the end of the run, so the "
                "resonance is not inside; measure further"
            )
        three = slice(top - 1, top + 2)
        at_hz, height = parabola_vertex(f[three], A[three])
        volts = self._specimen_volts(run)[three]

        if self.options.damping == "neglected":
            m = self._mass_for(at_hz)
            c0 = self._damping_for(m, float(A[top]), float(volts[1]))
        else:
            m, c0 = self._solve_mass_and_damping(f[three], volts, at_hz, height, run.label)
        self.tactor = replace(self.tactor, m_add=m, c0=c0)
        text = f"m_add = {1e3 * m:.4g} g from the resonance at {at_hz:.5g} Hz"
        self.record_step("m_add", [run.label], {"m_add": m}, text)
        self.record_step(
            "c0", [run.label], {"c0": c0}, f"c0 = {c0:.4g} kg/(m s) from the peak of {2e6 * height:.4g} um"
        )

    def _solve_mass_and_damping(
        self, f: Array, volts: Array, at_hz: float, height: float, label: str
    ) -> tuple[float, float]:
        """Newton's method in the logarithms, from the last round or from the undamped mass."""

        def off(x: Array) -> Array:
            t = replace(self.tactor, m_add=float(np.exp(x[0])), c0=float(np.exp(x[1])))
            peak_hz, high = parabola_vertex(f, amplitudes(t, f, volts, n=self.options.n))
            return np.array([peak_hz / at_hz - 1, np.log(high / height)])

        starts = [(self.tactor.m_add, self.tactor.c0)] if "c0" in self.steps else []
        masses = [self._mass_for(up * at_hz) for up in (1.03, 1.0, 1.06)] if not starts else [self.tactor.m_add]
        for start in (*starts, *((m, c0) for c0 in (150.0, 75.0, 30.0, 300.0) for m in masses)):
            x = np.log(start)
            for _ in range(40):
                r = off(x)
                J = np.stack([(off(x + d) - r) / 1e-6 for d in 1e-6 * np.eye(2)], axis=-1)
                if not abs(np.linalg.det(J)) > 1e-12:
                    break
                x = x - np.clip(np.linalg.solve(J, r), -0.5, 0.5)
                if np.abs(r).max() < 1e-10:
                    return float(np.exp(x[0])), float(np.exp(x[1]))
        raise PaperChainError(
            f"steps 3 and 4: no mass and damping give {label!r} its peak at {at_hz:.4g} Hz with k2 = {self.tactor.k2:.3g} N m^2 "
            f"and mu = {self.tactor.mu:.3g} N m/V; check those, or the points next to the peak"
        )

    def _mass_for(self, f_hz: float) -> float:
        from scipy.optimize import brentq

        def off(mass: float) -> float:
            return float(
                resonance_frequencies(self.tactor, np.array([mass]), np.array([False]), self.options.n)[0][0] - f_hz
            )

        if off(0.0) <= 0 or off(1.0) >= 0:
            raise PaperChainError(
                f"step 3, m_add: with k2 = {self.tactor.k2:.3g} N m^2 no added mass resonates at {f_hz:.4g} Hz; check k2"
            )
        return float(brentq(off, 0.0, 1.0, xtol=1e-15))

    def _damping_for(self, m: float, amplitude: float, volts: float) -> float:
        from scipy.optimize import brentq

        def off(log_c: float) -> float:
            t = replace(self.tactor, m_add=m, c0=float(np.exp(log_c)))
            a = tactor_factors(t, np.array([m]), np.zeros(1), np.zeros(1))
            dense = ReceptanceSolver(t.L1 / t.L, t.L2 / t.L, self.options.n)
            return float(
                np.log(
                    amplitudes(t, dense.resonance_peak(a).omega / (2 * np.pi), np.array([volts]), n=self.options.n)[0]
                    / amplitude
                )
            )

        low, high = np.log(1e-2), np.log(1e3)
        if off(low) <= 0 or off(high) >= 0:
            raise PaperChainError("step 4, c0: no damping gives the measured peak; check mu and the drive's amplitude")
        return float(np.exp(brentq(off, low, high, xtol=1e-13)))

    def identify_modulus(self) -> None:
        """Step 5: E_m whose sag in the model is the mean of the measured sags."""
        runs = self.observations.of_type(observed.MembraneSagObservation)
        if not runs:
            return
        values = []
        for run in runs:
            strip, w = run.geometry or self.membrane, float(np.mean(run.deflection_m[run.usable]))
            load = run.load_per_length(self.membrane)
            try:
                values.append(young_modulus_from_sag(strip, w, load, run.delta))
            except ParameterError as error:
                raise PaperChainError(f"step 5, E_m: the run {run.label!r}: {error}") from error
        E_m = float(np.mean(values))
        self.membrane = replace(self.membrane, E_m=E_m)
        self.record_step("E_m", [r.label for r in runs], {"E_m": E_m}, f"E_m = {E_m / 1e6:.4g} MPa from the sag")

    def identify_skin_damping(self) -> dict[float, float]:
        """Step 6: per elongation the c_s for which the model's largest amplitude in 100..250 Hz equals the measured one."""
        from scipy.optimize import brentq

        out: dict[float, float] = {}
        for run in self.membrane_runs:
            elongation = run.elongation_m or 0.0
            f, A = self.measured_amplitudes(run)
            inside = (f >= PEAK_BAND_HZ[0]) & (f <= PEAK_BAND_HZ[1])
            if not inside.any():
                raise PaperChainError(f"step 6, c_s: {run.label!r} has no point in 100..250 Hz; measure there")
            largest, volts = float(A[inside].max()), self._specimen_volts(run)[inside]
            k_s = self._k_s(elongation)

            def off(
                c_s: float, f: Array = f[inside], volts: Array = volts, k_s: float = k_s, largest: float = largest
            ) -> float:
                return float(np.log(amplitudes(self.tactor, f, volts, k_s, c_s, self.options.n).max() / largest))

            top = 1e3
            while off(top) > 0 and top < 1e7:
                top *= 4
            message = f"peak of {2e6 * largest:.4g} um"
            if off(0.0) <= 0:
                c_s, message = 0.0, message + ", more than without any damping by the skin"
            else:
                c_s = float(brentq(off, 0.0, top, xtol=1e-12, rtol=1e-13))
            out[elongation] = c_s
            self.record_step(
                elongation_parameter("c_s", elongation),
                [run.label],
                {elongation_parameter("c_s", elongation): c_s},
                f"{c_s:.4g} kg/(m s) from the {message}",
            )
        return out

    def fit_skin_damping_line(self, c_s: dict[float, float]) -> float | None:
        """Step 7: slope by least squares, intercept fixed to c_s(0)."""
        if 0.0 not in c_s:
            return None
        self.membrane = replace(self.membrane, c_s_0=c_s[0.0])
        values = {"c_s_0": c_s[0.0]}
        delta = np.array(list(c_s)) / self.membrane.L_m
        y = np.array(list(c_s.values()))
        r_squared = None
        message = f"c_s(0) = {c_s[0.0]:.4g} kg/(m s)"
        if len(c_s) > 1:
            slope = float(delta @ (y - c_s[0.0]) / (delta @ delta))
            gap = y - c_s[0.0] - slope * delta
            r_squared = float(1 - gap @ gap / ((y - y.mean()) @ (y - y.mean())))
            self.membrane = replace(self.membrane, c_s_delta=slope)
            values["c_s_delta"] = slope
            message = f"c_s = {slope:.4g} delta + {c_s[0.0]:.4g} kg/(m s), R^2 = {r_squared:.3f}"
        self.record_step("line", [r.label for r in self.membrane_runs], values, message)
        return r_squared

    def validate_curves(self, c_s: dict[float, float]) -> tuple[CurveValidation, ...]:
        """Step 8."""
        out = []
        for run in (*self.free_runs, *self.membrane_runs):
            f, A = self.measured_amplitudes(run)
            k_s, c = (0.0, 0.0) if run.elongation_m is None else (self._k_s(run.elongation_m), c_s[run.elongation_m])
            predicted = amplitudes(self.tactor, f, self._specimen_volts(run), k_s, c, self.options.n)
            if A.size > 2 and np.ptp(A) > 0:
                r = float(np.clip(np.corrcoef(A, predicted)[0, 1], -1, 1))
                half = A.size / 2 - 1  # under no correlation (1 + r) / 2 has a beta distribution
                out.append(CurveValidation(run.label, r, 2 * float(betainc(half, half, (1 - abs(r)) / 2)), A.size))
        return tuple(out)

    def measured_amplitudes(self, run: observed.FrequencyResponseObservation) -> tuple[Array, Array]:
        return measured_amplitudes(run, self.options.amplitude == "peak_to_peak")

    def _specimen_volts(self, run: observed.FrequencyResponseObservation) -> Array:
        """Peak volts of the fundamental on the specimen, (F,), in the order of `measured_amplitudes`."""
        volts = np.abs(specimen_harmonic(run, self.options.amplifier))
        return np.asarray(volts[np.argsort(run.frequency_hz[run.usable])])

    def _k_s(self, elongation: float) -> float:
        m, t = self.membrane, self.tactor
        length = t.L - t.L2 if self.options.contact_length is None else self.options.contact_length
        return float(point_stiffness(m.L_m, m.b_m, m.h_m, m.E_m, elongation / m.L_m) / length)
