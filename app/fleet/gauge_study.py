"""Gauge study (gauge R&R): standard deviations between specimens, operators and mountings, and of repeats, from runs that exist.

Variance components by restricted maximum likelihood, which needs no balanced plan (Searle, Casella, McCulloch, Variance Components,
1992, ch. 6). With a balanced plan they are those of the analysis of variance in AIAG, Measurement Systems Analysis, 4th ed., 2010, ch. III.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.common import Column, Table, pluralize
from app.fleet.catalogue_values import CALIBRATION, FleetError, FleetSelection
from model import Array, Series, format_with_uncertainty, shown_unit
from model.studies import PaperFigure
from protocols.runfile import Run, translate_read_errors

SPECIMEN, OPERATOR, MOUNTING, INTERACTION, REPEAT = "specimen", "operator", "mounting", "specimen x operator", "repeat"
MAX_VALUES = 1000
"""Largest number of values: a step of the fit takes the cube of it, a second for a thousand."""
MIN_VALUES = 3
SMALLEST_REPEAT = 1e-9
"""Smallest variance of repeats, as a share of the variance of all values: without any the likelihood has no maximum."""

MOST_SCORINGS = 20
"""Most scorings after the search."""

CATEGORIES_FACTOR = 1.41
"""Distinct categories are this many times the specimens' standard deviation over the gauge's (AIAG)."""


@dataclass(frozen=True, slots=True)
class VarianceComponent:
    """Variance of one source, SI, with its standard error; `levels` is the number of its groups, or of values for repeats."""

    name: str
    levels: int
    variance: float
    variance_error: float

    @property
    def sd(self) -> float:
        """Standard deviation."""
        return math.sqrt(self.variance)

    @property
    def sd_error(self) -> float:
        """Standard error of the standard deviation; NaN where it is zero."""
        return self.variance_error / (2 * self.sd) if self.variance > 0 else math.nan


@dataclass(frozen=True)
class GaugeStudy:
    """Variance components of values; `inseparable` states why a source has none."""

    mean: float
    components: tuple[VarianceComponent, ...]
    inseparable: tuple[str, ...]
    covariance: Array
    """(C, C), of the variances."""

    def together(self, name: str, parts: Sequence[str]) -> VarianceComponent:
        """Return the sum of the components of some sources."""
        rows = np.array([each.name in parts for each in self.components], float)
        variance = float(rows @ [each.variance for each in self.components])
        return VarianceComponent(name, 0, variance, math.sqrt(max(float(rows @ self.covariance @ rows), 0.0)))

    @property
    def gauge(self) -> VarianceComponent:
        """Repeatability and reproducibility: everything but the specimens."""
        return self.together("gauge (R&R)", [each.name for each in self.components if each.name != SPECIMEN])

    @property
    def total(self) -> VarianceComponent:
        """All sources."""
        return self.together("total", [each.name for each in self.components])

    @property
    def categories(self) -> int | None:
        """Number of distinct categories (AIAG), at least 1; None where the variance of the specimens or of the gauge is zero."""
        specimens = self.together("", [SPECIMEN])
        if not (specimens.variance > 0 and self.gauge.variance > 0):
            return None
        return max(math.floor(CATEGORIES_FACTOR * specimens.sd / self.gauge.sd), 1)


def gauge_study(values: Array, factors: Mapping[str, Sequence[str]]) -> GaugeStudy:
    """Return the variance components of values (N,) by factors, each with N labels.

    Raises:
        FleetError: there are too few or too many values, or no factor with groups.
    """
    if not MIN_VALUES <= values.size <= MAX_VALUES:
        raise FleetError(f"a gauge study takes {MIN_VALUES} to {MAX_VALUES} values; there are {values.size}")
    groups, inseparable = _separable(factors)
    if not groups:
        reasons = "; ".join(inseparable)
        raise FleetError(f"nothing repeats in these {values.size} values that could be told apart: {reasons}")
    scale = float(values.std()) or 1.0
    variances, covariance = _restricted_likelihood((values - values.mean()) / scale, [*groups.values()])
    errors = np.sqrt(np.maximum(covariance.diagonal(), 0.0)) * scale**2
    levels = [*(int(codes.max()) + 1 for codes in groups.values()), values.size]
    rows = zip((*groups, REPEAT), levels, variances * scale**2, errors, strict=True)
    found = tuple(VarianceComponent(name, n, float(v), float(e)) for name, n, v, e in rows)
    return GaugeStudy(float(values.mean()), found, tuple(inseparable), covariance * scale**4)


def _separable(factors: Mapping[str, Sequence[str]]) -> tuple[dict[str, Array], list[str]]:
    """Return the groups (N,) of each factor that differs from the others, and the reasons against the rest."""
    groups: dict[str, Array] = {}
    reasons = []
    for name, labels in factors.items():
        if name == INTERACTION and not {SPECIMEN, OPERATOR} <= groups.keys():
            continue
        numbers = {label: i for i, label in enumerate(dict.fromkeys(labels))}  # in the order of appearance
        codes = np.array([numbers[label] for label in labels], float)
        same = next((other for other, own in groups.items() if np.array_equal(own, codes)), None)
        if len(numbers) == 1:
            reasons.append(f"one {name} only")
        elif len(numbers) == codes.size:
            reasons.append(f"every value has a {name} of its own, which cannot be told from a repeat")
        elif same is not None:
            reasons.append(f"{name} cannot be told from {same}: they change together")
        else:
            groups[name] = codes
    return groups, reasons


def _restricted_likelihood(y: Array, groups: Sequence[Array]) -> tuple[Array, Array]:
    """Return the variances (K + 1,) of K groupings and of repeats, and their covariance by the expected information."""
    from scipy.optimize import minimize

    alike = [np.equal.outer(codes, codes).astype(float) for codes in groups] + [np.eye(y.size)]

    def projection(variances: Array) -> tuple[Array, float]:
        """Return the matrix P of the likelihood without the mean, (N, N), and the logarithm of its determinant's part."""
        V = sum(v * each for v, each in zip(variances, alike, strict=True))
        factor = np.linalg.cholesky(V)
        inverse = np.linalg.inv(V)
        ones = inverse.sum(axis=0)
        size = float(ones.sum())
        return inverse - np.outer(ones, ones) / size, 2 * float(np.log(factor.diagonal()).sum()) + math.log(size)

    def cost(variances: Array) -> tuple[float, Array, Array]:
        """Return minus the logarithm of the likelihood, its slopes (K + 1,), and P."""
        P, logarithm = projection(variances)
        r = P @ y
        slopes = np.array([float(np.sum(P * each)) - float(r @ each @ r) for each in alike])
        return 0.5 * (logarithm + float(y @ r)), 0.5 * slopes, P

    def descent(variances: Array) -> tuple[float, Array]:
        return cost(variances)[:2]

    start = np.full(len(alike), 1.0 / len(alike))
    limits = [(0.0, None)] * len(groups) + [(SMALLEST_REPEAT, None)]
    found = minimize(descent, start, jac=True, bounds=limits, method="L-BFGS-B", options={"ftol": 1e-15, "gtol": 1e-9})

    def covariance(P: Array, free: Sequence[bool]) -> Array:
        """Return the covariance by the expected information, with zeros where a variance is not free."""
        products = [P @ each for each in alike]
        information = 0.5 * np.array([[float(np.sum(a * b.T)) for b in products] for a in products])
        size = np.sqrt(information.diagonal())  # variances of repeats may be a billionth of the others
        scaled = np.where(np.outer(free, free), information / np.outer(size, size), 0.0)
        return np.asarray(np.linalg.pinv(scaled) / np.outer(size, size))

    # L-BFGS-B stops a few percent from the smallest of very unequal variances; Fisher's scoring ends at it.
    variances, lowest = np.asarray(found.x), np.array([low for low, _ in limits])
    value, slopes, P = cost(variances)
    for _ in range(MOST_SCORINGS):
        step = covariance(P, ((variances > lowest) | (slopes < 0)).tolist()) @ slopes
        trial = np.maximum(variances - step, lowest)
        trial_value, *at_trial = cost(trial)
        if not trial_value < value:
            break
        variances, value, (slopes, P) = trial, trial_value, at_trial
    return variances, covariance(P, [True] * len(alike))


