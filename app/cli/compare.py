"""The command `compare`: two runs of one protocol point by point, or up to 20 runs by their curves in one relation."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.special import chdtrc

from app.archive import FORMATS, ExportError
from app.cli.options import JSON_OBJECT, argument, command, option
from app.cli.output import PICTURE_SUFFIXES, CommandResult, render, writing_output
from app.common import Column, Table, UsageError, print_message, usage_errors
from app.comparison import (
    VIEW_SUFFIX,
    Comparison,
    ComparisonError,
    compare_files,
    draw_comparison,
    export_comparison,
    save_view,
    view_path,
)
from model import Relation, shown_unit
from model.identification import format_p_value
from protocols.base import Protocol, usable_mask
from protocols.runfile import Run, RunReadError, translate_read_errors

MATCH_COLUMNS = ("side", "repeat", "direction", "level", "mass", "load")
"""Columns that distinguish points of equal x, if both runs have them."""

Point = dict[str, float]


@command("example: tactor-bench compare runs/A_sine-dwell.h5 runs/B_sine-dwell.h5")
class CompareCommand:
    """Compare the points of two runs: values, differences, and differences in standard errors. With three and more runs (at
    most 20), a saved view or any of the options: peaks of all runs, what differs between them, and their curves in a
    relation to a reference as a picture or as data.
    """

    runs: Sequence[Path] = argument(f"run files; or one saved view, NAME{VIEW_SUFFIX}", nargs="+")
    quantity: str = option("axes of the curves, e.g. 'response over frequency' (default: those that most runs have)")
    relation: str = option(f"{', '.join(Relation)} (default: values)")
    reference: Path | None = option("run to which the others are related (default: the first)", metavar="RUN")
    over: str = option("waterfall: curves above each other over time, mass, elongation or amplitude", metavar="SETTING")
    model: bool = option("add the model's curve with its band, by the calibration of the reference's specimen")
    plot: Path | None = option("draw the curves", metavar="FILE.svg|pdf|png")
    export: str = option(f"write the shown values: {', '.join(FORMATS)}", metavar="FORMAT")
    save: str = option("save the view under a name beside the first run", metavar="NAME")
    json: bool = JSON_OBJECT

    @usage_errors(RunReadError, ComparisonError, ExportError)
    def execute(self) -> int:
        asked = (self.quantity, self.relation, self.reference, self.over, self.model, self.plot, self.export, self.save)
        if len(self.runs) == 2 and not any(asked):
            with Run(self.runs[0]) as a, Run(self.runs[1]) as b, translate_read_errors(self.runs[1]):
                return render(_comparison_result(a, b), self.json)
        fields = {name: getattr(self, name) for name in ("quantity", "relation", "over", "model")}
        fields["reference"] = str(self.reference or "")
        comparison = compare_files(self.runs, **{name: value for name, value in fields.items() if value})
        folder = self.runs[0].parent
        if self.plot:
            with writing_output(self.plot, PICTURE_SUFFIXES):
                draw_comparison(comparison, self.plot)
        if self.export:
            kind = next((each for each in FORMATS if each == self.export), None)
            if kind is None:
                raise UsageError(f"there is no format '{self.export}'; there are: {', '.join(FORMATS)}")
            for path in export_comparison(comparison, folder, kind, self.save or "comparison"):
                print_message(str(path))
        if self.save:
            save_view(comparison.view, view_path(folder, self.save))
        return render(_summary(comparison), self.json)


def _summary(comparison: Comparison) -> CommandResult:
    """Return peaks and differences of the runs; rows with equal values are folded into a note."""
    differing = [each for each in comparison.differences if not each.is_equal]
    letters = [run.letter for run in comparison.runs]
    table = Table.of_rows("differences", ("what differs", *letters), [(each.name, *each.values) for each in differing])
    files = Table.of_rows("runs", ("run", "file"), [(run.letter, run.path.name) for run in comparison.runs])
    reference = f" to {comparison.reference.letter}" if comparison.view.relation.has_reference else ""
    notes = (
        f"{len(comparison.differences) - len(differing)} settings and results are equal",
        f"curves: {comparison.quantity or 'none'}, {comparison.view.relation}{reference}",
        *comparison.left_out,
    )
    return CommandResult("compare", {}, (files, comparison.peaks, table), notes)


def _comparison_result(a: Run, b: Run) -> CommandResult:
    kind = _common_protocol(a, b)
    x, y = kind.axes
    units, left, right = a.units(), _usable_points(a), _usable_points(b)
    pairs = _match_points(left, right, x)
    if not pairs:
        raise UsageError(f"these runs have no usable point at the same {x.replace('_', ' ')} in common")
    changes = [two[y] - one[y] for one, two in pairs]
    errors = [math.hypot(one.get(f"{y}_errors", 0.0), two.get(f"{y}_errors", 0.0)) for one, two in pairs]
    deviations = [change / error if error > 0 else None for change, error in zip(changes, errors, strict=True)]
    shown = shown_unit(units[y], y).unit
    columns = [
        *_setting_columns(pairs, x, units),
        Column(x, units[x].removesuffix("1"), [one[x] for one, _ in pairs]),
        Column(f"{y} first", units[y], [one[y] for one, _ in pairs], display_unit=shown),
        Column(f"{y} second", units[y], [two[y] for _, two in pairs], display_unit=shown),
        Column("difference", units[y], changes, display_unit=shown, format_spec="+.3g"),
    ]
    notes = [f"{len(pairs)} points in common, of {len(left)} and {len(right)} usable ones"]
    if finite := [deviation for deviation in deviations if deviation is not None]:
        columns.append(Column("standard errors", "", deviations, format_spec="+.1f"))
        chi = sum(deviation**2 for deviation in finite)
        p_value = format_p_value(float(chdtrc(len(finite), chi)), 2)
        notes[0] += (
            f"; chi-square of the differences {chi:.1f} for {len(finite)} points ({p_value}), statistical errors only"
        )
    if len(finite) < len(pairs):
        notes.append(f"{len(pairs) - len(finite)} points have no uncertainty")
    notes += _drive_differences(a, b, left, right)
    title = f"{kind.title}: {b.path.name} less {a.path.name}"
    return CommandResult("compare", {}, (Table("points", title, tuple(columns)),), tuple(notes))


def _common_protocol(a: Run, b: Run) -> type[Protocol]:
    """Return the protocol of both runs.

    Raises:
        UsageError: they are of two protocols, or of an unknown one.
    """
    from protocols import PROTOCOLS

    protocols = a.record.protocol, b.record.protocol
    if protocols[0] != protocols[1]:
        raise UsageError(
            f"{a.path.name} is a {protocols[0]} and {b.path.name} a {protocols[1]}: compare runs of one kind"
        )
    kind = PROTOCOLS.get(protocols[0])
    if kind is None:
        raise UsageError(f"{a.path.name} is a run of '{protocols[0]}', an unknown protocol")
    return kind


def _setting_columns(pairs: Sequence[tuple[Point, Point]], x: str, units: Mapping[str, str]) -> Iterator[Column]:
    """Yield the settings besides x that differ between the points."""
    for name in (*MATCH_COLUMNS, "elongation"):
        if name != x and name in units and len({f"{one.get(name)}" for one, _ in pairs}) > 1:
            values = [one[name] if math.isfinite(one[name]) else "none" for one, _ in pairs]
            yield Column(name, units[name].removesuffix("1"), values, format_spec=".4g")


def _match_points(left: Sequence[Point], right: Sequence[Point], x: str) -> list[tuple[Point, Point]]:
    """Pair points of equal settings, independent of their position in the plans; several of one setting in order."""
    named = [
        n for n in MATCH_COLUMNS if left and right and all(math.isfinite(p.get(n, math.nan)) for p in (*left, *right))
    ]
    named += [n for n in ("elongation",) if n in (left[0] if left else {})]

    def by_setting(points: Sequence[Point]) -> dict[tuple[str, ...], Point]:
        matched: dict[tuple[str, ...], Point] = {}
        counts: Counter[tuple[str, ...]] = Counter()
        for point in points:
            setting = tuple(f"{point[name]:.4g}" for name in (x, *named))
            number = counts[setting]
            counts[setting] += 1
            matched[*setting, str(number)] = point
        return matched

    others = by_setting(right)
    return [(point, others[key]) for key, point in by_setting(left).items() if key in others]


def _drive_differences(a: Run, b: Run, left: Sequence[Point], right: Sequence[Point]) -> list[str]:
    """Return a note if the drives differ."""
    volts = [2 * float(np.median([p.get("drive_amplitude", 0.0) for p in points])) for points in (left, right)]
    if abs(volts[0] - volts[1]) <= 0.01 * max(volts):
        return []
    return [f"the drives differ: {volts[0]:.3g} V in {a.path.name}, {volts[1]:.3g} V in {b.path.name}, max - min"]


def _usable_points(run: Run) -> list[Point]:
    """Return the usable points, one-valued columns only."""
    with translate_read_errors(run.path):
        columns = run.points()
        return [
            {name: float(values[at]) for name, values in columns.items() if values.ndim == 1}
            for at in np.flatnonzero(usable_mask(columns["quality"]))
        ]
