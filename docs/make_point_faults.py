"""Point faults: plants sensor faults in the middle of recordings, counts the flagged points, writes docs/point-faults.md.

    python docs/make_point_faults.py [--points N] [--clean N] [--seed N] [ROW...]

With rows (a protocol, or `mass-resonance by dwells`) only theirs are measured anew; 100 points of each fault in all of them take some hours. Exit code 1
if a fault is not flagged, or too many sound points are.
"""

import argparse
import itertools
import sys
import tempfile
from collections import Counter
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from protocols.base import Quality  # noqa: E402
from tests.helpers.point_faults import FAULTS, SETTINGS, clean_run, faulty_run  # noqa: E402

BENCHES = ("sim", "ideal")

MOST_FALSE = 1e-3
"""Largest share of sound points that are flagged."""

HEAD = """# Faults in the middle of a point

Written by `python docs/make_point_faults.py`, which runs every protocol on the simulated benches (`sim`, with the imperfections of a
laboratory, and `ideal`, in turn, each run with other noise and, on `sim`, other weights and instruments) and plants one fault at the sensor in each
point: at 30 to 70 % of one of its recordings, as large as ten times the sensor's noise at rest or 2 % of the recording's max - min, whichever is larger. A point counts
as flagged if no fit uses it: flagged `disturbed` (judged as a whole: [theory](theory.md)) or otherwise, or without values because nothing could be fitted.

- **stuck**: the output stays at its value until the end of the recording; the card's own noise remains.
- **jump**: the reading jumps to either side, until the end of the recording.
- **dropout**: the reading is off for 5 ms.
- **saturated**: the output is cut off below the highest later displacement, until the end of the recording.
- **moved**: the laser is moved at once and stays there.

A cell gives the flagged points of all points with the fault. The last column gives the sound points, and how many of them are flagged.

| protocol | {faults} | sound points, flagged |
|{rule}|
"""


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--points", type=int, default=100, help="points of each fault")
    parser.add_argument("--clean", type=int, default=0, help="fewest sound points")
    parser.add_argument("--seed", type=int, default=1000, help="of the first run")
    parser.add_argument("rows", nargs="*", default=[])
    chosen = parser.parse_args()
    page = HERE / "point-faults.md"
    before = page.read_text("utf-8").splitlines() if page.exists() else []
    lines = {row: next((line for line in before if line.startswith(f"| {row} |")), "") for row in SETTINGS}
    bad = False
    for row in chosen.rows or list(SETTINGS):
        lines[row], sound = _row(row, chosen.points, chosen.clean, chosen.seed)
        bad |= not sound
        print(lines[row], flush=True)
        head = HEAD.format(faults=" | ".join(FAULTS), rule="---|" * (len(FAULTS) + 1) + "---")
        page.write_text(head + "\n".join(filter(None, lines.values())) + "\n", encoding="utf-8")
    return int(bad)


def _row(row: str, points: int, clean: int, first: int) -> tuple[str, bool]:
    """Return the row of the table, and whether every fault and no more sound points than allowed are flagged."""
    planted: Counter[str] = Counter()
    flagged: Counter[str] = Counter()
    sound = false = 0
    for seed, bench in zip(itertools.count(first), itertools.cycle(BENCHES), strict=False):
        wanted = tuple(fault for fault in FAULTS if planted[fault] < points)
        if not wanted and sound >= clean:
            break
        with tempfile.TemporaryDirectory() as folder:
            twin = clean_run(row, bench, seed, Path(folder))
            qualities = [Quality(int(point.quality)) for point in twin.ran.points]
            sound, false = sound + len(qualities), false + sum(not quality.usable for quality in qualities)
            for fault, is_flagged in faulty_run(row, bench, seed, Path(folder), twin, wanted) if wanted else ():
                planted[fault] += 1
                flagged[fault] += is_flagged
                if not is_flagged:
                    print(f"missed: {row}, {fault}, {bench}, seed {seed}", flush=True)
        if any(not quality.usable for quality in qualities):
            print(
                f"flagged: {row}, {bench}, seed {seed}: {[q.description for q in qualities if not q.usable]}",
                flush=True,
            )
    cells = " | ".join(f"{flagged[fault]} of {planted[fault]}" for fault in FAULTS)
    return f"| {row} | {cells} | {sound}, {false} |", flagged == planted and false <= max(MOST_FALSE * sound, 1)


if __name__ == "__main__":
    sys.exit(main())
