"""Batch of short runs on the real wires at random speeds, on a busy computer: counts false alarms of the watchdog.

    python -m tests.helpers.loaded_runs --out FOLDER [--count N] [--minutes M] [--parallel N] [--busy N] [--seed S]

Every run goes through its own process of the simulated bench and the watchdog's process. Several benches run at the same time,
each with a program and an identity of its own: they are the load of each other. The volts at the simulated amplifier's input decide
whether a run ended at rest. A batch that was interrupted continues in its FOLDER where the code is the same; the files
of runs that did not end good are kept there, too.
"""

import argparse
import collections
import hashlib
import json
import logging
import math
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random

from app.session.bench_connection import BenchConnection, connect
from drivers.watchdog.client import WatchdogClient
from protocols.base import Event, EventBus, LevelExceeded, LogMessage, Outcome, RunStatus
from protocols.registry import PROTOCOLS
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.helpers.simulated_bench import simulated
from tests.helpers.timed_hangs import busy

RUNS_PER_BENCH = 10
"""Runs after which bench and watchdog are started again, at another speed."""

PLANS: tuple[tuple[str, dict[str, object]], ...] = (
    ("sine-dwell", {"frequencies_hz": (160.0,), "peak_to_peak_v": 4.0}),
    ("sine-dwell", {"frequencies_hz": (60.0, 220.0), "peak_to_peak_v": 2.0, "record_s": 0.2}),
    ("voltage-steps", {"levels_v": (1.5, 4.5), "repeats": 1, "rest_s": 0.3, "read_s": 0.3, "hold_s": 0.6}),
    ("hysteresis", {"frequencies_hz": (5.0,), "cycles": 2}),
    ("sweep", {"start_hz": 100.0, "stop_hz": 300.0, "sweep_s": 0.2, "periods": 2}),
    ("wiring-check", {"record_s": 0.5}),
)
"""Protocols with the settings that make them short."""


@dataclass(frozen=True, slots=True)
class LoadedRun:
    """What became of one run, with the load average beside it."""

    number: int
    protocol: str
    speed: float
    load: float
    took_s: float
    status: str
    outcome: str
    reason: str
    at_rest: bool
    volts: str
    """What is wrong with the volts; empty if nothing."""
    false_alarm: str
    """What the watchdog reported, or the program of it; empty if nothing."""
    repeated: int
    """Entries measured again because scans were lost."""
    levels: tuple[str, ...]
    """Abort levels that were reported."""
    silence_s: float
    """Longest time between two heartbeats of the run thread where the watchdog allowed `silence_s` only."""

    @property
    def failed(self) -> bool:
        return self.status != RunStatus.COMPLETED

    @property
    def noteworthy(self) -> bool:
        """Whether it is printed and its files are kept."""
        return bool(self.failed or self.volts or self.false_alarm or self.outcome != Outcome.GOOD)


class Silence:
    """The longest time between two heartbeats of a run thread in which no longer silence was allowed."""

    def __init__(self, watchdog: WatchdogClient) -> None:
        self.longest_s = 0.0
        self._usual_s = watchdog.notices_after_s
        self._latest_s = math.inf
        self._send = watchdog._send
        watchdog._send = self._observe  # type: ignore[method-assign]

    def _observe(self, line: str) -> None:
        keyword, _, allowed_s = line.partition(" ")
        if keyword in ("live", "beat", "rest"):
            self.longest_s = max(self.longest_s, time.monotonic() - self._latest_s)
            usual = keyword == "live" or (keyword == "beat" and float(allowed_s) <= self._usual_s + 1e-3)
            self._latest_s = time.monotonic() if usual else math.inf
        self._send(line)


def run_bench(index: int, seed: int, fastest: float, folder: Path) -> list[LoadedRun]:
    """Start a bench with an identity of its own, and make its runs; the same ones for the same seed and index."""
    random = Random(f"{seed} {index}")
    speed = round(math.exp(random.uniform(0.0, math.log(fastest))), 2)
    bench = simulated(generator={"serial": f"MY{seed:03}{index:05}"}, card={"serial": 0x1000000 * seed + index})
    with connect(bench, speed) as lab:
        assert isinstance(lab.bench.watchdog, WatchdogClient)
        silence = Silence(lab.bench.watchdog)
        numbers = range(index * RUNS_PER_BENCH, (index + 1) * RUNS_PER_BENCH)
        return [_one(lab, silence, speed, number, random.choice(PLANS), folder) for number in numbers]


