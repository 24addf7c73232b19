"""Do the stated errors of every protocol hold? python benchmarks/coverage/error_bars.py [--seeds 200] [--bench same|drawn] [--file FILE] [PROTOCOL ...]

Every protocol runs with short settings on the simulated bench, in this process and on the virtual clock, once per seed.

- `same`: one realistic specimen and one set of instruments; only the noise differs. The scatter of a number over its stated
  statistical error.
- `drawn`: a specimen without creep, hysteresis and sides, whose numbers have closed forms; sensor, amplifier, weights, clock and the membrane's
  reference are drawn anew within their stated uncertainties. Mean and rms of the error over the stated total.

Every run is a line of JSON in FILE; lines that are there are not made again. Without `--seeds` the table of the file is printed. `--page PAGE` replaces the
rows of these protocols in the page; the others stay.
"""

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from app.archive.figures import run_figures
from app.config.bench_file import BenchConfig, load_bench
from app.session.bench_connection import connect
from benchmarks.coverage.plant_truth import true_response, true_values
from protocols.base import Protocol, Quality
from protocols.measurements.electrical import Electrical
from protocols.measurements.endurance import Endurance
from protocols.measurements.free_decay import FreeDecay
from protocols.measurements.hysteresis import Hysteresis
from protocols.measurements.latency import OnsetLatency
from protocols.measurements.mass_resonance import MassResonance
from protocols.measurements.membrane_sag import MembraneSag
from protocols.measurements.membrane_series import MembraneSeries
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.square_dwell import SquareDwell
from protocols.measurements.static_loading import StaticLoading
from protocols.measurements.sweep import Sweep
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runfile.reader import Run
from tests.helpers.electrical.bench import MONITORS, with_inputs
from tests.helpers.simulated_bench import run

SHORT: Mapping[str, Protocol] = {
    "sweep": Sweep(),
    "membrane sag": MembraneSag(repeats=3, settle_s=3.0, density_error_kg_per_m3=0.0, elongation_error_m=0.0),
    "free decay": FreeDecay(edges=6),
    "sine dwell": SineDwell(frequencies_hz=(50, 75, 110, 140, 160, 180, 225)),
    "square dwell": SquareDwell(frequencies_hz=(75, 160)),
    "membrane series": MembraneSeries(frequencies_hz=(75, 130, 160), elongations_m=(0.0, 2.54e-3)),
    "hysteresis": Hysteresis(frequencies_hz=(1.0, 2.0, 5.0)),
    "voltage steps": VoltageSteps(levels_v=(0.5, 1.5, 3.5, 5.0), repeats=2, hold_s=2.0),
    "static loading": StaticLoading(weights_kg=(0.02, 0.1, 0.5), repeats=2),
    "mass resonance": MassResonance(
        masses_kg=(7.75e-3,), start_hz=75.0, stop_hz=325.0, low_hz=100.0, high_hz=300.0, sweep_s=60.0, piece_s=15.0
    ),
    "latency": OnsetLatency(repeats=2, frequencies_hz=(150.0,)),
    "endurance": Endurance(cycles=100, first_cycles=100),
    "electrical": Electrical(frequencies_hz=(20.0, 200.0), drives_v=(5.0,), levels_v=(5.0,), wait_s=1.0, record_s=0.3),
}
"""Short settings of every protocol."""

COARSE_GRID_HZ = 20e3
"""Time grid of the plant for slow protocols; a response at 100 Hz is 2e-5 too large: more modes are beyond this grid."""
FINE_GRID_HZ = 500e3
"""Time grid of the plant for fast responses; with the default grid of 10 µs a response at 500 Hz is 9e-6 too small, its phase 1e-5 rad off."""
MONITOR_HZ = 1e5
"""Corner of the current monitor: with that of `--bench sim`, 20 kHz, the current at 200 Hz is 5e-5 too small."""
BLOCK_S = 0.2
SLOW = ("membrane sag", "hysteresis", "voltage steps", "static loading")
FAST = ("sweep", "sine dwell", "square dwell", "latency")
SAME, DRAWN = "same", "drawn"
BENCHES = (SAME, DRAWN)
SEED = 7
"""Seed of the properties of instruments and weights of the bench `same`."""
SPECIMEN, SPECIMEN_SPREAD = ("k2", "m_add", "c0"), 0.03
WEIGHT_UNCERTAINTY = 3e-5
MIN_SEEDS = 3
BAND = 0.1
"""Largest deviation of scatter / stated from 1, and of the mean error / stated from 0, besides the band of the seeds."""
Row = dict[str, Any]


