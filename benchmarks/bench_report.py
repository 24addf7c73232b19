"""Report of a specimen, of two pages and in full: time and bytes of the command, against matplotlib drawing as many pages.

    python benchmarks/bench_report.py RUNS SPECIMEN [--json]

RUNS is a folder with the runs of a campaign, as `tactor-bench campaign run --all` leaves them. The reference is a page of four plots of 100
points with a legend, drawn as PDF and as SVG in a process of its own; command and reference take turns.
"""

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

ROUNDS = 3
GOALS_S = {"two pages": 3.0, "full": 6.0}
REFERENCE = """
import io, sys
import matplotlib.figure, numpy as np
for i in range(int(sys.argv[1])):
    figure = matplotlib.figure.Figure(figsize=(8.27, 11.69), layout="constrained")
    for axes in figure.subplots(2, 2).ravel():
        axes.plot(np.linspace(0, 1, 100), np.sin(np.linspace(0, 9, 100) + i), "o-", label="measured")
        axes.set(xlabel="frequency (Hz)", ylabel="displacement", title="a plot")
        axes.legend()
    for kind in ("pdf", "svg"):
        figure.savefig(io.BytesIO(), format=kind)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("specimen")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    asked = parser.parse_args()
    found = {name: measure(asked.runs, asked.specimen, name == "full") for name in GOALS_S}
    if asked.json:
        print(json.dumps(found))
        return
    for kind, numbers in found.items():
        goal = GOALS_S[kind]
        print(
            f"{kind}: goal wall <= {goal:g} s: {'met' if numbers['wall, s'] <= goal else 'not met on this computer now'}"
        )
        for name, value in numbers.items():
            print(f"    {name:36s} {value:10.4g}")


def measure(runs: Path, specimen: str, full: bool) -> dict[str, float]:
    walls, cpus, walls_of_pages, cpus_of_pages, written = [], [], [], [], []
    pages = 0
    for _ in range(ROUNDS):
        with tempfile.TemporaryDirectory() as out:
            words = ["-m", "app.cli.main", "report", specimen, "--folder", str(runs), "--out", out]
            wall, cpu = timed([*words, "--full"] if full else words)
            written.append({path.name: path.read_bytes() for path in Path(out).iterdir()})
        walls.append(wall)
        cpus.append(cpu)
        pages = next(
            len(re.findall(rb"/Type /Page\b", data)) for name, data in written[-1].items() if name.endswith("f")
        )
        wall, cpu = timed(["-c", REFERENCE, str(pages)])
        walls_of_pages.append(wall)
        cpus_of_pages.append(cpu)
    return {
        "wall, s": median(walls),
        "processor, s": median(cpus),
        "pages": pages,
        "the same pages by matplotlib, s": median(walls_of_pages),
        "ratio": median(a / b for a, b in zip(walls, walls_of_pages, strict=True)),
        "ratio of processor time": median(a / b for a, b in zip(cpus, cpus_of_pages, strict=True)),
        "invocations equal byte for byte": float(all(each == written[0] for each in written)),
    }


def timed(words: list[str]) -> tuple[float, float]:
    """Seconds of wall clock and of processor of a process and those that it starts."""
    wall, used = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, *words], check=True, capture_output=True, env={**os.environ, "PYTHONHASHSEED": "random"}
    )
    now = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.monotonic() - wall, now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime


if __name__ == "__main__":
    main()
