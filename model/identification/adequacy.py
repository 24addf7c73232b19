"""Model adequacy: tests whether the misfit of a fit is noise or a wrong model, and gives a verdict.

Every test has its exact null distribution for normal errors. Score tests: with H the projection on the space of the fit, a
discrepancy d is in the residuals r with the size d.r / d.(1 - H)d and the standard error (d.(1 - H)d)^-1/2, as if it had been
fitted as one more parameter. Patterns: the correlation of neighbouring residuals against its exact mean and variance under 1 - H.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, gammaln, ndtr

from model import Array, Mask
from model.identification import attribution
from model.identification.fit_result import MIN_P_VALUE, JointFit, format_p_value
from model.identification.forward_model import Values, beam_under, equation_factors, skin_from_values
from model.identification.model_discrepancy import Discrepancy, clamp_discrepancy, possible_discrepancies
from model.identification.nonidealities import loop_harmonic, specimen_harmonic, with_flexible_clamp
from model.identification.observations import FrequencyResponseObservation, observed_values
from model.identification.receptance import ReceptanceSolver

SIGNIFICANCE_LEVEL = 0.05
"""Probability over all tests together below which the model is not adequate: rate of false alarms among runs of a correct model."""
MIN_PATTERN_ROWS = 6
"""Smallest number of residuals of a run for a comparison of neighbours."""
CLAMP = attribution.Cause("parameter", "clamp_flexibility")
TESTED_HARMONICS = (2, 3, 4, 5)
HARMONIC_TOLERANCE = 0.03
"""Relative error of a harmonic's predicted amplitude, by amplifier map and upper modes."""


@dataclass(frozen=True)
class Finding:
    """One discrepancy between data and model."""

    kind: str
    runs: tuple[str, ...]
    size: float
    """A share (1 is one hundred percent), or a correlation for a pattern."""
    standard_error: float
    probability: float
    """Bonferroni-corrected p-value."""
    text: str


@dataclass(frozen=True)
class Adequacy:
    """Adequacy of the model; `adequate` is None for runs that cannot test it."""

    adequate: bool | None
    message: str
    findings: tuple[Finding, ...]
    """The most significant first, unexplained patterns last."""
    test_count: int
    diagnosis: attribution.Diagnosis | None = None
    """Causes that explain the misfit of an inadequate model."""
    undecidable: tuple[attribution.UndecidableError, ...] = ()
    """Scale errors that these runs cannot show, with the measurement that can."""


def assess_adequacy(fit: JointFit, attribute: bool = True, cancelled: Callable[[], bool] | None = None) -> Adequacy:
    """Test a fit for every discrepancy that its runs can show, for patterns, harmonics, and the size of the misfit.

    `attribute` fits the likeliest causes of an inadequate model, which takes several times as long as the fit.

    Raises:
        FitCancelled: `cancelled` returned true.
    """
    if fit.degrees_of_freedom <= 0:
        return Adequacy(None, fit.verdict, (), 0)
    Q, discrepancies, cause_effects = (
        attribution.fit_subspace(fit),
        possible_discrepancies(fit),
        attribution.effects(fit),
    )
    if (clamp := cause_effects.get(CLAMP)) is not None:
        discrepancies = (*discrepancies, clamp_discrepancy(fit, clamp))
    directions = [*(d.direction for d in discrepancies), *cause_effects.values()]
    unseen = tuple(attribution.undecidable_errors(fit, cause_effects))
    harmonics = _harmonic_tests(fit, 1.0)
    chance = attribution.chance_of_smallest(fit, Q, directions, [pattern for _, pattern in _patterns(fit, Q)])
    tests = len(directions) + len(harmonics) + sum(run.values.size > 1 for run in fit.residuals) + 1
    if harmonics:
        least = min(1.0, min(f.probability for f in harmonics) * len(harmonics))
        chance = float(-np.expm1(2 * np.log1p(-min(chance, least, 1 - 1e-12))))
    if chance > SIGNIFICANCE_LEVEL:
        return Adequacy(True, _noise_message(fit, tests, chance), (), tests, undecidable=unseen)
    findings, _ = _significant_findings(fit, Q, discrepancies, 1.0)
    left = _residual_error_scale(
        fit, Q, [w for w in discrepancies if any((w.kind, w.runs) == (f.kind, f.runs) for f in findings)]
    )
    if left > 1 and findings:
        # The unexplained rest shows that the errors are too small: discrepancies must exceed the enlarged errors.
        findings, _ = _significant_findings(fit, Q, discrepancies, left)
    diagnosis = attribution.diagnose(fit, cause_effects, cancelled=cancelled) if attribute else None
    message = _verdict_message(fit, findings, tests, diagnosis, chance)
    return Adequacy(False, message, tuple(findings), tests, diagnosis, unseen)


