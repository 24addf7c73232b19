"""Sentences of a diagnosis: a cause with value, error and sign, its effect on the fit, and its decisive check."""

import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from model import SCALES, format_with_uncertainty
from model.identification import observations as observed
from model.identification import parameters as fit_parameters
from model.identification.attribution.causes import Cause, labels_of
from model.identification.attribution.explanation import Explanation
from model.identification.fit_result import MIN_P_VALUE, JointFit, format_p_value

UNITS = {"1": "%", "kg": "g", "m": "mm", "s": "µs", "N": "mN", "Pa": "MPa"}
"""Units of sizes of errors."""
WORD_PAIR = re.compile(r"<([^<>|]*)\|([^<>|]*)>")

PARAMETER_TEXTS = {
    "mass_fraction": "the masses put in the cylinder act as {value} of their weight",
    "mass_offset": "{size} <more|less> than stated acts with every added mass: cylinder and glue, or the balance",
    "asymmetry": "loads deflect the MFC side {size} <more|less> than the mean of both sides, the aluminium side <less|more>",
    "load_gain": "all loads are {size} <larger|smaller> than stated: weigh a weight on another balance",
    "sensor_gain": "all displacements read {size} too <large|small>: move the sensor by a micrometer or a gauge block",
    "load_offset": "{size} <more|less> than stated loads the centre with every weight: pan and hook, or the balance",
    "zero_drift": "the sensor's zero drifts <up|down> by {size} from the first to the last row of a static loading",
    "clamp_flexibility": "the clamp <turns|is stiffer than rigid>, by {size} of what the bare plate bends",
    "creep": "deflections creep <on|back> by {size} a decade of time",
    "hysteresis": "hysteresis: {size} of the deflection at full drive comes <late|early>",
    "stiffening": "the specimen is {size} <stiffer|softer> at a deflection of 1 mm than at none: it is not linear",
    "gain_below_rest": "the amplifier's slope below rest is {size} <larger|smaller> against the slope above rest than in its map",
    "delay": "the displacement is {size} <later|earlier> than its phases were corrected for",
    "gain_drift": "the dwells <grow|shrink> by {size} from the first to the last",
    "elongation_offset": "the membrane is {size} <longer|shorter> than every stated elongation",
    "elongation_slip": "the membrane is stretched {size} <less|more> than every stated elongation: it slips in its clamps",
    "h_Al": "the bare plate bends as with h_Al = {value}, not {held} (h_Al, b_Al or E_Al)",
    "contact_length": "the skin acts over a contact_length of {value}, not {held} (or b_m differs)",
}
"""Templates with {value}, {held} (the value held in the fit) and {size} (their difference); <one|other> by its sign."""


class CauseText(NamedTuple):
    """Template of a kind of cause with {run}, {size} and the {second} size, <one|other> by the sign; and its decisive check."""

    text: str
    check: str


RUN_TEXTS = {
    "scale": CauseText("the scale of {run} is {size} too <large|small>{factor}", "checking its unit, rms or peak, and range, and measuring one of its points again"),
    "time base": CauseText("the frequencies of {run} are {size} too <low|high>", "measuring its drive with a counter"),
    "delay": CauseText("{run} is {size} <later|earlier> than the other runs", "measuring one of its points again with the settings of the others"),
    "elongation": CauseText("the elongation of {run} is {size} <more|less> than stated", "stretching the membrane to it again"),
    "mass of": CauseText("{size} <more|less> acts at the centre in {run} than in the other runs", "weighing what is mounted"),
    "mass from": CauseText("{size} <more|less> acts at the centre from {run} on: the mass was mounted anew", "a free dwell before and after mounting"),
    "clamp of": CauseText("the clamp <gives|holds> by {size} of what the bare plate bends <more|better> in {run} than in the other runs", "clamping again, and a free dwell"),
    "clamp from": CauseText("from {run} on the clamp <gives|holds> by {size} of what the bare plate bends <more|better>: the plate was clamped anew", "a free dwell before and after clamping"),
    "drift": CauseText("{run} <grows|shrinks> by {size} from its first to its last point", "measuring its first point again at the end"),
    "bend": CauseText("{run}: the deflection is {size} <more|less> at the largest reading than in proportion to small ones: not linear", "readings at half and at full load or voltage in turn"),
    "slip": CauseText("under large loads the centre moves {size} <more|less> than the smaller ones say: the clamp slips, or something touches", "a small load before and after the largest"),
    "sensor curvature": CauseText("displacements of 1 mm read {size} too <large|small> against small ones: the sensor is not linear ({run} error)", "moving the sensor by a micrometer"),
    "roll-off": CauseText("what is driven falls by {size} to 250 Hz, and lags by {second} of a radian there: drive or sensor roll off", "the drive's readback at the specimen, and a fast sensor"),
    "mount": CauseText("sensor or stand moves with the specimen at {run}: its mount resonates ({size} of the displacement)", "tightening the mount, a dwell around {run}"),
    "creep of the dwells": CauseText("the dwells creep by {size} a decade <more|less> than the other runs: loss in clamp or glue, or a wrong phase", "voltage steps read at several times"),
    "repeat": CauseText("{repeat} deflects {size} <more|less> than the others{side}", "loading both sides once more"),
}  # fmt: skip
PARAMETER_CHECKS = {
    "sensor_gain": "moving the sensor by a micrometer or a gauge block",
    "load_gain": "weighing one of the weights on another balance",
    "mass_fraction": "weighing the masses and fixing them at the centre",
    "stiffening": "a dwell at half the voltage",
    "delay": "the phase of a second sensor, or of a stiff target",
    "gain_below_rest": "the volts at the amplifier's output on both sides of rest",
    "load_offset": "weighing pan and hook",
    "clamp_flexibility": "clamping again",
}
COMMON_FACTORS = {
    2**-0.5: "as rms does instead of peak", 2**0.5: "as peak does instead of rms", 0.5: "as peak does instead of peak to peak",
    2.0: "as peak to peak does instead of peak", 1e-3: "as a unit a thousand times larger does", 1e3: "as a unit a thousand times smaller does",
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
    if cause.kind == "point":
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
    check = kind.check.format(run=cause.name) if kind else PARAMETER_CHECKS.get(cause.name, "measuring it again")
    return replace(explanation, cause_text=meaning, text=f"{meaning} ({fit_text})", check=check)
