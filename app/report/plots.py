"""The paper's Figs. 4, 5, 6, 8 and 9 of one specimen: its points on the model, with bands and residuals.

The frequency responses of one specimen, free and on the membrane, on the model: the paper's Fig. 9.

How well the drawn curves agree with their points: Pearson's r and p as the paper gives them, R^2, residuals.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from app.report.document import Dots, Line, Panel, Plot
from app.report.specimen import GRID_HZ, NORMAL, Specimen
from model.identification.observations import Campaign, FrequencyResponse, MassResonance, StaticLoading, VoltageSteps
from model.identification.paper_chain import resonances
from model.response.perception import THRESHOLD_M
from model.response.statics import load_compliance, voltage_gain
from model.studies.uncertainty import Band

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


Kind = TypeVar("Kind", bound=np.generic)


def plots_of(known: Specimen, campaign: Campaign) -> list[Plot]:
    """Every figure of the paper that these runs can fill, in the paper's order."""
    drawn = (
        loading(known, campaign.of(StaticLoading)),
        resonance(known, campaign.of(MassResonance)),
        steps(known, campaign.of(VoltageSteps)),
        damping(known),
        responses(known, campaign),
    )
    return [plot for plot in drawn if plot is not None]


def loading(known: Specimen, runs: Sequence[StaticLoading]) -> Plot | None:
    """Fig. 4: deflection under a load, each side by itself; the model has one stiffness for both."""
    if not runs:
        return None
    load = np.linspace(0, 1.05 * max(float(run.load_n.max()) for run in runs), 40)
    band = known.band(lambda t, _: load_compliance(t) * load)
    per_newton = load_compliance(known.tactor)
    looks = {"mfc": ("o", "MFC side"), "aluminium": ("s", "aluminium side"), "both": ("D", "both sides")}
    dots = tuple(
        Dots(
            looks[side][1],
            *_joined((r.load_n, 1e6 * r.deflection_m, 1e6 * NORMAL * r.errors_m) for r in runs if r.side == side),
            _stack(r.use for r in runs if r.side == side),
            looks[side][0],
            1e6 * per_newton * _stack(r.load_n for r in runs if r.side == side),
        )
        for side in looks
        if any(r.side == side for r in runs)
    )
    panel = Panel(
        "",
        "load at the centre (N)",
        "deflection (µm)",
        (line_of(known, load, band, 1e6),),
        dots,
        unit="µm",
    )
    caption = f"Static loading, electrodes shorted; positive in the direction of the push; every reading. {BARS}"
    return Plot("Fig. 4: deflection under a load", (panel,), caption)


def resonance(known: Specimen, runs: Sequence[MassResonance]) -> Plot | None:
    """Fig. 5: resonance frequency against the added mass, where the model's response is largest."""
    if not runs:
        return None
    masses = np.concatenate([run.mass_kg for run in runs])
    grid = np.linspace(masses.min(), masses.max(), 40) if np.ptp(masses) else masses[:1] * np.array([0.95, 1, 1.05])
    damped = {run.label: np.full(run.mass_kg.size, run.meaning == "peak") for run in runs}
    peaks = np.full(grid.size, runs[0].meaning == "peak")
    band = known.band(lambda t, _: resonances(t, grid, peaks, known.n)[0])
    dots = tuple(
        Dots(
            "measured" if len(runs) == 1 else when(run.label),
            1e3 * run.mass_kg,
            run.frequency_hz,
            NORMAL * run.errors_hz,
            run.use,
            "os^Dv"[i % 5],
            resonances(known.tactor, run.mass_kg, damped[run.label], known.n)[0],
        )
        for i, run in enumerate(runs)
    )
    panel = Panel(
        "",
        "added mass (g)",
        "resonance (Hz)",
        (line_of(known, 1e3 * grid, band),),
        dots,
        from_zero=False,
        unit="Hz",
    )
    what = "peak of the displacement's spectrum" if runs[0].meaning == "peak" else "natural frequency"
    return Plot("Fig. 5: resonance against added mass", (panel,), f"Frequency of the {what}. {BARS}")


