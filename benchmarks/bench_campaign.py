"""The paper's whole campaign on the virtual clock, nothing skipped; and memory over the length of a sweep.

    python benchmarks/bench_campaign.py [--bench sim] [--items wiring,steps] [--memory] [--sweeps]

Per item: bench time, wall time, processor time, and its state. At the end what the paper's chain identified,
against the truth of the simulated tactor, and the largest memory. `--memory` runs one mass of the mass resonance in 30 s and
in 300 s, each in a process of its own, and tells by how much the longer one needs more. `--sweeps` compares the bench time of sweeps
with the time that was asked for.
"""

import argparse
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program does, before numpy is there

from app.campaign.campaign import Campaign
from app.campaign.plan import PAPER_ITEMS, drop_unknown_protocols
from app.campaign.queue import CampaignRunner
from app.campaign.summary import identify_campaign_runs
from app.config.bench_file import BenchConfig, load_bench
from app.session.bench_connection import UNATTENDED_BLOCK_S, connect
from app.session.session import Session
from protocols.registry import PROTOCOLS
from protocols.runner.request import RunRequest

RATE_HZ = 5000.0
"""Scans per second of the campaign."""

GOAL_S = {"ideal": 30.0}
"""Wall time on two quiet cores; `sim` may take 1.5 times as long."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--items", default="", help="only these, separated by commas")
    parser.add_argument("--bench", default="ideal", help="bench file, 'ideal' (default) or 'sim'")
    parser.add_argument("--memory", action="store_true")
    parser.add_argument("--sweeps", action="store_true", help="bench time of sweeps against the time asked for")
    parser.add_argument("--sweep", type=float, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.sweep:
        sweep(asked.sweep)
        print(peak_mb())
    elif asked.sweeps:
        sweeps()
    elif asked.memory:
        memory()
    else:
        goal_s = GOAL_S.get(asked.bench, 1.5 * GOAL_S["ideal"])
        campaign([name for name in asked.items.split(",") if name], load_bench(asked.bench), goal_s)


def campaign(only: list[str], config: BenchConfig, goal_s: float) -> None:
    items = drop_unknown_protocols([item for item in PAPER_ITEMS if not only or item.name in only], PROTOCOLS)
    items = tuple(item for item in items)
    missing = [item.protocol for item in PAPER_ITEMS if item.protocol not in PROTOCOLS]
    if missing:
        print(f"not known here, and left out: {', '.join(missing)}")
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, connect(config, None, UNATTENDED_BLOCK_S) as lab:
        told = Campaign.create(Path(folder), "bench", True, items)
        conductor = CampaignRunner(told)
        session = Session(lambda: nullcontext(lab), [conductor], lab.operator)
        session.start()
        print(f"{'item':12} {'bench time':>11} {'wall time':>10} {'processor':>10}  state")
        while (line := told.next_item()) is not None:
            bench_s, wall_s, used_s = lab.bench.clock.now(), time.monotonic(), time.process_time()
            conductor.start(session, line)
            session.finished.wait()
            bench_s, wall_s = lab.bench.clock.now() - bench_s, time.monotonic() - wall_s
            used_s = time.process_time() - used_s
            stands = told.item_state(line.item.name)
            print(
                f"{line.item.name:12} {bench_s:>9.0f} s {wall_s:>8.1f} s {used_s:>8.1f} s  "
                f"{stands.status}: {stands.reason}",
                flush=True,
            )
            if session.outcome is None or session.outcome.status != "completed":
                break
        session.close()
        print(
            f"together {lab.bench.clock.now():.0f} s of bench time in {time.monotonic() - began:.1f} s (goal {goal_s:g} s), "
            f"processor time {time.process_time():.1f} s, {1e6 * time.process_time() / lab.bench.clock.now() / RATE_HZ:.2f} us a scan"
        )
        found = identify_campaign_runs(told)
        if isinstance(found, str):
            print(found)
        else:
            record = config.simulation_parameters.as_record()
            truth = {**record["tactor"], **record["membrane"]}
            for estimate in found.identified:
                beside = truth.get(estimate.name)
                away = "" if beside is None else f", truth {beside:.5g}, {100 * (estimate.value / beside - 1):+.2f} %"
                print(
                    f"  {estimate.name:12} {estimate.value:12.6g} +- {estimate.standard_error:8.2g} {estimate.unit}{away}"
                )
    print(f"largest memory {peak_mb():.0f} MB")


def sweeps() -> None:
    took = []
    for seconds in (30.0, 300.0, 900.0):
        took.append(sweep(seconds))
        met = "met" if took[-1] <= 1.1 * seconds + 5 else "NOT met"
        print(f"asked {seconds:g} s, took {took[-1]:.1f} s of bench time; goal 1.1 times and 5 s: {met}")
    print(f"exponent from 300 s to 900 s: {math.log(took[2] / took[1]) / math.log(3):.2f}")


def memory() -> None:
    peaks = []
    for seconds in (30, 300):
        done = subprocess.run(
            [sys.executable, __file__, "--sweep", str(seconds)], capture_output=True, text=True, check=True
        )
        peaks.append(float(done.stdout.split()[-1]))
        print(f"a sweep of {seconds} s: largest memory {peaks[-1]:.0f} MB", flush=True)
    print(f"ten times as long needs {peaks[1] - peaks[0]:+.0f} MB, {100 * (peaks[1] / peaks[0] - 1):+.1f} %")


def sweep(seconds: float, bench: str = "ideal") -> float:
    """Run one mass of the mass resonance; return the bench time that it took."""
    with tempfile.TemporaryDirectory() as folder, connect(load_bench(bench), None, UNATTENDED_BLOCK_S) as lab:
        session = Session(lambda: nullcontext(lab), [], lab.operator)
        session.start()
        protocol = PROTOCOLS["mass-resonance"](masses_kg=(7.75e-3,), sweep_s=seconds)
        session.run(RunRequest(protocol, Path(folder), "bench"))
        session.finished.wait()
        session.close()
        assert session.outcome is not None, session.outcome
        assert session.outcome.status == "completed", session.outcome
        return lab.bench.clock.now()


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
