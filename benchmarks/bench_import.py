"""Reading a long text table for import, against numpy.loadtxt and PyArrow's own CSV reader.

    python benchmarks/bench_import.py [--rows 1000000] [--rounds 5]

A clean table of time, drive and displacement. The import also hashes the file, finds delimiter, header, units and decimal sign, and
checks that every cell is a number. With PyArrow (the extra `formats`) numbers are read by it. Quote ratios of processor time.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from timing import timed

from app.archive.importing import read_table

GOAL_NUMPY, GOAL_ARROW = 1.2, 2.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.csv"
        t = np.arange(arguments.rows) / 5e3
        rows = np.column_stack((t, 2.5 + 2.4 * np.sin(600 * t), 100 * np.sin(600 * t - 0.3)))
        with path.open("w") as file:
            file.write("time [s],drive [V],displacement [um]\n")
            np.savetxt(file, rows, delimiter=",", fmt="%.9g")
        took = np.array([_round(path) for _ in range(arguments.rounds + 1)])[1:]  # the first one imports
    loadtxt, arrow, ours_numpy, ours_arrow = took.T
    print(f"{arguments.rows} rows of 3: numpy.loadtxt {np.median(loadtxt):.2f} s, PyArrow {np.median(arrow):.2f} s")
    for name, ours, reference, goal in (
        ("import by NumPy / numpy.loadtxt", ours_numpy, loadtxt, GOAL_NUMPY),
        ("import by PyArrow / numpy.loadtxt", ours_arrow, loadtxt, GOAL_NUMPY),
        ("import by PyArrow / PyArrow", ours_arrow, arrow, GOAL_ARROW),
    ):
        ratio = float(np.median(ours / reference))
        print(f"{name}: {ratio:.2f} (goal {goal:g}: {'met' if ratio <= goal else 'not met on this machine now'})")


def _round(path: Path) -> list[float]:
    import pyarrow as pa
    from pyarrow import csv

    times = [
        timed(lambda: np.loadtxt(path, delimiter=",", skiprows=1))[1],
        timed(lambda: csv.read_csv(path, read_options=csv.ReadOptions(use_threads=False)))[1],
    ]
    sys.modules["pyarrow"] = sys.modules["pyarrow.csv"] = None  # type: ignore[assignment]
    times.append(timed(lambda: read_table(path))[1])
    sys.modules["pyarrow"], sys.modules["pyarrow.csv"] = pa, csv
    times.append(timed(lambda: read_table(path))[1])
    return times


if __name__ == "__main__":
    main()