def _cause_message(diagnosis: attribution.Diagnosis) -> str:
    """Return the likeliest cause as text, and the causes that the runs do not distinguish from it."""
    first, *others = diagnosis.likeliest
    text = f"the model is wrong for these runs, most likely because {first.text}"
    if others:
        text += "; these runs do not distinguish it from: " + "; or ".join(e.cause_text for e in others)
    return text


def _significant_findings(
    fit: JointFit, Q: Array, discrepancies: Sequence[Discrepancy], error_scale: float
) -> tuple[list[Finding], int]:
    """The significant findings with all errors multiplied by `error_scale`, and the number of tests."""
    r = np.where(fit.used_rows, fit.weighted_residuals, 0.0) / error_scale
    findings = [
        *_score_tests(fit, discrepancies, r, Q, error_scale),
        *_pattern_tests(fit, r, Q),
        *_harmonic_tests(fit, error_scale),
    ]
    tests = len(findings) + 1
    significant = [replace(f, probability=min(1.0, f.probability * tests)) for f in findings]
    significant = [f for f in significant if f.probability < SIGNIFICANCE_LEVEL]
    return sorted(significant, key=lambda f: (f.kind == "pattern", f.probability)), tests


def _residual_error_scale(fit: JointFit, Q: Array, discrepancies: Sequence[Discrepancy]) -> float:
    """Return the root of the reduced chi-square without these discrepancies; 1 if it can be chance."""
    basis = np.linalg.svd(
        np.column_stack((Q, *(w.direction / np.linalg.norm(w.direction) for w in discrepancies))), full_matrices=False
    )
    B = basis[0][:, basis[1] > 1e-6]
    r = np.where(fit.used_rows, fit.weighted_residuals, 0.0)
    rest = r - B @ (B.T @ r)
    freedom = int(fit.used_rows.sum()) - B.shape[1]
    if freedom <= 0 or chdtrc(freedom, rest @ rest) > MIN_P_VALUE:
        return 1.0
    return float(np.sqrt(rest @ rest / freedom))


def _chi_square_text(fit: JointFit) -> str:
    return f"chi-square {fit.chi_square:.0f} for {fit.degrees_of_freedom} degrees of freedom, {format_p_value(fit.p_value, 2)}"


def _noise_message(fit: JointFit, tests: int, chance: float) -> str:
    return (
        f"the misfit is noise: none of {tests} tests for a wrong model is significant ({format_p_value(chance, 2)} for the least "
        f"likely of them). {_chi_square_text(fit)}"
    )


def _verdict_message(
    fit: JointFit, findings: list[Finding], tests: int, diagnosis: attribution.Diagnosis | None, chance: float
) -> str:
    chi = _chi_square_text(fit)
    if diagnosis is not None and diagnosis.likeliest:
        seen = "; ".join(f"{f.text} ({format_p_value(f.probability)})" for f in findings[:2])
        return f"{_cause_message(diagnosis)}{f'. Without it: {seen}' if seen else ''}. {chi}"
    if findings:
        first = "; ".join(f"{f.text} ({format_p_value(f.probability)})" for f in findings[:3])
        more = f"; and {len(findings) - 3} more" if len(findings) > 3 else ""
        return f"the model is wrong for these runs: {first}{more}. {chi}"
    if fit.p_value <= MIN_P_VALUE:
        worst = max(fit.residuals, key=lambda run: run.chi_square / max(run.values.size, 1))
        return (
            f"the misfit is {np.sqrt(fit.chi_square / fit.degrees_of_freedom):.2g} times the errors given but follows no pattern of {tests} "
            f"looked for: the errors are too small, or points are wrong, most of all in {worst.label}. {chi}"
        )
    return (
        f"the misfit is more than noise ({format_p_value(chance, 2)} for the least likely of {tests} tests), but no single one "
        f"shows the cause: repeat the doubtful measurements. {chi}"
    )


def _score_tests(
    fit: JointFit, discrepancies: Sequence[Discrepancy], r: Array, Q: Array, error_scale: float
) -> list[Finding]:
    out = []
    for departure in discrepancies:
        d = np.where(fit.used_rows, departure.direction, 0.0) / error_scale
        rest = d - Q @ (Q.T @ d)
        weight = float(rest @ rest)
        if weight <= 1e-6 * float(d @ d) or weight == 0:
            continue  # inside the space of the fit: these runs cannot show it
        size, error = float(rest @ r) / weight, weight**-0.5
        p = float(2 * ndtr(-abs(size) / error))
        out.append(Finding(departure.kind, departure.runs, size, error, p, departure.describe(size, error)))
    return out


