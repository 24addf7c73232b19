"""Coverage of the protocol `electrical`: specimens and monitors drawn anew, measured on the simulated bench, against their parameters.

    python benchmarks/coverage/electrical.py 100 electrical.jsonl

Capacitance, loss, leakage, bending and its coupling of the specimen are drawn, gains and delay of the monitors within their stated
uncertainties, and the current monitor's offset. Prints for each quantity the share of the total 95 % intervals that hold the truth.
Each specimen is a line of JSON in the file; those that are there are not measured again.
"""

import json
import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from app.config.bench_file import BenchConfig
from protocols.base import RunStatus
from protocols.measurements.electrical import Electrical
from sim_hardware.plant.parameters import SimulationParameters
from tests.helpers.electrical.bench import MONITORS, with_inputs
from tests.helpers.electrical.truth import true_capacitance, true_energy, true_loss
from tests.helpers.simulated_bench import laboratory, run, simulated

PROTOCOL = Electrical(frequencies_hz=(20, 150, 400), drives_v=(5.0,), levels_v=(5.0,), wait_s=1.0, record_s=0.3)
GAIN, DELAY_S, V_GAIN = 0.005, 2e-6, 0.003
"""Stated relative uncertainty of the current monitor's gain, uncertainty of its delay, of the voltage monitor's gain."""


def drawn_bench(seed: int) -> BenchConfig:
    """Return the bench of a seed."""
    rank = np.random.default_rng((20261128, seed)).random(10)
    normal = norm.ppf(rank)
    standard = simulated().simulation or {}
    tactor = {name: standard["tactor"][name] * (1 + 0.03 * z) for name, z in zip(("k2", "mu"), normal, strict=False)}
    config = simulated(
        seed=seed,
        tactor=tactor,
        electrical={
            "capacitance_f": float(0.8e-9 + 1.2e-9 * rank[2]),
            "loss_per_decade": float(0.01 + 0.04 * rank[3]),
            "leakage_ohm": float(10 ** (8.5 + 1.5 * rank[4])),
            "coupling": float(0.6 + 0.4 * rank[5]),
        },
        amplifier={
            "current_monitor_v_per_a": 100.0 / (1 + GAIN * normal[6]),
            "current_monitor_delay_s": 1.2e-5 + DELAY_S * normal[7],
            "current_monitor_zero_v": 2e-3 * normal[8],
            "voltage_monitor_v_per_v": 1e-3 / (1 + V_GAIN * normal[9]),
        },
    )
    delay_s = 1.2e-5 + 1 / (2 * math.pi * 20e3)
    current = MONITORS[1] | {"gain_relative_uncertainty": GAIN, "delay_s": delay_s, "delay_uncertainty_s": DELAY_S}
    return with_inputs(config, MONITORS[0] | {"gain_relative_uncertainty": V_GAIN}, current)


def differences(points: list[Any], parameters: SimulationParameters) -> Iterator[tuple[str, float, float]]:
    """Yield each quantity with its difference from the truth and its total standard uncertainty."""
    load = parameters.electrical
    for p in points:
        f = np.array([p.frequency])
        if p.frequency:
            yield "capacitance", p.capacitance - float(true_capacitance(parameters, f)[0]), p.capacitance_total
            yield "loss", p.loss - float(true_loss(parameters, f)[0]), p.loss_total
            yield "energy", p.energy - true_energy(parameters, p.frequency, p.drive), p.energy_total
        else:
            held_s = PROTOCOL.wait_s + PROTOCOL.record_s / 2 + 0.25  # since the middle of the ramp
            absorbed = load.capacitance_f * load.loss_per_decade / math.log(10) / held_s
            yield "leakage", p.leakage - 1500 * (1 / load.leakage_ohm + absorbed), p.leakage_total


def measured(seed: int) -> list[tuple[str, float, float]]:
    """Measure the specimen of a seed; return quantity, difference and total standard uncertainty of each interval."""
    config = drawn_bench(seed)
    with laboratory(config) as lab, tempfile.TemporaryDirectory() as folder:
        ran = run(PROTOCOL, Path(folder), lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    return list(differences(ran.points, config.simulation_parameters))


def main(specimens: int, file: Path) -> None:
    """Measure the specimens that are missing in the file and print the table."""
    lines = file.read_text().splitlines() if file.exists() else []
    every = {int(line["seed"]): line["intervals"] for line in map(json.loads, lines)}
    for seed in sorted(set(range(1, specimens + 1)) - set(every)):
        every[seed] = measured(seed)
        with file.open("a") as kept:
            kept.write(json.dumps({"seed": seed, "intervals": every[seed]}) + "\n")
    found: dict[str, list[float]] = {}
    for name, off, total in (each for seed in range(1, specimens + 1) for each in every[seed]):
        found.setdefault(name, []).append(off / total)
    found["pooled"] = [pull for pulls in list(found.values()) for pull in pulls]
    for name, pulls in found.items():
        held, rms = np.mean(np.abs(pulls) < 1.96), np.sqrt(np.mean(np.square(pulls)))
        print(
            f"{name:12s} {len(pulls):4d} intervals, {100 * held:5.1f} % hold the truth, rms pull {rms:.2f}, mean {np.mean(pulls):+.2f}"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]))
