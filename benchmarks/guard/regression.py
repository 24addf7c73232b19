"""Regression guard: short benchmarks whose ratios are compared with a committed table, benchmarks/guard/ratios.toml.

    python benchmarks/guard/regression.py [--json] [--update] [--only CASE] [--plant MODULE:FUNCTION]

Each case is the least processor time of this program divided by the least of a named reference, which is never this program, over
rounds in which both take turns in one run, so that the computer and its load cancel. A ratio above `ALLOWED` times that of the
table is measured once more; if it is above again, the exit code is 1. The table has a part for each set of installed extras that
change a ratio. `--update` writes the part of this computer anew. `--plant` makes a function 1.5 times slower: see
benchmarks/guard/planted_slowness.py.
"""

import argparse
import functools
import importlib
import importlib.util
import json
import os
import resource
import sqlite3
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from pathlib import Path
from time import process_time, thread_time
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program does, before numpy is imported
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from io import BytesIO, StringIO

import h5py
import numpy as np
import tomlkit
from bench_campaign import sweep
from bench_model import eig_and_residues
from bench_report import REFERENCE as PAGES
from bench_runfile import PlainWriter
from bench_signals import scipys
from bench_sine import ORDERS, written_out
from bench_startup import BARE, OURS
from bench_startup import LIBRARIES as WINDOW_LIBRARIES
from campaigns import SHARED, Noise, World, perfect
from reportlab.pdfgen.canvas import Canvas
from scipy.signal import butter, lfilter, sosfilt

from app.archive.catalogue import Catalogue
from app.archive.importing import read_table
from app.plotting.panels import PlotPanel, ReportPlot, draw_plot, new_figure
from app.report.document import WIDTH_IN
from app.report.drawings import draw_report_plot
from drivers.drive_shapes import LinearSweep
from drivers.interfaces import Block
from model import Band, Series
from model.identification import joint_fit
from model.parameters import Tactor
from model.response.harmonic_response import frequency_response, system_matrices, tactor_modal_form
from protocols.base import Quality, Recording
from protocols.measurements.sine_dwell import SinePoint
from protocols.runfile.reader import Run
from protocols.runfile.writer import RunFileWriter
from protocols.signals import fit_sine, judge_recording
from protocols.signals.swept_response import estimate_swept_response
from tests.helpers.model.redrawn import resample
from tests.helpers.run_files import SCALES, finished_run, initial_record
from tests.helpers.sampled import march

ROOT = Path(__file__).resolve().parents[2]
TABLE = Path(__file__).with_name("ratios.toml")
ALLOWED = 1.3
"""How many times its ratio of the table a case may need, on the kind of computer that the table was measured on."""

ROUNDS = 9
"""Rounds of a case; of one of whole processes a third."""

PLANTED = 1.5
"""How many times slower `--plant` makes a function."""

HEAD = """# Least processor time of this program relative to a reference, measured by `python benchmarks/guard/regression.py --update`
# for each set of installed extras.
"""

EXTRAS = {"cluster": "distributed", "formats": "pyarrow"}
"""Extras that change a ratio, with a module of each."""

Pair = tuple[Callable[[], object], Callable[[], object]]
"""This program's way and the reference."""

LIBRARIES = "import numpy, scipy.optimize, scipy.signal, h5py"


