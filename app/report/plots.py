"""Report plots: the paper's Figs. 4, 5, 6, 8 and 9 of a specimen, with model bands, residuals and agreement.

Agreement is given as Pearson's r and p as in the paper, R^2 and residuals.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from app.plotting.panels import MeasuredPoints, PlotLine, PlotPanel, ReportPlot
from app.plotting.threshold_line import threshold_line
from app.report.specimen import GRID_HZ, Effects, SpecimenModel, acting_tactor
from model import COVERAGE_FACTOR_95, Array, Mask
from model.identification import (
    LOADING_TIME_S,
    STEP_TIME_S,
    FrequencyResponseObservation,
    MassResonanceObservation,
    ObservationSet,
    StaticLoadingObservation,
    VoltageStepsObservation,
    resonance_frequencies,
)
from model.response import (
    ABDOMEN_THRESHOLD,
    REFERENCE_S,
    UNCOMFORTABLE_SOURCE,
    PerceptionThreshold,
    load_compliance,
    voltage_gain,
)
from model.studies.uncertainty import UncertaintyBand

TITLE = "Fig. 9: frequency response"
ERROR_BARS_NOTE = (
    "Below: measured less model (Δ), in the same unit. Bars and bands: 95 %. Hollow: flagged, and in no fit."
)


def response_figure(
    specimen: SpecimenModel, observations: ObservationSet, threshold: PerceptionThreshold, most: int | None = None
) -> ReportPlot | None:
    """Plot Fig. 9: response against frequency, free and on the membrane at every elongation; `most` panels of them."""
    panels = response_panels(specimen, observations, threshold, most)
    if not panels:
        return None
    caption = (
        f"{threshold_caption(threshold)} Motion of the centre under a sine around rest; line: {specimen.description}. Max - min has the harmonics that the amplifier's two slopes "
        f"add; noise widens it, so that points lie above the line by a little. {ERROR_BARS_NOTE}"
    )
    many = len(panels) > 1
    return ReportPlot(TITLE, tuple(panels), caption, columns=2 if many else 1, row_height_in=2.15 if many else 2.6)


def threshold_caption(threshold: PerceptionThreshold) -> str:
    """Return what the dashed line and the shade of a response are."""
    return f"Dashed: threshold of perception, {threshold.description}. Shaded: uncomfortable ({UNCOMFORTABLE_SOURCE})."


def response_panels(
    specimen: SpecimenModel,
    observations: ObservationSet,
    threshold: PerceptionThreshold = ABDOMEN_THRESHOLD,
    most: int | None = None,
) -> list[PlotPanel]:
    """Return one panel for every elongation and drive, free ones and largest drives first; the first `most` of them."""
    groups: dict[tuple[float, float, bool], list[FrequencyResponseObservation]] = {}
    for run in observations.of_type(FrequencyResponseObservation):
        volts = round(float(np.median(_drive_amplitudes(run)[run.usable])), 2)
        where = -1.0 if run.elongation_m is None else run.elongation_m
        groups.setdefault((where, -volts, run.peak_to_peak_m is None), []).append(run)
    drives = {volts for _, volts, _ in groups}
    panels = []
    for at, ((where, volts, _), runs) in enumerate(sorted(groups.items(), key=lambda item: item[0])[:most]):
        title = "free" if where < 0 else f"on the membrane, {1e3 * where:g} mm"
        title += f", {-2 * volts:g} V peak to peak" if len(drives) > 1 or where < 0 else ""
        letter = f"({chr(97 + at)}) " if len(groups) > 1 else ""
        elongation = None if where < 0 else where
        panels.append(_response_panel(specimen, runs, -volts, elongation, letter + title, threshold))
    return panels


def _response_panel(
    specimen: SpecimenModel,
    runs: Sequence[FrequencyResponseObservation],
    volts: float,
    elongation: float | None,
    title: str,
    threshold: PerceptionThreshold,
) -> PlotPanel:
    whole = runs[0].peak_to_peak_m is not None
    top = max(float(run.frequency_hz.max()) for run in runs)
    if top <= GRID_HZ[-1]:
        grid, band = GRID_HZ, specimen.response(volts, elongation, whole)
    else:
        grid = np.append(GRID_HZ, np.arange(GRID_HZ[-1] + 5, top + 5, 5.0))
        band = specimen.curve_with_band(specimen.amplitude_curve(grid, volts, elongation, whole))
    dots = []
    for i, run in enumerate(runs):
        y, errors = _peak_to_peak(run)
        here = specimen.curve_values(specimen.amplitude_curve(run.frequency_hz, volts, elongation, whole))
        # Scaled to the drive of each point: around rest the response of the two slopes is proportional to the drive.
        model = None if here is None else 1e6 * here * _drive_amplitudes(run) / volts
        label = "measured" if len(runs) == 1 else start_time_label(run.label)
        dots.append(
            MeasuredPoints(
                label, run.frequency_hz, 1e6 * y, 1e6 * COVERAGE_FACTOR_95 * errors, run.usable, "os^Dv"[i % 5], model
            )
        )
    return PlotPanel(
        title,
        "frequency (Hz)",
        "max - min (µm)" if whole else "2 x fundamental (µm)",
        (model_line(specimen, grid, band, 1e6),),
        tuple(dots),
        threshold_line(threshold, grid),
        unit="µm",
    )


def _drive_amplitudes(run: FrequencyResponseObservation) -> Array:
    return np.asarray(run.drive_amplitude_v) * np.ones_like(run.frequency_hz)


def _peak_to_peak(run: FrequencyResponseObservation) -> tuple[Array, Array]:
    """Return max - min, or twice the fundamental if a table had only that, with standard errors."""
    if run.peak_to_peak_m is not None and run.peak_to_peak_errors_m is not None:
        return run.peak_to_peak_m, run.peak_to_peak_errors_m
    return 2 * np.abs(np.asarray(run.fundamental_m)), 2 * np.asarray(run.errors_m)


def model_line(
    specimen: SpecimenModel, x: Array, band: UncertaintyBand | None, factor: float = 1.0, label: str = ""
) -> PlotLine:
    """Return a model curve, with its band if identified parameters affect it."""
    if band is None:
        return PlotLine("the model cannot be evaluated here", x[:0], x[:0])
    wide = bool((band.upper > band.lower).any())
    edges = (factor * band.lower, factor * band.upper) if wide else (None, None)
    return PlotLine((label or specimen.description) + (", 95 % band" if wide else ""), x, factor * band.centre, *edges)


def start_time_label(label: str) -> str:
    """`20261121T091502Z_T7_sine-dwell` as time of the run, which distinguishes runs of one panel."""
    stamp, _, rest = label.partition("_")
    if len(stamp) != 16 or not rest:
        return label
    which = rest.partition(" ")[2]
    return f"{stamp[:4]}-{stamp[4:6]}-{stamp[6:8]} {stamp[9:11]}:{stamp[11:13]}" + (f", {which}" if which else "")


Scalar = TypeVar("Scalar", bound=np.generic)


def paper_plots(
    specimen: SpecimenModel, observations: ObservationSet, threshold: PerceptionThreshold = ABDOMEN_THRESHOLD
) -> list[ReportPlot]:
    """Return the figures of the paper for which these runs have points, in the paper's order."""
    drawn = (
        loading_plot(specimen, observations.of_type(StaticLoadingObservation)),
        resonance_plot(specimen, observations.of_type(MassResonanceObservation)),
        steps_plot(specimen, observations.of_type(VoltageStepsObservation)),
        damping_plot(specimen),
        response_figure(specimen, observations, threshold),
    )
    return [plot for plot in drawn if plot is not None]


