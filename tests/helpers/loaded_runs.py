"""Batch of short runs on the real wires at random speeds, on a busy computer: counts false alarms of the watchdog.

    python -m tests.helpers.loaded_runs [--count N] [--minutes M] [--seed S] [--out FOLDER] [--fastest SPEED]

Every run goes through its own process of the simulated bench and the watchdog's process, one run at a time. The volts at the
simulated amplifier's input decide whether it ended at rest. The files of runs that did not complete are kept in FOLDER.
"""

import argparse
import collections
import json
import logging
import math
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random

from app.session.bench_connection import BenchConnection, connect
from protocols.base import Event, EventBus, LevelExceeded, LogMessage, RunStatus
from protocols.registry import PROTOCOLS
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.helpers.simulated_bench import simulated

RUNS_PER_BENCH = 5
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

    @property
    def failed(self) -> bool:
        return self.status != RunStatus.COMPLETED


@dataclass
class Batch:
    """Runs until `count` or the end of `minutes`."""

    count: int
    minutes: float
    folder: Path
    fastest: float = 20.0
    random: Random = field(default_factory=lambda: Random(1))
    ran: list[LoadedRun] = field(default_factory=list)

    def run(self) -> Iterator[LoadedRun]:
        """Yield every run as it ends."""
        deadline = time.monotonic() + 60 * self.minutes
        while len(self.ran) < self.count and time.monotonic() < deadline:
            speed = round(math.exp(self.random.uniform(0.0, math.log(self.fastest))), 2)
            with connect(simulated(), speed) as lab:
                for _ in range(min(RUNS_PER_BENCH, self.count - len(self.ran))):
                    if time.monotonic() > deadline:
                        return
                    self.ran.append(self._one(lab, speed))
                    yield self.ran[-1]

    def _one(self, lab: BenchConnection, speed: float) -> LoadedRun:
        name, settings = self.random.choice(PLANS)
        protocol = PROTOCOLS[name].model_validate(settings)
        begun = time.monotonic()
        with tempfile.TemporaryDirectory(prefix=f"run{len(self.ran):04}-", dir=self.folder) as temporary:
            folder = Path(temporary)
            lab.bench.watchdog.set_log_folder(folder)
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
                number=len(self.ran),
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
            )
            if ran.failed:
                kept = self.folder / f"failed-{ran.number:04}"
                kept.mkdir(exist_ok=True)
                for file in folder.iterdir():
                    file.rename(kept / file.name)
                (kept / "events.txt").write_text(
                    "\n".join(repr(event)[:400] for event in events if event.kind not in ("BlockStored",))
                )
        return ran


def _wrong_volts(report: object) -> str:
    try:
        assert_safe_voltage(report)  # type: ignore[arg-type]
    except AssertionError as error:
        return str(error)
    return ""


def summary(ran: list[LoadedRun]) -> str:
    """Return the counts as lines."""
    loads = sorted(each.load for each in ran) or [math.nan]
    lines = [
        f"{len(ran)} runs at {min((each.speed for each in ran), default=math.nan):g} to "  # noqa: ISC004
        f"{max((each.speed for each in ran), default=math.nan):g} times real speed; load average "
        f"{loads[0]:.1f} to {loads[-1]:.1f}, median {loads[len(loads) // 2]:.1f}",
        f"false alarms of the watchdog: {sum(bool(each.false_alarm) for each in ran)}",
        f"not at rest at the end: {sum(not each.at_rest for each in ran)}; unsafe volts: {sum(bool(e.volts) for e in ran)}",
        f"not completed for another reason: {sum(each.failed and not each.false_alarm for each in ran)}",
        f"entries measured again because scans were lost: {sum(each.repeated for each in ran)}",
        f"abort levels reported: {dict(collections.Counter(level for each in ran for level in each.levels))}",
        f"verdicts: {dict(collections.Counter(each.outcome for each in ran))}",
    ]
    reasons = collections.Counter(each.reason[:160] for each in ran if each.failed)
    return "\n".join(lines + [f"  {count} x {reason}" for reason, count in reasons.most_common()])


def main() -> int:
    """Run the batch; return 1 if a run was not at rest, or the watchdog acted without a reason."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fastest", type=float, default=20.0, help="the greatest speed, times real")
    parser.add_argument("--out", type=Path, help="folder for the log and the files of runs that failed")
    options = parser.parse_args()
    logging.basicConfig(level=logging.ERROR)
    with _folder(options.out) as folder, (folder / "runs.jsonl").open("a") as log:
        batch = Batch(options.count, options.minutes, folder, options.fastest, Random(options.seed))
        try:
            for ran in batch.run():
                log.write(json.dumps(asdict(ran)) + "\n")
                log.flush()
                if ran.failed or ran.volts or ran.false_alarm:
                    print(
                        f"run {ran.number}, {ran.protocol} at speed {ran.speed:g}, load {ran.load:.1f}: {ran.status}: "
                        f"{ran.reason}; {ran.false_alarm}; {ran.volts}",
                        flush=True,
                    )
        finally:
            print(summary(batch.ran), flush=True)
    return int(any(ran.false_alarm or not ran.at_rest or ran.volts for ran in batch.ran))


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