def process(*words: str) -> Callable[[], object]:
    """Return the call that runs Python with these arguments, from the folder of the program."""
    environment = {"QT_QPA_PLATFORM": "offscreen", **os.environ, "PYTHONPATH": str(ROOT)}
    return lambda: subprocess.run(
        [sys.executable, *words],
        cwd=ROOT,
        env=environment,
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def command(*words: str) -> Callable[[], object]:
    """Return the call that runs a command of this program; a function planted here is planted there."""
    plant = (
        f"from benchmarks.guard.regression import plant; plant({sys.argv[sys.argv.index('--plant') + 1]!r});"
        if "--plant" in sys.argv
        else ""
    )
    return process(
        "-c",
        f"import sys; sys.argv = ['tactor-bench', *{list(words)!r}]; {plant} from app.cli.main import entry; entry()",
    )


@contextmanager
def response_of_the_model(_: Path) -> Iterator[Pair]:
    """One set at 1000 frequencies, against numpy's eig with residues."""
    f, tactor = np.linspace(1, 500, 1000), Tactor()

    matrices = system_matrices(tactor)

    def reference() -> object:
        return [eig_and_residues(matrices, f) for _ in range(50)]

    yield lambda: [frequency_response(tactor, f) for _ in range(50)], reference


@contextmanager
def joint_fit_of_a_campaign(_: Path) -> Iterator[Pair]:
    """Against 100 responses at 100 frequencies by numpy's eig with residues."""
    measured, _ = resample(perfect(World(), Noise(), SHARED), np.random.default_rng(1))
    f, matrices = np.linspace(1, 500, 100), system_matrices(Tactor())
    yield lambda: joint_fit(measured), lambda: [eig_and_residues(matrices, f) for _ in range(100)]


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
    """The same run on the realistic bench, against the same filter."""
    sections, drive = butter(8, 0.01, output="sos"), np.random.default_rng(1).standard_normal(100_000)
    yield lambda: sweep(20.0, "sim"), lambda: [sosfilt(sections, drive) for _ in range(20)]


@contextmanager
def judgement_of_a_recording(_: Path) -> Iterator[Pair]:
    """20 s of 5 kS/s, against scipy's filter of 24 coefficients three times over the same samples, twenty times."""
    t = np.arange(100_000) / 5e3
    drive = 2.5 + 2 * np.sin(2 * np.pi * (20 * t + 5 * t * t))
    moved = 1e-4 * np.sin(2 * np.pi * (20 * t + 5 * t * t) + 1) + 1e-8 * np.random.default_rng(1).standard_normal(
        t.size
    )
    recording = Recording(0, (0, t.size), 5e3, LinearSweep(20.0, 220.0, 20.0, 2.0, 2.5), drive, moved, Quality.GOOD)
    coefficients = np.linspace(0, 1, 24)
    yield lambda: judge_recording(recording), lambda: [lfilter(coefficients, 1.0, moved) for _ in range(60)]


@contextmanager
def opening_of_a_run(folder: Path) -> Iterator[Pair]:
    """Fifty times one that was found in order, against h5py opening and closing it."""
    path = finished_run(folder, "T1")
    yield (
        lambda: [Run(path).close() for _ in range(50)],
        lambda: [h5py.File(path, "r", locking=False).close() for _ in range(50)],
    )


@contextmanager
def start_of_a_command(_: Path) -> Iterator[Pair]:
    """`run --help` in a process of its own, against Python importing numpy."""
    yield command("run", "--help"), process("-c", "import numpy")


@contextmanager
def list_by_the_command(folder: Path) -> Iterator[Pair]:
    """`runs` of 20 known runs, against Python importing numpy, scipy and h5py."""
    for i in range(20):
        finished_run(folder, f"T{i}")
    yield command("runs", str(folder)), process("-c", LIBRARIES)


@contextmanager
def run_by_the_command(folder: Path) -> Iterator[Pair]:
    """A dwell of 25 points on the virtual clock, against Python importing numpy, scipy and h5py."""
    frequencies = "frequencies_hz=60...240 step 7.5"
    words = ("run", "sine-dwell", "--bench", "sim", "--speed", "max", "--out", str(folder), "--set", frequencies)
    yield command(*words), process("-c", LIBRARIES)


@contextmanager
def identification_by_the_command(folder: Path) -> Iterator[Pair]:
    """`identify` of one dwell, against Python importing numpy, scipy and h5py."""
    made = dwell_in(folder)
    yield command("identify", made), process("-c", LIBRARIES)


@contextmanager
def report_by_the_command(folder: Path) -> Iterator[Pair]:
    """Two pages of one dwell, against matplotlib drawing two pages."""
    dwell_in(folder)
    yield (
        command("report", "unnamed", "--folder", str(folder), "--out", str(folder / "report")),
        process("-c", PAGES, "2"),
    )


def dwell_in(folder: Path) -> str:
    """Measure a dwell, and return its file."""
    words = ("run", "sine-dwell", "--bench", "sim", "--speed", "max", "--out", str(folder))
    command(*words, "--set", "frequencies_hz=60...240 step 15")()
    return str(next(folder.glob("*.h5")))


@contextmanager
def first_paint(_: Path) -> Iterator[Pair]:
    """A start without a bench, against a bare window of pyqtgraph with the same libraries."""
    yield process("-c", OURS), process("-c", WINDOW_LIBRARIES + BARE)


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
    judgement_of_a_recording,
    opening_of_a_run,
)