def _one(
    lab: BenchConnection, silence: Silence, speed: float, number: int, plan: tuple[str, dict[str, object]], parent: Path
) -> LoadedRun:
    name, settings = plan
    protocol = PROTOCOLS[name].model_validate(settings)
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix=f"run{number:04}-", dir=parent) as temporary:
        folder = Path(temporary)
        lab.bench.watchdog.set_log_folder(folder)
        silence.longest_s = 0.0
        if lab.operator is not None:
            lab.operator.clear_specimen()
        events: list[Event] = []
        runner = Runner(RunRequest(protocol, folder, "T1"), lab.bench, lab.operator, EventBus(events.append))
        ended = runner.run()
        assert lab.control is not None
        report = lab.control.report()
        log = folder / "watchdog.log"
        said = log.read_text() if log.exists() else ""
        if not said and "watchdog" in ended.reason:
            said = ended.reason
        messages = [event.text for event in events if isinstance(event, LogMessage)]
        ran = LoadedRun(
            number=number,
            protocol=name,
            speed=speed,
            load=os.getloadavg()[0],
            took_s=time.monotonic() - begun,
            status=str(ended.status),
            outcome=str(ended.verdict.outcome),
            reason=ended.reason,
            at_rest=report.ends_at_rest,
            volts=_wrong_volts(report),
            false_alarm=said,
            repeated=sum("because scans were lost" in message for message in messages),
            levels=tuple(event.level for event in events if isinstance(event, LevelExceeded)),
            silence_s=silence.longest_s,
        )
        if ran.noteworthy:
            kept = parent / f"kept-{ran.number:04}"
            kept.mkdir(exist_ok=True)
            for file in folder.iterdir():
                file.rename(kept / file.name)
            (kept / "events.txt").write_text(
                "\n".join(repr(event)[:400] for event in events if event.kind not in ("BlockStored",))
            )
    return ran


