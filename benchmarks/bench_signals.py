"""From a run file to resonance and response: a 300 s sweep at 5 kS/s, against scipy's Welch on the same data.

    python benchmarks/bench_signals.py [--rounds 7]

A run file as the runner writes it (two channels of 1.5 million raw integers) is opened, scaled and analysed: frequency response
with coherence and error bars, its peak, and the peak of the displacement's spectrum. Beside it, in the same rounds,
scipy.signal's welch, welch and csd of the volts and metres that were read: S_xx, S_yy and S_yx, no errors, no peak.
Quote ratios; absolute times belong to the machine and to who else uses it. CPU time is told as well, for a busy machine.
"""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
from scipy.signal import csd, welch
from timing import peak_mb, timed

from drivers.drive_shapes import LinearSweep
from drivers.interfaces import Block, Scale
from drivers.sensors.laser_sensor import LaserSensor
from model.amplifier_map import AmplifierMap
from model.parameters import Tactor
from model.response.harmonic_response import tactor_modal_form
from protocols.base import RunStatus
from protocols.measurements.sine_dwell import SinePoint
from protocols.runfile.reader import Run
from protocols.runfile.record import RunRecord
from protocols.runfile.writer import RunFileWriter
from protocols.signals.peak import PEAK_BAND_HZ, joined_spectrum_peak, response_peak
from protocols.signals.swept_response import estimate_swept_response
from tests.helpers.sampled import march

RATE = 5000.0
BAND = (25.0, 525.0)
SCALE = Scale((-1.7e-4, 3.2054e-4, 2.0e-14, -3.1e-19))
SENSOR = LaserSensor("simulated laser", 1e-4, delay_s=1e-4)
BLOCK = 2500


def written(folder: Path) -> Path:
    """A run file with one recording of the paper's sweep, as the card would have given it."""
    sweep = LinearSweep(*BAND, 300.0, 2.5, 2.5)
    volts = sweep.volts(np.arange(1_500_000) / RATE)
    moved = march(tactor_modal_form(Tactor()), AmplifierMap().specimen_v(volts), RATE)
    noise = np.random.default_rng(1).standard_normal((2, volts.size))
    both = np.stack((volts, moved / SENSOR.gain_m_per_v)) + np.array([[2.7e-4], [5e-3]]) * noise
    raw = np.rint(both / SCALE.coefficients[1]).astype(np.int16)
    record = RunRecord(protocol="sweep", title="Sweep", axes=("frequency", "fundamental"), sensor=SENSOR)
    file = RunFileWriter.new(folder, record, SinePoint)
    file.start_stream(RATE, (SCALE, SCALE))
    for start in range(0, raw.shape[1], BLOCK):
        file.append_block(Block(start, raw[:, start : start + BLOCK]), start / RATE)
    file.append_recording((0, raw.shape[1]), 0, sweep)
    file.finish(RunStatus.COMPLETED, "")
    return file.path


def read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    with Run(path) as run:
        return run.trace.drive_v(), run.trace.displacement_m()


def whole(path: Path) -> float:
    """What a user of a mass-resonance run waits for."""
    drive, moved = read(path)
    response = estimate_swept_response(drive, moved, RATE, BAND, delay_s=SENSOR.delay_s)
    return response_peak(response).frequency_hz


def scipys(drive: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """H1 with segments of 2 s, the plain way."""
    length = int(2 * RATE)
    _, s_xx = welch(drive, RATE, nperseg=length)
    welch(moved, RATE, nperseg=length)
    return csd(drive, moved, RATE, nperseg=length)[1] / s_xx


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    with tempfile.TemporaryDirectory() as folder:
        path = written(Path(folder))
        drive, moved = read(path)
        cases: dict[str, Callable[[], object]] = {
            "file to response and resonance": lambda: whole(path),
            "  of it: file to volts and metres": lambda: read(path),
            "  of it: response with error bars": lambda: estimate_swept_response(drive, moved, RATE, BAND),
            "peak of the displacement's spectrum": lambda: joined_spectrum_peak(
                [moved], RATE, [PEAK_BAND_HZ], PEAK_BAND_HZ
            ),
            "scipy: welch, welch, csd": lambda: scipys(drive, moved),
        }
        for call in cases.values():
            call()
        times = {name: [] for name in cases}
        for _ in range(rounds):  # all cases in every round, so that they share what the machine does meanwhile
            for name, call in cases.items():
                times[name].append(timed(call))
        print(f"resonance {whole(path):.4f} Hz")
        print(f"{'':38s} {'best':>8s} {'median':>8s} {'best CPU':>9s} {'memory':>8s}")
        for name, call in cases.items():
            walls, cpus = [w for w, _ in times[name]], [c for _, c in times[name]]
            print(
                f"{name:38s} {1e3 * min(walls):5.0f} ms {1e3 * median(walls):5.0f} ms {1e3 * min(cpus):6.0f} ms {peak_mb(call):5.0f} MB"
            )

        def ratio(one: str, other: str) -> float:
            return median(a[0] / b[0] for a, b in zip(times[one], times[other], strict=True))

        print(
            f"scipy's Welch / file to response and resonance: {ratio('scipy: welch, welch, csd', 'file to response and resonance'):.1f}"
        )
        wall, cpu = (min(column) for column in zip(*times["file to response and resonance"], strict=True))
        for name, took in (("wall", wall), ("CPU", cpu)):
            met = "met" if took < 0.15 else "not met on this machine now"
            print(f"goal file to response and resonance < 150 ms, {name}: {met}")


if __name__ == "__main__":
    main()
