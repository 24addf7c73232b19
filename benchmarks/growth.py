"""Growth of costs: processor time and memory over the length of recordings, points, runs, channels, shape functions and specimens.

    python benchmarks/growth.py [--write] [--only NAME,...]

Each size runs in a process of its own, so that its largest memory is its own. The exponent is the slope of the logarithms over the
upper half of the sizes: 1 is linear. `--write` makes the page docs/growth.md.
"""

import argparse
import json
import math
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from time import process_time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program does, before numpy is imported

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
PAGE = HERE.parent / "docs" / "growth.md"
LINEAR = 1.1
"""Largest exponent of what should be linear work."""

Work = Callable[[], object]
Case = Callable[[int, Path], Work]
"""Prepares the work of a size in a folder."""


def run_protocol(name: str, folder: Path, channels: int = 2, **settings: object) -> Work:
    """A run on the ideal simulated bench and its virtual clock."""
    from app.config import load_bench
    from app.session import UNATTENDED_BLOCK_S, Session, connect
    from protocols.registry import PROTOCOLS
    from protocols.runner.request import RunRequest

    further = [{"name": f"further_{i}", "channel": f"ai{i}"} for i in range(2, channels)]
    config = type(base := load_bench("ideal")).model_validate({**base.model_dump(), "channels": further})

    def work() -> None:
        with connect(config, None, UNATTENDED_BLOCK_S) as bench:
            session = Session(lambda: nullcontext(bench), [], bench.operator)
            session.start()
            session.run(RunRequest(PROTOCOLS[name](**settings), folder, "growth"))
            session.finished.wait()
            session.close()
            assert session.outcome is not None
            assert session.outcome.status == "completed", session.outcome

    return work


def sweep_length(size: int, folder: Path) -> Work:
    return run_protocol("mass-resonance", folder, masses_kg=(7.75e-3,), sweep_s=float(size))


def dwell_length(size: int, folder: Path) -> Work:
    frequencies = tuple(100 + 100 * i / (2 * size) for i in range(2 * size))
    return run_protocol("sine-dwell", folder, frequencies_hz=frequencies, record_s=28.0)


def dwell_points(size: int, folder: Path) -> Work:
    frequencies = tuple(50 + 200 * i / size for i in range(size))
    return run_protocol("sine-dwell", folder, frequencies_hz=frequencies, record_s=0.2)


def channel_count(size: int, folder: Path) -> Work:
    return run_protocol(
        "sine-dwell", folder, channels=size, frequencies_hz=(100.0, 155.0), record_s=6.0, sample_rate_hz=5e4
    )


def recording_length(size: int, _: Path) -> Work:
    from bench_sine import analysis

    rate_hz, t = 5e5, np.arange(size) / 5e5
    drive = 2.5 + 2.5 * np.sin(2 * np.pi * 155.3 * t)
    moved = 5e-4 * np.sin(2 * np.pi * 155.3 * t - 1.2) + 1e-8 * np.random.default_rng(1).standard_normal(size)
    return lambda: analysis(drive, moved, rate_hz)


def points_of_a_fit(size: int, _: Path) -> Work:
    return joint_fit_of(13, size)


def runs_of_a_fit(size: int, _: Path) -> Work:
    return joint_fit_of(size, 20)


def joint_fit_of(runs: int, points: int) -> Work:
    """Dwells with two added masses in turn."""
    from model import Tactor
    from model.identification import FitOptions, FrequencyResponseObservation, ObservationSet, joint_fit
    from model.response import amplifier_response

    rng, f = np.random.default_rng(1), np.linspace(60, 220, points)
    truth = Tactor(k2=7.2e-3, mu=-1.29e-5, c0=166.0, m_add=7.85e-3)
    moved = amplifier_response(truth, f).fundamental
    sizes = 2e-4 * np.abs(moved)
    observed = [
        FrequencyResponseObservation(
            f"run {i}",
            f,
            fundamental_m=moved + sizes * (rng.standard_normal(points) + 1j * rng.standard_normal(points)),
            errors_m=sizes,
            good=np.ones(points, bool),
            drive_amplitude_v=2.5,
        )
        for i in range(runs)
    ]
    options = FitOptions(free=("mu", "c0", "m_add"))
    return lambda: joint_fit(ObservationSet(tuple(observed)), options)


