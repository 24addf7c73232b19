"""Drawings of a report: its plots and the pictures of its runs, each drawn once for PDF and HTML."""

import os
import signal
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from typing import Any

from app.common import NO_PROGRESS, Progress, kept_result
from app.plotting import (
    ReportPlot,
    VectorDrawing,
    describe_plot,
    draw_plot,
    draw_vectors,
    legend_height_in,
    matplotlib_folder,
    new_figure,
    run_figure,
)
from app.report.document import PAGE_IN, WIDTH_IN, Report
from app.report.runs import ReportRun
from app.report.specimen import SpecimenModel
from model.response import ABDOMEN_THRESHOLD, PerceptionThreshold
from protocols.runfile import Run, translate_read_errors

MAX_HEIGHT_IN = 5.0
"""Of the panels in one drawing: half a page, so that pages are filled."""
GAP_IN = 0.75
"""Between the axes of a run's picture: ticks, label and title."""


@dataclass(frozen=True, slots=True)
class Drawings:
    """Drawings of the plots of a report, in their order, and of its runs by name."""

    plots: tuple[tuple[VectorDrawing, ...], ...]
    """Several drawings of one plot where its rows need more than a page."""
    runs: tuple[tuple[str, VectorDrawing], ...]


def draw_report(
    report: Report,
    specimen: SpecimenModel,
    runs: Sequence[ReportRun],
    progress: Progress = NO_PROGRESS,
    threshold: PerceptionThreshold = ABDOMEN_THRESHOLD,
) -> Drawings:
    """Draw the plots of a report, and the pictures of these runs with the perception threshold; in two processes where the system can copy this one.

    Raises:
        RunReadError: a run file is damaged.
    """
    plots = [block for block in report.blocks if isinstance(block, ReportPlot)]
    pieces = [_pieces(plot) for plot in plots]
    tasks: list[ReportPlot | ReportRun] = [*(piece for every in pieces for piece in every), *runs]
    progress.update(0.0, "drawing")
    # A copy of a process has one thread only: a lock that another one held would stay locked.
    if runs and hasattr(os, "fork") and threading.active_count() == 1:
        drawn = _draw_in_two_processes(tasks, specimen, threshold)
    else:
        drawn = _draw(tasks, specimen, threshold)
    rest = iter(drawn)
    return Drawings(
        tuple(tuple(next(rest) for _ in every) for every in pieces), tuple((run.name, next(rest)) for run in runs)
    )


def _draw_in_two_processes(
    tasks: Sequence[ReportPlot | ReportRun], specimen: SpecimenModel, threshold: PerceptionThreshold
) -> list[VectorDrawing]:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    import matplotlib.backends.backend_svg  # noqa: F401 - loaded once, before the copy

    ignore_interrupts = partial(signal.signal, signal.SIGINT, signal.SIG_IGN)  # the original process ends both
    with ProcessPoolExecutor(1, get_context("fork"), ignore_interrupts) as pool:
        others = pool.submit(_draw, tasks[1::2], specimen, threshold)
        drawn: list[Any] = [None] * len(tasks)
        drawn[::2] = _draw(tasks[::2], specimen, threshold)
        drawn[1::2] = others.result()
    return drawn


def _draw(
    tasks: Sequence[ReportPlot | ReportRun], specimen: SpecimenModel, threshold: PerceptionThreshold
) -> list[VectorDrawing]:
    return [
        _kept_plot(task) if isinstance(task, ReportPlot) else _draw_run(task, specimen, threshold) for task in tasks
    ]


def _kept_plot(plot: ReportPlot) -> VectorDrawing:
    """Return the drawing of an equal plot by the same matplotlib, whose fonts it names, or draw it."""
    drawn_by = version("matplotlib"), matplotlib_folder()
    return kept_result("drawing", (drawn_by, plot), lambda: draw_report_plot(plot))


def draw_report_plot(plot: ReportPlot) -> VectorDrawing:
    """Draw a plot as wide as the text of a page."""
    height = plot.row_height_in * plot.rows + legend_height_in(plot)
    figure = new_figure(figsize=(WIDTH_IN, height))
    figure.patch.set_visible(False)  # marks across the page are seen through it
    draw_plot(figure, plot, (-0.1, 0.0, WIDTH_IN + 0.1, height))
    return draw_vectors(figure, describe_plot(plot))


def _pieces(plot: ReportPlot) -> list[ReportPlot]:
    """Return a plot in pieces of whole rows that fit on a page."""
    panels = plot.columns * max(1, int(MAX_HEIGHT_IN / plot.row_height_in))
    return [replace(plot, panels=plot.panels[i : i + panels]) for i in range(0, len(plot.panels), panels)]


def _draw_run(each: ReportRun, specimen: SpecimenModel, threshold: PerceptionThreshold) -> VectorDrawing:
    """Draw the picture of a run as large as the text of a page."""
    with Run(each.path) as run, translate_read_errors(each.path):
        # Fixed margins: measuring every text takes as long as drawing it.
        figure = run_figure(run, specimen.specimen, threshold, layout="none")
    height, bottom, top = PAGE_IN[1] - 2.2, 0.055, 0.95
    figure.set_size_inches(WIDTH_IN, height)
    figure.suptitle(figure.get_suptitle(), y=0.985, fontsize=10, parse_math=False)
    rows = figure.axes[0].get_gridspec().nrows
    axes_in = ((top - bottom) * height - (rows - 1) * GAP_IN) / rows
    figure.subplots_adjust(left=0.1, right=0.91, bottom=bottom, top=top, hspace=GAP_IN / axes_in)
    return draw_vectors(figure, f"Run {each.name}")
