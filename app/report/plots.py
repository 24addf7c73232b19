"""Report plots: the figures of the paper and of the protocols from one specimen, with model bands, residuals and agreement.

Agreement is given as Pearson's r and p as in the paper, R^2 and residuals.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.plotting import UNCOMFORTABLE, PlotPanel, ReportPlot, axis_label, threshold_line
from app.report.runs import ReportRun
from app.report.specimen import GRID_HZ, SpecimenModel
from model import Array, Band, Role, Series, shown_unit
from model.identification import FrequencyResponseObservation, ObservationSet
from model.response import ABDOMEN_THRESHOLD, UNCOMFORTABLE_SOURCE, PerceptionThreshold
from model.studies import UncertaintyBand
from protocols.base import Figure, ModelFunction

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
    """Return the meaning of the dashed line and of the shade of a response."""
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
    for run in runs:
        y, errors = _peak_to_peak(run)
        here = specimen.curve_values(specimen.amplitude_curve(run.frequency_hz, volts, elongation, whole))
        # Scaled to the drive of each point: around rest the response of the two slopes is proportional to the drive.
        model = None if here is None else 1e6 * here * _drive_amplitudes(run) / volts
        label = "measured" if len(runs) == 1 else start_time_label(run.label)
        dots.append(Series(run.frequency_hz, 1e6 * y, 1e6 * errors, usable=run.usable, fit=model, label=label))
    return PlotPanel(
        title,
        "frequency (Hz)",
        "max - min (µm)" if whole else "2 x fundamental (µm)",
        (model_line(specimen, grid, band, 1e6),),
        tuple(dots),
        threshold_line(threshold, grid),
        UNCOMFORTABLE,
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
) -> Series:
    """Return a model curve, with its band if identified parameters affect it."""
    if band is None:
        return Series(x[:0], x[:0], label="the model cannot be evaluated here", role=Role.MODEL)
    label = label or specimen.description
    edges = Band(factor * band.lower, factor * band.upper) if (band.upper > band.lower).any() else None
    if edges is not None:
        label += ", 95 % band"
    return Series(x, factor * band.centre, band=edges, label=label, role=Role.MODEL)


def start_time_label(label: str) -> str:
    """`20261121T091502Z_T7_sine-dwell` as time of the run, which distinguishes runs of one panel."""
    stamp, _, rest = label.partition("_")
    if len(stamp) != 16 or not rest:
        return label
    which = rest.partition(" ")[2]
    return f"{stamp[:4]}-{stamp[4:6]}-{stamp[6:8]} {stamp[9:11]}:{stamp[11:13]}" + (f", {which}" if which else "")


def specimen_plots(
    specimen: SpecimenModel,
    observations: ObservationSet | None,
    runs: Sequence[ReportRun],
    threshold: PerceptionThreshold = ABDOMEN_THRESHOLD,
) -> list[ReportPlot]:
    """Return the figures of the paper and of the protocols for which these runs have points, by their titles."""
    by_title: dict[str, list[tuple[str, Figure]]] = {}
    for run in runs:
        for figure in run.figures:
            by_title.setdefault(figure.title, []).append((start_time_label(run.path.stem), figure))
    drawn = [protocol_plot(specimen, figures) for figures in by_title.values()]
    response = None if observations is None else response_figure(specimen, observations, threshold)
    plots = [*drawn, damping_plot(specimen), response]
    # Figures of other protocols come behind the paper's.
    return sorted((plot for plot in plots if plot is not None), key=lambda plot: (plot.title[:4] != "Fig.", plot.title))


def protocol_plot(specimen: SpecimenModel, figures: Sequence[tuple[str, Figure]]) -> ReportPlot:
    """Plot the figures of one title, each with the name of its run: one panel with the model's curve and band."""
    first = figures[0][1]
    groups: dict[tuple[str, int], list[tuple[Series, ModelFunction | None]]] = {}
    for at, (run, figure) in enumerate(figures):
        for series in figure.points:
            name = (series.label, 0) if series.label else ("measured" if len(figures) == 1 else run, at)
            groups.setdefault(name, []).append((series, figure.model))
    x_axis, y_axis = first.points[0].x_axis, first.points[0].y_axis
    (over, x_unit), (factor, y_unit) = shown_unit(x_axis.unit), shown_unit(y_axis.unit)
    dots, markers = [], []
    for i, ((label, _), parts) in enumerate(groups.items()):
        x, y, errors, usable, model = (
            np.concatenate(column)
            for column in zip(
                *((s.x, s.plotted, s.errors, s.usable, _model_values(specimen, m, s.x)) for s, m in parts), strict=True
            )
        )
        markers.append(first.markers.get(label, "os^Dv"[i % 5]))
        fit = None if np.isnan(model).all() else model
        dots.append(Series(x, y, errors, usable=usable, fit=fit, label=label).scaled(over, factor))
    grid = first.model_grid(np.concatenate([series.x for parts in groups.values() for series, _ in parts]))
    lines: tuple[Series, ...] = ()
    if first.model is not None and np.isfinite(_model_values(specimen, first.model, grid)).any():
        band = specimen.curve_with_band(specimen.figure_curve(first.model, grid))
        lines = (model_line(specimen, over * grid, band, factor),)
    panel = PlotPanel(
        "", axis_label(x_axis, x_unit), axis_label(y_axis, y_unit), lines, tuple(dots),
        from_zero=first.from_zero, unit=y_unit, markers=markers,
    )  # fmt: skip
    return ReportPlot(first.title, (panel,), f"{first.caption} {ERROR_BARS_NOTE}".strip())


def _model_values(specimen: SpecimenModel, curve: ModelFunction | None, x: Array) -> Array:
    """Return y over x by the model, (N,); NaN where it has none."""
    values = None if curve is None else specimen.curve_values(specimen.figure_curve(curve, x))
    return np.full(x.size, np.nan) if values is None else values


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
    dots = Series(delta, values, errors, fit=line, label="each by itself")
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
    agreements = [_panel_agreement(plot, panel) for plot in plots for panel in plot.panels]
    return [each for each in agreements if each is not None]


def _panel_agreement(plot: ReportPlot, panel: PlotPanel) -> CurveAgreement | None:
    from scipy.special import stdtr

    pairs = [(d.y[d.fit_rows], d.fit[d.fit_rows]) for d in panel.points if d.fit is not None and d.fit_rows.any()]
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
