"""Figures of merit of a specimen with standard errors: resonance, amplitude, perception margin, latency.

Limits are set on them by name; those that the runs do not determine are missing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from annotated_types import Interval

from app.report.specimen import COVERAGE_FACTOR_95, GRID_HZ, HIGH_HZ, LOW_HZ, SpecimenModel
from model import Array, Membrane, ParameterSpec, Tactor
from model.identification import SPECIMEN_PARAMETERS, FrequencyResponseObservation, ObservationSet, parabola_vertex
from model.response import THRESHOLD_M, perception_margin, step_latency, usable_bands
from model.studies.uncertainty import UncertaintyBand

FULL_DRIVE_TOLERANCE = 0.02
"""Relative difference from the largest drive up to which a drive counts as full."""

PARAMETER_MERITS = ("k2", "mu", "m_add", "c0", "E_m", "c_s_0", "c_s_delta")
_SPECIMEN_MERITS = (
    ("resonance", "Hz", "frequency of the largest fundamental as measured, free, full drive"),
    ("amplitude_at_resonance", "m", "largest max - min as measured, free, full drive"),
    ("usable_from", "Hz", "lowest frequency felt, free, full drive; by the model, from 5 Hz on"),
    ("usable_to", "Hz", "highest frequency felt, free, full drive; by the model, up to 250 Hz"),
    ("smallest_margin", "1", "smallest max - min over the threshold, 5 to 250 Hz, free, by the model"),
    ("smallest_margin_on_membrane", "1", "the same at the largest elongation that was measured"),
    ("latency", "s", "from a step to the highest voltage until it is felt, by the model"),
    ("rise_time", "s", "10 to 90 % after that step, by the model"),
)
FIGURES_OF_MERIT = {
    name: ParameterSpec(name, unit, Interval(gt=0), words, None) for name, unit, words in _SPECIMEN_MERITS
} | {name: SPECIMEN_PARAMETERS[name] for name in PARAMETER_MERITS}
"""Quantities that limits can be set on: name, unit, description."""


@dataclass(frozen=True, slots=True)
class FigureOfMerit:
    """A quantity of the specimen with its standard error, SI."""

    name: str
    value: float
    standard_error: float

    @property
    def unit(self) -> str:
        return FIGURES_OF_MERIT[self.name].unit


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


def perception_margin_of(specimen: SpecimenModel, elongation_m: float | None) -> PerceptionMargin | None:
    """Compute the margin by the model; None if it cannot be evaluated."""
    band = specimen.response(specimen.full_amplitude_v, elongation_m)
    if band is None:
        return None
    over = perception_margin(GRID_HZ, band.centre)
    worst = int(over.argmin())
    usable = usable_bands(GRID_HZ, band.centre)
    words = "free" if elongation_m is None else f"on the membrane, {1e3 * elongation_m:g} mm"
    edges = tuple((_edge_error(band, a), _edge_error(band, b)) for a, b in usable)
    error = float(band.standard_error[worst] / THRESHOLD_M)
    return PerceptionMargin(words, band, usable, edges, float(over[worst]), error, float(GRID_HZ[worst]))


def _edge_error(band: UncertaintyBand, at_hz: float) -> float:
    """Return the shift of a band edge for one standard error of the curve."""
    if at_hz in (LOW_HZ, HIGH_HZ):
        return 0.0
    slope = float(np.interp(at_hz, GRID_HZ, np.gradient(band.centre, GRID_HZ)))
    return float(np.interp(at_hz, GRID_HZ, band.standard_error)) / abs(slope) if slope else float("inf")


@dataclass(frozen=True, slots=True)
class StepLatency:
    """Latency from a step to the highest voltage until the motion is felt."""

    step_v: float
    latency: FigureOfMerit | None
    rise_time: FigureOfMerit | None
    overshoot: float
    overshoot_error: float


def step_latency_of(specimen: SpecimenModel) -> StepLatency | None:
    """Compute the latency by the model; None if it cannot be evaluated."""
    volts = float(specimen.amplifier.specimen_v(specimen.amplifier.high_v))

    def figures(tactor: Tactor, _: Membrane) -> Array:
        step = step_latency(tactor, volts, THRESHOLD_M, n=specimen.n)
        return np.array([np.nan if t is None else t for t in (step.to_threshold_s, step.rise_s, step.overshoot)], float)

    band = specimen.curve_with_band(figures)
    if band is None:
        return None
    merits = [
        FigureOfMerit(name, float(v), float(e)) if np.isfinite(v) else None
        for name, v, e in zip(("latency", "rise_time"), band.centre, band.standard_error, strict=False)
    ]
    return StepLatency(volts, merits[0], merits[1], float(band.centre[2]), float(band.standard_error[2]))


def measured_resonance(specimen: SpecimenModel, observations: ObservationSet) -> list[FigureOfMerit]:
    """Return resonance and amplitude at full drive, free, from the newest dwell with an interior maximum."""
    found: dict[str, FigureOfMerit] = {}
    for run in reversed(observations.of_type(FrequencyResponseObservation)):
        if run.elongation_m is not None or run.added_mass_kg is not None:
            continue
        if run.fundamental_m is not None and run.errors_m is not None:
            top = _parabola_vertex(run, np.abs(run.fundamental_m), run.errors_m, specimen.full_amplitude_v)
            if top is not None:
                found.setdefault("resonance", FigureOfMerit("resonance", *top[0]))
        if run.peak_to_peak_m is not None and run.peak_to_peak_errors_m is not None:
            top = _parabola_vertex(run, run.peak_to_peak_m, run.peak_to_peak_errors_m, specimen.full_amplitude_v)
            if top is not None:
                found.setdefault("amplitude_at_resonance", FigureOfMerit("amplitude_at_resonance", *top[1]))
    return list(found.values())


def _parabola_vertex(
    run: FrequencyResponseObservation, y: Array, errors: Array, full_v: float
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return frequency and height of a single resonance through the three highest points, with standard errors.

    For a single resonance 1 / y^2 is a parabola over f^2. The errors combine those of the points, the difference from the
    paper's parabola of y over f (the ambiguity of a curve through three points), and for the height the shared gain error of
    the sensor.
    """
    drive = np.asarray(run.drive_amplitude_v) * np.ones_like(run.frequency_hz)
    at = np.flatnonzero(run.usable & (np.abs(drive / full_v - 1) < FULL_DRIVE_TOLERANCE))
    f, index = np.unique(run.frequency_hz[at], return_index=True)
    y, errors = y[at][index], errors[at][index]
    top = int(y.argmax()) if y.size else 0
    if not 0 < top < y.size - 1:
        return None
    three = slice(top - 1, top + 2)
    f, y, errors = f[three], y[three], errors[three]
    centre = _resonance_vertex(f, y)
    moved = np.array([_resonance_vertex(f, y + 1e-3 * step) - centre for step in np.diag(errors)]) / 1e-3
    shared = float(np.sqrt(sum(c.standard_error**2 for c in run.shared_errors if c.acts_on == "displacement")))
    error = np.sqrt((moved**2).sum(axis=0) + (centre - np.array(parabola_vertex(f, y))) ** 2)
    return (float(centre[0]), float(error[0])), (float(centre[1]), float(np.hypot(error[1], shared * centre[1])))


