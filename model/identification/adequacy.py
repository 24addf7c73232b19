"""Model adequacy: tests whether the misfit of a fit is noise or a wrong model, and gives a verdict.

Tested are the evidence for every possible cause, the size of the misfit, the correlation of neighbouring residuals, and harmonics. The
distribution of the most significant of them under noise alone is simulated for this fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, gammaln

from model import Array, Complex
from model.identification import attribution
from model.identification.fit_result import MIN_P_VALUE, JointFit, format_p_value
from model.identification.forward_model import beam_under, equation_factors, skin_from_values
from model.identification.nonidealities import loop_harmonic, specimen_harmonic, values_of_run
from model.identification.observations import FrequencyResponseObservation
from model.identification.receptance import Factors, ReceptanceSolver

SIGNIFICANCE_LEVEL = 0.03
"""Probability over all tests together below which the model is not adequate: rate of false alarms among runs of a correct model."""
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
    """Test a fit for every cause that its runs can show, for patterns, harmonics, and the size of the misfit.

    `attribute` fits the likeliest causes of an inadequate model, which takes several times as long as the fit.

    Raises:
        FitCancelled: `cancelled` returned true.
    """
    if fit.degrees_of_freedom <= 0:
        return Adequacy(None, fit.verdict, (), 0)
    evidence = attribution.Evidence(fit)
    harmonics = _harmonic_tests(fit)
    tests = evidence.cause_count + len(harmonics) + len(fit.residuals) + 1
    chance = evidence.chance([min(f.probability for f in harmonics) * len(harmonics)] if harmonics else [])
    unseen = attribution.undecidable_errors(evidence)
    if chance > SIGNIFICANCE_LEVEL:
        return Adequacy(True, _noise_message(fit, tests, chance), (), tests, undecidable=unseen)
    findings = sorted((*_pattern_findings(evidence), *harmonics), key=lambda f: f.probability)
    findings = [replace(f, probability=min(1.0, f.probability * tests)) for f in findings]
    findings = [f for f in findings if f.probability < SIGNIFICANCE_LEVEL]
    diagnosis = attribution.diagnose(evidence, cancelled) if attribute else None
    message = _verdict_message(fit, findings, tests, diagnosis, chance)
    return Adequacy(False, message, tuple(findings), tests, diagnosis, unseen)


def _cause_message(diagnosis: attribution.Diagnosis) -> str:
    """Return the likeliest cause as text, the causes that the runs do not distinguish from it, and the decisive checks."""
    first, *others = diagnosis.likeliest
    text = f"the model is wrong for these runs, most likely because {first.text}"
    if others:
        text += "; these runs do not distinguish it from: " + "; or ".join(e.cause_text for e in others)
    checks = dict.fromkeys(e.check for e in diagnosis.likeliest)
    return f"{text}. Decisive check: {'; or '.join(checks)}"


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
    seen = "; ".join(f"{f.text} ({format_p_value(f.probability)})" for f in findings[:2])
    if diagnosis is not None and diagnosis.likeliest:
        return f"{_cause_message(diagnosis)}. {chi}"
    if findings:
        return f"the model is wrong for these runs: {seen}. {chi}"
    if fit.p_value <= MIN_P_VALUE:
        worst = max(fit.residuals, key=lambda run: run.chi_square / max(run.values.size, 1))
        return (
            f"the misfit is {np.sqrt(fit.chi_square / fit.degrees_of_freedom):.2g} times the errors given but follows none of {tests} "
            f"possible causes: the errors are too small, or points are wrong, most of all in {worst.label}. {chi}"
        )
    return (
        f"the misfit is more than noise ({format_p_value(chance, 2)} for the least likely of {tests} tests), but no single one "
        f"shows the cause: repeat the doubtful measurements. {chi}"
    )


def _pattern_findings(evidence: attribution.Evidence) -> list[Finding]:
    """Return the correlation of neighbours of each run."""
    out = []
    for label, rows, correlation, p in evidence.patterns():
        message = f"residuals of {label} follow each other (correlation of neighbours {correlation:+.2f}): a pattern, not noise"
        out.append(Finding("pattern", (label,), correlation, rows**-0.5, p, message))
    return out


def _harmonic_tests(fit: JointFit) -> list[Finding]:
    """Return tests of measured harmonics against the harmonics of the linear model with the amplifier's two slopes."""
    out = []
    runs = [run for run in fit.observations.of_type(FrequencyResponseObservation) if run.harmonics_m is not None]
    receptances = {k: _receptances(fit, runs, k) for k in TESTED_HARMONICS}
    for i, run in enumerate(runs):
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
            expected = np.abs(receptances[k][i] * _acting_volts(fit, run, k))[here]
            error: Array = np.hypot(noise[run.usable][here], HARMONIC_TOLERANCE * expected)
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
    reach = 8 * np.sqrt(largest + 1) + 40  # beyond 8 deviations the terms are below 1e-13 of the largest
    j = np.arange(np.floor(max(largest - reach, 0)), np.ceil(largest + reach))
    return float(np.exp(j * np.log(half) - half - gammaln(j + 1)) @ chdtrc(degrees + 2 * j, value))


def _receptances(fit: JointFit, runs: Sequence[FrequencyResponseObservation], k: int) -> list[Complex]:
    """Return the displacement per volt at harmonic k of each usable point of each run, (F,); runs of one geometry are solved together."""
    values = [values_of_run(fit.values, run, fit.observations.reference_c) for run in runs]
    groups: dict[tuple[float, float], list[int]] = {}
    for i, v in enumerate(values):
        groups.setdefault((v["L1"] / v["L"], v["L2"] / v["L"]), []).append(i)
    out: dict[int, Complex] = {}
    for geometry, which in groups.items():
        own = [equation_factors(beam_under(runs[i], values[i]), skin_from_values(runs[i], values[i]), 1) for i in which]
        stacked = Factors(*(np.concatenate(each) for each in zip(*own, strict=True)))
        _, equal = np.unique(np.concatenate(stacked, axis=1), axis=0, return_inverse=True)
        f = [runs[i].frequency_hz[runs[i].usable] for i in which]
        rows = np.repeat(np.arange(len(which)), [each.size for each in f])
        H, _, _ = ReceptanceSolver(*geometry, fit.options.n).response_with_ends(
            stacked.take_rows(rows), 2 * np.pi * k * np.concatenate(f), (), equal.ravel()[rows]
        )
        parts = np.split(H, np.cumsum([each.size for each in f])[:-1])
        out |= {i: values[i]["mu"] / values[i]["L"] * part for i, part in zip(which, parts, strict=True)}
    return [out[i] for i in range(len(runs))]


def _acting_volts(fit: JointFit, run: FrequencyResponseObservation, k: int) -> Complex:
    """Return harmonic k of the volts at each usable point, with the hysteresis of the fit, (F,)."""
    volts = specimen_harmonic(run, fit.options.amplifier, k)
    hysteresis = fit.values["hysteresis"]
    return volts + hysteresis * loop_harmonic(run, fit.options.amplifier, k) if hysteresis else volts
