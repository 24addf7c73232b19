"""The archive: listing, filtering and re-scanning ten thousand runs, and reading small real files into a new index.

    python benchmarks/bench_catalogue.py

The ratios are against opening every file, which is what a list without an index would do each time.
"""

import tempfile
from pathlib import Path

from timing import seconds

from app.archive.catalogue import Catalogue
from app.archive.run_summary import RunFilter, read_run_summary
from tests.helpers.run_files import finished_run

MANY = 10_000
REAL = 200


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        real = [finished_run(here / "real", f"T{i % 20}") for i in range(REAL)]
        index = Catalogue(here / "real", here / "real.sqlite")
        first = min(seconds(index.scan, 1))
        again = min(seconds(index.scan, 5))
        print(f"{REAL} real files: into a new index {1e3 * first:.0f} ms, looked at again {1e3 * again:.1f} ms")
        opening = min(seconds(lambda: [read_run_summary(path, path.name) for path in real[:50]], 1)) / 50
        synthetic(here, index, opening)


def synthetic(here: Path, index: Catalogue, opening: float) -> None:
    one = index.entries()[0]
    names = [f"2026{1 + i % 12:02d}/{i:05d}_T{i % 40}_sine-dwell.h5" for i in range(MANY)]
    many = Catalogue(here / "many", here / "many.sqlite")
    many.upsert([one._replace(path=name, specimen=f"T{i % 40}") for i, name in enumerate(names)])
    for name in names:
        path = here / "many" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    listing = min(seconds(many.entries, 5))
    entries = many.entries()
    filtering = min(seconds(lambda: RunFilter(search_text="t7 resonance simulated").apply(entries), 5))
    walking = min(seconds(lambda: many.scan(cancelled=lambda: True), 5))
    print(f"{MANY} runs: listed {1e3 * listing:.0f} ms, filtered by three words {1e3 * filtering:.1f} ms, ")
    print(f"  folder compared with the index {1e3 * walking:.0f} ms")
    print(
        f"  opening every file instead (from 50 of them): {MANY * opening:.0f} s, {MANY * opening / listing:.0f} times as long"
    )


if __name__ == "__main__":
    main()
