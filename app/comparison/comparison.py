"""Up to 20 runs in one comparison: layers in a relation to a reference, peaks and differences."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from app.archive import RunDifference, compare_runs
from app.common import Column, Table
from app.comparison.compared_run import LETTERS, MAX_RUNS, ComparedRun, ComparisonError, RunCurve
from app.comparison.view import VIEW_SUFFIX, ComparisonView, read_view, view_problem
from model import (
    COVERAGE_FACTOR_95,
    SCALES,
    EstimatedQuantity,
    Relation,
    Role,
    Series,
    SeriesAxis,
    quality_factor,
    related,
    rising,
    shown_unit,
)

WATERFALL_STEP = 0.35
"""Distance of two curves that stand above each other, as a share of the largest value."""

PEAK_NAMES = ("natural_frequency", "damped_frequency", "quality_factor")
PEAK_HEADINGS = {
    "natural_frequency": "natural",
    "damped_frequency": "damped",
    "quality_factor": "Q",
    "largest": "largest",
}


@dataclass(frozen=True, slots=True, eq=False)
class ComparisonLayer:
    """A curve of a run in the relation of the view.

    Attributes:
        name: the letter of its run, with a number where the run has several curves.
        run: None for the model.
        series: SI, with the offset of a waterfall added.
        hidden: whether the view hides it.
        setting: value over which a waterfall stands; NaN without one.
        offset: of a waterfall, in the unit of y.
    """

    name: str
    run: ComparedRun | None
    series: Series
    hidden: bool = False
    setting: float = math.nan
    offset: float = 0.0

    @property
    def title(self) -> str:
        """Name, specimen, time and label."""
        return f"{self.name}  {self.run.title if self.run else 'Model'} {self.series.label}".strip()

    def value_at(self, x: float) -> tuple[float, float]:
        """Return value and total standard uncertainty at a place on the line, SI, without offset; NaN outside."""
        known, y = self.series.x, self.series.plotted - self.offset
        if not known.size or not known[0] <= x <= known[-1]:
            return math.nan, math.nan
        errors = self.series.total_errors
        return float(np.interp(x, known, y)), math.nan if errors is None else float(np.interp(x, known, errors))


class Comparison:
    """Runs in the relation of a view; a change of the view is another comparison of the same runs, see `with_view`.

    Args:
        runs: as read, in their order.
        view: what is shown.
        model: curves of the model by quantity, see `model_in`.

    Attributes:
        runs, view, model: as given.

    Raises:
        ComparisonError: there is no run, or too many, or the runs have no such quantity.
    """

    def __init__(
        self, runs: Sequence[ComparedRun], view: ComparisonView, model: dict[str, Series] | None = None
    ) -> None:
        if not 1 <= len(runs) <= MAX_RUNS:
            raise ComparisonError(f"{len(runs)} runs cannot be compared; choose 1 to {MAX_RUNS}")
        self.runs = tuple(replace(run, letter=letter) for run, letter in zip(runs, LETTERS, strict=False))
        self.view, self.model = view, model or {}
        if view.quantity and view.quantity not in self.quantities:
            raise ComparisonError(
                f"no run has '{view.quantity}'; they have: {', '.join(self.quantities) or 'no curves'}"
            )

    def with_view(self, view: ComparisonView) -> "Comparison":
        """Return another view of the same runs, in the order of the view, without reading them again."""
        rank = {name: at for at, name in enumerate(view.runs)}
        ordered = sorted(self.runs, key=lambda run: rank.get(run.path.name, len(rank)))
        return Comparison(ordered, view, self.model)

    @cached_property
    def quantities(self) -> list[str]:
        """Axes of the curves as text; those that most runs have come first, in the order of the first run."""
        count = Counter(quantity for run in self.runs for quantity in {each.quantity for each in run.curves})
        every = dict.fromkeys(each.quantity for run in self.runs for each in run.curves)
        return sorted(every, key=lambda quantity: -count[quantity])

    @property
    def quantity(self) -> str:
        """The axes of the layers; empty if no run has a curve."""
        return self.view.quantity or next(iter(self.quantities), "")

    @property
    def reference(self) -> ComparedRun:
        """The run to which the others are related."""
        named = (run for run in self.runs if run.path.name == Path(self.view.reference).name)
        return next(named, self.runs[0])

    @property
    def simulated(self) -> bool:
        """Whether any run was measured on the simulated bench."""
        return any(run.simulated for run in self.runs)

    @cached_property
    def left_out(self) -> tuple[str, ...]:
        """A sentence for each run without the quantity, and for each curve that has no place in the relation."""
        drawn = {layer.run.letter for layer in self.layers if layer.run}
        without = [
            f"{run.letter} {run.path.name} has no {self.quantity}" for run in self.runs if run.letter not in drawn
        ]
        relation = self.view.relation
        empty = [
            f"{layer.name} has no value where the reference {self.reference.letter} has one"
            for layer in self.layers
            if relation.has_reference and not np.isfinite(layer.series.y).any()
        ]
        return (*without, *empty)

    @cached_property
    def layers(self) -> tuple[ComparisonLayer, ...]:
        """Curves of all runs in the relation, in the order of the runs or of the waterfall; the model is last."""
        bases = {each.series.label: each.series for each in self._curves_of(self.reference)}
        hidden = {Path(name).name for name in self.view.hidden}
        layers = []
        for run in self.runs:
            curves = self._curves_of(run)
            for number, curve in enumerate(curves, 1):
                name = run.letter + (str(number) if len(curves) > 1 else "")
                series = self._related(run, curve, bases)
                layers.append(
                    ComparisonLayer(
                        name, run, series, run.path.name in hidden, curve.settings.get(self.view.over, math.nan)
                    )
                )
        if self.view.model and (modelled := self.model.get(self.quantity)) is not None:
            layers.append(ComparisonLayer("Model", None, self._model_layer(modelled, bases)))
        return self._waterfall(layers) if self.view.over else tuple(layers)

    def _model_layer(self, curve: Series, bases: dict[str, Series]) -> Series:
        reference = next(iter(bases.values()), None) if self.view.relation.has_reference else None
        return related(curve, self.view.relation, reference)

    def _curves_of(self, run: ComparedRun) -> list[RunCurve]:
        return [each for each in run.curves if each.quantity == self.quantity]

    def _related(self, run: ComparedRun, curve: RunCurve, bases: dict[str, Series]) -> Series:
        """Return a curve in relation to the reference's of the same label, else to its first."""
        unit, relation = curve.series.y_axis.unit, self.view.relation
        gains = run.gains_against(self.reference, unit)
        if curve.series.is_loop and not relation.has_reference:
            whole = curve.series
            largest = np.nanmax(np.abs(whole.plotted), initial=0.0) or 1.0
            return whole.scaled(1.0, 1.0 / largest if relation is Relation.NORMALISED else 1.0)
        base = bases.get(curve.series.label, next(iter(bases.values()), None)) if relation.has_reference else None
        if relation.has_reference and base is None:
            return rising(curve.series).scaled(1.0, math.nan)
        return replace(related(curve.series, relation, base, gains), label=curve.series.label)

    def _waterfall(self, layers: Sequence[ComparisonLayer]) -> tuple[ComparisonLayer, ...]:
        """Return the layers in the order of their setting, each a step above the one before."""
        ordered = sorted(
            layers, key=lambda layer: (layer.setting if math.isfinite(layer.setting) else math.inf, layer.name)
        )
        sizes = [float(np.nanmax(np.abs(each.series.plotted), initial=0.0)) for each in ordered if not each.hidden]
        step, raised, place = WATERFALL_STEP * max(sizes, default=0.0), [], 0
        for layer in ordered:
            offset = step * place
            place += not layer.hidden
            raised.append(replace(layer, series=replace(layer.series, y=layer.series.plotted + offset), offset=offset))
        return tuple(raised)

    @cached_property
    def peaks(self) -> Table:
        """Natural and damped frequency, largest response with its place, and Q of each run; SI, standard errors beside.

        The first two and Q are estimates of the run, Q = 1 / (2 x damping ratio); the largest response is its largest usable value.
        """
        rows = [_peak_row(run, [each.series for each in self._curves_of(run)]) for run in self.runs]
        unit = next((curve.series.y_axis.unit for run in self.runs for curve in self._curves_of(run)), "1")
        x_unit = next((curve.series.x_axis.unit for run in self.runs for curve in self._curves_of(run)), "1")
        columns = [
            Column("run", None, [run.letter for run in self.runs]),
            Column("of", None, [run.title for run in self.runs], "specimen and start"),
        ]
        for name, of in (
            ("natural_frequency", "Hz"),
            ("damped_frequency", "Hz"),
            ("largest", unit),
            ("quality_factor", ""),
        ):
            heading, shown = PEAK_HEADINGS[name], shown_unit(of, name).unit
            spec = _fixed_decimals([row[name] for row in rows], shown)
            for part, title, at in (("", heading, 0), ("_errors", "±", 1)):
                values = [row[name][at] for row in rows]
                columns.append(Column(name + part, of, values, title, shown, spec, missing=""))
            if name == "largest":
                spec = _fixed_decimals([row["at"] for row in rows], x_unit)
                columns.append(Column("largest_at", x_unit, [row["at"][0] for row in rows], "at", "", spec, missing=""))
        return Table("peaks", "Peaks", tuple(columns))

    @cached_property
    def differences(self) -> tuple[RunDifference, ...]:
        """Settings, conditions, instruments, people, verdict and results of the runs; `is_equal` rows can be folded."""
        return compare_runs([run.summary for run in self.runs])

    def estimates(self) -> tuple[EstimatedQuantity, ...]:
        """Return the estimates of the runs, each named after the letter of its run."""
        return tuple(
            replace(each, name=f"{run.letter} {each.name}")
            for run in self.runs
            for each in run.summary.record.estimates
        )

    def to_pandas(self) -> Any:
        """Return the shown values as a pandas frame: layer, x, y and the total standard uncertainty, SI.

        Raises:
            ImportError: pandas is not installed.
        """
        import pandas as pd

        frames = [
            pd.DataFrame({"layer": layer.name, "x": s.x, "y": s.plotted, "total_error": np.nan if s.total_errors is None else s.total_errors})
            for layer in self.layers
            if not layer.hidden and (s := layer.series).x.size
        ]  # fmt: skip
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def open_comparison(
    paths: Sequence[Path], view: ComparisonView | None = None, model: dict[str, Series] | None = None
) -> Comparison:
    """Read runs for a comparison.

    Raises:
        RunReadError: a run cannot be read.
        ComparisonError: they are too many, or have no such quantity.
    """
    if len(paths) > MAX_RUNS:
        raise ComparisonError(f"{len(paths)} runs cannot be compared; choose 1 to {MAX_RUNS}")
    view = view or ComparisonView()
    names = tuple(path.name for path in paths)
    return Comparison([*map(ComparedRun.read, paths)], view.model_copy(update={"runs": view.runs or names}), model)


