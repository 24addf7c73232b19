"""Run file: writing blocks against plain h5py in SWMR mode, reading a sweep in units against h5py times a gain, loss by a kill.

    python benchmarks/bench_runfile.py [--json]

Both writers flush every block, keep the numbers of its first scan and HDF5's checksums, so that a killed program loses no block
that was written. The ways take turns block by block, and times are of the processor: another load of the computer meets both.
For the loss a process writes blocks of 50 ms as they would come from a card and is killed (SIGKILL); what it acquired and the
file does not have is lost.
"""

import tempfile
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from time import monotonic, process_time, sleep, thread_time

import h5py
import numpy as np
from timing import tell

from drivers.interfaces import Block
from protocols.measurements.sine_dwell import SinePoint
from protocols.runfile.creation import RAW_CHUNK, TABLE_CHUNK
from protocols.runfile.reader import Run
from protocols.runfile.schema import BLOCK_DTYPE
from protocols.runfile.writer import RunFileWriter
from tests.helpers.run_files import SCALES, initial_record

CHANNELS = ("drive", "displacement")
BLOCKS = 300
SIZES = ((5e3, 0.05), (250e3, 0.05), (500e3, 0.05), (5e6, 0.05), (20e6, 0.05))
"""Rate and duration of the blocks."""
SWEEP_S, SWEEP_RATE_HZ = 300.0, 5e3
KILLED_RATES_HZ, KILLS, KILLED_AFTER_S = (5e6, 10e6, 20e6), 5, 1.5
MOST_LOST_S = 0.2


class PlainWriter:
    """What h5py's documentation shows, with the same datasets."""

    def __init__(self, path: Path) -> None:
        self._file = h5py.File(path, "w", libver="latest")
        self._channels = [
            self._file.create_dataset(name, (0,), "i2", maxshape=(None,), chunks=(RAW_CHUNK,), fletcher32=True)
            for name in CHANNELS
        ]
        self._blocks = self._file.create_dataset(
            "blocks", (0,), BLOCK_DTYPE, maxshape=(None,), chunks=(TABLE_CHUNK,), fletcher32=True
        )
        self._file.swmr_mode = True

    def append_block(self, block: Block, time_s: float) -> None:
        row, count = self._channels[0].shape[0], block.raw.shape[1]
        for data, counts in zip(self._channels, block.raw, strict=True):
            data.resize((row + count,))
            data[row:] = counts
        number = self._blocks.shape[0]
        self._blocks.resize((number + 1,))
        self._blocks[number] = (row, block.start, time_s)
        self._file.flush()

    def close(self) -> None:
        self._file.close()


def measure() -> dict[str, float]:
    numbers: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for rate_hz, block_s in SIZES:
            numbers |= written(Path(folder), rate_hz, round(rate_hz * block_s))
        numbers |= read_in_units(Path(folder))
        for rate_hz in KILLED_RATES_HZ:
            lost = [lost_by_a_kill(Path(folder), rate_hz, KILLED_AFTER_S + 0.017 * i) for i in range(KILLS)]
            numbers[f"{rate_hz / 1e6:g} MS/s x 2: lost by a kill, at most, s"] = max(lost)
    return numbers


def lost_by_a_kill(folder: Path, rate_hz: float, after_s: float) -> float:
    """Seconds between what was acquired when the writer was killed and what its file has."""
    folder = Path(tempfile.mkdtemp(dir=folder))
    here, there = get_context("spawn").Pipe(duplex=False)
    writer = get_context("spawn").Process(target=_write_as_acquired, args=(folder, rate_hz, there))
    writer.start()
    began = here.recv()
    sleep(max(began + after_s - monotonic(), 0.0))
    writer.kill()
    acquired_s = monotonic() - began
    writer.join()
    (path,) = folder.glob("*.h5")
    with Run(path) as run:
        lost_s = acquired_s - run.trace.sample_count / rate_hz
    path.unlink()
    return lost_s


