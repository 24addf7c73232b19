"""Regression guard: short benchmarks whose ratios are compared with a committed table, benchmarks/ratios.toml.

    python benchmarks/regression.py [--json] [--update]

Each case is this program's processor time divided by that of a named reference, in turn in one run, so that the computer and its
load cancel. A ratio above `ALLOWED` times that of the table ends with exit code 1: something became several times slower.
`--update` writes the table anew.
"""

import argparse
import json
import os
import sqlite3
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from statistics import median
from time import process_time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program does, before numpy is imported
sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from io import BytesIO, StringIO

import h5py
import numpy as np
from bench_campaign import sweep
from bench_model import eig_and_residues
from bench_runfile import PlainWriter
from bench_signals import scipys
from bench_sine import ORDERS, written_out
from campaigns import SHARED, Noise, World, perfect
from reportlab.pdfgen.canvas import Canvas
from scipy.signal import butter, sosfilt

from app.archive.catalogue import Catalogue
from app.archive.importing import read_table
from app.plotting.panels import PlotPanel, ReportPlot, draw_plot, new_figure
from app.report.document import WIDTH_IN
from app.report.drawings import draw_report_plot
from drivers.interfaces import Block
from model import Band, Series
from model.identification import joint_fit
from model.parameters import Tactor
from model.response.harmonic_response import frequency_response, system_matrices, tactor_modal_form
from protocols.measurements.sine_dwell import SinePoint
from protocols.runfile.reader import Run
from protocols.runfile.writer import RunFileWriter
from protocols.signals import fit_sine
from protocols.signals.swept_response import estimate_swept_response
from tests.helpers.model.redrawn import resample
from tests.helpers.run_files import SCALES, finished_run, initial_record
from tests.helpers.sampled import march

TABLE = Path(__file__).with_name("ratios.toml")
ALLOWED = 2.5
"""How many times its ratio of the table a case may need: ratios of one computer scatter by tenths under load, other processors differ more."""

HEAD = """# Processor time of this program divided by that of a reference, as `python benchmarks/regression.py --update` measured it.
# The deep tests fail where a ratio is more than 2.5 times as large.

"""

Pair = tuple[Callable[[], object], Callable[[], object]]
"""This program's way and the reference."""


@contextmanager
def response_of_the_model(_: Path) -> Iterator[Pair]:
    """One set at 1000 frequencies, against numpy's eig with residues."""
    f, tactor = np.linspace(1, 500, 1000), Tactor()

    def reference() -> object:
        return [eig_and_residues(system_matrices(tactor), f) for _ in range(50)]

    yield lambda: [frequency_response(tactor, f) for _ in range(50)], reference


@contextmanager
def joint_fit_of_a_campaign(_: Path) -> Iterator[Pair]:
    """Against 300 responses of the model at 100 frequencies."""
    measured, _ = resample(perfect(World(), Noise(), SHARED), np.random.default_rng(1))
    f, tactor = np.linspace(1, 500, 100), Tactor()
    yield lambda: joint_fit(measured), lambda: [frequency_response(tactor, f) for _ in range(300)]


@contextmanager
def sine_fit(_: Path) -> Iterator[Pair]:
    """Eight harmonics in 6 s at 50 kS/s, against the normal equations written out."""
    t = np.arange(300_000) / 5e4
    moved = 5e-4 * np.sin(2 * np.pi * 155.3 * t - 1.2) + 1e-8 * np.random.default_rng(1).standard_normal(t.size)
    yield lambda: fit_sine(moved, 5e4, 155.3, ORDERS), lambda: written_out(moved, 5e4, 155.3)


@contextmanager
def response_of_a_sweep(_: Path) -> Iterator[Pair]:
    """60 s at 5 kS/s with error bars, against scipy's welch, welch and csd."""
    t = np.arange(300_000) / 5e3
    drive = 2.5 + 2.5 * np.sin(2 * np.pi * (25 * t + 500 / 120 * t * t))
    moved = march(tactor_modal_form(Tactor()), drive, 5e3)
    yield lambda: estimate_swept_response(drive, moved, 5e3, (25.0, 525.0)), lambda: scipys(drive, moved)


@contextmanager
def writing_of_blocks(folder: Path) -> Iterator[Pair]:
    """50 ms at 250 kS/s, against h5py in SWMR mode with a flush and the same datasets."""
    raw = np.random.default_rng(1).integers(-30000, 30000, (2, 12_500)).astype(np.int16)
    ours, plain = (
        RunFileWriter.new(folder, initial_record("blocks", (100.0,), 5000.0), SinePoint),
        PlainWriter(folder / "plain.h5"),
    )
    ours.start_stream(250e3, SCALES)
    written = {"ours": 0, "plain": 0}

    def append(writer: RunFileWriter | PlainWriter, name: str) -> None:
        for _ in range(60):
            writer.append_block(Block(written[name] * 12_500, raw), 0.0)
            written[name] += 1

    try:
        yield lambda: append(ours, "ours"), lambda: append(plain, "plain")
    finally:
        plain.close()
        ours.close_after_error()


@contextmanager
def reading_in_units(folder: Path) -> Iterator[Pair]:
    """300 s of 5 kS/s, against h5py times a gain."""
    writer = RunFileWriter.new(folder, initial_record("sweep", (100.0,), 5000.0), SinePoint)
    writer.start_stream(5e3, SCALES)
    raw = np.random.default_rng(1).integers(-30000, 30000, (2, 1_500_000)).astype(np.int16)
    for start in range(0, raw.shape[1], 5000):
        writer.append_block(Block(start, raw[:, start : start + 5000]), 0.0)
    writer.close_after_error()
    with Run(writer.path) as run, h5py.File(writer.path, "r", libver="latest", locking=False) as file:
        names = ("drive", "displacement")
        gains = [float(file[f"entry/trace/{name}_scaling_factor"][()]) for name in names]
        yield (
            lambda: (run.trace.drive_v(), run.trace.displacement_m()),
            lambda: [file[f"entry/trace/{name}"][:] * gain for name, gain in zip(names, gains, strict=True)],
        )