def new_runs(size: int, folder: Path) -> Work:
    from app.archive.catalogue import Catalogue

    runs = run_files(size, folder)
    return lambda: Catalogue(runs, folder / "index.sqlite").scan()


def known_runs(size: int, folder: Path) -> Work:
    from app.archive.catalogue import Catalogue

    known = Catalogue(runs := run_files(20, folder), folder / "index.sqlite")
    known.scan()
    one = known.entries()[0]
    many = Catalogue(runs, folder / "many.sqlite")
    many.upsert([one._replace(path=f"{i:06d}_T{i % 40}_sine-dwell.h5") for i in range(size)])
    return many.entries


def specimens(size: int, folder: Path) -> Work:
    from app.archive.catalogue import Catalogue
    from app.fleet.catalogue_values import read_fleet

    known = Catalogue(runs := run_files(20, folder), folder / "index.sqlite")
    known.scan()
    one = known.entries()[0]
    known.upsert([one._replace(path=f"{i:06d}.h5", specimen=f"T{i}") for i in range(size)])
    return lambda: read_fleet(runs, known)


def run_files(count: int, folder: Path) -> Path:
    """A folder of copies of twenty runs."""
    from tests.helpers.run_files import finished_run

    written = [finished_run(folder / "written", f"T{i}") for i in range(20)]
    runs = folder / "runs"
    runs.mkdir()
    for i in range(count):
        shutil.copy(written[i % 20], runs / f"{i:06d}_{written[i % 20].name}")
    return runs


def rows_of_csv(size: int, folder: Path) -> Work:
    return export_of(size, folder, "csv")


def rows_of_mat(size: int, folder: Path) -> Work:
    return export_of(size, folder, "mat")


def export_of(size: int, folder: Path, kind: str) -> Work:
    from app.archive.transfer import export_runs
    from drivers.drive_shapes import Sine
    from drivers.interfaces import Block
    from protocols.measurements.sine_dwell import SinePoint
    from protocols.runfile.writer import RunFileWriter
    from tests.helpers.run_files import SCALES, initial_record

    writer = RunFileWriter.new(folder, initial_record("growth", (100.0,), 5000.0), SinePoint)
    writer.start_stream(5e3, SCALES)
    raw = np.random.default_rng(1).integers(-30000, 30000, (2, 50_000)).astype(np.int16)
    for start in range(0, size, 50_000):
        writer.append_block(Block(start, raw[:, : min(50_000, size - start)]), 0.0)
    writer.append_recording((0, size), 0, Sine(100.0, 2.5, 2.5, 20))
    writer.close_after_error()
    return lambda: export_runs([writer.path], folder / "out", kind)  # type: ignore[arg-type]


def shape_functions(size: int, _: Path) -> Work:
    from model import Tactor
    from model.response import frequency_response

    f = np.linspace(1, 500, 1000)
    frequency_response(Tactor(), f, n=size)  # the integrals of the geometry, once
    return lambda: [frequency_response(Tactor(), f, n=size) for _ in range(200)]


@dataclass(frozen=True, slots=True)
class Growth:
    """A case, its sizes in a unit, and the exponent that is expected."""

    case: Case
    what: str
    unit: str
    sizes: Sequence[int]
    limit: float = LINEAR