COMMANDS = (
    start_of_a_command,
    list_by_the_command,
    run_by_the_command,
    identification_by_the_command,
    report_by_the_command,
    first_paint,
)
"""Cases of whole processes."""


def processor_s(call: Callable[[], object]) -> float:
    """Processor time of a call, with that of the processes that it started and that have ended."""
    begun, before = process_time(), resource.getrusage(resource.RUSAGE_CHILDREN)
    call()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return process_time() - begun + after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(case: Callable[[Path], AbstractContextManager[Pair]], rounds: int) -> float:
    """Return the least processor time of the program over the least of the reference: load only adds to both."""
    with tempfile.TemporaryDirectory() as folder, case(Path(folder)) as (ours, reference):
        ours(), reference()  # imports, caches
        both = [(processor_s(ours), processor_s(reference)) for _ in range(rounds)]
    return min(a for a, _ in both) / min(b for _, b in both)


def plant(place: str, factor: float = PLANTED) -> None:
    """Make a function or method `MODULE:NAME` `factor` times slower, wherever a module of the program has its name."""
    module, _, name = place.partition(":")
    owner: Any = importlib.import_module(module)
    *path, last = name.split(".")
    for part in path:
        owner = getattr(owner, part)
    planted = vars(owner)[last]

    @functools.wraps(planted)
    def slower(*given: Any, **named: Any) -> Any:
        begun = thread_time()
        result = planted(*given, **named)
        until = thread_time() + (factor - 1) * (thread_time() - begun)
        while thread_time() < until:
            pass
        return result

    setattr(owner, last, slower)
    for each in list(sys.modules.values()):
        if not path and getattr(each, last, None) is planted:
            setattr(each, last, slower)


def extras() -> str:
    """Return the name of the table's part: the installed extras."""
    return "+".join(name for name, module in EXTRAS.items() if importlib.util.find_spec(module)) or "none"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--update", action="store_true", help="write this computer's part of the table anew")
    parser.add_argument("--only", action="append", help="only this case; may be repeated", metavar="CASE")
    parser.add_argument("--plant", help="make this function slower", metavar="MODULE:FUNCTION")
    parser.add_argument("--allowed", type=float, default=ALLOWED, help="bound (default: %(default)s)")
    options = parser.parse_args()
    if options.plant:
        plant(options.plant)
    tables = tomllib.loads(TABLE.read_text("utf-8"))
    table, found, slower = tables.get(extras(), {}), {}, []
    missing: list[str] = []
    for case in (*CASES, *COMMANDS):
        name, rounds = case.__name__, ROUNDS // 3 if case in COMMANDS else ROUNDS
        if options.only and name not in options.only:
            continue
        if not options.update and name not in table:
            missing.append(name)
            continue
        found[name] = measure(case, rounds)
        if not options.update and found[name] > options.allowed * table[name]:
            found[name] = min(found[name], measure(case, rounds))
            slower += [name] if found[name] > options.allowed * table[name] else []
        if options.update:
            tables.setdefault(extras(), {})[name] = float(f"{found[name]:.3g}")
            TABLE.write_text(HEAD + tomlkit.dumps(tables), "utf-8")
        if not options.json:
            mark = f"  MORE THAN {options.allowed:g} TIMES THE TABLE" if name in slower else ""
            print(f"{name:30s} {found[name]:8.3g} (table {table.get(name, 0):g}){mark}   {case.__doc__}", flush=True)
    if options.json:
        print(json.dumps({"ratios": found, "table": table, "slower": slower}))
    if missing:
        print(f"{TABLE.name} has no {', '.join(missing)} of the extras '{extras()}': --update them", file=sys.stderr)
    return 1 if slower else 2 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