def loading_plot(specimen: SpecimenModel, runs: Sequence[StaticLoadingObservation]) -> ReportPlot | None:
    """Plot Fig. 4: deflection under a load for each side; the model has one stiffness for both."""
    if not runs:
        return None
    load = np.linspace(0, 1.05 * max(float(run.load_n.max()) for run in runs), 40)
    band = specimen.curve_with_band(
        lambda t, _, effects: load_compliance(acting_tactor(t, effects)) * load * crept(effects, LOADING_TIME_S)
    )
    per_newton = load_compliance(acting_tactor(specimen.tactor, specimen.effects)) * crept(
        specimen.effects, LOADING_TIME_S
    )
    looks = {"mfc": ("o", "MFC side"), "aluminium": ("s", "aluminium side"), "both": ("D", "both sides")}
    dots = tuple(
        MeasuredPoints(
            looks[side][1],
            *_join_rows(
                (r.load_n, 1e6 * r.deflection_m, 1e6 * COVERAGE_FACTOR_95 * r.errors_m) for r in runs if r.side == side
            ),
            _concatenate(r.usable for r in runs if r.side == side),
            looks[side][0],
            1e6 * per_newton * _concatenate(r.load_n for r in runs if r.side == side),
        )
        for side in looks
        if any(r.side == side for r in runs)
    )
    panel = PlotPanel(
        "",
        "load at the centre (N)",
        "deflection (µm)",
        (model_line(specimen, load, band, 1e6),),
        dots,
        unit="µm",
    )
    caption = (
        f"Static loading, electrodes shorted; positive in the direction of the push; every reading. {ERROR_BARS_NOTE}"
    )
    return ReportPlot("Fig. 4: deflection under a load", (panel,), caption)


