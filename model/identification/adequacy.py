"""Is the misfit noise, or is the model wrong? Every test with its exact null distribution for normal errors, and a verdict.

Score tests: with H the projection on what the fit can follow, a departure d is in the residuals r with the size
d.r / d.(1 - H)d, give or take (d.(1 - H)d)^-1/2: as if it had been fitted as one more parameter. Patterns: the
correlation of neighbouring residuals against its exact mean and variance under 1 - H.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtr

from model.identification.fit_result import DOUBTFUL, JointFit, Residuals, chance
from model.identification.forward_model import Values, beam_of, factors_of, skin_of
from model.identification.model_discrepancy import Departure, departures
from model.identification.observations import FrequencyResponse
from model.identification.receptance import Dense
from model.response.drive_spectrum import series

Array = NDArray[np.float64]

SIGNIFICANT = 0.01
"""Probability, over all tests together, below which a finding is told."""
HARMONICS = (2, 3, 4, 5)
HARMONIC_TOLERANCE = 0.03
"""Of a harmonic's predicted amplitude: the amplifier's map and the upper modes are not known better."""


@dataclass(frozen=True)
class Finding:
    """One way in which the data do not follow the model."""

    kind: str
    runs: tuple[str, ...]
    size: float
    """A share (1 is one hundred percent), or a correlation for a pattern."""
    standard_error: float
    probability: float
    """Of so much by chance in any of all tests made (Bonferroni)."""
    words: str


@dataclass(frozen=True)
class Adequacy:
    """The verdict: `adequate` is None where the runs cannot test the model."""

    adequate: bool | None
    words: str
    findings: tuple[Finding, ...]
    """The most significant first, patterns that no departure names last."""
    tests: int


def adequacy(fit: JointFit) -> Adequacy:
    """Test the fit for every departure its runs could show, for patterns, harmonics, and the size of the misfit."""
    if fit.freedom <= 0:
        return Adequacy(None, fit.verdict, (), 0)
    Q, ways = _followed(fit), departures(fit)
    findings, tests = _findings(fit, Q, ways, 1.0)
    left = _left(fit, Q, [w for w in ways if any((w.kind, w.runs) == (f.kind, f.runs) for f in findings)])
    if left > 1 and findings:
        # What no departure explains says that the errors are too small; then departures must stand out from it.
        findings, tests = _findings(fit, Q, ways, left)
    adequate = not findings and fit.probability > DOUBTFUL
    return Adequacy(adequate, _verdict(fit, findings, tests), tuple(findings), tests)


def _findings(fit: JointFit, Q: Array, ways: Sequence[Departure], larger: float) -> tuple[list[Finding], int]:
    """The significant findings if all errors are `larger` than given, and how many tests were made."""
    r = fit.rows / larger
    found = [*_scores(ways, r, Q, larger), *_patterns(fit, r, Q), *_harmonics(fit, larger)]
    tests = len(found) + 1
    told = [replace(f, probability=min(1.0, f.probability * tests)) for f in found]
    told = [f for f in told if f.probability < SIGNIFICANT]
    return sorted(told, key=lambda f: (f.kind == "pattern", f.probability)), tests


def _left(fit: JointFit, Q: Array, ways: Sequence[Departure]) -> float:
    """Root of the reduced chi-square that is left when these departures are taken out; 1 where that can be chance."""
    basis = np.linalg.svd(
        np.column_stack((Q, *(w.direction / np.linalg.norm(w.direction) for w in ways))), full_matrices=False
    )
    B = basis[0][:, basis[1] > 1e-6]
    rest = fit.rows - B @ (B.T @ fit.rows)
    freedom = fit.rows.size - B.shape[1]
    if freedom <= 0 or chdtrc(freedom, rest @ rest) > DOUBTFUL:
        return 1.0
    return float(np.sqrt(rest @ rest / freedom))


def _verdict(fit: JointFit, findings: list[Finding], tests: int) -> str:
    chi = f"chi-square {fit.chi_square:.0f} for {fit.freedom} degrees of freedom, {chance(fit.probability, 2)}"
    if findings:
        first = "; ".join(f"{f.words} ({chance(f.probability)})" for f in findings[:3])
        more = f"; and {len(findings) - 3} more" if len(findings) > 3 else ""
        return f"the model is wrong for these runs: {first}{more}. {chi}"
    if fit.probability <= DOUBTFUL:
        worst = max(fit.residuals, key=_reduced)
        return (
            f"the misfit is {np.sqrt(fit.chi_square / fit.freedom):.2g} times the errors given but follows no pattern of {tests} "
            f"looked for: the errors are too small, or points are wrong, most of all in {worst.label}. {chi}"
        )
    return f"the misfit is noise: none of {tests} tests for a wrong model is significant. {chi}"


def _reduced(run: Residuals) -> float:
    return run.chi_square / max(run.values.size, 1)


def _followed(fit: JointFit) -> Array:
    """Orthonormal basis (rows, k) of what the fit can follow."""
    J = fit.jacobian * fit.scale
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    return np.asarray(U[:, s > 1e-7 * s[0]])


def _scores(ways: Sequence[Departure], r: Array, Q: Array, larger: float) -> list[Finding]:
    out = []
    for departure in ways:
        d = departure.direction / larger
        rest = d - Q @ (Q.T @ d)
        weight = float(rest @ rest)
        if weight <= 1e-6 * float(d @ d) or weight == 0:
            continue  # the fit follows it wholly: these runs cannot tell
        size, error = float(rest @ r) / weight, weight**-0.5
        p = float(2 * ndtr(-abs(size) / error))
        said = departure.words.format(f"{100 * size:+.2g} +- {100 * error:.1g}")
        out.append(Finding(departure.kind, departure.runs, size, error, p, said))
    return out


def _patterns(fit: JointFit, r: Array, Q: Array) -> list[Finding]:
    """Neighbours of one run: sum of products, normal by its exact mean and variance for r = (1 - H) e."""
    out = []
    for run, part in zip(fit.residuals, fit.slices, strict=True):
        n = r[part].size
        if n < 6:
            continue
        q = Q[part]
        S = np.eye(n) - q @ q.T  # covariance of the run's residuals
        L = np.zeros((n, n))
        half = n // 2 if _has_phase(fit, run.label) else n
        for i in range(n - 1):
            if i + 1 != half:
                L[i, i + 1] = L[i + 1, i] = 0.5
        A = L @ S
        z = (float(r[part] @ L @ r[part]) - float(np.trace(A))) / float(np.sqrt(2 * np.sum(A * A.T)))
        correlation = float(r[part] @ L @ r[part] / max(float(r[part] @ r[part]), 1e-300))
        words = f"residuals of {run.label} follow each other (correlation of neighbours {correlation:+.2f}): a pattern, not noise"
        # skewed like a chi-square, so the tail of the normal is taken with twice its probability
        p = min(1.0, 2 * float(2 * ndtr(-max(z, 0.0))))
        out.append(Finding("pattern", (run.label,), correlation, float(1 / np.sqrt(n)), p, words))
    return out


def _has_phase(fit: JointFit, label: str) -> bool:
    run = next(r for r in fit.campaign.runs if r.label == label)
    return isinstance(run, FrequencyResponse) and np.asarray(run.fundamental_m).dtype.kind == "c"


def _harmonics(fit: JointFit, larger: float) -> list[Finding]:
    """Measured harmonics against those the amplifier's two slopes make of the linear model."""
    from scipy.stats import ncx2

    out = []
    for run in fit.campaign.of(FrequencyResponse):
        noise = run.errors_m if run.harmonic_errors_m is None else run.harmonic_errors_m
        if run.harmonics_m is None or noise is None or run.fundamental_m is None:
            continue
        for k in HARMONICS:
            if k > run.harmonics_m.shape[1]:
                break
            h = run.harmonics_m[run.use, k - 1]
            here = np.isfinite(h)
            if not here.any():
                continue
            f = run.frequency_hz[run.use][here]
            expected = _expected(fit, run, k, f, here)
            error: Array = np.hypot(larger * noise[run.use][here], HARMONIC_TOLERANCE * expected)
            h = h[here]
            p = float(ncx2.sf(np.sum((h / error) ** 2), 2 * h.size, max(float(np.sum((expected / error) ** 2)), 1e-12)))
            excess = float(np.sqrt(max(float(np.mean(h**2 - expected**2 - 2 * error**2)), 0.0)))
            whole = float(np.sqrt(np.mean(np.abs(np.asarray(run.fundamental_m)[run.use][here]) ** 2)))
            share = excess / whole
            name = {2: "second", 3: "third", 4: "fourth", 5: "fifth"}[k]
            words = f"{run.label} has a {name} harmonic of {100 * share:.2g} % of the fundamental beyond the amplifier's: nonlinear"
            out.append(Finding("harmonic", (run.label,), share, float(np.sqrt(np.mean(error**2))) / whole, p, words))
    return out


def _expected(fit: JointFit, run: FrequencyResponse, k: int, f: Array, here: NDArray[np.bool_]) -> Array:
    v: Values = fit.values
    factors = factors_of(beam_of(v, run.added_mass_kg), skin_of(run, v), 1)
    per_volt, l1, l2 = (v[name] / v["L"] for name in ("mu", "L1", "L2"))
    H = Dense(l1, l2, fit.setting.n).response(factors.rows(np.zeros(f.size, int)), 2 * np.pi * k * f)[0]
    drives = np.stack((run.drive_amplitude_v, run.drive_offset_v), axis=-1)[run.use][here]
    different, where = np.unique(drives, axis=0, return_inverse=True)
    V = np.array([abs(series("sine", a, o, fit.setting.amplifier, k)[k]) for a, o in different])[where.ravel()]
    return np.asarray(np.abs(per_volt * H) * V)