def _write_as_acquired(folder: Path, rate_hz: float, began: Connection) -> None:
    scans = round(0.05 * rate_hz)
    raw = np.random.default_rng(1).integers(-30000, 30000, (2, scans)).astype(np.int16)
    writer = RunFileWriter.new(folder, initial_record("killed", (100.0,), 5000.0), SinePoint)
    writer.start_stream(rate_hz, SCALES)
    start = monotonic()
    began.send(start)
    for number in range(10_000):
        sleep(max(start + (number + 1) * 0.05 - monotonic(), 0.0))
        writer.append_block(Block(number * scans, raw), 0.0)


def written(folder: Path, rate_hz: float, scans: int) -> dict[str, float]:
    raw = np.random.default_rng(1).integers(-30000, 30000, (2, scans)).astype(np.int16)
    name = f"{rate_hz / 1e3:g} kS/s"
    blocks = max(min(BLOCKS, round(1e7 / scans)), 20)
    ours = RunFileWriter.new(folder, initial_record(f"at {rate_hz:g}", (100.0,), 5000.0), SinePoint)
    ours.start_stream(rate_hz, SCALES)
    plain = PlainWriter(folder / f"plain-{rate_hz:g}.h5")
    taken: dict[object, list[float]] = {ours: [], plain: []}
    for number in range(blocks):
        for writer in (ours, plain) if number % 2 else (plain, ours):
            start = thread_time()
            writer.append_block(Block(number * scans, raw), 0.0)
            taken[writer].append(thread_time() - start)
    plain.close()
    ours.close_after_error()
    # Sums, because every thirty-second block or so begins a chunk.
    own, reference = sum(taken[ours]), sum(taken[plain])
    return {
        f"{name}: a block, us": 1e6 * median(taken[ours]),
        f"{name}: MB/s": 4e-6 * scans * blocks / own,
        f"{name}: share of real time": own / (blocks * scans / rate_hz),
        f"{name}: ratio to plain h5py": own / reference,
    }


def read_in_units(folder: Path) -> dict[str, float]:
    writer = RunFileWriter.new(folder, initial_record("sweep", (100.0,), 5000.0), SinePoint)
    writer.start_stream(SWEEP_RATE_HZ, SCALES)
    count = round(SWEEP_S * SWEEP_RATE_HZ)
    raw = np.random.default_rng(1).integers(-30000, 30000, (2, count)).astype(np.int16)
    for start in range(0, count, 5000):
        writer.append_block(Block(start, raw[:, start : start + 5000]), 0.0)
    writer.close_after_error()
    ours, plain = [], []
    with Run(writer.path) as run, h5py.File(writer.path, "r", libver="latest", locking=False) as file:
        gains = [file[f"entry/trace/{name}_scaling_factor"][()] for name in CHANNELS]
        offsets = [file[f"entry/trace/{name}_offset"][()] for name in CHANNELS]
        for _ in range(9):
            start = process_time()
            own = run.trace.drive_v(), run.trace.displacement_m()
            ours.append(process_time() - start)
            start = process_time()
            found = [
                (file[f"entry/trace/{name}"][:] + offset) * gain
                for name, gain, offset in zip(CHANNELS, gains, offsets, strict=True)
            ]
            plain.append(process_time() - start)
    for a, b in zip(own, found, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9 * float(np.abs(b).max()))
    return {
        "300 s of 5 kS/s in units, ms": 1e3 * median(ours),
        "300 s in units: ratio to h5py times gain": median(a / b for a, b in zip(ours, plain, strict=True)),
    }


if __name__ == "__main__":
    tell(
        "Run file: writing and reading against plain h5py.",
        measure,
        [(f"{rate_hz / 1e3:g} kS/s: ratio to plain h5py", "<", 1.05) for rate_hz, _ in SIZES]
        + [("300 s in units: ratio to h5py times gain", "<", 1.3)]
        + [
            (f"{rate_hz / 1e6:g} MS/s x 2: lost by a kill, at most, s", "<", MOST_LOST_S) for rate_hz in KILLED_RATES_HZ
        ],
    )
