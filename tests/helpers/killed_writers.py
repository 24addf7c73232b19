"""Writers of run files killed at random moments: nothing acknowledged may be lost, and one repair must suffice.

`python -m tests.helpers.killed_writers [--count 180] [--seed 1]` kills as many, and prints what was left.
"""

import argparse
import collections
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import h5py
import numpy as np
from annotated_types import Unit

from drivers.interfaces import Block, Scale
from drivers.sensors.laser_sensor import LaserSensor
from protocols.base import EstimatedQuantity, LogMessage, RunStatus
from protocols.runfile.names import notes_path
from protocols.runfile.record import RunRecord
from protocols.runfile.repair import needs_repair, repair_folder, repair_run
from protocols.runfile.sidecar import read_notes
from protocols.runfile.verify import FileState, verify_run
from protocols.runfile.writer import RunFileWriter

BLOCKS, ROWS = 60, 5_000
ESTIMATE = EstimatedQuantity("gain", 1.0, 0.1, "1", "the test")


@dataclass
class Spot:
    """A small point."""

    frequency: Annotated[float, Unit("Hz"), "f"]
    height: Annotated[float, Unit("m"), "h"]


def write_run(folder: Path, acknowledged: int) -> None:
    """Write a run as fast as possible; write a line to the descriptor for everything that is stored."""

    def acknowledge(kind: str, number: int) -> None:
        os.write(acknowledged, f"{kind} {number}\n".encode())

    sensor = LaserSensor("laser", 1e-4)
    record = RunRecord(protocol="sine-dwell", title="P of T", specimen="T", axes=("frequency", "height"), sensor=sensor)
    file = RunFileWriter.new(folder, record, Spot)
    acknowledge("created", 1)
    file.start_stream(5000.0, (Scale((0.0, 3e-4)), Scale((0.0, 3e-4))))
    for k in range(BLOCKS):
        file.append_block(Block(ROWS * k, np.full((2, ROWS), k + 1, np.int16)), 0.1 * k)
        acknowledge("rows", ROWS * (k + 1))
        file.append_event(LogMessage("x" * 2500), 0.1 * k)
        acknowledge("events", k + 1)
        file.append_point(Spot(k, k))
        acknowledge("points", k + 1)
    file.finish(RunStatus.COMPLETED, "all points measured", [ESTIMATE])
    acknowledge("finished", 1)


def kill_one(folder: Path, after_s: float | None) -> tuple[dict[str, int], float]:
    """Kill a writer after a time; return what it had acknowledged, and how long it ran."""
    reading, writing = os.pipe()
    begun = time.perf_counter()
    child = os.fork()
    if child == 0:
        try:
            write_run(folder, writing)
        finally:
            os._exit(0)
    os.close(writing)
    if after_s is not None:
        time.sleep(after_s)
        os.kill(child, signal.SIGKILL)
    with os.fdopen(reading) as lines:
        told = [line.split() for line in lines.read().splitlines() if line]
    os.waitpid(child, 0)
    return {words[0]: int(words[1]) for words in told if len(words) == 2}, time.perf_counter() - begun


def check(folder: Path, told: dict[str, int]) -> str:
    """Repair the folder as the next start does; return what the kill left. Raises AssertionError if anything is lost."""
    files = list(folder.glob("*.h5"))
    if not files:
        assert not told
        list(repair_folder(folder))
        assert not list(folder.iterdir())
        return "no file yet"
    (path,) = files
    left = "closed in order"
    if needs_repair(path):
        left = "repaired"
        if told:
            with h5py.File(path, "r", swmr=True) as file:
                assert file["entry/trace/drive"].shape[0] >= told.get("rows", 0)
    sentences = list(repair_folder(folder))
    if left == "repaired" and not sentences:
        shutil.copytree(folder, tempfile.mkdtemp() + "/left")
        repair_run(path)  # says why not
    assert bool(sentences) == (left == "repaired")
    with h5py.File(path, "r") as file:
        entry = file["entry"]
        for name in ("drive", "displacement"):
            raw = entry["trace"][name][:]
            assert len(raw) >= told.get("rows", 0), "samples lost"
            assert np.array_equal(raw, np.arange(len(raw)) // ROWS + 1), "samples wrong"
        for name in ("frequency", "height"):
            column = entry["points"][name][:]
            assert len(column) >= told.get("points", 0), "points lost"
            assert np.array_equal(column, np.arange(len(column))), "points wrong"
        assert sum(entry["events"][:]["kind"] != b"+") >= told.get("events", 0), "events lost"
        assert list(entry.get("estimates", [])) in ([], ["gain"])
        if told.get("finished"):
            assert (left, list(entry["estimates"])) == ("closed in order", ["gain"])
        status = entry["status"][()].decode()
    notes = notes_path(path)
    beside = {
        notes,
        notes.with_suffix(".json.part"),
        notes.with_name(f".{notes.name}.lock"),
    }  # killed while writing notes
    assert {path} <= set(folder.iterdir()) <= {path} | beside
    read_notes(notes_path(path))
    state = verify_run(path).state
    assert state in (
        (FileState.GOOD,) if left == "repaired" or told.get("finished") else (FileState.GOOD, FileState.NOT_CHECKABLE)
    ), verify_run(path)
    return f"{left}, {status}, {state}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=180)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit", type=float, default=300.0, help="seconds after which no more are started")
    options = parser.parse_args()
    chance, counts, begun = random.Random(options.seed), collections.Counter[str](), time.perf_counter()
    with tempfile.TemporaryDirectory() as base:
        whole = 0.0
        for i in range(2):
            (folder := Path(base, f"whole{i}")).mkdir()
            told, whole = kill_one(folder, None)
            check(folder, told)
        for i in range(options.count):
            if time.perf_counter() - begun > options.limit:
                break
            (folder := Path(base, str(i))).mkdir()
            told, _ = kill_one(folder, chance.uniform(0, 1.1 * whole))
            counts[check(folder, told)] += 1
    print(
        f"one writer takes {whole:.2f} s; {sum(counts.values())} kills: {dict(counts)}; nothing acknowledged was lost"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