def steps(known: Specimen, runs: Sequence[VoltageSteps]) -> Plot | None:
    """Fig. 6: deflection under a held voltage, against rest."""
    if not runs:
        return None
    map_ = known.amplifier
    volts = np.linspace(map_.low_v, map_.high_v, 51)
    band = known.band(lambda t, _: voltage_gain(t) * map_.specimen_v(volts))

    def chosen(pick: Callable[[VoltageSteps], NDArray[np.bool_]], label: str, marker: str) -> Iterable[Dots]:
        at = [pick(run) for run in runs]
        if any(each.any() for each in at):
            x, y, half = _joined(
                (r.input_v[a], 1e6 * r.deflection_m[a], 1e6 * NORMAL * r.errors_m[a])
                for r, a in zip(runs, at, strict=True)
            )
            model = 1e6 * voltage_gain(known.tactor) * map_.specimen_v(x)
            yield Dots(label, x, y, half, _stack(r.use[a] for r, a in zip(runs, at, strict=True)), marker, model)

    def none(run: VoltageSteps) -> NDArray[np.bool_]:
        return np.full(run.input_v.size, run.rising is None)

    def rising(run: VoltageSteps) -> NDArray[np.bool_]:
        return ~none(run) if run.rising is None else run.rising & ~none(run)

    def falling(run: VoltageSteps) -> NDArray[np.bool_]:
        return np.zeros(run.input_v.size, bool) if run.rising is None else ~run.rising

    dots = (*chosen(none, "measured", "o"), *chosen(rising, "rising", "^"), *chosen(falling, "falling", "v"))
    panel = Panel(
        "",
        "voltage at the amplifier's input (V)",
        "deflection (µm)",
        (line_of(known, volts, band, 1e6),),
        dots,
        from_zero=False,
        unit="µm",
    )
    caption = (
        f"Deflection against rest at {map_.rest_v:g} V (0 V on the specimen). The kink is the amplifier's: "
        f"{map_.slope_below:g} V/V below rest, {map_.slope_above:g} V/V above. {BARS}"
    )
    return Plot("Fig. 6: deflection under a voltage", (panel,), caption)


def damping(known: Specimen) -> Plot | None:
    """Fig. 8: damping by the skin against pre-stretch: every elongation by itself, and the line that was fitted to all."""
    if known.each is None:
        return None
    elongation = np.array(sorted(known.each))
    values, errors = np.array([known.each[e] for e in elongation]).T
    delta = 100 * elongation / known.membrane.L_m
    grid = np.linspace(0.0, 1.05 * float(delta.max()), 30)
    band = known.band(lambda _, m: m.c_s_delta * grid / 100 + m.c_s_0)
    line = known.membrane.c_s_delta * delta / 100 + known.membrane.c_s_0
    dots = Dots("each by itself", delta, values, NORMAL * errors, np.ones(delta.size, bool), "o", line)
    panel = Panel(
        "",
        "pre-stretch δ (%)",
        "c$_s$ (kg/(m s))",
        (line_of(known, grid, band, label="line fitted to all runs at once"),),
        (dots,),
        unit="kg/(m s)",
    )
    caption = (
        "Points: fits in which every elongation has its own damping. Line: c_s = c_s_delta δ + c_s_0, as fitted to all runs; its "
        "intercept is free here, fixed in the paper. Bars and band: 95 %."
    )
    return Plot("Fig. 8: damping by the skin", (panel,), caption)


def _stack(parts: Iterable[NDArray[Kind]]) -> NDArray[Kind]:
    return np.concatenate(list(parts))


def _joined(rows: Iterable[tuple[Array, Array, Array]]) -> tuple[Array, Array, Array]:
    x, y, half = (np.concatenate(column) for column in zip(*rows, strict=True))
    return x, y, half


@dataclass(frozen=True, slots=True)
class Agreement:
    """One curve. r, p and R^2 are None where there are too few points, or all are alike."""

    label: str
    points: int
    r: float | None
    p: float
    r_squared: float | None
    rms: float
    largest: float
    unit: str


def agreements(plots: Sequence[Plot]) -> list[Agreement]:
    """One for every panel, of its usable points."""
    found = [_agreement(plot, panel) for plot in plots for panel in plot.panels]
    return [each for each in found if each is not None]


def _agreement(plot: Plot, panel: Panel) -> Agreement | None:
    from scipy.stats import pearsonr

    pairs = [(d.y[d.good], d.model[d.good]) for d in panel.dots if d.model is not None and d.good.any()]
    if not pairs:
        return None
    y, model = (np.concatenate(column) for column in zip(*pairs, strict=True))
    gap = y - model
    r = p = squared = None
    if y.size > 2 and np.ptp(y) > 0 and np.ptp(model) > 0:
        told = pearsonr(y, model)
        r, p = float(told.statistic), float(told.pvalue)
        squared = float(1 - gap @ gap / ((y - y.mean()) @ (y - y.mean())))
    figure = plot.title.partition(":")[0]
    label = f"{figure} {panel.title}" if panel.title else plot.title
    return Agreement(
        label,
        y.size,
        r,
        float("nan") if p is None else p,
        squared,
        float(np.sqrt(np.mean(gap**2))),
        float(np.abs(gap).max()),
        panel.unit,
    )
