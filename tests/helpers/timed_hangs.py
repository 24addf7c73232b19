"""Hangs of the program in mid-drive: how long the watchdog takes to bring the source to rest.

    python -m tests.helpers.timed_hangs [--count N] [--drive full|sine|level] [--busy N] [--limit SECONDS]

Each hang is a program of its own with its watchdog, on the real wires of a simulated bench that this process serves. The program gets
SIGSTOP in mid-drive; the volts at the simulated amplifier's input decide from when on the input is at rest.
"""

import argparse
import contextlib
import os
import signal
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sim_hardware.testing.safe_volts import STEP_V
from tests.helpers.double_faults import NotLiveError, open_scene, rest_since
from tests.helpers.waiting import wait_until

BUSY = "import os; parent = os.getppid()\nwhile os.getppid() == parent: pass"
"""Program that computes without a pause as long as its parent lives."""

PATIENCE_S = 60.0
"""Longest wait for the watchdog's report."""


@dataclass(frozen=True, slots=True)
class Hang:
    """One program that was stopped in mid-drive.

    Attributes:
        rest_s: bench time, which is real time, from SIGSTOP until the input was constant at rest; NaN if it was not.
        log: what the watchdog reported.
    """

    rest_s: float
    largest_jump_v: float
    end_v: float
    load: float
    log: str


def hang(drive: str, folder: Path) -> Hang:
    """Stop a program in mid-drive; return what followed.

    Raises:
        NotLiveError: the program ended before.
    """
    with open_scene("33511B", drive, folder, watchdog="") as (scene, _):
        scene.go_live()
        begin_s, load = scene.bench.now(), os.getloadavg()[0]
        scene.program.process.send_signal(signal.SIGSTOP)
        wait_until(lambda: "brought to rest" in scene.log(), PATIENCE_S)
        report = scene.bench.report()
        rest_s = rest_since(scene.bench, begin_s) - begin_s if report.ends_at_rest else float("nan")
        return Hang(rest_s, report.largest_jump_v, report.end_v, load, scene.log().strip())


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Run processes that compute without a pause."""
    processes = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def summary(hangs: list[Hang], not_live: int) -> str:
    """Return the result as lines."""
    rested = sorted(each.rest_s for each in hangs if each.rest_s == each.rest_s)
    loads = sorted(each.load for each in hangs)
    lines = [f"{len(hangs)} hangs; {len(hangs) - len(rested)} not at rest; {not_live} programs did not come to a drive"]
    if rested:
        lines.append(f"from SIGSTOP to rest: median {statistics.median(rested):.2f} s, longest {rested[-1]:.2f} s")
    if hangs:
        lines.append(f"largest jump {max(each.largest_jump_v for each in hangs):.4f} V (limit {STEP_V:g} V)")
        lines.append(f"load average {loads[0]:.1f} to {loads[-1]:.1f}, median {statistics.median(loads):.1f}")
    return "\n".join(lines)


def main() -> int:
    """Time the hangs; return 1 if the input was not at rest within the limit, or jumped."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=25)
    parser.add_argument("--drive", choices=("full", "sine", "level"), default="full")
    parser.add_argument("--busy", type=int, default=0, help="processes beside it that compute without a pause")
    parser.add_argument("--limit", type=float, default=3.0, help="longest time to rest, s")
    options = parser.parse_args()
    hangs: list[Hang] = []
    not_live = 0
    with (
        busy(options.busy),
        tempfile.TemporaryDirectory(prefix="timed-hangs-") as folder,
        contextlib.suppress(KeyboardInterrupt),
    ):
        for number in range(1, options.count + 1):
            (own := Path(folder, str(number))).mkdir()
            try:
                hangs.append(hang(options.drive, own))
            except NotLiveError as error:
                not_live += 1
                print(f"{number}: no drive: {error}", flush=True)
                continue
            latest = hangs[-1]
            print(
                f"{number}: {latest.rest_s:.2f} s, load {latest.load:.1f}, jump {latest.largest_jump_v:.4f} V: {latest.log}",
                flush=True,
            )
    print(summary(hangs, not_live))
    return int(
        not hangs or any(not each.rest_s <= options.limit or each.largest_jump_v > STEP_V + 1e-6 for each in hangs)
    )


if __name__ == "__main__":
    sys.exit(main())
