"""Writes docs/attribution-matrix.md from the lines of benchmarks/coverage/laboratories.py.

    python docs/make_attribution_matrix.py COVERAGE DEVELOPED WITHHELD

Each is a file of JSON lines of one kind.
"""

import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from benchmarks.coverage.laboratories import IDENTIFIED, covered  # noqa: E402
from tests.helpers.model.departures import DEVELOPED  # noqa: E402
from tests.helpers.model.laboratories import Departure  # noqa: E402
from tests.helpers.model.withheld_departures import WITHHELD  # noqa: E402

HEAD = """# Coverage and the attribution matrix

Written by `python docs/make_attribution_matrix.py` from identifications of `benchmarks/coverage/laboratories.py`: default `identify` with the sheet, in laboratories of
`tests/helpers/model/laboratories.py`. These have finite elements for the beam, their own membrane, amplifier, plays for hysteresis and lags for creep; specimen, sheet and instruments are drawn for each,
nonidealities from distributions that are not the fit's priors (uniform, exponential, lognormal, shifted, heavy-tailed).
"""


def page(coverage: Sequence[Any], developed: Sequence[Any], withheld: Sequence[Any]) -> str:
    """Return the page."""
    lines = [HEAD, "## Without a departure", ""]
    lines += ["*Alarm*: not adequate, or a cause was added. Parameters reported as assumed are apart.", ""]
    lines += [
        f"| runs | laboratories | alarms | coverage of {', '.join(IDENTIFIED)} | of all parameters | rms z |",
        "|---|---|---|---|---|---|",
    ]
    for name in dict.fromkeys(row["set"] for row in coverage):
        rows = [row for row in coverage if row["set"] == name]
        found = covered(rows)
        number, share, _, rms = found["identified"]
        text = f"{share:.1%} of {number} | {found['all'][1]:.1%} of {found['all'][0]} | {rms:.2f}"
        lines.append(f"| {name} | {len(rows)} | {sum(row['alarm'] for row in rows)} | {text} |")
    full = covered([row for row in coverage if row["set"] == "full"])
    lines += ["", "Full campaigns, by parameter:", "", "| parameter | coverage | mean z | rms z |", "|---|---|---|---|"]
    lines += [f"| {name} | {share:.1%} | {mean:+.2f} | {rms:.2f} |" for name, (_, share, mean, rms) in full.items()]
    for title, departures, rows in (
        ("Departures of the development", DEVELOPED, developed),
        ("Withheld departures, opened once", WITHHELD, withheld),
    ):
        lines += ["", f"## {title}", "", *_table(departures, rows)]
    return "\n".join(lines) + "\n"


def _table(departures: Sequence[Departure], rows: Sequence[Any]) -> list[str]:
    detected, right = sum(row["alarm"] for row in rows), sum(row["right"] for row in rows)
    lines = [f"Right cause first in {right} of {detected} detected: {right / max(detected, 1):.0%}.", ""]
    lines += [
        "| departure | size | laboratories | detected | right first | named instead |",
        "|---|---|---|---|---|---|",
    ]
    for d in departures:
        own = [row for row in rows if (row["name"], row["size"]) == (d.name, d.size)]
        wrong = Counter((row["named"] or ["no cause"])[0] for row in own if row["alarm"] and not row["right"])
        cells = (
            f"{len(own)} | {sum(r['alarm'] for r in own)} | {sum(r['right'] for r in own)} | {', '.join(wrong) or '-'}"
        )
        lines.append(f"| {d.name} | {d.size} | {cells if own else 'not measured | | |'} |")
    return lines


if __name__ == "__main__":
    files = [[json.loads(line) for line in Path(name).read_text("utf-8").splitlines()] for name in sys.argv[1:4]]
    (HERE / "attribution-matrix.md").write_text(page(*files), encoding="utf-8")
