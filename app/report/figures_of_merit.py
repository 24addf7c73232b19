"""Figures of merit of a specimen with standard errors: frequencies, amplitude, perception margin, latency.

Limits are set on them by name; figures that the runs do not determine are missing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from app.common import NO_PROGRESS, Progress
from app.identification import SpecimenSheet
from app.report.limits import FIGURES_OF_MERIT
from app.report.runs import ReportRun
from app.report.specimen import GRID_HZ, HIGH_HZ, LOW_HZ, Effects, SpecimenModel, acting_tactor, fit_specimen
from model import AmplifierMap, Array, EstimatedQuantity, Membrane, Tactor, quality_factor
from model.identification import FrequencyResponseObservation, ObservationSet
from model.response import (
    ABDOMEN_THRESHOLD,
    THRESHOLD_M,
    PerceptionThreshold,
    perception_margin,
    step_latency,
    usable_bands,
)
from model.studies import UncertaintyBand

FULL_DRIVE_TOLERANCE = 0.02
"""Largest relative difference of a full drive from the largest drive."""
MODE_NAMES = ("natural_frequency", "damped_frequency", "damping_ratio", "peak_frequency", "quality_factor")
GAIN_NAMES = ("static_gain_above_rest", "static_gain_below_rest")
STEP_FIGURES = {
    "latency": f"latency, {1e6 * THRESHOLD_M:g} µm, after a step to {{:g}} V",
    "rise_time": "rise_time, after a step to {:g} V",
}
"""Figures of a step to the amplifier's highest input, which the model has too, with their names in a run."""
MODEL_SOURCE, FREE = "identified model", "free"


def figure_of_merit(name: str, value: float, standard_error: float, source: str = MODEL_SOURCE) -> EstimatedQuantity:
    """Return a quantity that limits can be set on, SI; `source` is the run with the measured value."""
    return EstimatedQuantity.listed(name, float(value), float(standard_error), source)


@dataclass(frozen=True, slots=True)
class PerceptionMargin:
    """Margin over the perception threshold in the band of touch, at full drive."""

    condition: str
    band: UncertaintyBand
    felt_bands: tuple[tuple[float, float], ...]
    edge_errors: tuple[tuple[float, float], ...]
    """Standard errors of the band edges; 0 at the edges of the evaluated range."""
    margin: float
    margin_error: float
    frequency_hz: float
    threshold: PerceptionThreshold = ABDOMEN_THRESHOLD


def perception_margin_of(
    specimen: SpecimenModel, elongation_m: float | None, threshold: PerceptionThreshold = ABDOMEN_THRESHOLD
) -> PerceptionMargin | None:
    """Compute the margin over a threshold by the model; None if it cannot be evaluated."""
    band = specimen.response(specimen.full_amplitude_v, elongation_m)
    if band is None:
        return None
    over = perception_margin(GRID_HZ, band.centre, threshold)
    worst = int(over.argmin())
    usable = usable_bands(GRID_HZ, band.centre, threshold)
    where = FREE if elongation_m is None else f"on the membrane, {1e3 * elongation_m:g} mm"
    edges = tuple((_edge_error(band, a, threshold), _edge_error(band, b, threshold)) for a, b in usable)
    at_hz = float(GRID_HZ[worst])
    error = float(band.standard_error[worst] / threshold.amplitude_at(at_hz))
    return PerceptionMargin(where, band, usable, edges, float(over[worst]), error, at_hz, threshold)


def _edge_error(band: UncertaintyBand, at_hz: float, threshold: PerceptionThreshold) -> float:
    """Return the shift of a band edge for one standard error of the curve."""
    if at_hz in (LOW_HZ, HIGH_HZ):
        return 0.0
    above = band.centre - threshold.amplitude_at(GRID_HZ)
    slope = float(np.interp(at_hz, GRID_HZ, np.gradient(above, GRID_HZ)))
    return float(np.interp(at_hz, GRID_HZ, band.standard_error)) / abs(slope) if slope else float("inf")


