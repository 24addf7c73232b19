"""The frequency responses of one specimen, free and on the membrane, on the model: the paper's Fig. 9."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.figures import THRESHOLD_M
from app.report.blocks import Dots, Line, Panel, Plot
from app.report.specimen import GRID_HZ, NORMAL, Specimen
from model.identification.observations import Campaign, FrequencyResponse
from model.uncertainty import Band

Array = NDArray[np.float64]
BARS = "Bars and bands: 95 %. Hollow: flagged, and in no fit."


def responses(known: Specimen, campaign: Campaign) -> Plot | None:
    """Fig. 9: max - min against frequency, free and on the membrane at every elongation."""
    panels = response_panels(known, campaign)
    if not panels:
        return None
    caption = (
        f"Max - min of the centre under a sine around rest; line: {known.words}, with the harmonics that the amplifier's two slopes "
        f"add. Noise widens max - min, so the points lie above the line by a little. {BARS}"
    )
    return Plot("Fig. 9: frequency response", tuple(panels), caption, columns=2 if len(panels) > 1 else 1, inches=2.15)


def response_panels(known: Specimen, campaign: Campaign) -> list[Panel]:
    """One for every elongation and drive, the free ones first."""
    groups: dict[tuple[float, float], list[FrequencyResponse]] = {}
    for run in campaign.of(FrequencyResponse):
        if run.peak_to_peak_m is not None:
            volts = round(float(np.median(np.asarray(run.drive_amplitude_v)[run.use])), 2)
            groups.setdefault((-1.0 if run.elongation_m is None else run.elongation_m, -volts), []).append(run)
    drives = {volts for _, volts in groups}
    panels = []
    for at, ((where, volts), runs) in enumerate(sorted(groups.items(), key=lambda item: item[0])):
        elongation = None if where < 0 else where
        title = "free" if elongation is None else f"on the membrane, {1e3 * elongation:g} mm"
        title += f", {-2 * volts:g} V peak to peak" if len(drives) > 1 or elongation is None else ""
        letter = f"({chr(97 + at)}) " if len(groups) > 1 else ""
        panels.append(_response(known, runs, -volts, elongation, letter + title))
    return panels


def _response(
    known: Specimen, runs: Sequence[FrequencyResponse], volts: float, elongation: float | None, title: str
) -> Panel:
    top = max(float(run.frequency_hz.max()) for run in runs)
    if top <= GRID_HZ[-1]:
        grid, band = GRID_HZ, known.response(volts, elongation)
    else:
        grid = np.append(GRID_HZ, np.arange(GRID_HZ[-1] + 5, top + 5, 5.0))
        band = known.band(known.moved(grid, volts, elongation))
    dots = []
    for i, run in enumerate(runs):
        assert run.peak_to_peak_m is not None
        assert run.peak_to_peak_errors_m is not None
        model = None
        if (here := known.value(known.moved(run.frequency_hz, volts, elongation))) is not None:
            # In proportion to the drive, as it was at that point: around rest the amplifier's kink has no scale.
            model = 1e6 * here * np.asarray(run.drive_amplitude_v) / volts
        dots.append(
            Dots(
                "measured" if len(runs) == 1 else when(run.label),
                run.frequency_hz,
                1e6 * run.peak_to_peak_m,
                1e6 * NORMAL * run.peak_to_peak_errors_m,
                run.use,
                "os^Dv"[i % 5],
                model,
            )
        )
    return Panel(
        title,
        "frequency (Hz)",
        "max - min (µm)",
        (line_of(known, grid, band, 1e6),),
        tuple(dots),
        (1e6 * THRESHOLD_M, "50 µm: felt on the abdomen"),
        residual_label="Δ (µm)",
    )


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