class Ratio(NamedTuple):
    """A number over the seeds; NaN where it has no such ratio.

    Attributes:
        seeds: number of seeds of the bench `drawn`, or of `same` for a number without a closed form.
        scatter: standard deviation over the rms stated error, bench `same`.
        error: rms error against the truth over the rms stated error, bench `drawn`.
        mean: mean error over the rms stated error, bench `drawn`; of several points or lines the largest.
    """

    protocol: str
    name: str
    seeds: int
    scatter: float
    error: float
    mean: float
    verdict: str


def bench(kind: str, protocol: str, seed: int) -> BenchConfig:
    """Return the bench of a seed."""
    config = load_bench("sim")
    simulation = {**(config.simulation or {}), "fresh_noise": False, "seed": SEED, "noise_seed": seed}
    if protocol in SLOW:
        simulation["plant_rate_hz"] = COARSE_GRID_HZ
    elif protocol in FAST:
        simulation["plant_rate_hz"] = FINE_GRID_HZ
    if kind == DRAWN:
        drawn = np.random.default_rng((20261128, seed)).standard_normal(8)
        simulation |= {
            "seed": seed,
            "beyond": {"weight_error": WEIGHT_UNCERTAINTY, "hum_m": simulation["beyond"]["hum_m"]},
            "sensor": {**simulation["sensor"], "gain_m_per_v": 1e-4, "delay_s": 1e-4},
            "amplifier": {**simulation["amplifier"], "map": {}},
        }
        for name, by in zip(SPECIMEN, drawn, strict=False):
            simulation["tactor"] = {
                **simulation["tactor"],
                name: simulation["tactor"][name] * (1 + SPECIMEN_SPREAD * by),
            }
        sag = MembraneSag()
        lengths = sag.length_m + sag.length_error_m * drawn[3], sag.thickness_m + sag.thickness_error_m * drawn[4]
        simulation["membrane"] = {**simulation["membrane"], "L_m": lengths[0], "b_m": sag.width_m, "h_m": lengths[1]}
        simulation["hands"] = {**simulation["hands"], "reference_m": sag.reference_error_m * drawn[5]}
    config = config.model_copy(update={"simulation": simulation})
    if not SHORT[protocol].input_kinds:
        return config
    amplifier = config.simulation_parameters.amplifier
    simulation["amplifier"] |= {"current_monitor_zero_v": 0.0, "current_monitor_hz": MONITOR_HZ}
    delay_s = amplifier.current_monitor_delay_s + 1 / (2 * math.pi * MONITOR_HZ)
    exact = {"gain_relative_uncertainty": 0.0, "delay_s": delay_s, "delay_uncertainty_s": 0.0}  # as of the sensor
    return with_inputs(config, MONITORS[0], MONITORS[1] | exact)


def measure(kind: str, name: str, seed: int) -> Row:
    """Return the reported numbers of one run: name, value, statistical and total error, truth (NaN: no closed form)."""
    protocol, config = SHORT[name], bench(kind, name, seed)
    with connect(config, block_s=BLOCK_S) as lab, tempfile.TemporaryDirectory() as folder:
        lab.bench.clock.sleep(float(np.random.default_rng((seed, 1)).uniform()))  # the phase of the hum
        ran = run(protocol, Path(folder), lab)
        with Run(ran.path) as file:
            figures, series = run_figures(file.record), file.series()
    truth = true_values(protocol, config.simulation_parameters, ran.points) if kind == DRAWN else {}
    numbers = [[f.name, f.value, f.statistical] for f in figures if f.statistical > 0]
    for i, point in enumerate(ran.points):
        if not Quality(point.quality).usable:
            continue
        for column in (f.name for f in fields(point) if hasattr(point, f"{f.name}_errors")):
            value, error = (float(getattr(point, each)) for each in (column, f"{column}_errors"))
            numbers.append([f"point {column} #{i}", value, error])
    for line in (each for each in series if np.iscomplexobj(each.y) and each.errors is not None):
        true = true_response(config.simulation_parameters, line.x, ran.points) if kind == DRAWN else line.y * math.nan
        columns = (np.asarray(each).tolist() for each in (line.y, line.errors, true))
        for i, (y, e, t) in enumerate(zip(*columns, strict=True)):
            numbers += [[f"line, real #{i}", y.real, e], [f"line, imaginary #{i}", y.imag, e]]
            truth |= {f"line, real #{i}": t.real, f"line, imaginary #{i}": t.imag}
    return {
        "bench": kind,
        "protocol": name,
        "seed": seed,
        "numbers": [[*n, truth.get(n[0], math.nan)] for n in numbers if all(map(math.isfinite, n[1:]))],
    }