def _patterns(fit: JointFit, Q: Array) -> list[tuple[str, attribution.Pattern]]:
    """Return for each run the sum of products of neighbours, with its exact mean and deviation for r = (1 - H) e."""
    out = []
    for run, part, observation in zip(fit.residuals, fit.run_slices, fit.observations.runs, strict=True):
        n = part.stop - part.start
        if n < MIN_PATTERN_ROWS:
            continue
        q = Q[part]
        S = np.eye(n) - q @ q.T  # covariance of the run's residuals
        L = np.zeros((n, n))
        half = n // 2 if np.iscomplexobj(observed_values(observation)[0]) else n
        for i in range(n - 1):
            if i + 1 != half:
                L[i, i + 1] = L[i + 1, i] = 0.5
        A = L @ S
        out.append((run.label, attribution.Pattern(part, L, float(np.trace(A)), float(np.sqrt(2 * np.sum(A * A.T))))))
    return out


def _pattern_tests(fit: JointFit, r: Array, Q: Array) -> list[Finding]:
    out = []
    for label, (part, L, mean, deviation) in _patterns(fit, Q):
        products = float(r[part] @ L @ r[part])
        z = (products - mean) / deviation
        correlation = products / max(float(r[part] @ r[part]), 1e-300)
        message = f"residuals of {label} follow each other (correlation of neighbours {correlation:+.2f}): a pattern, not noise"
        # skewed like a chi-square, so the tail of the normal is taken with twice its probability
        p = min(1.0, 2 * float(2 * ndtr(-max(z, 0.0))))
        out.append(Finding("pattern", (label,), correlation, float(1 / np.sqrt(r[part].size)), p, message))
    return out


def _harmonic_tests(fit: JointFit, error_scale: float) -> list[Finding]:
    """Yield tests of measured harmonics against the harmonics of the linear model with the amplifier's two slopes."""
    out = []
    for run in fit.observations.of_type(FrequencyResponseObservation):
        noise = run.errors_m if run.harmonic_errors_m is None else run.harmonic_errors_m
        if run.harmonics_m is None or noise is None or run.fundamental_m is None:
            continue
        for k in TESTED_HARMONICS:
            if k > run.harmonics_m.shape[1]:
                break
            h = run.harmonics_m[run.usable, k - 1]
            here = np.isfinite(h)
            if not here.any():
                continue
            f = run.frequency_hz[run.usable][here]
            expected = _predicted_harmonic(fit, run, k, f, here)
            error: Array = np.hypot(error_scale * noise[run.usable][here], HARMONIC_TOLERANCE * expected)
            h = h[here]
            p = noncentral_chi_square_tail(
                float(np.sum((h / error) ** 2)), 2 * h.size, float(np.sum((expected / error) ** 2))
            )
            excess = float(np.sqrt(max(float(np.mean(h**2 - expected**2 - 2 * error**2)), 0.0)))
            whole = float(np.sqrt(np.mean(np.abs(np.asarray(run.fundamental_m)[run.usable][here]) ** 2)))
            share = excess / whole
            name = {2: "second", 3: "third", 4: "fourth", 5: "fifth"}[k]
            message = f"{run.label} has a {name} harmonic of {100 * share:.2g} % of the fundamental beyond the amplifier's: nonlinear"
            out.append(Finding("harmonic", (run.label,), share, float(np.sqrt(np.mean(error**2))) / whole, p, message))
    return out


def noncentral_chi_square_tail(value: float, degrees: int, noncentrality: float) -> float:
    """Return the probability of more than `value`: a Poisson mixture of central tails, without loading `scipy.stats`."""
    half = max(noncentrality, 1e-12) / 2
    largest = np.sqrt(half * max(value / 2, half))  # the order of the largest term
    j = np.arange(np.ceil(largest + 40 * np.sqrt(largest + 1) + 40))
    return float(np.exp(j * np.log(half) - half - gammaln(j + 1)) @ chdtrc(degrees + 2 * j, value))


def _predicted_harmonic(fit: JointFit, run: FrequencyResponseObservation, k: int, f: Array, here: Mask) -> Array:
    v: Values = with_flexible_clamp(fit.values)
    factors = equation_factors(beam_under(run, v), skin_from_values(run, v), 1)
    per_volt, l1, l2 = (v[name] / v["L"] for name in ("mu", "L1", "L2"))
    H = ReceptanceSolver(l1, l2, fit.options.n).response(factors.take_rows(np.zeros(f.size, int)), 2 * np.pi * k * f)[0]
    volts = specimen_harmonic(run, fit.options.amplifier, k)
    if v["hysteresis"]:
        volts = volts + v["hysteresis"] * loop_harmonic(run, fit.options.amplifier, k)
    return np.asarray(np.abs(per_volt * H) * np.abs(volts[here]))
