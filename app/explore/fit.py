"""Fit of the Explore page: joint fit of model parameters to measured runs, starting from the sliders."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from app.explore.sliders import SLIDERS
from app.explore.state import ExploreSetting
from model import LAG_NAMES, AmplifierMap, Mask, Membrane, ParameterError, Series, format_with_uncertainty

if TYPE_CHECKING:
    from app.archive import MeasuredResponse
    from model.identification import FitOptions, FrequencyResponseObservation, ObservationSet

MAX_EVALUATIONS = 60
"""Largest number of evaluations of the fit with free dimensions, whose derivatives alone are used."""
ERRORS_NOTE = "± has noise and dimensions by ruler and caliper; the other sliders and the sensor's gain count as exact ('Identify …' has all sources)"
FREE_PARAMETERS = ("m_add", "c0", "mu")
"""The parameters that the response of a free tactor determines for a given stiffness; the others keep their values."""


@dataclass(frozen=True, slots=True)
class ExploreFit:
    """The best fit and its uncertainty."""

    setting: ExploreSetting
    summary: str
    """Each parameter with total uncertainty and noise, and the quality of the fit."""


def fit_runs(
    runs: Sequence["MeasuredResponse"], setting: ExploreSetting, cancelled: Callable[[], bool] | None = None
) -> ExploreFit:
    """Fit added mass, damping and moment of a free tactor, or the skin under one, to the runs.

    Raises:
        ValueError: the runs cannot be fitted (`ParameterError`, `IdentificationError`).
        FitCancelled: `cancelled` returned True.
    """
    from app.identification import shape_count_of_file
    from model.identification import FitOptions, ObservationSet, elongation_parameter, joint_fit

    specimen = setting.specimen
    elongation = specimen.delta * specimen.membrane.L_m if specimen.membrane is not None else None
    names = {name: name for name in FREE_PARAMETERS}
    if elongation is not None:
        names = {elongation_parameter(letter, elongation): letter for letter in ("k_s", "c_s")}
    observed = tuple(_observation(f"{number}: {run.label}", run, elongation) for number, run in enumerate(runs, 1))
    held = {name: setting.value(name) for name in LAG_NAMES}
    # Every MFC has both: without them mu of the simulated bench was 7 % off, with them 3 %, by k2, which is held.
    if all(run.fundamental_m is not None and np.iscomplexobj(run.fundamental_m) for run in observed):
        names |= {name: name for name in LAG_NAMES}
        held = {}
    start = {name: setting.value(letter) for name, letter in names.items()}
    options = FitOptions(
        tactor=specimen.acting_tactor,
        membrane=specimen.membrane or Membrane(),
        free=tuple(names),
        fixed=held,
        start=start,
        n=max(shape_count_of_file(run.path) if run.simulated else FitOptions.n for run in runs),
    )
    fit = joint_fit(ObservationSet(observed), options, cancelled=cancelled)
    values = dict(zip(fit.names, fit.theta, strict=True))
    for name, letter in names.items():
        if not np.isfinite(values[name]) and name not in LAG_NAMES:
            raise ValueError(f"{letter} is not determined by these runs; overlay one with points around the resonance")
        if np.isfinite(values[name]):
            setting = setting.with_value(letter, float(f"{values[name]:.6g}"))
    noise = {e.name: e.standard_error for e in fit.estimates()}
    rest = _dimension_errors(ObservationSet(observed), replace(options, start=values), setting, cancelled)
    described = [
        _format_parameter(letter, values[name], noise.get(name, np.nan), rest.get(name, 0.0))
        for name, letter in names.items()
    ]
    return ExploreFit(setting, "; ".join((*described, ERRORS_NOTE, fit.verdict if fit.converged else fit.message)))


def _dimension_errors(
    observations: "ObservationSet", options: "FitOptions", setting: ExploreSetting, cancelled: Callable[[], bool] | None
) -> dict[str, float]:
    """Return the uncertainty of each parameter that comes from the dimensions, measured by ruler and caliper."""
    from app.identification import DIMENSIONS, table_one_entry
    from model.identification import IdentificationError, joint_fit, uncertainty_budget

    membrane = setting.specimen.membrane is not None
    names = [name for name in DIMENSIONS if membrane or not name.endswith("_m")]
    priors = {name: (setting.value(name), table_one_entry(name).uncertainty) for name in names}
    extended = replace(options, free=(*(options.free or ()), *names), priors=priors)
    try:
        fit = joint_fit(observations, extended, cancelled=cancelled, max_evaluations=MAX_EVALUATIONS, max_starts=1)
    except (ParameterError, IdentificationError):
        return {}
    budget = uncertainty_budget(fit)
    return dict(zip(budget.names, budget.systematic.tolist(), strict=True))


def _observation(label: str, run: "MeasuredResponse", elongation: float | None) -> "FrequencyResponseObservation":
    """Return the run as an observation; an imported table may have no phase, or max - min only."""
    from model.identification import FrequencyResponseObservation

    amplitude_v, highest_v = run.peak_to_peak_v / 2, AmplifierMap().rest_v
    more: dict[str, Any] = {
        # A full swing is read back with noise of up to a thousandth.
        "drive_amplitude_v": highest_v if highest_v < amplitude_v < 1.001 * highest_v else amplitude_v,
        "elongation_m": elongation,
        "simulated": run.simulated,
    }
    sine, whole = run.fundamental, run.peak_to_peak
    if (good := _weighted(sine)).any():
        more |= {"fundamental_m": sine.y, "errors_m": sine.errors}
    else:
        good = _weighted(whole)
        more |= {"peak_to_peak_m": whole.y, "peak_to_peak_errors_m": whole.errors}
    return FrequencyResponseObservation(label, run.frequency_hz, good=good, **more)


def _weighted(series: Series) -> Mask:
    """Return whether each value can be fitted, (P,): usable and with a standard error."""
    return np.asarray(series.fit_rows & np.isfinite(series.y) & (np.asarray(series.errors) > 0))


def _format_parameter(letter: str, value: float, noise: float, rest: float) -> str:
    """Format a parameter with its total uncertainty, and the part by noise to the same digits."""
    slider = SLIDERS[letter]
    if not np.isfinite(noise):
        return f"{slider.label}: not determined by these runs"
    text = format_with_uncertainty(slider.factor * value, slider.factor * float(np.hypot(noise, rest)))
    digits = len(text.rpartition(".")[2]) if "." in text else 0
    part = f"{slider.factor * noise:.{digits}f}"
    if not float(part):
        part = f"below {10.0**-digits:.{digits}f}"
    return f"{slider.label} ({text}) {slider.unit}, by noise {part}"