@dataclass(frozen=True, slots=True)
class StepLatency:
    """Latency from a step to the highest voltage until the motion is felt."""

    step_v: float
    latency: EstimatedQuantity | None
    rise_time: EstimatedQuantity | None
    overshoot: float
    overshoot_error: float


def step_latency_of(specimen: SpecimenModel) -> StepLatency | None:
    """Compute the latency by the model; None if it cannot be evaluated."""
    volts = float(specimen.amplifier.specimen_v(specimen.amplifier.high_v))

    @cache  # many parameters of a band do not change the tactor
    def figures_of(acting: Tactor) -> Array:
        step = step_latency(acting, volts, THRESHOLD_M, n=specimen.n)
        return np.array([np.nan if t is None else t for t in (step.to_threshold_s, step.rise_s, step.overshoot)], float)

    def figures(tactor: Tactor, _: Membrane, effects: Effects) -> Array:
        return figures_of(acting_tactor(tactor, effects))

    band = specimen.curve_with_band(figures)
    if band is None:
        return None
    latency, rise_time = (
        figure_of_merit(name, v, e) if np.isfinite(v) else None
        for name, v, e in zip(("latency", "rise_time"), band.centre, band.standard_error, strict=False)
    )
    return StepLatency(volts, latency, rise_time, float(band.centre[2]), float(band.standard_error[2]))


def measured_figures(runs: Sequence[ReportRun], amplifier: AmplifierMap) -> Mapping[str, EstimatedQuantity]:
    """Return the figures of the free specimen that runs measured, with their total uncertainty, from the newest run that has them.

    Runs left out of the identification are not used, nor simulated ones beside real ones.
    """
    real = any(not run.summary.simulated for run in runs)
    figures: dict[str, EstimatedQuantity] = {}
    for run in runs:
        free = all(
            getattr(each, "elongation_m", None) is None and getattr(each, "added_mass_kg", None) is None
            for each in run.observations
        )
        if run.problem or run.exclusion_reason or not run.summary.has_result or (real and run.summary.simulated):
            continue
        found = {f.name: f for f in run.summary.figures}
        names = {name: name for name in (*MODE_NAMES, *GAIN_NAMES)} if free else {}
        names |= {name: condition.format(amplifier.high_v) for name, condition in STEP_FIGURES.items()}
        for name, stored in names.items():
            if (f := found.get(stored)) is not None:
                figures[name] = figure_of_merit(stored, f.value, f.total, run.path.stem)
        if free and (ratio := found.get("damping_ratio")) is not None and "quality_factor" not in found:
            damping = figure_of_merit("damping_ratio", ratio.value, ratio.total, run.path.stem)
            figures["quality_factor"] = quality_factor(damping)
    return figures


def measured_peak(
    specimen: SpecimenModel, observations: ObservationSet, threshold: PerceptionThreshold
) -> tuple[Mapping[str, EstimatedQuantity], float]:
    """Return the largest amplitude at full drive and its margin, free, from the newest dwell with an interior maximum; and the frequency of the largest amplitude, 0 without one.

    It is the largest measured one, as in the fleet; its error has the shared gain error of the sensor, too.
    """
    peaks, at_hz = dict[str, EstimatedQuantity](), 0.0
    for run in observations.of_type(FrequencyResponseObservation):
        if run.elongation_m is not None or run.added_mass_kg is not None or run.swept:
            continue
        drive = np.asarray(run.drive_amplitude_v) * np.ones_like(run.frequency_hz)
        at = np.flatnonzero(run.usable & (np.abs(drive / specimen.full_amplitude_v - 1) < FULL_DRIVE_TOLERANCE))
        if run.peak_to_peak_m is not None and run.peak_to_peak_errors_m is not None:
            f, y, errors = run.frequency_hz[at], run.peak_to_peak_m[at], run.peak_to_peak_errors_m[at]
            top = int(y.argmax()) if y.size else 0
            if y.size and f.min() < f[top] < f.max():
                shared = np.sqrt(sum(c.standard_error**2 for c in run.shared_errors if c.acts_on == "displacement"))
                error = float(np.hypot(errors[top], shared * y[top]))
                at_hz = float(f[top])
                level = float(threshold.amplitude_at(at_hz))
                peaks["amplitude_at_resonance"] = figure_of_merit("amplitude_at_resonance", y[top], error, run.label)
                peaks["margin_at_resonance"] = figure_of_merit(
                    "margin_at_resonance", y[top] / level, error / level, run.label
                )
    return peaks, at_hz