def ratios(rows: Sequence[Row]) -> list[Ratio]:
    """Return scatter and mean error over the stated ones, of every number; numbers of points and lines are pooled."""
    found: dict[tuple[str, str], dict[str, dict[str, list[list[float]]]]] = {}
    for row in rows:
        for name, *values in row["numbers"]:
            group, _, item = name.partition(" #")
            kinds = found.setdefault((row["protocol"], group), {SAME: {}, DRAWN: {}})
            kinds[row["bench"]].setdefault(item, []).append(values)
    return [_ratio(protocol, name, kinds) for (protocol, name), kinds in found.items()]


def _ratio(protocol: str, name: str, kinds: Mapping[str, Mapping[str, list[list[float]]]]) -> Ratio:
    scatters, errors, means = [], [], []
    seeds = dict.fromkeys(BENCHES, 0)
    for kind, items in kinds.items():
        for values in items.values():
            value, stated, truth = np.array(values).T
            square = float(np.mean(stated**2))
            if value.size < MIN_SEEDS or (kind == DRAWN and not np.isfinite(truth).all()):
                continue
            seeds[kind] = max(seeds[kind], value.size)
            if kind == SAME:
                scatters.append(float(value.var(ddof=1)) / square)
            else:
                errors.append(float(np.mean((value - truth) ** 2)) / square)
                means.append(float(np.mean(value - truth)) / math.sqrt(square))
    scatter, error = (math.sqrt(np.mean(each)) if each else math.nan for each in (scatters, errors))
    mean = max(means, key=abs) if means else math.nan
    decisive = (error, seeds[DRAWN]) if means else (scatter, seeds[SAME])
    verdict = _verdict(*decisive, mean, len(means))
    if means and seeds[SAME] and scatter > band(seeds[SAME])[1]:
        verdict = f"{verdict}, but narrow on one specimen"
    return Ratio(protocol, name, decisive[1], scatter, error, mean, verdict)


def band(seeds: int) -> tuple[float, float]:
    """Return the limits of scatter / stated: 0.9 to 1.1, widened by the 99.7 % band of chi-square of the seeds."""
    from scipy.stats import chi2

    low, high = (math.sqrt(chi2.ppf(p, seeds - 1) / (seeds - 1)) for p in (0.00135, 0.99865))
    return (1 - BAND) * low, (1 + BAND) * high


def mean_limit(seeds: int, numbers: int) -> float:
    """Return the largest mean error / stated of one of `numbers`: three standard errors for a single one, and a tenth."""
    from scipy.stats import norm

    return float(-norm.ppf(0.00135 / numbers)) / math.sqrt(seeds) + BAND


def _verdict(ratio: float, seeds: int, mean: float, numbers: int) -> str:
    if seeds < MIN_SEEDS:
        return "–"
    low, high = band(seeds)
    words = ["wide"] if ratio < low else ["narrow"] if ratio > high else []
    if numbers and abs(mean) > mean_limit(seeds, numbers):
        words.append("biased")
    return ", ".join(words) or "holds"


def table(rows: Sequence[Row]) -> str:
    """Return the table in Markdown."""
    lines = [
        "| protocol | number | seeds | error / stated | mean error / stated | scatter / stated, one specimen | band | verdict |",
        "|---|---|---|---|---|---|---|---|",
    ]

    def shown(x: float, form: str) -> str:
        return format(x, form) if math.isfinite(x) else "–"

    for r in ratios(rows):
        if r.seeds:
            low, high = band(r.seeds)
            numbers = f"{shown(r.error, '.2f')} | {shown(r.mean, '+.2f')} | {shown(r.scatter, '.2f')}"
            lines.append(f"| {r.protocol} | {r.name} | {r.seeds} | {numbers} | {low:.2f}–{high:.2f} | {r.verdict} |")
    return "\n".join(lines)


def merged(page: str, new: str) -> str:
    """Return the table of a page with the rows of the protocols of `new` replaced; the others stay."""
    old = [line for line in page.splitlines() if line.startswith("|")]
    groups: dict[str, list[str]] = {}
    for lines in (old[2:], new.splitlines()[2:]):
        fresh: dict[str, list[str]] = {}
        for line in lines:
            fresh.setdefault(line.split("|")[1], []).append(line)
        groups |= fresh
    return "\n".join((*old[:2], *(line for lines in groups.values() for line in lines)))


