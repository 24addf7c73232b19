"""Double faults: runs two faults at a time under every kind of drive, writes docs/double-faults.md; exit code 1 if a cell is at fault.

    python docs/make_double_faults.py [--jobs N] [--source NAME] [--drive NAME] [--only FAULT] [--missing]

With `--source`, `--drive`, `--only` or `--missing` the other cells are kept as they are. All of them take about two hours on two cores.
"""

import argparse
import concurrent.futures
import multiprocessing
import os
import re
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from tests.helpers.double_faults import (  # noqa: E402
    DRIVES,
    FAULTS,
    INTERLOCK,
    SAFE_V,
    SLOW_WIRE_S,
    SOURCES,
    WATCHDOG_PATIENCE_S,
    NotLiveError,
    double_cell,
    pairs_of,
)

PAGE = HERE / "double-faults.md"

HEAD = f"""# Two faults at the same time

Written by `python docs/make_double_faults.py`. Every cell runs the whole program with its watchdog, each in a process of its own, on the
real wires of the simulated bench; both faults are injected while the drive is on the specimen. The voltage at the simulated
amplifier's input, over the whole run, decides what a cell says, and the text of the program and `watchdog.log` decide who reported it.

- **rest 0.5 s**: from 0.5 s after the faults on, the input was constant at rest.
- **off 0.5 s** (*level with interlock*: a bench with an interlock, monostable {INTERLOCK.monostable_s:g} s, relay and amplifier {INTERLOCK.release_s:g} s): from 0.5 s after the
  faults on, the specimen had less than {SAFE_V:g} V, because the interlock had taken the high voltage away.
- **3.2 V** in bold: the input was not at rest at the end. Every such cell names who reported it, and when.
- *may be live*: the warning that the specimen may be live, with the manual instruction, before the program or the watchdog acts.
- *unsafe*: the run ended unsafe, exit code 3. *could not*: the watchdog wrote into `watchdog.log` and on the terminal that the source could
  not be brought to rest.
- **-**: not measured.
- *next start*: reported by the next start of the program, in seconds after it was started, before it asked the operator anything.

Times are wall time, on two cores with a load average of {{low}} to {{high}}; a computer with less other work is faster. The slow wire has a
round trip of {2 * SLOW_WIRE_S:g} s. The watchdog tries for {WATCHDOG_PATIENCE_S:g} s (`patience_s`; the default is 30 s). A ramp has a slope of 1 V/s here. The limits that
hold are in [safety](safety.md).
"""

CELLS_PER_POOL = 40
"""Cells after which new processes take over: each simulated bench leaves its history behind."""

LOAD = re.compile(r"load average of (\d+) to (\d+)")

Key = tuple[str, str, tuple[str, str]]


def main() -> int:
    """Run the chosen cells and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--source", choices=list(SOURCES))
    parser.add_argument("--drive")
    parser.add_argument("--only", choices=list(FAULTS), help="cells with this fault")
    parser.add_argument("--missing", action="store_true", help="cells that were not run yet, or are at fault")
    options = parser.parse_args()
    cells = _read_page()
    done = {key for key, words in cells.items() if "FAULT" not in words} if options.missing else set()
    chosen = [
        (source, drive, pair)
        for source, kind in SOURCES.items()
        for pair in pairs_of(source)
        for drive in kind.drives
        if options.source in (None, source)
        and options.drive in (None, drive)
        and (not options.only or options.only in pair)
        and (source, drive, pair) not in done
    ]
    chosen.sort(key=lambda key: DRIVES.index(key[1]))
    loads = _read_loads()
    context = multiprocessing.get_context("spawn")  # each cell has threads, servers and clocks of its own
    for first in range(0, len(chosen), CELLS_PER_POOL):
        with concurrent.futures.ProcessPoolExecutor(options.jobs, mp_context=context) as pool:
            running = {pool.submit(run_cell, key): key for key in chosen[first : first + CELLS_PER_POOL]}
            for ended in concurrent.futures.as_completed(running):
                key = running[ended]
                try:
                    cells[key] = ended.result()
                except NotLiveError as error:
                    print(*key, f"was not measured: {error}", flush=True)
                    continue
                except Exception as error:  # noqa: BLE001 - the other cells are of use all the same
                    cells[key] = f"FAULT: {type(error).__name__}: {' '.join(str(error).split())[-300:]}".replace(
                        "|", "/"
                    )
                print(*key, cells[key], flush=True)
                loads.append(round(os.getloadavg()[0]))
                _write_page(cells, loads)
    bad = {key: words for key, words in cells.items() if "FAULT" in words}
    print(
        f"{len(bad)} of {len(cells)} cells are at fault", *(f"{key}: {words}" for key, words in bad.items()), sep="\n"
    )
    return int(bool(bad))


def run_cell(key: Key) -> str:
    """Return the text of a cell."""
    with tempfile.TemporaryDirectory() as folder:
        return double_cell(*key, Path(folder)).words


def _read_page() -> dict[Key, str]:
    cells: dict[Key, str] = {}
    source, drives = "", []
    for line in PAGE.read_text("utf-8").splitlines() if PAGE.exists() else []:
        if found := re.match(r"## .*\((\w+)\)$", line):
            source = found[1]
        parts = [part.strip() for part in line.strip("|").split("|")]
        if line.startswith("| first fault"):
            drives = parts[2:]
        elif line.startswith("| ") and source in SOURCES and tuple(parts[:2]) in pairs_of(source):
            for drive, words in zip(drives, parts[2:], strict=True):
                if words != NOT_RUN:
                    cells[source, drive, (parts[0], parts[1])] = words
    return cells


NOT_RUN = "-"


def _read_loads() -> list[int]:
    """Return the load averages that the page states."""
    found = LOAD.search(PAGE.read_text("utf-8")) if PAGE.exists() else None
    return [int(load) for load in found.groups()] if found else []


def _write_page(cells: dict[Key, str], loads: list[int]) -> None:
    lines = [HEAD.format(low=min(loads), high=max(loads))]
    for source, kind in SOURCES.items():
        lines += [f"## {kind.title} ({source})", ""]
        lines += [
            f"| first fault | second fault | {' | '.join(kind.drives)} |",
            "|---|---|" + "---|" * len(kind.drives),
        ]
        for pair in pairs_of(source):
            row = [cells.get((source, drive, pair), NOT_RUN) for drive in kind.drives]
            lines.append(f"| {' | '.join((*pair, *row))} |")
        lines.append("")
    lines += ["## The faults", "", "| fault | what it is |", "|---|---|"]
    lines += [f"| {name} | {description} |" for name, description in FAULTS.items()]
    PAGE.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
