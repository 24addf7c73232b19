"""Sentences of a diagnosis: a cause with value, error and sign, its effect on the fit, and its decisive check."""

import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from model import SCALES, format_with_uncertainty
from model.identification import observations as observed
from model.identification import parameters as fit_parameters
from model.identification.attribution.causes import TABLE, Cause, labels_of, listed
from model.identification.attribution.explanation import Explanation
from model.identification.fit_result import MIN_P_VALUE, JointFit, format_p_value

UNITS = {"1": "%", "kg": "g", "m": "mm", "s": "µs", "N": "mN", "Pa": "MPa"}
"""Units of sizes of errors."""
WORD_PAIR = re.compile(r"<([^<>|]*)\|([^<>|]*)>")

PARAMETER_TEXTS = {name: each["text"] for name, each in TABLE["parameters"].items()}
PARAMETER_CHECKS = {name: each["check"] for name, each in TABLE["parameters"].items() if "check" in each}


class CauseText(NamedTuple):
    """Template of a kind of cause, and its decisive check."""

    text: str
    check: str


RUN_TEXTS = {kind: CauseText(**each) for kind, each in TABLE["runs"].items()}
COMMON_FACTORS = {
    2**-0.5: "as rms does instead of peak", 2**0.5: "as peak does instead of rms", 0.5: "as peak does instead of peak to peak",
    -1.0: "as exchanged leads do", 2.0: "as peak to peak does instead of peak", 1e-3: "as a unit a thousand times larger does", 1e3: "as a unit a thousand times smaller does",
}  # fmt: skip
SAME_FACTOR = 0.02
"""Relative distance up to which a scale is one of the common factors."""


def format_size(value: float, error: float | None, unit: str, signed: bool = True) -> str:
    """Return a value with its error in the unit of errors, e.g. `70.3 ± 0.3 %`."""
    shown = UNITS.get(unit, unit)
    factor = SCALES[shown] if unit in UNITS else 1.0
    value, error = factor * (value if signed else abs(value)), factor * (error or 0.0)
    has_error = np.isfinite(error) and error > 0
    return format_with_uncertainty(value, error, shown) if has_error else f"{value:.4g} {shown}".strip()


def cause_text(fit: JointFit, cause: Cause, sizes: tuple[tuple[float, float], ...]) -> str:
    """Return the meaning of a cause of these sizes; the text expresses the sign of the difference."""
    if cause.kind in ("point", "points"):
        return _point_text(fit, cause)
    if cause.kind == "exchange":
        x, unit = _labels(fit, cause)
        return f"the labels of points {cause.points[0] + 1} and {cause.points[1] + 1} of {cause.name} ({x[0]:.4g} and {x[1]:.4g} {unit}) are exchanged"
    size, error = sizes[0]
    if cause.kind in RUN_TEXTS:
        unit = observed.SHARED_ERROR_UNITS[cause.errors[0].error.acts_on]
        fields = {"run": cause.name, "repeat": cause.title, "size": format_size(size, error, unit, False)}
        fields |= {
            "second": format_size(*sizes[-1], "1"),
            "factor": _common_factor(1 + size),
            "side": _other_side(fit, size),
        }
        return _signed(RUN_TEXTS[cause.kind].text, size).format(**fields)
    spec = fit_parameters.parameter_spec(cause.name)
    if cause.name in fit.options.priors:
        stated = format_size(*fit.options.priors[cause.name], spec.unit)
        meaning = _parameter_text(fit, cause.name, size, error) if cause.name in PARAMETER_TEXTS else ""
        description = f"{cause.name} ({spec.description}) is {format_size(size, error, spec.unit)}"
        return f"{meaning or description}, far from {stated}, which was {'stated' if cause.kind == 'stated' else 'expected'}"
    return _parameter_text(fit, cause.name, size, error)