HEAD = """# Stated errors against scatter and truth

Written by `python benchmarks/coverage/error_bars.py --page docs/error-bars.md` from runs of the simulated bench on the virtual clock, one seed a run, with short settings of every protocol.

- **error / stated**: rms error against the plant's closed form over the stated statistical error. A specimen without creep, hysteresis and sides; its `k2`, `m_add` and `c0` vary by 3 % from seed
  to seed, weights, membrane and reference by their stated uncertainties, the noise and the phase of the hum freely. Gain and delay of the sensor are exact: their errors are common to all numbers.
- **mean error / stated**: of several points or lines the largest; the limit is 3 standard errors of the mean and 0.1, with the number of points and lines counted.
- **scatter / stated, one specimen**: standard deviation under noise alone, with creep, hysteresis, sides and instruments of `--bench sim` unchanged. Below 1 where the stated error contains what every
  seed has alike: the misfit of a line or of one mode by hysteresis, a zero that has not crept back, distortions that repeat with a sweep. It decides for numbers without a closed form.
- **band**: 0.9 to 1.1, widened by the 99.7 % band of chi-square of the seeds. *wide*, *narrow*: below, above it; *biased*: mean error beyond its limit.

*point* and *line* are columns of points and lines of a response, pooled. The simulated plant has a time grid of 2 µs for sweep, dwells and latency, 50 µs for slow protocols, and 10 µs, that of `--bench sim`, otherwise.

"""


NOTES = """
## Causes of rows that deviate

- **latency**: an edge of 0.28 ms hides what rings faster; the times after a step state 0.75 % of the edge for that, which the modes of this plant do not use up. Where the last swing of a sine
  only grazes the band, its settling time jumps by half a period with the noise.
- **linear_young_modulus, sag, E_m**: the stated error has the reference and the geometry, which are the same at every seed of one specimen.
- **mass resonance**: a piece longer than an octave has the amplifier's second harmonic in the upper part of its spectrum, and `spectrum_peak` moves by up to 0.2 Hz; the pieces of the protocol's
  default and of these settings are shorter.
- **static loading on one specimen**: the weight of a point changes with what its zero moves beyond its creep, which earlier weights add to; likely, not traced further.
- **hysteresis**: the area at 1 Hz has the creep over the cycles, which every seed has alike.
- **electrical**: the energy's rest is 4e-5 at 200 Hz, about what the plant's grid of 10 µs leaves out near the resonance (3e-5). Its estimates have total uncertainties; gains and delays are exact on these benches.
- **endurance** has the bench `same` only, without monitors. Capacitance and loss are those of **electrical**.
- **membrane sag, free decay, voltage steps, static loading, latency**: rows of runs before errors were enlarged by significant scatter only. Of static loading on one specimen, 40 seeds since: 1.34 (MFC up) and 0.99 (aluminium up).
- **interference_at_rest** has no closed form, because the largest line is chosen.
"""


def main() -> None:
    """Measure what the file does not have, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("protocols", nargs="*", default=list(SHORT), metavar="PROTOCOL")
    parser.add_argument("--seeds", type=int, default=0)
    parser.add_argument("--bench", choices=BENCHES, nargs="*", default=BENCHES)
    parser.add_argument("--page", type=Path, help="write the table as a page instead of printing it")
    parser.add_argument("--file", type=Path, default=Path("error_bars.jsonl"))
    args = parser.parse_args()
    rows = [json.loads(line) for line in args.file.read_text("utf-8").splitlines()] if args.file.exists() else []
    done = {(r["bench"], r["protocol"], r["seed"]) for r in rows}
    with args.file.open("a", encoding="utf-8") as file:
        for seed in range(1, args.seeds + 1):
            for kind in args.bench:
                for name in args.protocols:
                    if (kind, name, seed) not in done:
                        rows.append(measure(kind, name, seed))
                        file.write(json.dumps(rows[-1]) + "\n")
                        file.flush()
    text = table([r for r in rows if r["protocol"] in args.protocols])
    if args.page is None:
        print(text)
    else:
        args.page.write_text(HEAD + merged(args.page.read_text("utf-8"), text) + "\n" + NOTES, encoding="utf-8")


if __name__ == "__main__":
    main()