@dataclass
class Batch:
    """The benches of a batch, several at a time, until `count` runs or `minutes`; runs in `folder` are not made again."""

    count: int
    minutes: float
    folder: Path
    seed: int = 1
    fastest: float = 20.0
    parallel: int = 1
    ran: list[LoadedRun] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)
    """Errors of benches that could not be opened, or of this program."""

    def resume(self) -> None:
        """Read the runs that an interrupted batch made.

        Raises:
            ValueError: they are of another state of the code, or of other options.
        """
        state = f"{code_state()} seed {self.seed} fastest {self.fastest:g}"
        file = self.folder / "state.txt"
        if file.exists() and file.read_text() != state:
            raise ValueError(
                f"{self.folder} has runs of '{file.read_text()}', this is '{state}'; choose another folder"
            )
        file.write_text(state)
        if (log := self.folder / "runs.jsonl").exists():
            for line in log.read_text().splitlines():
                record = json.loads(line)
                self.ran.append(LoadedRun(**{**record, "levels": tuple(record["levels"])}))

    @property
    def made(self) -> set[int]:
        """Indices of the benches whose runs were made."""
        return {ran.number // RUNS_PER_BENCH for ran in self.ran}

    def run(self) -> Iterator[list[LoadedRun]]:
        """Yield the runs of every bench as it ends.

        Raises:
            ValueError: the code changed meanwhile.
        """
        deadline, state = time.monotonic() + 60 * self.minutes, code_state()
        left = iter([i for i in range(math.ceil(self.count / RUNS_PER_BENCH)) if i not in self.made])
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(self.parallel, context) as pool, (self.folder / "runs.jsonl").open("a") as log:
            running: set[Future[list[LoadedRun]]] = set()
            while True:
                while len(running) < self.parallel and time.monotonic() < deadline:
                    if (index := next(left, None)) is None:
                        break
                    if code_state() != state:
                        raise ValueError("the code was changed during the batch; run it in a copy of its own")
                    running.add(pool.submit(run_bench, index, self.seed, self.fastest, self.folder))
                if not running:
                    return
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for each in done:
                    try:
                        runs = each.result()
                    except BrokenProcessPool:
                        raise
                    except Exception as error:  # noqa: BLE001 - it is counted
                        self.broken.append(f"{type(error).__name__}: {error}")
                        continue
                    self.ran.extend(runs)
                    log.writelines(json.dumps(asdict(ran)) + "\n" for ran in runs)
                    log.flush()
                    yield runs


def code_state() -> str:
    """Return the commit of the product, and whether files differ from it."""
    git = ("git", "-C", str(Path(__file__).parent))
    commit = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout.strip()
    changed = subprocess.run([*git, "diff", "HEAD"], capture_output=True, check=True).stdout
    return commit + (f" with changes {hashlib.sha256(changed).hexdigest()[:12]}" if changed else "")


def _wrong_volts(report: object) -> str:
    try:
        assert_safe_voltage(report)  # type: ignore[arg-type]
    except AssertionError as error:
        return str(error)
    return ""


def summary(ran: list[LoadedRun]) -> str:
    """Return the counts as lines."""
    loads = sorted(each.load for each in ran) or [math.nan]
    silences = sorted(each.silence_s for each in ran) or [math.nan]
    allowed_s = "the watchdog allows 0.4 s, and more while the computer is busy"
    lines = [
        f"{len(ran)} runs at {min((each.speed for each in ran), default=math.nan):g} to "  # noqa: ISC004
        f"{max((each.speed for each in ran), default=math.nan):g} times real speed; load average "
        f"{loads[0]:.1f} to {loads[-1]:.1f}, median {loads[len(loads) // 2]:.1f}",
        f"false alarms of the watchdog: {sum(bool(each.false_alarm) for each in ran)}",
        f"not at rest at the end: {sum(not each.at_rest for each in ran)}; unsafe volts: {sum(bool(e.volts) for e in ran)}",
        f"not completed for another reason: {sum(each.failed and not each.false_alarm for each in ran)}",
        f"longest silence of a run thread: {silences[-1]:.2f} s, median {silences[len(silences) // 2]:.2f} s ({allowed_s})",
        f"entries measured again because scans were lost: {sum(each.repeated for each in ran)}",
        f"abort levels reported: {dict(collections.Counter(level for each in ran for level in each.levels))}",
        f"verdicts: {dict(collections.Counter(each.outcome for each in ran))}",
    ]
    reasons = collections.Counter(each.reason[:160] for each in ran if each.failed)
    return "\n".join(lines + [f"  {count} x {reason}" for reason, count in reasons.most_common()])


def main() -> int:
    """Run the batch; return 1 if a run was not at rest, the watchdog acted without a reason, or a bench could not be opened."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--minutes", type=float, default=60.0, help="no bench is started later")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fastest", type=float, default=20.0, help="the greatest speed, times real")
    parser.add_argument("--parallel", type=int, default=1, help="benches at the same time")
    parser.add_argument("--busy", type=int, default=0, help="processes beside them that compute without a pause")
    parser.add_argument("--out", type=Path, help="folder for the log and the files of runs that did not end good")
    options = parser.parse_args()
    logging.basicConfig(level=logging.ERROR)
    begun = time.monotonic()
    with _folder(options.out) as folder, busy(options.busy):
        batch = Batch(options.count, options.minutes, folder, options.seed, options.fastest, options.parallel)
        try:
            batch.resume()
            for runs in batch.run():
                for ran in runs:
                    if ran.noteworthy:
                        print(
                            f"run {ran.number}, {ran.protocol} at speed {ran.speed:g}, load {ran.load:.1f}: {ran.status}, {ran.outcome}: "
                            f"{ran.reason}; {ran.false_alarm}; {ran.volts}",
                            flush=True,
                        )
                alarms, silence_s = sum(bool(r.false_alarm) for r in batch.ran), max(r.silence_s for r in batch.ran)
                print(
                    f"{len(batch.ran)} of {options.count} runs after {(time.monotonic() - begun) / 60:.1f} min, {alarms} false "
                    f"alarms, longest silence {silence_s:.2f} s, load {runs[-1].load:.1f}",
                    flush=True,
                )
        except ValueError as error:
            parser.error(str(error))
        finally:
            print(summary(batch.ran), flush=True)
            print(*(f"bench not run: {error}" for error in batch.broken), sep="\n", flush=True)
    return int(bool(batch.broken) or any(ran.false_alarm or not ran.at_rest or ran.volts for ran in batch.ran))


@contextmanager
def _folder(chosen: Path | None) -> Iterator[Path]:
    if chosen is not None:
        chosen.mkdir(parents=True, exist_ok=True)
        yield chosen
        return
    with tempfile.TemporaryDirectory(prefix="loaded-runs-") as folder:
        yield Path(folder)


if __name__ == "__main__":
    sys.exit(main())