def _parameter_text(fit: JointFit, name: str, size: float, error: float) -> str:
    spec, held = fit_parameters.parameter_spec(name), fit_parameters.start_value(name, fit.options.base_values())
    template = _signed(
        PARAMETER_TEXTS.get(name, f"{name} ({spec.description}) is {{value}}, not {{held}}"), size - held
    )
    return template.format(
        value=format_size(size, error, spec.unit),
        size=format_size(size - held, error, spec.unit, False),
        held=format_size(held, None, spec.unit),
    )


def _signed(template: str, size: float) -> str:
    return WORD_PAIR.sub(lambda pair: pair[1 if size >= 0 else 2], template)


def _common_factor(factor: float) -> str:
    return next((f", {text}" for f, text in COMMON_FACTORS.items() if abs(factor / f - 1) < SAME_FACTOR), "")


def _other_side(fit: JointFit, size: float) -> str:
    """Return that a repeat reads as with the other side up, if the sides differ by so much."""
    sides = abs(2 * float(fit.values.get("asymmetry") or 0.0))
    return ", as with the other side up" if sides > 0 and 0.5 < abs(size) / sides < 2 else ""


def describe_cause(fit: JointFit, name: str, size: float, error: float) -> str:
    """Return the meaning of a parameter of this size and standard uncertainty."""
    return _parameter_text(fit, name, size, error)


def _labels(fit: JointFit, cause: Cause) -> tuple[list[float], str]:
    run = next(run for run in fit.observations.runs if run.label == cause.name)
    factor, unit = (1.0, "N") if isinstance(run, observed.StaticLoadingObservation) else (1e3, "g")
    return [factor * float(labels_of(run)[point]) for point in cause.points], unit


def _point_text(fit: JointFit, cause: Cause) -> str:
    at = next(i for i, run in enumerate(fit.observations.runs) if run.label == cause.name)
    run, part, point = fit.observations.runs[at], fit.run_slices[at], cause.points[0]
    if len(cause.points) > 1:
        places = listed([f"{i + 1}{_where(run, i)}" for i in cause.points])
        return f"points {places} of {cause.name} alone are wrong"
    rows = fit.weighted_residuals[part].reshape(-1, int(run.usable.sum()))
    place = int(run.usable[:point].sum())
    away = float(np.linalg.norm(rows[:, place]))
    return f"point {point + 1} of {cause.name}{_where(run, point)} alone is wrong, by {away:.2g} standard errors"


def _where(run: observed.Observation, point: int) -> str:
    match run:
        case observed.StaticLoadingObservation():
            return f" ({run.load_n[point]:.3g} N)"
        case observed.MassResonanceObservation():
            return f" ({1e3 * run.mass_kg[point]:.4g} g)"
        case observed.VoltageStepsObservation():
            return f" ({run.input_v[point]:.3g} V)"
        case observed.DecayPoleObservation():
            return f" (edge {point + 1})"
        case observed.FrequencyResponseObservation():
            return f" ({run.frequency_hz[point]:.4g} Hz)"
    return ""


def with_text(fit: JointFit, explanation: Explanation) -> Explanation:
    """Return the explanation with its texts: the cause, the fit with it, and its decisive check."""
    cause = explanation.cause
    meaning = cause_text(fit, cause, explanation.sizes)
    freedom = explanation.degrees_of_freedom
    fit_text = f"chi-square {fit.cost:.0f} becomes {explanation.chi_square:.0f} for {freedom} degrees of freedom"
    if explanation.p_value < MIN_P_VALUE:
        fit_text += f", {format_p_value(explanation.p_value)}: it is not the only cause"
    if explanation.shifts:
        fit_text += "; " + ", ".join(
            f"{s.name} {s.before:.3g} becomes {format_with_uncertainty(s.after, s.standard_error)}"
            for s in explanation.shifts
        )
    kind = RUN_TEXTS.get(cause.kind)
    check = (
        kind.check.format(run=cause.name)
        if kind
        else PARAMETER_CHECKS.get(cause.name, f"measuring {'them' if len(cause.points) > 1 else 'it'} again")
    )
    return replace(explanation, cause_text=meaning, text=f"{meaning} ({fit_text})", check=check)
