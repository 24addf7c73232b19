"""Sentences of a diagnosis: a cause with value, error and sign, and its effect on the fit."""

import re
from dataclasses import replace

import numpy as np

from model import SCALES, format_with_uncertainty
from model.identification import observations as observed
from model.identification import parameters as fit_parameters
from model.identification.attribution.causes import Cause
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


def format_size(value: float, error: float | None, unit: str, signed: bool = True) -> str:
    """Return a value with its error in the unit of errors, e.g. `70.3 ± 0.3 %`."""
    shown = UNITS.get(unit, unit)
    factor = SCALES[shown] if unit in UNITS else 1.0
    value, error = factor * (value if signed else abs(value)), factor * (error or 0.0)
    has_error = np.isfinite(error) and error > 0
    return format_with_uncertainty(value, error, shown) if has_error else f"{value:.4g} {shown}".strip()


def cause_text(fit: JointFit, cause: Cause, size: float, error: float) -> str:
    """Return the meaning of a cause of this size; the text expresses the sign of the difference."""
    match cause.kind:
        case "scale":
            return f"{cause.name} reads {format_size(size, error, '1', False)} too {'large' if size > 0 else 'small'}"
        case "frequency":
            return f"the frequencies of {cause.name} are {format_size(size, error, 'Hz', False)} too {'low' if size > 0 else 'high'}"
        case "elongation":
            return f"the elongation of {cause.name} is {format_size(size, error, 'm', False)} {'more' if size > 0 else 'less'} than stated"
        case "point":
            return _point_text(fit, cause)
    spec = fit_parameters.parameter_spec(cause.name)
    if cause.kind == "prior":
        stated, uncertainty = fit.options.priors[cause.name]
        return (
            f"{cause.name} ({spec.description}) is {format_size(size, error, spec.unit)}, which contradicts its prior value, "
            f"{format_size(stated, uncertainty, spec.unit)}"
        )
    held = fit_parameters.start_value(cause.name, fit.options.base_values())
    template = PARAMETER_TEXTS.get(cause.name, f"{cause.name} ({spec.description}) is {{value}}, not {{held}}")
    template = WORD_PAIR.sub(lambda pair: pair[1 if size >= held else 2], template)
    return template.format(
        value=format_size(size, error, spec.unit),
        size=format_size(size - held, error, spec.unit, False),
        held=format_size(held, None, spec.unit),
    )


def describe_cause(fit: JointFit, name: str, size: float, error: float) -> str:
    """Return the meaning of a parameter of this size and standard uncertainty, as `cause_text`."""
    return cause_text(fit, Cause("parameter", name), size, error)


def _point_text(fit: JointFit, cause: Cause) -> str:
    run = cause.run(fit)
    part = fit.run_slices[fit.observations.runs.index(run)]
    rows = fit.weighted_residuals[part].reshape(-1, int(run.usable.sum()))
    place = int(run.usable[: cause.point].sum())
    away = float(np.linalg.norm(rows[:, place]))
    return f"point {cause.point + 1} of {cause.name}{_where(run, cause.point)} alone is wrong, by {away:.2g} standard errors"


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
    """Return the explanation with its texts: the cause, and the fit with it."""
    cause = cause_text(fit, explanation.cause, explanation.size, explanation.standard_error)
    freedom = explanation.degrees_of_freedom
    fit_text = f"chi-square {fit.cost:.0f} becomes {explanation.chi_square:.0f} for {freedom} degrees of freedom"
    if explanation.p_value < MIN_P_VALUE:
        fit_text += f", {format_p_value(explanation.p_value)}: it is not the only cause"
    if explanation.shifts:
        fit_text += "; " + ", ".join(
            f"{s.name} {s.before:.3g} becomes {format_with_uncertainty(s.after, s.standard_error)}"
            for s in explanation.shifts
        )
    return replace(explanation, cause_text=cause, text=f"{cause} ({fit_text})")
