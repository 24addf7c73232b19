"""Redrawn data: observations with normal errors of the sizes they state, and the errors of the paper's chain from its repetition on them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from model import Array, EstimatedQuantity, ParameterError
from model.identification.fit_options import FitCancelled
from model.identification.observations import (
    DecayPoleObservation,
    ErrorTarget,
    FrequencyResponseObservation,
    MassResonanceObservation,
    Observation,
    ObservationSet,
    StaticLoadingObservation,
)
from model.identification.paper_chain import (
    PaperChainError,
    PaperChainOptions,
    PaperChainResult,
    identify_by_paper_chain,
)
from model.identification.paper_chain.errors import _estimates as estimates_of


def resample(observations: ObservationSet, rng: np.random.Generator) -> tuple[ObservationSet, dict[str, float]]:
    """The campaign with normal errors of the sizes it states added to its values, and the shared errors that were drawn."""
    drawn = {e.name: float(e.standard_error * rng.standard_normal()) for e in observations.shared_errors.values()}
    return ObservationSet(tuple(_resampled_run(run, drawn, rng) for run in observations.runs)), drawn


def _resampled_run(run: Observation, shared_errors: dict[str, float], rng: np.random.Generator) -> Observation:
    def of(acts_on: ErrorTarget, inputs: Array | None = None) -> Any:
        mine = [e for e in run.shared_errors if e.acts_on == acts_on]
        if inputs is None and any(e.at is not None for e in mine):
            raise ParameterError(f"{run.label}: errors of single inputs ({acts_on}) cannot be drawn from")
        return sum(shared_errors[e.name] * (1 if inputs is None else e.acts_at(inputs)) for e in mine)

    if any(of(target) for target in ("level", "elongation", "frequency")):
        raise ParameterError(f"{run.label}: errors of level, elongation and frequency cannot be drawn from")
    load = of("load", run.load_n) if isinstance(run, StaticLoadingObservation) else of("load")
    gain = (1 + of("displacement")) * (1 + of("volts")) * (1 + load)
    match run:
        case MassResonanceObservation():
            f = run.frequency_hz
            offset = of("mass", run.mass_kg)
            if np.any(offset):
                # the mass that is there differs from the one written down
                squares = np.polynomial.Polynomial.fit(run.mass_kg, f**-2.0, min(3, f.size - 1))
                f = squares(run.mass_kg + offset) ** -0.5 * f / squares(run.mass_kg) ** -0.5
            return replace(run, frequency_hz=f + run.errors_hz * rng.standard_normal(f.size))
        case DecayPoleObservation():
            noise = run.errors_hz / run.frequency_hz * rng.standard_normal(run.frequency_hz.size)
            turned = run.phase_errors_rad * rng.standard_normal(run.frequency_hz.size)
            return run.with_pole(run.pole_hz * (1 + noise + 1j * turned))
        case FrequencyResponseObservation():
            return _resampled_response(run, gain, of("delay"), rng)
    w = run.deflection_m * gain
    return replace(run, deflection_m=w + run.errors_m * rng.standard_normal(w.size))


def _resampled_response(
    run: FrequencyResponseObservation, gain: float, delay_s: float, rng: np.random.Generator
) -> FrequencyResponseObservation:
    width = run.peak_to_peak_m
    if width is not None and run.peak_to_peak_errors_m is not None:
        width = width * gain + run.peak_to_peak_errors_m * rng.standard_normal(width.size)
    F = run.fundamental_m
    if F is not None and run.errors_m is not None:
        F = F * gain
        along: Any = 1.0
        if np.iscomplexobj(F):
            F = F * np.exp(-2j * np.pi * run.frequency_hz * delay_s)
            across = run.errors_m
            if run.phase_errors_rad is not None:
                along, across = np.exp(1j * np.angle(F)), np.abs(F) * run.phase_errors_rad
            F = F + 1j * along * across * rng.standard_normal(F.size)
        F = F + along * run.errors_m * rng.standard_normal(F.size)
    h = run.harmonics_m
    error = run.errors_m if run.harmonic_errors_m is None else run.harmonic_errors_m
    if h is not None and error is not None:
        noise = rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape)
        h = np.abs(h * gain + error[:, None] * noise)
    return replace(run, fundamental_m=F, peak_to_peak_m=width, harmonics_m=h)


def resampled_errors(
    observations: ObservationSet,
    options: PaperChainOptions,
    result: PaperChainResult,
    draws: int = 100,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> tuple[tuple[EstimatedQuantity, ...], Array]:
    """As `linearized_errors`, from the spread of the whole chain over redrawn data; any method.

    Raises:
        PaperChainError: more than half of the draws cannot be identified.
        FitCancelled: `cancelled` returned true.
    """
    names = tuple(result.values)
    rows = []
    for i in range(draws):
        if cancelled is not None and cancelled():
            raise FitCancelled("the chain's errors were stopped on request")
        try:
            values = identify_by_paper_chain(
                resample(observations, np.random.default_rng((seed, i)))[0], options
            ).values
            rows.append([values[n] for n in names])
        except (PaperChainError, KeyError):
            pass
        if progress is not None:
            progress(i + 1, draws)
    if len(rows) < max(draws / 2, 2):
        raise PaperChainError(
            f"{draws - len(rows)} of {draws} redrawn campaigns cannot be identified: the data are too noisy"
        )
    S = np.atleast_2d(np.cov(np.array(rows).T))
    return estimates_of(names, S, result), S