def model_figures(
    specimen: SpecimenModel, margins: Sequence[PerceptionMargin], latency: StepLatency | None
) -> Mapping[str, EstimatedQuantity]:
    """Return the fitted parameters and the figures of the fitted model; `margins`: free, and on the membrane."""
    figures = {
        e.name: figure_of_merit(e.name, e.value, e.standard_error)
        for e in specimen.identified
        if e.name in FIGURES_OF_MERIT
    }
    for each in margins:
        if each.condition != FREE:
            pressed = figure_of_merit("smallest_margin_on_membrane", each.margin, each.margin_error)
            figures[pressed.name] = pressed  # of the largest elongation, which is the last
            continue
        figures["smallest_margin"] = figure_of_merit("smallest_margin", each.margin, each.margin_error)
        if bands := each.felt_bands:
            figures["usable_from"] = figure_of_merit("usable_from", bands[0][0], each.edge_errors[0][0])
            figures["usable_to"] = figure_of_merit("usable_to", bands[-1][1], each.edge_errors[-1][1])
    for name, value in () if latency is None else (("latency", latency.latency), ("rise_time", latency.rise_time)):
        if value is not None:
            figures[name] = replace(value, name=STEP_FIGURES[name].format(specimen.amplifier.high_v))
    return figures


@dataclass(frozen=True, slots=True)
class SpecimenSummary:
    """A specimen with its observations, margins and figures of merit."""

    specimen: SpecimenModel
    observations: ObservationSet | None
    perception_margins: tuple[PerceptionMargin, ...]
    """Free, then on the membrane at every measured elongation."""
    latency: StepLatency | None
    figures_of_merit: Mapping[str, EstimatedQuantity]
    """By name; the model's only where no run measured them."""
    largest_at_hz: float = 0.0
    """Frequency of the largest measured amplitude; 0 for none."""


def summarize_specimen(
    name: str,
    runs: tuple[ReportRun, ...],
    progress: Progress = NO_PROGRESS,
    sheet: SpecimenSheet | None = None,
    threshold: PerceptionThreshold = ABDOMEN_THRESHOLD,
    every_margin: bool = True,
) -> SpecimenSummary:
    """Identify a specimen from its runs, then compute margins and latency; not `every_margin`: free and at the largest elongation."""
    progress.update(0.0, "identifying")
    fitted, observations = fit_specimen(
        name, runs, lambda evaluations, _: progress.update(min(evaluations, 40) / 41, "identifying"), sheet
    )
    measured = measured_figures(runs, fitted.amplifier)
    peaks, at_hz = ({}, 0.0) if observations is None else measured_peak(fitted, observations, threshold)
    measured = {**measured, **peaks}
    if observations is None or fitted.identification is None:
        return SpecimenSummary(fitted, observations, (), None, measured, at_hz)
    progress.update(0.0, "margins and latency")
    responses = observations.of_type(FrequencyResponseObservation)
    elongations = sorted({run.elongation_m for run in responses if run.elongation_m is not None})
    identified = [each for each in elongations if fitted.identifies_response_at(each)]
    conditions: list[float | None] = [None] if fitted.identifies_free_response else []
    conditions += identified if every_margin else identified[-1:]
    margins = tuple(filter(None, (perception_margin_of(fitted, each, threshold) for each in conditions)))
    latency = step_latency_of(fitted) if fitted.identifies_free_response else None
    merits = {**model_figures(fitted, margins, latency), **measured}
    return SpecimenSummary(fitted, observations, margins, latency, merits, at_hz)
