"""Run files of a made-up laboratory: fifty specimens in three batches on two lasers, one of which drifts.

Shares nothing with `app.fleet`: the files are written by the run file writer, their values drawn here.
"""

import random
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from drivers import LaserSensor
from model import EstimatedQuantity
from protocols.base import Outcome, RunStatus, Verdict
from protocols.measurements.sine_dwell import SinePoint
from protocols.runfile.record import RunRecord
from protocols.runfile.writer import RunFileWriter

BEGIN = datetime(2026, 1, 5, 9, 0, tzinfo=UTC)
DRIFT_FROM_DAY, DRIFT_PER_DAY = 75, -0.0006
"""The drift of laser 2: its displacements fall by 0.06 % a day from that day on."""
REPEATABILITY = 0.002
BATCHES = {"A": 17, "B": 17, "C": 16}
DAYS = 180
GOLDEN = "G1"


def laser(number: int) -> LaserSensor:
    return LaserSensor("laser", 1e-4, gain_relative_uncertainty=0.01, serial=f"L{number}")


def write_run(
    folder: Path,
    specimen: str,
    day: float,
    largest_m: float,
    resonance_hz: float,
    number: int,
    simulated: bool = True,
    **facts: Any,
) -> Path:
    """Write the finished run of a specimen with its largest amplitude and resonance, and further facts of its record."""
    record = RunRecord(
        protocol="sine-dwell",
        title=f"Sine dwell of {specimen}",
        specimen=specimen,
        start_time=(BEGIN + timedelta(days=day)).isoformat(timespec="milliseconds"),
        simulated=simulated,
        parameters={"peak_to_peak_v": 5.0},
        axes=("frequency", "fundamental"),
        sensor=laser(number),
        configuration={"name": f"bench {number}", "identities": {"sensor": "laser"}},
        **facts,
    )
    file = RunFileWriter.new(folder, record, SinePoint)
    file.start_stream(5000.0, ())
    for f, share in ((resonance_hz - 40, 0.4), (resonance_hz, 1.0), (resonance_hz + 40, 0.35)):
        y = largest_m * share
        point = SinePoint(
            f, y, 2e-7, y / 2, 1e-7, -1.0, 1e-3, 0.01, (0.0,) * 8, 2.5, 2.5, 0.0, 0.0, 1e-7, 40.0, 32 * simulated
        )
        file.append_point(point)
    found = (EstimatedQuantity("natural_frequency", resonance_hz, 0.02, "Hz", "drawn"),)
    file.finish(RunStatus.COMPLETED, "all points measured", found, verdict=Verdict(Outcome.GOOD, ()))
    return file.path


def write_laboratory(folder: Path, seed: int = 1) -> None:
    """Write the runs of half a year: each specimen once, two of three again, and the golden one every fourth day on each laser."""
    draw = random.Random(seed)

    def seen(true_m: float, day: float, number: int) -> float:
        drift = 1 + DRIFT_PER_DAY * max(day - DRIFT_FROM_DAY, 0) if number == 2 else 1.0
        return true_m * drift * (1 + draw.gauss(0, REPEATABILITY))

    for batch, (name, count) in enumerate(BATCHES.items()):
        for i in range(count):
            specimen = f"{name}{i:02d}"
            true_m, true_hz = (
                1e-3 * (1 + 0.01 * batch) * (1 + draw.gauss(0, 0.03)),
                160 + 2 * batch + draw.gauss(0, 1.5),
            )
            for day in (5 + 25 * batch + i, 120 + 15 * batch + i)[: 1 + (i % 3 > 0)]:
                number = 1 + i % 2
                hz = true_hz + draw.gauss(0, 0.02)
                write_run(folder, specimen, day + 0.1, seen(true_m, day, number), hz, number)
            (folder / f"{specimen}.specimen.toml").write_text(f'specimen = "{specimen}"\nbatch = "{name}"\n')
    for day in range(0, DAYS, 4):
        for number in (1, 2):
            write_run(
                folder,
                GOLDEN,
                day + 0.02 * number,
                seen(1.1e-3, day, number),
                161 + draw.gauss(0, 0.02),
                number,
            )