def study_of_runs(folder: Path, selection: FleetSelection) -> tuple[GaugeStudy, dict[str, tuple[str, ...]]]:
    """Return the gauge study of the values of one quantity, and the labels of its factors.

    Raises:
        FleetError: too few values, or nothing that repeats.
        RunReadError: a run file is damaged.
    """
    every = selection.values
    specimens = tuple(v.specimen for v in every)
    operators = tuple(v.operator or "unknown" for v in every)
    mounted = [f"{v.specimen} {'' if v.protocol == CALIBRATION else _mounting_of(folder / v.path)}" for v in every]
    factors = {
        SPECIMEN: specimens,
        OPERATOR: operators,
        MOUNTING: tuple(mounted),
        INTERACTION: tuple(f"{s}\n{o}" for s, o in zip(specimens, operators, strict=True)),
    }
    return gauge_study(np.array([v.value for v in every]), factors), factors


def _mounting_of(path: Path) -> str:
    with Run(path) as run, translate_read_errors(path):
        return ", ".join(f"{each.part} {each.time}" for each in sorted(run.mountings, key=lambda each: each.part))


def gauge_table(selection: FleetSelection, study: GaugeStudy) -> Table:
    """Return the standard deviation of each source, with its share of the variance."""
    factor, unit = shown_unit(selection.unit, selection.name)
    rows, total = [*study.components, study.gauge, study.total], study.total.variance or 1.0
    return Table(
        "components",
        f"{selection.label} of {pluralize(len(selection.values), 'value')} ({selection.about}): where the scatter comes from",
        (
            Column("source", None, [each.name for each in rows]),
            Column("levels", None, [str(each.levels) if each.levels else "" for each in rows], "groups"),
            Column("shown_sd", None, [_sd_text(each, factor) for each in rows], f"standard deviation ({unit})"),
            Column("share", "%", [100 * each.variance / total for each in rows], "of the variance", format_spec=".1f"),
            Column("relative", "%", [100 * each.sd / abs(study.mean) if study.mean else None for each in rows], "of the mean", format_spec=".2g"),
            Column("sd", selection.unit, [each.sd for each in rows], displayed=False),
            Column("sd_error", selection.unit, [each.sd_error for each in rows], displayed=False),
            Column("variance", None, [each.variance for each in rows], displayed=False),
        ),
    )  # fmt: skip


