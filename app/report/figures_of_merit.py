"""What a specimen is worth, as numbers with errors: resonance and height as measured, margin over the threshold, latency.

What a lab sets limits on. Each is known by a name; one that the runs do not tell is not there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from app.report.specimen import GRID_HZ, HIGH_HZ, LOW_HZ, NORMAL, Specimen
from model.identification.observations import Campaign, FrequencyResponse
from model.identification.paper_chain import vertex
from model.identification.parameters import OWN
from model.parameter_spec import Quantity
from model.parameters import Membrane, Tactor
from model.response.latency import step_latency
from model.response.perception import THRESHOLD_M, margin, usable_bands
from model.studies.uncertainty import Band

Array = NDArray[np.float64]

AT_FULL = 0.02
"""How far, relative, a drive may be from the largest and still count as full."""

PARAMETERS = ("k2", "mu", "m_add", "c0", "E_m", "c_s_0", "c_s_delta")
_OF_ALL = (
    ("resonance", "Hz", "frequency of the largest fundamental as measured, free, full drive"),
    ("amplitude_at_resonance", "m", "largest max - min as measured, free, full drive"),
    ("usable_from", "Hz", "lowest frequency felt, free, full drive; by the model, from 5 Hz on"),
    ("usable_to", "Hz", "highest frequency felt, free, full drive; by the model, up to 250 Hz"),
    ("smallest_margin", "1", "smallest max - min over the threshold, 5 to 250 Hz, free, by the model"),
    ("smallest_margin_on_membrane", "1", "the same at the largest elongation that was measured"),
    ("latency", "s", "from a step to the highest voltage until it is felt, by the model"),
    ("rise_time", "s", "10 to 90 % after that step, by the model"),
)
MERITS = {name: Quantity(name, unit, Interval(gt=0), words, None) for name, unit, words in _OF_ALL} | {
    name: OWN[name] for name in PARAMETERS
}
"""Everything a limit can be set on: name, unit, meaning."""


@dataclass(frozen=True, slots=True)
class Merit:
    """A number of the specimen with its standard error, SI."""

    name: str
    value: float
    standard_error: float

    @property
    def unit(self) -> str:
        return MERITS[self.name].unit


@dataclass(frozen=True, slots=True)
class Felt:
    """How far above the threshold of the skin the specimen is over the band of touch, at full drive."""

    words: str
    band: Band
    usable: tuple[tuple[float, float], ...]
    edges: tuple[tuple[float, float], ...]
    """Standard errors of the ends of `usable`; 0 where it ends with the band that was looked at."""
    margin: float
    margin_error: float
    at_hz: float


def felt(known: Specimen, elongation_m: float | None) -> Felt | None:
    """By the model; None where it cannot be evaluated."""
    band = known.response(known.full_v, elongation_m)
    if band is None:
        return None
    over = margin(GRID_HZ, band.centre)
    worst = int(over.argmin())
    usable = usable_bands(GRID_HZ, band.centre)
    words = "free" if elongation_m is None else f"on the membrane, {1e3 * elongation_m:g} mm"
    edges = tuple((_edge_error(band, a), _edge_error(band, b)) for a, b in usable)
    error = float(band.standard_error[worst] / THRESHOLD_M)
    return Felt(words, band, usable, edges, float(over[worst]), error, float(GRID_HZ[worst]))


def _edge_error(band: Band, at_hz: float) -> float:
    """By how much the end of a usable band moves for one standard error of the curve."""
    if at_hz in (LOW_HZ, HIGH_HZ):
        return 0.0
    slope = float(np.interp(at_hz, GRID_HZ, np.gradient(band.centre, GRID_HZ)))
    return float(np.interp(at_hz, GRID_HZ, band.standard_error)) / abs(slope) if slope else float("inf")


@dataclass(frozen=True, slots=True)
class Quick:
    """How soon the specimen is felt after a step to the highest voltage."""

    volts: float
    latency: Merit | None
    rise: Merit | None
    overshoot: float
    overshoot_error: float


def quick(known: Specimen) -> Quick | None:
    """By the model; None where it cannot be evaluated."""
    volts = float(known.amplifier.specimen_v(known.amplifier.high_v))

    def figures(tactor: Tactor, _: Membrane) -> Array:
        told = step_latency(tactor, volts, THRESHOLD_M, n=known.n)
        return np.array([np.nan if t is None else t for t in (told.to_threshold_s, told.rise_s, told.overshoot)], float)

    band = known.band(figures)
    if band is None:
        return None
    merits = [
        Merit(name, float(v), float(e)) if np.isfinite(v) else None
        for name, v, e in zip(("latency", "rise_time"), band.centre, band.standard_error, strict=False)
    ]
    return Quick(volts, merits[0], merits[1], float(band.centre[2]), float(band.standard_error[2]))


def peak(known: Specimen, campaign: Campaign) -> list[Merit]:
    """Resonance and height as measured at full drive, free, in the newest dwell that has its highest point between two others."""
    found: dict[str, Merit] = {}
    for run in reversed(campaign.of(FrequencyResponse)):
        if run.elongation_m is not None or run.added_mass_kg is not None:
            continue
        if run.fundamental_m is not None and run.errors_m is not None:
            top = _vertex(run, np.abs(run.fundamental_m), run.errors_m, known.full_v)
            if top is not None:
                found.setdefault("resonance", Merit("resonance", *top[0]))
        if run.peak_to_peak_m is not None and run.peak_to_peak_errors_m is not None:
            top = _vertex(run, run.peak_to_peak_m, run.peak_to_peak_errors_m, known.full_v)
            if top is not None:
                found.setdefault("amplitude_at_resonance", Merit("amplitude_at_resonance", *top[1]))
    return list(found.values())


def _vertex(
    run: FrequencyResponse, y: Array, errors: Array, full_v: float
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Frequency and height of the single resonance through the three highest points, each with its standard error.

    Of a single resonance 1 / y^2 is a parabola over f^2. The errors are those of the points, and how far the paper's parabola
    of y over f is from it: what a curve through three points leaves open. The gain of the sensor, which all points share, moves
    the height.
    """
    drive = np.asarray(run.drive_amplitude_v) * np.ones_like(run.frequency_hz)
    at = np.flatnonzero(run.use & (np.abs(drive / full_v - 1) < AT_FULL))
    f, index = np.unique(run.frequency_hz[at], return_index=True)
    y, errors = y[at][index], errors[at][index]
    top = int(y.argmax()) if y.size else 0
    if not 0 < top < y.size - 1:
        return None
    three = slice(top - 1, top + 2)
    f, y, errors = f[three], y[three], errors[three]
    centre = _resonance(f, y)
    moved = np.array([_resonance(f, y + 1e-3 * step) - centre for step in np.diag(errors)]) / 1e-3
    shared = float(np.sqrt(sum(c.standard_error**2 for c in run.common if c.acts_on == "displacement")))
    error = np.sqrt((moved**2).sum(axis=0) + (centre - np.array(vertex(f, y))) ** 2)
    return (float(centre[0]), float(error[0])), (float(centre[1]), float(np.hypot(error[1], shared * centre[1])))