@contextmanager
def index_of_new_runs(folder: Path) -> Iterator[Pair]:
    """40 files, against h5py opening and closing each."""
    runs = folder / "runs"
    paths = [finished_run(runs, f"T{i}") for i in range(40)]
    count = iter(range(1000))
    yield (
        lambda: Catalogue(runs, folder / f"index-{next(count)}.sqlite").scan(),
        lambda: [h5py.File(path, "r", locking=False).close() for path in paths],
    )


@contextmanager
def import_of_a_table(folder: Path) -> Iterator[Pair]:
    """100,000 rows of three columns of text, against numpy.loadtxt."""
    path = folder / "long.csv"
    t = np.arange(100_000) / 5e3
    with path.open("w") as file:
        file.write("time [s],drive [V],displacement [um]\n")
        np.savetxt(file, np.column_stack((t, 2.5 + 2.4 * np.sin(600 * t), 100 * np.sin(600 * t))), "%.9g", ",")
    yield lambda: read_table(path), lambda: np.loadtxt(path, delimiter=",", skiprows=1)


@contextmanager
def sweep_on_the_virtual_clock(_: Path) -> Iterator[Pair]:
    """A run of 20 s on the ideal bench, against scipy's sosfilt of four sections over as many steps of the plant's grid."""
    sections, drive = butter(8, 0.01, output="sos"), np.random.default_rng(1).standard_normal(100_000)
    yield lambda: sweep(20.0), lambda: [sosfilt(sections, drive) for _ in range(20)]


@contextmanager
def realistic_bench(_: Path) -> Iterator[Pair]:
    """The same run on the realistic bench, against the ideal one."""
    yield lambda: sweep(20.0, "sim"), lambda: sweep(20.0)


@contextmanager
def list_of_known_runs(folder: Path) -> Iterator[Pair]:
    """3000 runs, against SQLite reading ten times the paths alone."""
    known = Catalogue(folder / "runs", folder / "index.sqlite")
    finished_run(folder / "runs", "T1")
    known.scan()
    (one,) = known.entries()
    known.upsert([one._replace(path=f"{i:06d}.h5") for i in range(3000)])
    with closing(sqlite3.connect(known.index)) as db:
        yield known.entries, lambda: [db.execute("SELECT path FROM runs").fetchall() for _ in range(10)]


@contextmanager
def figure_of_a_report(_: Path) -> Iterator[Pair]:
    """Drawn for PDF and HTML, against matplotlib's SVG of the same figure."""
    x = np.linspace(0, 250, 100)
    y = np.sin(x / 40)
    curve = Series(x, y, band=Band(y - 0.1, y + 0.1), label="model")
    dots = Series(x[::5], y[::5], np.full(20, 0.025), label="measured")
    plot = ReportPlot("a plot", (PlotPanel("(a)", "frequency (Hz)", "displacement (µm)", (curve,), (dots,)),))

    def ours() -> None:
        canvas = Canvas(BytesIO(), invariant=1)
        draw_report_plot(plot).paint(canvas)
        canvas.save()

    def reference() -> None:
        figure = new_figure(figsize=(WIDTH_IN, 2.5))
        draw_plot(figure, plot, (0.0, 0.0, WIDTH_IN, 2.5))
        figure.savefig(StringIO(), format="svg")

    yield ours, reference


CASES = (
    response_of_the_model,
    joint_fit_of_a_campaign,
    sine_fit,
    response_of_a_sweep,
    writing_of_blocks,
    reading_in_units,
    index_of_new_runs,
    import_of_a_table,
    list_of_known_runs,
    figure_of_a_report,
    sweep_on_the_virtual_clock,
    realistic_bench,
)


def processor_s(call: Callable[[], object]) -> float:
    begun = process_time()
    call()
    return process_time() - begun


def ratios(rounds: int = 3) -> dict[str, float]:
    """Each case's processor time over that of its reference: the median of rounds in which both take turns."""
    found = {}
    for case in CASES:
        with tempfile.TemporaryDirectory() as folder, case(Path(folder)) as (ours, reference):
            ours(), reference()  # imports, caches
            found[case.__name__] = median(processor_s(ours) / processor_s(reference) for _ in range(rounds))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--update", action="store_true", help="write the table anew")
    options = parser.parse_args()
    found = ratios(7 if options.update else 3)
    if options.update:
        TABLE.write_text(HEAD + "".join(f"{name} = {ratio:.2g}\n" for name, ratio in found.items()), "utf-8")
    table = tomllib.loads(TABLE.read_text("utf-8"))
    slower = [name for name, ratio in found.items() if ratio > ALLOWED * table[name]]
    if options.json:
        print(json.dumps({"ratios": found, "table": table, "slower": slower}))
    else:
        for case in CASES:
            mark = f"  MORE THAN {ALLOWED:g} TIMES THE TABLE" if case.__name__ in slower else ""
            print(
                f"{case.__name__:26s} {found[case.__name__]:8.3g} (table {table[case.__name__]:g}){mark}   {case.__doc__}"
            )
    return 1 if slower else 0


if __name__ == "__main__":
    sys.exit(main())
