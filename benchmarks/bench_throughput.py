"""End to end: samples from the card's wire through the file to the reduced trace, at 5 kS/s and at 500 kS/s.

    python benchmarks/bench_throughput.py [--seconds 10]

A sine dwell of one long recording on the simulated bench over its real wires (the card in a process of its own, NI's gRPC
service in between). Per case: scans in the file; scans that the card counted within the recording and the file does not have; how
busy the program's process was; the longest time between two blocks that were read, beyond the block's own duration; the time of the analysis,
while which blocks are read and not stored; the size of the file.
"""

import argparse
import resource
import tempfile
import time
from itertools import pairwise
from pathlib import Path

from app.config.bench_file import load_bench
from app.live.minmax_trace import MinMaxTrace
from app.session.bench_connection import connect
from drivers.bench.card_reading import DISPLACEMENT_CHANNEL, DRIVE_CHANNEL
from protocols.base import BlockDiscarded, BlockStored, EventBus, PointMeasured, RecordingFinished, StreamStarted
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.reader import Run
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    print(
        f"{'scans/s x channels':>20} {'scans in file':>14} {'lost':>5} {'busy':>6} {'longest gap':>12} {'analysis':>9} {'file':>9}"
    )
    for rate_hz, max_rate_hz in ((5e3, 500e3), (250e3, 500e3), (500e3, 1e6)):
        case(rate_hz, max_rate_hz, seconds)


def case(rate_hz: float, max_rate_hz: float, seconds: float) -> None:
    config = load_bench("ideal")
    truth = {**config.simulation, "card": {**config.simulation["card"], "max_rate_hz": max_rate_hz}}
    config = config.model_copy(update={"simulation": truth})
    protocol = SineDwell(frequencies_hz=(160,), sample_rate_hz=rate_hz, record_s=seconds)
    traces = MinMaxTrace(1.0), MinMaxTrace(1.0)
    arrivals: list[tuple[float, int]] = []
    moments: dict[type, float] = {}
    scales = []

    def preview(event: object) -> None:
        if isinstance(event, StreamStarted):
            scales.extend(event.scales)
        if isinstance(event, RecordingFinished | PointMeasured):
            moments[type(event)] = time.monotonic()
        if isinstance(event, BlockStored | BlockDiscarded):
            arrivals.append((time.monotonic(), event.block.stop - event.block.start))
        if isinstance(event, BlockStored):
            for trace, channel in zip(traces, (DRIVE_CHANNEL, DISPLACEMENT_CHANNEL), strict=True):
                trace.append(scales[channel].to_volts(event.block.raw[channel]))

    with tempfile.TemporaryDirectory() as folder, connect(config, 1.0) as lab:
        assert lab.operator is not None
        runner = Runner(RunRequest(protocol, Path(folder), "throughput"), lab.bench, lab.operator, EventBus(preview))
        before, begin = resource.getrusage(resource.RUSAGE_SELF), time.monotonic()
        ended = runner.run()
        took, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_SELF)
        assert ended.status == "completed", ended.reason
        with Run(runner.path) as run:
            lost = lost_scans(run)
            samples = run.trace.sample_count
        size = runner.path.stat().st_size
    busy = (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / took
    gap = max(b[0] - a[0] - b[1] / rate_hz for a, b in pairwise(arrivals))
    analysis_s = moments[PointMeasured] - moments[RecordingFinished]
    print(
        f"{rate_hz:>16.0f} x 2 {samples:>14} {lost:>5} {100 * busy:>5.0f}% {1e3 * gap:>9.0f} ms {analysis_s:>7.2f} s "
        f"{size / 1e6:>6.1f} MB",
        flush=True,
    )


def lost_scans(run: Run) -> int:
    """Return how many scans within the recordings the card counted and the file does not have."""
    lost = 0
    for recording in run.recordings():
        first, last = (
            round(t * run.trace.rate_hz) for t in run.trace.times_of_rows([recording.rows[0], recording.rows[1] - 1])
        )
        lost += last - first - (recording.rows[1] - 1 - recording.rows[0])
    return lost


if __name__ == "__main__":
    main()
