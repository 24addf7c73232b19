"""Posterior of an identification as a table, a sentence and a picture: whether the linear totals hold."""

import numpy as np

from app.common import Column, Table, terminal_progress
from app.identification import IdentificationResult
from model import Series, format_estimate
from model.identification import JointFit, Posterior, parameter_spec, sample_posterior
from model.studies import PaperFigure

TOLERANCE = 0.05
"""Relative difference of a total from the posterior's up to which it holds."""
MAX_SHIFT = 0.2
"""Distance of an estimate from the posterior's mean, in standard deviations, up to which it holds."""
GRID = 121
SMOOTHING = 0.3
"""Width of a smoothed draw, in standard deviations."""


def posterior_of(fit: JointFit, quiet: bool) -> Posterior:
    """Sample the posterior of a fit with a bar on a terminal.

    Raises:
        ParameterError: it cannot be sampled.
    """
    with terminal_progress("sampling the posterior", quiet) as bar:
        return sample_posterior(fit, progress=bar.update)


def posterior_table(posterior: Posterior, identification: IdentificationResult) -> Table:
    """Return totals of the linear fit and of the posterior, with intervals, of every parameter but shared errors."""
    names = [e.name for e in identification.estimates]
    at = [posterior.names.index(name) for name in names]
    intervals = [posterior.interval(name) for name in names]
    return Table(
        "posterior",
        f"Posterior by Monte Carlo: {len(posterior.draws)} draws, worth {posterior.independent:.0f} of equal weight",
        (
            Column("name", "", names, "parameter"),
            Column("mean", "", posterior.means[at].tolist(), format_spec=".6g"),
            Column("deviation", "", posterior.deviations[at].tolist(), "standard deviation", format_spec=".3g"),
            Column("unit", "", [e.unit for e in identification.estimates]),
            Column("low", "", [low for low, _ in intervals], "95 % from", format_spec=".6g"),
            Column("high", "", [high for _, high in intervals], "to", format_spec=".6g"),
            Column("ratio", "", posterior.ratios[at].tolist(), "linear total / posterior's", format_spec=".3f"),
            Column("shift", "", posterior.shifts[at].tolist(), "mean less estimate, in deviations", format_spec="+.2f"),
        ),
    )


def posterior_note(posterior: Posterior, identification: IdentificationResult) -> str:
    """Return whether the linear totals and correlations of the identified parameters hold, as text."""
    names = [e.name for e in identification.identified]
    at = [posterior.names.index(name) for name in names]
    noise = (2 * posterior.independent) ** -0.5
    allowed = max(TOLERANCE, 3 * noise)
    wrong = [
        i for i in at if abs(posterior.ratios[i] - 1) > allowed or abs(posterior.shifts[i]) > max(MAX_SHIFT, 5 * noise)
    ]
    if not wrong:
        least, most = (100 * (f(posterior.ratios[at]) - 1) for f in (np.min, np.max))
        away = np.abs(posterior.correlation - posterior.linear_correlation)[np.ix_(at, at)].max()
        return (
            f"the linear totals hold: {least:+.1f} to {most:+.1f} % against the posterior, which is known to {100 * noise:.1f} %; "
            f"correlations to {away:.2f}."
        )
    parts = []
    for i in wrong:
        low, high = posterior.interval(posterior.names[i])
        parts.append(f"{posterior.names[i]} from {low:.5g} to {high:.5g} {parameter_spec(posterior.names[i]).unit}")
    return f"the linear totals do not hold for {len(wrong)} of {len(at)} parameters; take the intervals of 95 %: {'; '.join(parts)}."


def posterior_figures(posterior: Posterior, identification: IdentificationResult) -> tuple[PaperFigure, ...]:
    """Return the density of each identified parameter beside the normal one of the linear fit, a panel each."""
    figures = []
    for e in identification.identified:
        i = posterior.names.index(e.name)
        middle, error, draws = posterior.estimates[i], posterior.errors[i], posterior.draws[:, i]
        x = np.linspace(min(draws.min(), middle - 3.5 * error), max(draws.max(), middle + 3.5 * error), GRID)
        width = SMOOTHING * posterior.deviations[i]
        smooth = np.exp(-0.5 * ((x[:, None] - draws) / width) ** 2) @ posterior.weights
        normal = np.exp(-0.5 * ((x - middle) / error) ** 2)
        curves = (Series(x, smooth / smooth.max(), label="posterior"), Series(x, normal, label="linear fit"))
        axes = e.name, e.unit, "density, largest 1", ""
        figures.append(PaperFigure("posterior", *axes, curves, f"{format_estimate(e)}. Posterior by Monte Carlo."))
    return tuple(figures)
