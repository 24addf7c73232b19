"""How well the drawn curves agree with their points: Pearson's r and p as the paper gives them, R^2, residuals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.report.blocks import Panel, Plot


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