def resonance_plot(specimen: SpecimenModel, runs: Sequence[MassResonanceObservation]) -> ReportPlot | None:
    """Plot Fig. 5: resonance frequency against added mass, with the peak of the model's response."""
    if not runs:
        return None
    masses = np.concatenate([run.mass_kg for run in runs])
    grid = np.linspace(masses.min(), masses.max(), 40) if np.ptp(masses) else masses[:1] * np.array([0.95, 1, 1.05])
    damped = {run.label: np.full(run.mass_kg.size, run.meaning == "peak") for run in runs}
    peaks = np.full(grid.size, runs[0].meaning == "peak")
    band = specimen.curve_with_band(
        lambda t, _, effects: resonance_frequencies(
            acting_tactor(t, effects), acting(effects, grid), peaks, specimen.n
        )[0]
    )
    dots = tuple(
        MeasuredPoints(
            "measured" if len(runs) == 1 else start_time_label(run.label),
            1e3 * run.mass_kg,
            run.frequency_hz,
            COVERAGE_FACTOR_95 * run.errors_hz,
            run.usable,
            "os^Dv"[i % 5],
            resonance_frequencies(
                acting_tactor(specimen.tactor, specimen.effects),
                acting(specimen.effects, run.mass_kg),
                damped[run.label],
                specimen.n,
            )[0],
        )
        for i, run in enumerate(runs)
    )
    panel = PlotPanel(
        "",
        "added mass (g)",
        "resonance (Hz)",
        (model_line(specimen, 1e3 * grid, band),),
        dots,
        from_zero=False,
        unit="Hz",
    )
    what = "peak of the displacement's spectrum" if runs[0].meaning == "peak" else "natural frequency"
    return ReportPlot("Fig. 5: resonance against added mass", (panel,), f"Frequency of the {what}. {ERROR_BARS_NOTE}")


def steps_plot(specimen: SpecimenModel, runs: Sequence[VoltageStepsObservation]) -> ReportPlot | None:
    """Fig. 6: deflection under a held voltage, against rest."""
    if not runs:
        return None
    map_ = specimen.amplifier
    volts = np.linspace(map_.low_v, map_.high_v, 51)
    band = specimen.curve_with_band(
        lambda t, _, effects: (
            voltage_gain(acting_tactor(t, effects)) * map_.specimen_v(volts) * crept(effects, STEP_TIME_S)
        )
    )

    def chosen(pick: Callable[[VoltageStepsObservation], Mask], label: str, marker: str) -> Iterable[MeasuredPoints]:
        at = [pick(run) for run in runs]
        if any(each.any() for each in at):
            x, y, half = _join_rows(
                (r.input_v[a], 1e6 * r.deflection_m[a], 1e6 * COVERAGE_FACTOR_95 * r.errors_m[a])
                for r, a in zip(runs, at, strict=True)
            )
            model = (
                1e6
                * voltage_gain(acting_tactor(specimen.tactor, specimen.effects))
                * map_.specimen_v(x)
                * crept(specimen.effects, STEP_TIME_S)
            )
            yield MeasuredPoints(
                label, x, y, half, _concatenate(r.usable[a] for r, a in zip(runs, at, strict=True)), marker, model
            )

    def none(run: VoltageStepsObservation) -> Mask:
        return np.full(run.input_v.size, run.rising is None)

    def rising(run: VoltageStepsObservation) -> Mask:
        return ~none(run) if run.rising is None else run.rising & ~none(run)

    def falling(run: VoltageStepsObservation) -> Mask:
        return np.zeros(run.input_v.size, bool) if run.rising is None else ~run.rising

    dots = (*chosen(none, "measured", "o"), *chosen(rising, "rising", "^"), *chosen(falling, "falling", "v"))
    panel = PlotPanel(
        "",
        "voltage at the amplifier's input (V)",
        "deflection (µm)",
        (model_line(specimen, volts, band, 1e6),),
        dots,
        from_zero=False,
        unit="µm",
    )
    caption = (
        f"Deflection against rest at {map_.rest_v:g} V (0 V on the specimen). The kink is the amplifier's: "
        f"{map_.slope_below:g} V/V below rest, {map_.slope_above:g} V/V above. {ERROR_BARS_NOTE}"
    )
    return ReportPlot("Fig. 6: deflection under a voltage", (panel,), caption)