GROWTHS = (
    Growth(sweep_length, "length of a sweep, virtual clock", "s", (30, 100, 300, 900)),
    Growth(dwell_length, "length of a recorded run at 5 kS/s, virtual clock", "min", (2, 6, 20, 60)),
    Growth(dwell_points, "points of a dwell, virtual clock", "points", (10, 30, 100, 300)),
    Growth(channel_count, "channels of a run at 50 kS/s, virtual clock", "channels", (2, 4, 8)),
    Growth(recording_length, "scans of one recording, analysed", "scans", (300_000, 1_000_000, 3_000_000, 10_000_000)),
    Growth(points_of_a_fit, "points per run of a joint fit, 13 runs", "points", (10, 30, 100, 300)),
    Growth(runs_of_a_fit, "runs of a joint fit, 20 points each", "runs", (3, 10, 30, 100)),
    Growth(new_runs, "new runs in a folder, indexed", "runs", (100, 300, 1000, 3000)),
    Growth(known_runs, "known runs, listed", "runs", (1000, 3000, 10_000, 30_000)),
    Growth(specimens, "specimens, compared by the fleet", "specimens", (100, 300, 1000, 3000)),
    Growth(rows_of_csv, "scans of a run, exported as CSV", "scans", (100_000, 300_000, 1_000_000, 3_000_000)),
    Growth(rows_of_mat, "scans of a run, exported as MAT", "scans", (100_000, 300_000, 1_000_000, 3_000_000)),
    Growth(shape_functions, "shape functions of the model, 200 responses", "functions", (7, 14, 28, 56), 3.0),
)
"""Linear work, but for the shape functions: an eigenproblem is of the third order."""


def measure(case: str, size: int) -> dict[str, float]:
    """Processor seconds and largest memory of one size, in a process of its own."""
    command = [sys.executable, __file__, "--case", case, "--size", str(size)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def measure_here(case: str, size: int) -> dict[str, float]:
    (growth,) = (each for each in GROWTHS if each.case.__name__ == case)
    with tempfile.TemporaryDirectory() as folder:
        work = growth.case(size, Path(folder))
        begun = process_time()
        work()
        return {
            "seconds": process_time() - begun,
            "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        }


def exponent(sizes: Sequence[int], costs: Sequence[float]) -> float:
    """Slope of the logarithms over the upper half of the sizes."""
    half = len(sizes) // 2
    return math.log(costs[-1] / costs[-1 - half]) / math.log(sizes[-1] / sizes[-1 - half])


def row(growth: Growth) -> str:
    """Measure a case and return its line of the table."""
    found = [measure(growth.case.__name__, size) for size in growth.sizes]
    power = exponent(growth.sizes, [each["seconds"] for each in found])
    shown = " | ".join(
        f"{size:,}: {each['seconds']:.3g} s, {each['memory_mb']:.0f} MB"
        for size, each in zip(growth.sizes, found, strict=True)
    )
    verdict = "" if round(power, 1) <= growth.limit else f" (expected at most {growth.limit:g})"
    cells = " | ".join(shown.split(" | ") + [""] * (4 - len(found)))
    return f"| {growth.what} ({growth.unit}) | {cells} | {power:.2f}{verdict} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help=f"write {PAGE.name}")
    parser.add_argument("--only", default="", help="names of cases, separated by commas")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    parser.add_argument("--size", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(measure_here(options.case, options.size)))
        return
    rows = []
    for growth in GROWTHS:
        if not options.only or growth.case.__name__ in options.only.split(","):
            rows.append(row(growth))
            print(rows[-1], flush=True)
    if options.write:
        PAGE.write_text(HEAD + "\n".join(rows) + "\n", "utf-8")


HEAD = """# How costs grow

Processor time and largest memory (of the whole process, imports included) over the size of the work. Each size ran in a process of its own; the exponent of the
time refers to the upper half of the sizes: 1 is linear. Times belong to one computer; the exponents should not. `python benchmarks/growth.py --write` makes this page.

| what grows | | | | | exponent |
|---|---|---|---|---|---|
"""


if __name__ == "__main__":
    main()