def compare_files(paths: Sequence[Path], **changes: object) -> Comparison:
    """Return the comparison of run files, or of the runs of one saved view, with changes of fields of the view and the model where the view has it.

    Raises:
        RunReadError: a run cannot be read.
        ComparisonError: they are too many, have no such quantity, or a field of the view is wrong.
    """
    view = ComparisonView()
    if len(paths) == 1 and paths[0].name.endswith(VIEW_SUFFIX):
        view, folder = read_view(paths[0]), paths[0].parent
        paths = [folder / name for name in view.runs]
    names = [path.name for path in paths]
    given = Path(str(changes.get("reference", "")))
    if given.name and given.parent != Path() and given.resolve() not in {path.resolve() for path in paths}:
        raise ComparisonError(f"the reference {given} is not one of the compared runs; add it to them")
    changes |= {"reference": given.name} if given.name else {}
    try:
        chosen = ComparisonView.model_validate(view.model_dump() | {"runs": names} | changes)
    except ValidationError as error:
        raise ComparisonError(f"the comparison cannot be made: {view_problem(error)}") from None
    if (reference := Path(chosen.reference).name) and reference not in names:
        raise ComparisonError(f"the reference {reference} is not one of the compared runs; add it to them")
    comparison = open_comparison(paths, chosen)
    return with_model(comparison) if chosen.model else comparison