def _sd_text(component: VarianceComponent, factor: float) -> str:
    if not component.variance > 0 or not math.isfinite(component.sd_error):
        return "none seen"
    return format_with_uncertainty(factor * component.sd, factor * component.sd_error)


def gauge_notes(selection: FleetSelection, study: GaugeStudy) -> Iterator[str]:
    """Yield the sources that are confounded, the number of distinct categories, and the method."""
    yield from (f"{text}." for text in study.inseparable)
    if (count := study.categories) is not None:
        yield f"the gauge tells {count} classes of specimens apart (AIAG asks for 5 or more)."
    if selection.left_out:
        yield f"{selection.left_out} values of another protocol or drive are left out."
    yield "restricted maximum likelihood; repeat: repeatability; all but specimen and repeat: reproducibility."


def gauge_figures(selection: FleetSelection, factors: Mapping[str, Sequence[str]]) -> tuple[PaperFigure, ...]:
    """Return the values less their mean by operator, in the order of specimen, operator and mounting, and the means of each group."""
    values = np.array([v.value for v in selection.values])
    values = values - values.mean()
    order = sorted(range(values.size), key=lambda i: (factors[SPECIMEN][i], factors[OPERATOR][i], factors[MOUNTING][i]))
    by = next((name for name in (SPECIMEN, MOUNTING) if len(set(factors[name])) > 1), SPECIMEN)
    names = list(dict.fromkeys(factors[by][i] for i in order))
    every, means = [], []
    for who in sorted(set(factors[OPERATOR])):
        own = [(place, i) for place, i in enumerate(order, 1) if factors[OPERATOR][i] == who]
        every.append(_curve([p for p, _ in own], [values[i] for _, i in own], who))
        groups = {n: [values[i] for _, i in own if factors[by][i] == n] for n in names}
        at = [n for n in names if groups[n]]
        means.append(_curve([names.index(n) + 1 for n in at], [float(np.mean(groups[n])) for n in at], who))
    axes = f"{selection.label}, less the mean", selection.unit
    first = PaperFigure("values", "value, by specimen, operator and mounting", "", *axes, tuple(every), "Every value.")
    second = PaperFigure("means", f"number of the {by}", "", *axes, tuple(means), f"Mean of each {by} by operator.")
    return first, second


def _curve(x: Sequence[float], y: Sequence[float], label: str) -> Series:
    """Return a curve; a single point is a short line, which can be seen."""
    if len(x) == 1:
        x, y = [x[0] - 0.2, x[0] + 0.2], [y[0], y[0]]
    return Series(np.array(x, float), np.array(y, float), label=label)
