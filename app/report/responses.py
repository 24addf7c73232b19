"""The frequency responses of one specimen, free and on the membrane, on the model: the paper's Fig. 9."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.report.blocks import Dots, Line, Panel, Plot
from app.report.specimen import GRID_HZ, NORMAL, Specimen
from model.identification.observations import Campaign, FrequencyResponse
from model.perception import THRESHOLD_M
from model.uncertainty import Band

Array = NDArray[np.float64]
TITLE = "Fig. 9: frequency response"
BARS = "Below: measured less model (Δ), in the same unit. Bars and bands: 95 %. Hollow: flagged, and in no fit."


def responses(known: Specimen, campaign: Campaign) -> Plot | None:
    """Fig. 9: the response against frequency, free and on the membrane at every elongation."""
    panels = response_panels(known, campaign)
    if not panels:
        return None
    caption = (
        f"Motion of the centre under a sine around rest; line: {known.words}. Max - min has the harmonics that the amplifier's two slopes "
        f"add; noise widens it, so that points lie above the line by a little. {BARS}"
    )
    many = len(panels) > 1
    return Plot(TITLE, tuple(panels), caption, columns=2 if many else 1, inches=2.15 if many else 2.6)


def response_panels(known: Specimen, campaign: Campaign) -> list[Panel]:
    """One for every elongation and drive, the free ones and the largest drives first."""
    groups: dict[tuple[float, float, bool], list[FrequencyResponse]] = {}
    for run in campaign.of(FrequencyResponse):
        volts = round(float(np.median(_drive(run)[run.use])), 2)
        where = -1.0 if run.elongation_m is None else run.elongation_m
        groups.setdefault((where, -volts, run.peak_to_peak_m is None), []).append(run)
    drives = {volts for _, volts, _ in groups}
    panels = []
    for at, ((where, volts, _), runs) in enumerate(sorted(groups.items(), key=lambda item: item[0])):
        title = "free" if where < 0 else f"on the membrane, {1e3 * where:g} mm"
        title += f", {-2 * volts:g} V peak to peak" if len(drives) > 1 or where < 0 else ""
        letter = f"({chr(97 + at)}) " if len(groups) > 1 else ""
        panels.append(_response(known, runs, -volts, None if where < 0 else where, letter + title))
    return panels


def _response(
    known: Specimen, runs: Sequence[FrequencyResponse], volts: float, elongation: float | None, title: str
) -> Panel:
    whole = runs[0].peak_to_peak_m is not None
    top = max(float(run.frequency_hz.max()) for run in runs)
    if top <= GRID_HZ[-1]:
        grid, band = GRID_HZ, known.response(volts, elongation, whole)
    else:
        grid = np.append(GRID_HZ, np.arange(GRID_HZ[-1] + 5, top + 5, 5.0))
        band = known.band(known.moved(grid, volts, elongation, whole))
    dots = []
    for i, run in enumerate(runs):
        y, errors = _amplitude(run)
        here = known.value(known.moved(run.frequency_hz, volts, elongation, whole))
        # In proportion to the drive, as it was at that point: around rest the amplifier's kink has no scale.
        model = None if here is None else 1e6 * here * _drive(run) / volts
        label = "measured" if len(runs) == 1 else when(run.label)
        dots.append(Dots(label, run.frequency_hz, 1e6 * y, 1e6 * NORMAL * errors, run.use, "os^Dv"[i % 5], model))
    return Panel(
        title,
        "frequency (Hz)",
        "max - min (µm)" if whole else "2 x fundamental (µm)",
        (line_of(known, grid, band, 1e6),),
        tuple(dots),
        (1e6 * THRESHOLD_M, "50 µm: felt on the abdomen"),
        unit="µm",
    )


def _drive(run: FrequencyResponse) -> Array:
    return np.asarray(run.drive_amplitude_v) * np.ones_like(run.frequency_hz)


def _amplitude(run: FrequencyResponse) -> tuple[Array, Array]:
    """Max - min, or where a table had the fundamental only, twice that; and its standard error."""
    if run.peak_to_peak_m is not None and run.peak_to_peak_errors_m is not None:
        return run.peak_to_peak_m, run.peak_to_peak_errors_m
    return 2 * np.abs(np.asarray(run.fundamental_m)), 2 * np.asarray(run.errors_m)


def line_of(known: Specimen, x: Array, band: Band | None, factor: float = 1.0, label: str = "") -> Line:
    """A curve of the model as it is drawn, with its band where what was identified moves it."""
    if band is None:
        return Line("the model cannot be evaluated here", x[:0], x[:0])
    wide = bool((band.upper > band.lower).any())
    edges = (factor * band.lower, factor * band.upper) if wide else (None, None)
    return Line((label or known.words) + (", 95 % band" if wide else ""), x, factor * band.centre, *edges)


def when(label: str) -> str:
    """`20261121T091502Z_T7_sine-dwell` as when it was: two runs of one panel differ in nothing else."""
    stamp, _, rest = label.partition("_")
    if len(stamp) != 16 or not rest:
        return label
    which = rest.partition(" ")[2]
    return f"{stamp[:4]}-{stamp[4:6]}-{stamp[6:8]} {stamp[9:11]}:{stamp[11:13]}" + (f", {which}" if which else "")
