"""What `tactor-bench compare` does: two runs of one kind, point by point."""

import argparse
import math

import numpy as np

from app.answer import Answer, Column, Table, deliver
from app.exits import UsageError
from protocols.layout import ENTRY
from protocols.quality import usable
from protocols.runreader import Run, RunError


def compare_runs(options: argparse.Namespace) -> int:
    """`tactor-bench compare A B`."""
    try:
        with Run(options.first) as a, Run(options.second) as b:
            return deliver(_comparison(a, b), options)
    except (RunError, ValueError) as error:
        raise UsageError(str(error)) from None


def _comparison(a: Run, b: Run) -> Answer:
    if a.protocol != b.protocol:
        raise ValueError(f"{a.path.name} is a {a.protocol} and {b.path.name} a {b.protocol}: compare runs of one kind")
    from protocols.registry import PROTOCOLS

    kind = PROTOCOLS.get(a.protocol)
    if kind is None:
        raise ValueError(f"{a.path.name} is a run of '{a.protocol}', a protocol that is not known here")
    x, y = kind.axes
    units, left, right = a.units(), _usable(a), _usable(b)
    shared = [entry for entry in left if entry in right]
    if not shared:
        raise ValueError("these runs have no usable point of the same entry in common")
    rows: dict[str, list[float | None]] = {"x": [], "first": [], "second": [], "difference": [], "errors": []}
    for entry in shared:
        one, two = left[entry], right[entry]
        error = math.hypot(one.get(f"{y}_errors", 0.0), two.get(f"{y}_errors", 0.0))
        change = two[y] - one[y]
        values = (one[x], one[y], two[y], change, change / error if error > 0 else None)
        for name, value in zip(rows, values, strict=True):
            rows[name].append(value)
    shown = {"m": "µm"}.get(units[y], "")
    table = Table(
        "points",
        f"{kind.title}: {b.path.name} less {a.path.name}",
        (
            Column(x, units[x].removesuffix("1"), rows["x"]),
            Column(f"{y} first", units[y], rows["first"], shown=shown),
            Column(f"{y} second", units[y], rows["second"], shown=shown),
            Column("difference", units[y], rows["difference"], shown=shown, form="+.3g"),
            Column("standard errors", "", rows["errors"], form="+.1f"),
        ),
    )
    told = [v for v in rows["errors"] if v is not None]
    words = f"{len(shared)} points in common"
    if told:
        chi = sum(v * v for v in told)
        words += f"; chi-square of the differences {chi:.1f} for {len(told)} points, statistical errors only"
    return Answer("compare", {}, (table,), (words,))


def _usable(run: Run) -> dict[int, dict[str, float]]:
    """The usable points by entry, one-valued columns only."""
    columns = run.points()
    rows: dict[int, dict[str, float]] = {}
    for at in np.flatnonzero(usable(columns["quality"])):
        rows[int(columns[ENTRY][at])] = {
            name: float(values[at]) for name, values in columns.items() if values.ndim == 1
        }
    return rows