def _resonance_vertex(f: Array, y: Array) -> Array:
    square, least = parabola_vertex(f**2, -(y**-2))
    return np.array([np.sqrt(square), (-least) ** -0.5])


def figures_of_merit(
    specimen: SpecimenModel,
    observations: ObservationSet | None,
    margin_free: PerceptionMargin | None,
    margin_on_membrane: PerceptionMargin | None,
    latency: StepLatency | None,
) -> Mapping[str, FigureOfMerit]:
    """Return the figures of merit that these runs determine, by name."""
    found: list[FigureOfMerit | None] = []
    if specimen.identification is not None:
        found += [
            FigureOfMerit(e.name, e.value, e.standard_error)
            for e in specimen.identification.estimates
            if e.name in FIGURES_OF_MERIT
        ]
    if observations is not None:
        found += measured_resonance(specimen, observations)
    if specimen.identification is not None and specimen.identifies_free_response:
        if margin_free is not None:
            found.append(FigureOfMerit("smallest_margin", margin_free.margin, margin_free.margin_error))
            if margin_free.felt_bands:
                found.append(FigureOfMerit("usable_from", margin_free.felt_bands[0][0], margin_free.edge_errors[0][0]))
                found.append(FigureOfMerit("usable_to", margin_free.felt_bands[-1][1], margin_free.edge_errors[-1][1]))
        if margin_on_membrane is not None:
            found.append(
                FigureOfMerit("smallest_margin_on_membrane", margin_on_membrane.margin, margin_on_membrane.margin_error)
            )
        if latency is not None:
            found += [latency.latency, latency.rise_time]
    return {merit.name: merit for merit in found if merit is not None}


def half_interval(merit: FigureOfMerit) -> float:
    """Return half of the 95 % interval."""
    return COVERAGE_FACTOR_95 * merit.standard_error


def merit_names() -> Sequence[str]:
    """What a limit can be set on."""
    return tuple(FIGURES_OF_MERIT)