def damping_plot(specimen: SpecimenModel) -> ReportPlot | None:
    """Plot Fig. 8: skin damping against pre-stretch for every elongation, with the line fitted to all."""
    if specimen.damping_by_elongation is None:
        return None
    elongation = np.array(sorted(specimen.damping_by_elongation))
    values, errors = np.array([specimen.damping_by_elongation[e] for e in elongation]).T
    delta = 100 * elongation / specimen.membrane.L_m
    grid = np.linspace(0.0, 1.05 * float(delta.max()), 30)
    band = specimen.curve_with_band(lambda _, m, __: m.c_s_delta * grid / 100 + m.c_s_0)
    line = specimen.membrane.c_s_delta * delta / 100 + specimen.membrane.c_s_0
    dots = MeasuredPoints(
        "each by itself", delta, values, COVERAGE_FACTOR_95 * errors, np.ones(delta.size, bool), "o", line
    )
    panel = PlotPanel(
        "",
        "pre-stretch δ (%)",
        "c$_s$ (kg/(m s))",
        (model_line(specimen, grid, band, label="line fitted to all runs at once"),),
        (dots,),
        unit="kg/(m s)",
    )
    caption = (
        "Points: fits in which every elongation has its own damping. Line: c_s = c_s_delta δ + c_s_0, as fitted to all runs; its "
        "intercept is free here, fixed in the paper. Bars and band: 95 %."
    )
    return ReportPlot("Fig. 8: damping by the skin", (panel,), caption)


def crept(effects: Effects, time_s: float) -> float:
    """Return the factor of a deflection that creeps for so long after its step."""
    return 1 + effects["creep"] * float(np.log10(time_s / REFERENCE_S))


def acting(effects: Effects, mass_kg: Array) -> Array:
    """Return the masses that act at the centre, of those put in the cylinder, (F,)."""
    return effects["mass_fraction"] * mass_kg + effects["mass_offset"]


def _concatenate(parts: Iterable[NDArray[Scalar]]) -> NDArray[Scalar]:
    return np.concatenate(list(parts))


def _join_rows(rows: Iterable[tuple[Array, Array, Array]]) -> tuple[Array, Array, Array]:
    x, y, half = (np.concatenate(column) for column in zip(*rows, strict=True))
    return x, y, half


@dataclass(frozen=True, slots=True)
class CurveAgreement:
    """Agreement of one curve. r and R^2 are None for too few or identical points."""

    label: str
    points: int
    r: float | None
    p: float
    r_squared: float | None
    rms: float
    largest: float
    unit: str


def curve_agreements(plots: Sequence[ReportPlot]) -> list[CurveAgreement]:
    """Return the agreement of every panel with its usable points."""
    found = [_panel_agreement(plot, panel) for plot in plots for panel in plot.panels]
    return [each for each in found if each is not None]


def _panel_agreement(plot: ReportPlot, panel: PlotPanel) -> CurveAgreement | None:
    from scipy.special import stdtr

    pairs = [(d.y[d.usable], d.model_y[d.usable]) for d in panel.points if d.model_y is not None and d.usable.any()]
    if not pairs:
        return None
    y, model = (np.concatenate(column) for column in zip(*pairs, strict=True))
    gap = y - model
    r = p = squared = None
    if y.size > 2 and np.ptp(y) > 0 and np.ptp(model) > 0:
        r = float(np.clip(np.corrcoef(y, model)[0, 1], -1, 1))
        free = y.size - 2
        p = float(2 * stdtr(free, -abs(r) * np.sqrt(free / max(1 - r * r, 1e-300))))  # Student's t
        squared = float(1 - gap @ gap / ((y - y.mean()) @ (y - y.mean())))
    figure = plot.title.partition(":")[0]
    label = f"{figure} {panel.title}" if panel.title else plot.title
    return CurveAgreement(
        label,
        y.size,
        r,
        float("nan") if p is None else p,
        squared,
        float(np.sqrt(np.mean(gap**2))),
        float(np.abs(gap).max()),
        panel.unit,
    )