def _resonance(f: Array, y: Array) -> Array:
    square, least = vertex(f**2, -(y**-2))
    return np.array([np.sqrt(square), (-least) ** -0.5])


def merits_of(
    known: Specimen, campaign: Campaign | None, felt_free: Felt | None, felt_on: Felt | None, quick_: Quick | None
) -> Mapping[str, Merit]:
    """Everything a limit can be set on, as far as these runs tell it."""
    found: list[Merit | None] = []
    if known.found is not None:
        found += [Merit(e.name, e.value, e.standard_error) for e in known.found.estimates if e.name in MERITS]
    if campaign is not None:
        found += peak(known, campaign)
    if known.found is not None and known.tells_free:
        if felt_free is not None:
            found.append(Merit("smallest_margin", felt_free.margin, felt_free.margin_error))
            if felt_free.usable:
                found.append(Merit("usable_from", felt_free.usable[0][0], felt_free.edges[0][0]))
                found.append(Merit("usable_to", felt_free.usable[-1][1], felt_free.edges[-1][1]))
        if felt_on is not None:
            found.append(Merit("smallest_margin_on_membrane", felt_on.margin, felt_on.margin_error))
        if quick_ is not None:
            found += [quick_.latency, quick_.rise]
    return {merit.name: merit for merit in found if merit is not None}


def half_interval(merit: Merit) -> float:
    """Half of the 95 % interval."""
    return NORMAL * merit.standard_error


def names() -> Sequence[str]:
    """What a limit can be set on."""
    return tuple(MERITS)
