"""Do total uncertainties cover, and is the right cause named? python benchmarks/coverage/laboratories.py [--kind KIND] [--laboratories N] [--file FILE]

Every laboratory of `tests/helpers/model/laboratories.py` has a specimen, a sheet and instruments of its own; its nonidealities are not drawn
from the fit's priors. The fit is the default one, with the sheet. Kinds: `coverage` (full campaigns, and of every fourth laboratory every
small set), `developed` and four `withheld` sets (one departure each). Every identification is a line of JSON in FILE; lines that are there
are not made again, so that the command can be interrupted and repeated.
"""

import argparse
import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from app.identification.specimen_identification import identify_observations
from model.identification import FitOptions, ObservationSet
from tests.helpers.model.departures import DEVELOPED
from tests.helpers.model.laboratories import SMALL_SETS, UNDISTURBED, Departure, World, draw, measure, subset
from tests.helpers.model.withheld_departures import WITHHELD
from tests.helpers.model.withheld_departures_2 import WITHHELD_2
from tests.helpers.model.withheld_departures_3 import WITHHELD_3
from tests.helpers.model.withheld_departures_4 import WITHHELD_4

IDENTIFIED = ("k2", "mu", "m_add", "c0", "E_m", "c_s_0", "c_s_delta")
STREAMS = {
    "coverage": 2811,
    "withheld": 2812,
    "developed": 2813,
    "withheld_2": 2814,
    "withheld_3": 2815,
    "withheld_4": 2816,
}
DEPARTURES = {
    "coverage": (UNDISTURBED,), "developed": DEVELOPED, "withheld": WITHHELD, "withheld_2": WITHHELD_2, "withheld_3": WITHHELD_3,
    "withheld_4": WITHHELD_4,
}  # fmt: skip
SMALL_SETS_EVERY = 4
Row = dict[str, Any]


def identified(world: World, observations: ObservationSet) -> Row:
    """Return deviations over total uncertainties, the verdict and the causes that are named."""
    result = identify_observations("laboratory", observations, "joint", FitOptions(), sheet=world.sheet)
    fit = result.joint_fit
    assert fit is not None
    assert result.adequacy is not None
    errors, assumed = np.sqrt(np.diag(fit.enlarged_covariance)), {e.name for e in result.assumed}
    found = zip(fit.names, fit.theta.tolist(), errors.tolist(), strict=True)
    z = {n: [(v - world.truth[n]) / s, n in assumed] for n, v, s in found if n in world.truth and s > 0}
    diagnosis = result.adequacy.diagnosis
    named = [e.cause.title for e in diagnosis.likeliest] if diagnosis is not None else []
    named = [result.steps[0].explanation.cause.title] if result.steps else named
    return {"z": z, "alarm": result.adequacy.adequate is False or bool(result.steps), "named": named}


def coverage(seed: int) -> Iterator[Row]:
    """Yield the full campaign of a laboratory, and its small sets."""
    world = draw(seed, stream=STREAMS["coverage"])
    every = measure(world, seed + 1000 * STREAMS["coverage"])
    sets = {"full": every}
    if seed % SMALL_SETS_EVERY == 0:
        sets |= {name: part for name, kinds in SMALL_SETS.items() if (part := subset(every, kinds)) is not None}
    yield from ({"set": name, "seed": seed, **identified(world, part)} for name, part in sets.items())


def departed(departure: Departure, seed: int, stream: int) -> Row:
    """Return a laboratory with a departure; `right`: whether the right cause is named first."""
    world = draw(seed, departure, stream)
    row = identified(world, measure(world, seed + 1000 * stream, departure))
    first = row["named"][0] if row["named"] else ""
    right = any(re.fullmatch(pattern, first) for pattern in departure.right)
    return {"name": departure.name, "size": departure.size, "seed": seed, **row, "right": right and row["alarm"]}


def covered(rows: Sequence[Mapping[str, Any]]) -> dict[str, tuple[int, float, float, float]]:
    """Return number, coverage of 95 % intervals, mean and rms of the deviations of each parameter that is not assumed, and of all."""
    z: dict[str, list[float]] = {}
    for row in rows:
        for name, (value, assumed, *_) in row["z"].items():
            if not assumed:
                for group in (name, "all", *(["identified"] if name in IDENTIFIED else [])):
                    z.setdefault(group, []).append(value)
    return {n: (len(v), *(float(f(np.array(v))) for f in (_share, np.mean, _rms))) for n, v in z.items()}


def _share(z: np.ndarray) -> Any:
    return np.mean(np.abs(z) < 1.96)


def _rms(z: np.ndarray) -> Any:
    return np.sqrt(np.mean(z**2))


def main() -> None:
    """Measure what the file does not have, and print the sums."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kind", choices=tuple(STREAMS), default="coverage")
    parser.add_argument("--laboratories", type=int, default=500, help="of a departure, or in all (default: 500)")
    parser.add_argument("--file", type=Path, default=Path("laboratories.jsonl"))
    args = parser.parse_args()
    rows = [json.loads(line) for line in args.file.read_text("utf-8").splitlines()] if args.file.exists() else []
    done = {(r.get("name"), r.get("size"), r["seed"]) for r in rows}
    with args.file.open("a", encoding="utf-8") as file:
        for d in DEPARTURES[args.kind]:
            for seed in range(args.laboratories):
                if (None if d is UNDISTURBED else d.name, None if d is UNDISTURBED else d.size, seed) in done:
                    continue
                made = coverage(seed) if d is UNDISTURBED else [departed(d, seed, STREAMS[args.kind])]
                for row in made:
                    rows.append(row)
                    file.write(json.dumps(row) + "\n")
                    file.flush()
    for name in dict.fromkeys(r.get("set") or r["name"] for r in rows):
        those = [r for r in rows if (r.get("set") or r["name"]) == name]
        alarms, right = (sum(bool(r.get(key)) for r in those) for key in ("alarm", "right"))
        number, share, mean, rms = covered(those).get("identified", (0, 0.0, 0.0, 0.0))
        print(f"{name}: {len(those)}, alarms {alarms}, right {right}; {number} z: {share:.1%}, {mean:+.2f}, {rms:.2f}")


if __name__ == "__main__":
    main()