def model_in(curves: Any, amplitude_v: float) -> dict[str, Series]:
    """Return a free tactor's model curves (`ModelCurves`) by quantity; errors are a standard error from the 95 % band."""
    found = {}
    for name, factor, axis in (
        ("peak_to_peak", 1.0, SeriesAxis("peak_to_peak", "m")),
        ("fundamental", 1.0 / amplitude_v, SeriesAxis("response", "m/V")),
    ):
        one = curves.free[name].scaled(1.0, factor)
        errors = None if one.band is None else (one.band.upper - one.band.lower) / (2 * COVERAGE_FACTOR_95)
        series = replace(
            one,
            y=one.plotted,
            errors=errors,
            band=None,
            x_axis=SeriesAxis("frequency", "Hz"),
            y_axis=axis,
            label="",
            role=Role.MODEL,
        )
        found[RunCurve(series, {}).quantity] = series
    return found


def with_model(comparison: Comparison) -> Comparison:
    """Return the comparison with the model's curves of the reference's specimen, computed in this thread."""
    from app.live import Overlay  # loads the session, which no list needs

    request, overlay = model_request(comparison), Overlay(comparison.reference.summary.record.amplifier_map)
    try:
        curves = overlay.compute(request)
    finally:
        overlay.close()
    return Comparison(comparison.runs, comparison.view, model_in(curves, request.amplitude_v))


