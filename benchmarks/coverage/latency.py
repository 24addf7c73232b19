"""Coverage of the protocol `latency`: runs over seeds on a simulated bench against the plant's own latency under ideal drives.

    python benchmarks/coverage/latency.py ideal 12
    python benchmarks/coverage/latency.py realistic 12
    python benchmarks/coverage/latency.py ideal 4 --skin       on a skin of 30 kN/m² and 600 kg/(m s)

Prints for each quantity the bias, the mean total standard uncertainty, the rms of (measured - true) / uncertainty, and the share within two.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from app.archive.figures import run_figures
from app.config.bench_file import load_bench
from protocols.measurements.latency import OnsetLatency
from protocols.runfile.reader import Run
from tests.helpers.latency_truth import true_sine, true_step
from tests.helpers.simulated_bench import laboratory, run

FREQUENCIES_HZ = (100.0, 150.0, 250.0)
FIELDS = {"latency to 50 µm": "latency", "rise": "rise", "overshoot": "overshoot", "settling": "settling"}
SKIN = {"k_s": 3e4, "c_s": 600.0}


def main(bench: str, seeds: int, on_skin: bool) -> None:
    """Measure with each seed and print the table."""
    differences: dict[str, list[tuple[float, float]]] = {}
    truth = {}
    for seed in range(1, seeds + 1):
        config = load_bench(bench)
        changed = {
            **(config.simulation or {}),
            "seed": seed,
            "fresh_noise": False,
            **({"skin": SKIN} if on_skin else {}),
        }
        config = config.model_copy(update={"simulation": changed})
        if not truth:
            parameters = config.simulation_parameters
            truth = {"after a step to 5 V": true_step(parameters, 5.0, before=2)}
            truth |= {f"from the onset of {f:g} Hz": true_sine(parameters, f) for f in FREQUENCIES_HZ}
        with laboratory(config) as lab, tempfile.TemporaryDirectory() as folder:
            ran = run(OnsetLatency(repeats=3, frequencies_hz=FREQUENCIES_HZ), Path(folder), lab)
            with Run(ran.path) as file:
                figures = run_figures(file.record)
        for figure in figures:
            name, _, onset = figure.name.partition(", ")
            if name in FIELDS:
                true = getattr(truth[onset], FIELDS[name])
                differences.setdefault(figure.name, []).append((figure.value - true, figure.total))
    for name, pairs in differences.items():
        off, total = np.array(pairs).T
        pull = off / total
        print(
            f"{name:42s} bias {off.mean():+.2g}  uncertainty {total.mean():.2g}  rms pull {np.sqrt(np.mean(pull**2)):.2f}  "
            f"within 2: {np.mean(np.abs(pull) < 2):.2f}"
        )


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), "--skin" in sys.argv)
