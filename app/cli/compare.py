"""The command `compare`: two runs of one protocol, point by point at the same settings."""

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.special import chdtrc

from app.cli.options import JSON_OBJECT, argument, command
from app.cli.output import CommandResult, render
from app.common import Column, Table, UsageError, usage_errors
from model.identification import format_p_value
from protocols.base import usable_mask
from protocols.runfile.reader import Run, RunReadError, translate_read_errors

MATCH_COLUMNS = ("side", "repeat", "direction", "level", "mass", "load")
"""Columns that distinguish points of equal x, if both runs have them."""

Point = dict[str, float]


@command("example: tactor-bench compare runs/A_sine-dwell.h5 runs/B_sine-dwell.h5")
class CompareCommand:
    """Points of two runs side by side: values, difference, and the difference in standard errors."""

    first: Path = argument()
    second: Path = argument()
    json: bool = JSON_OBJECT

    @usage_errors(RunReadError)
    def execute(self) -> int:
        with Run(self.first) as a, Run(self.second) as b, translate_read_errors(self.second):
            result = _comparison_result(a, b)
        return render(result, self.json)


def _comparison_result(a: Run, b: Run) -> CommandResult:
    if a.record.protocol != b.record.protocol:
        raise UsageError(
            f"{a.path.name} is a {a.record.protocol} and {b.path.name} a {b.record.protocol}: compare runs of one kind"
        )
    from protocols.registry import PROTOCOLS

    kind = PROTOCOLS.get(a.record.protocol)
    if kind is None:
        raise UsageError(f"{a.path.name} is a run of '{a.record.protocol}', a protocol that is not known here")
    x, y = kind.axes
    units, left, right = a.units(), _usable_points(a), _usable_points(b)
    pairs = _match_points(left, right, x)
    if not pairs:
        raise UsageError(f"these runs have no usable point at the same {x.replace('_', ' ')} in common")
    rows: dict[str, list[float | None]] = {"x": [], "first": [], "second": [], "difference": [], "errors": []}
    for one, two in pairs:
        error = math.hypot(one.get(f"{y}_errors", 0.0), two.get(f"{y}_errors", 0.0))
        change = two[y] - one[y]
        values = (one[x], one[y], two[y], change, change / error if error > 0 else None)
        for name, value in zip(rows, values, strict=True):
            rows[name].append(value)
    deviations = [v for v in rows["errors"] if v is not None]
    shown = {"m": "µm"}.get(units[y], "")
    apart = [
        n
        for n in (*MATCH_COLUMNS, "elongation")
        if n != x and n in units and len({f"{p.get(n)}" for p, _ in pairs}) > 1
    ]
    columns = (
        *(
            Column(
                n,
                units[n].removesuffix("1"),
                [p[n] if math.isfinite(p[n]) else "none" for p, _ in pairs],
                format_spec=".4g",
            )
            for n in apart
        ),
        Column(x, units[x].removesuffix("1"), rows["x"]),
        Column(f"{y} first", units[y], rows["first"], display_unit=shown),
        Column(f"{y} second", units[y], rows["second"], display_unit=shown),
        Column("difference", units[y], rows["difference"], display_unit=shown, format_spec="+.3g"),
        Column("standard errors", "", rows["errors"], format_spec="+.1f"),
    )
    title = f"{kind.title}: {b.path.name} less {a.path.name}"
    notes = [f"{len(pairs)} points in common, of {len(left)} and {len(right)} usable ones"]
    if deviations:
        chi = sum(v * v for v in deviations)
        notes[0] += (
            f"; chi-square of the differences {chi:.1f} for {len(deviations)} points ({format_p_value(float(chdtrc(len(deviations), chi)), 2)}), statistical errors only"
        )
    if len(deviations) < len(pairs):
        notes.append(f"of {len(pairs) - len(deviations)} points no uncertainty is given")
    notes += _drive_differences(a, b, left, right)
    return CommandResult(
        "compare", {}, (Table("points", title, columns if deviations else columns[:-1]),), tuple(notes)
    )


def _match_points(left: Sequence[Point], right: Sequence[Point], x: str) -> list[tuple[Point, Point]]:
    """Pair points at the same setting, whatever their position in the plans; several at one setting in their order."""
    named = [
        n for n in MATCH_COLUMNS if left and right and all(math.isfinite(p.get(n, math.nan)) for p in (*left, *right))
    ]
    named += [n for n in ("elongation",) if n in (left[0] if left else {})]

    def by_setting(points: Sequence[Point]) -> dict[tuple[str, ...], Point]:
        found: dict[tuple[str, ...], Point] = {}
        counts: Counter[tuple[str, ...]] = Counter()
        for point in points:
            setting = tuple(f"{point[name]:.4g}" for name in (x, *named))
            number = counts[setting]
            counts[setting] += 1
            found[*setting, str(number)] = point
        return found

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
