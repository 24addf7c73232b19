"""Catalogue of runs: a thousand new files indexed, ten thousand known ones listed, searched and compared with their folder.

    python benchmarks/bench_catalogue.py [--json]

The reference for new files is h5py opening and closing each of them, in turn with the index in the same run. Copies of another time
are compared by their hash. Files without a sidecar, as earlier versions wrote, are read through HDF5. The list of known runs is in seconds of the processor.
"""

import gc
import shutil
import tempfile
from pathlib import Path
from statistics import median

import h5py
from timing import seconds, tell, timed

from app.archive.catalogue import Catalogue
from app.archive.run_filter import RunFilter
from app.archive.run_reading import read_run_summary
from app.cli.main import GC_THRESHOLD
from app.common import Progress
from protocols.runfile.names import notes_path
from tests.helpers.run_files import finished_run

NEW, KNOWN = 1000, 10_000
WRITTEN = 20
"""Files that are written; the others are copies."""
ROUNDS = 5


class Cancelled(Progress):
    """Ends a scan after the folder was compared with the index."""

    cancelled = True


def measure() -> dict[str, float]:
    gc.set_threshold(GC_THRESHOLD)  # as the program does
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        written = [finished_run(here / "written", f"T{i}") for i in range(WRITTEN)]
        (here / "new").mkdir()
        for i in range(NEW):
            new = here / "new" / f"{i:05d}_{written[i % WRITTEN].name}"
            shutil.copy2(written[i % WRITTEN], new)
            shutil.copy2(notes_path(written[i % WRITTEN]), notes_path(new))
        return {**new_files(here), **known_files(here)}


def new_files(here: Path) -> dict[str, float]:
    paths = sorted((here / "new").glob("*.h5"))
    index, opening = [], []
    for number in range(ROUNDS):
        catalogue = Catalogue(here / "new", here / f"new-{number}.sqlite")
        index += seconds(catalogue.scan, 1)
        opening += seconds(lambda: [h5py.File(path, "r", locking=False).close() for path in paths], 1)
        if len(catalogue.entries()) != NEW:
            raise SystemExit("the index does not have every file")
    for path in paths:
        path.touch()
    copied = seconds(Catalogue(here / "new", here / "copied.sqlite").scan, 1)
    for path in paths[:WRITTEN]:
        notes_path(path).unlink()
    long_way = min(seconds(lambda: [read_run_summary(path, path.name) for path in paths[:WRITTEN]], 3)) / WRITTEN
    return {
        f"{NEW} new files indexed, s": median(index),
        f"{NEW} files opened and closed by h5py, s": median(opening),
        "ratio": median(ours / other for ours, other in zip(index, opening, strict=True)),
        f"{NEW} new copies of another time, s": median(copied),
        "a file without a sidecar, ms": 1e3 * long_way,
        "ratio of a file without a sidecar": long_way / (median(opening) / NEW),
    }


def known_files(here: Path) -> dict[str, float]:
    one = Catalogue(here / "new", here / "new-0.sqlite").entries()[0]
    names = [f"2026{1 + i % 12:02d}/{i:05d}_T{i % 40}_sine-dwell.h5" for i in range(KNOWN)]
    many = Catalogue(here / "many", here / "many.sqlite")
    many.upsert([one._replace(path=name, specimen=f"T{i % 40}") for i, name in enumerate(names)])
    for name in names:
        path = here / "many" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    entries = many.entries()
    return {
        f"{KNOWN} known runs listed, ms": 1e3 * median(timed(many.entries)[1] for _ in range(2 * ROUNDS)),
        f"{KNOWN} filtered by three words, ms": 1e3
        * median(seconds(lambda: RunFilter(search_text="t7 resonance simulated").apply(entries), ROUNDS)),
        f"{KNOWN} compared with their folder, ms": 1e3 * median(seconds(lambda: many.scan(Cancelled()), ROUNDS)),
    }


if __name__ == "__main__":
    tell(
        "Catalogue of runs: new files, known files.",
        measure,
        [(f"{NEW} new files indexed, s", "<", 1.0), (f"{KNOWN} known runs listed, ms", "<", 50.0)],
    )
