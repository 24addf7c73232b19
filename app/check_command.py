"""`tactor-bench check`: runs the wiring check and prints its table."""

import argparse
import copy
import json
import math
import sys
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from app.commands import chosen_bench, make_protocol, run_headless
from app.exits import DONE, FAILED
from drivers.rest import RETURN_TOLERANCE_V
from protocols.events import AtRest, PointMeasured, RunEnded
from protocols.plain import plain
from protocols.wiring_check import Verdict, WiringCheck

SCALES = {"m": (1e6, "µm"), "s": (1e3, "ms"), "m/V": (1e6, "µm/V")}


def check(options: argparse.Namespace) -> int:
    """Run it; 0 where everything passed, 1 where not or where the run failed, 3 UNSAFE."""
    config, speed = chosen_bench(options)
    protocol = make_protocol(WiringCheck.name, options.settings)
    assert isinstance(protocol, WiringCheck)
    events: list[Any] = []
    told = copy.copy(options)
    told.json = False  # the run speaks to the person; only the table is for the machine
    code, path = run_headless(config, speed, told, protocol, [events.append], options.faults)
    points = [event.point for event in events if isinstance(event, PointMeasured)]
    verdicts = protocol.verdicts(points)
    if verdicts:
        rest = next((event for event in events if isinstance(event, AtRest)), None)
        verdicts = (*verdicts, _rest_confirmed(rest, points[0].drive))
    passed = code == DONE and bool(verdicts) and all(verdict.passed for verdict in verdicts)
    if options.json:
        ended = next((event for event in events if isinstance(event, RunEnded)), None)
        record = {
            "passed": passed,
            "status": ended.status if ended else "failed",
            "reason": ended.reason if ended else "the bench could not be opened",
            "file": str(path) if path else None,
            "checks": [_record(verdict) for verdict in verdicts],
        }
        sys.stdout.write(json.dumps(plain(record), allow_nan=False) + "\n")
    else:
        Console(markup=False).print(
            _table(verdicts) if verdicts else "The check was not carried to its end: there is no table."
        )
        for verdict in verdicts:
            if not verdict.passed:
                Console(stderr=True, markup=False).print(
                    f"{verdict.name}: {verdict.remedy}", highlight=False, soft_wrap=True
                )
    return code if code != DONE else (DONE if passed else FAILED)


def _rest_confirmed(rest: AtRest | None, before_v: float) -> Verdict:
    measured_v = rest.measured_v if rest is not None and rest.confirmed else math.nan
    low, high = before_v - RETURN_TOLERANCE_V, before_v + RETURN_TOLERANCE_V
    return Verdict("rest confirmed at the end", measured_v, "V", low, high, "see the run's own sentence above")


def _record(verdict: Verdict) -> dict[str, Any]:
    return {
        "name": verdict.name,
        "value": verdict.value,
        "unit": verdict.unit,
        "low": verdict.low,
        "high": verdict.high,
        "passed": verdict.passed,
        "remedy": "" if verdict.passed else verdict.remedy,
    }


def _table(verdicts: Sequence[Verdict]) -> Table:
    table = Table(title="Wiring check", title_justify="left")
    for head in ("", "what", "figure", "limits", "unit"):
        table.add_column(head, justify="right" if head in ("figure", "limits") else "left")
    for verdict in verdicts:
        factor, unit = SCALES.get(verdict.unit, (1.0, verdict.unit))
        low, high = (None if limit is None else f"{factor * limit:.4g}" for limit in (verdict.low, verdict.high))
        limits = f"{low} .. {high}" if low and high else f"at least {low}" if low else f"at most {high}"
        word = Text("pass", "green") if verdict.passed else Text("FAIL", "bold red")
        figure = f"{factor * verdict.value:.4g}" if math.isfinite(verdict.value) else "not seen"
        table.add_row(word, verdict.name, figure, limits, "" if unit == "1" else unit)
    return table