def model_request(comparison: Comparison) -> Any:
    """Return the request (`CurveRequest`) of the model's curves for drive and specimen of the reference."""
    from app.live import CurveRequest

    run = comparison.reference
    amplitude_v = next((each.settings["amplitude"] / 2 for each in run.curves if "amplitude" in each.settings), 2.5)
    highest = max((float(each.series.x.max()) for each in run.curves if each.series.x_axis.unit == "Hz"), default=250.0)
    return CurveRequest(highest, amplitude_v, run.path.parent, run.summary.specimen)


def _fixed_decimals(values: Sequence[tuple[float, float]], unit: str) -> str:
    """Return the format of values and errors with one number of decimals: two digits of the least error, else five of the values."""
    scale = SCALES.get(unit, 1.0)
    errors = [scale * error for _, error in values if error > 0 and math.isfinite(error)]
    if errors:
        return f".{max(1 - math.floor(math.log10(min(errors))), 0)}f"
    texts = [f"{scale * value:.5g}" for value, _ in values if math.isfinite(value)]
    return f".{max((len(text.partition('.')[2]) for text in texts), default=0)}f"


def _peak_row(run: ComparedRun, curves: Sequence[Series]) -> dict[str, tuple[float, float]]:
    """Return value and standard error of each peak quantity; NaN where it is unknown."""
    unknown = (math.nan, math.nan)
    row = dict.fromkeys((*PEAK_NAMES, "largest", "at"), unknown)
    found = {each.name: each for each in run.summary.record.estimates}
    if (damping := found.get("damping_ratio")) is not None and damping.value > 0:
        found.setdefault("quality_factor", quality_factor(damping))
    row |= {name: (found[name].value, found[name].standard_error) for name in PEAK_NAMES if name in found}
    for one in map(rising, curves):
        if one.x.size and not row["largest"][0] >= (most := float(one.y.max())):
            at = int(one.y.argmax())
            gain = run.gains_against(run, one.y_axis.unit).own
            error = math.nan if one.errors is None else math.hypot(one.errors[at], gain * most)
            row |= {"largest": (most, error), "at": (float(one.x[at]), math.nan)}
    return row
