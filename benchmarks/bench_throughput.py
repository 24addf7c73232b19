"""End to end: samples from the card's wire through the file to the reduced trace, at 5 kS/s and at 500 kS/s.

    python benchmarks/bench_throughput.py [--seconds 10]

A sine dwell of one long recording on the simulated bench over its real wires (the card in a process of its own, NI's gRPC
service in between). Told per case: scans asked and scans in the file (none may be lost), how busy the bench thread's
process was, the longest wait between two blocks over the block's own duration, and the size of the file.
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
from drivers.bench.shutdown import DISPLACEMENT_CHANNEL, DRIVE_CHANNEL
from protocols.base import BlockStored, EventBus, StreamStarted
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.reader import Run
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    print(f"{'scans/s x channels':>20} {'scans in file':>14} {'lost':>5} {'busy':>6} {'longest gap':>12} {'file':>9}")
    for rate_hz, max_rate_hz in ((5e3, 500e3), (250e3, 500e3), (500e3, 1e6)):
        case(rate_hz, max_rate_hz, seconds)


def case(rate_hz: float, max_rate_hz: float, seconds: float) -> None:
    config = load_bench("ideal")
    truth = {**config.simulation, "card": {**config.simulation["card"], "max_rate_hz": max_rate_hz}}
    config = config.model_copy(update={"simulation": truth})
    protocol = SineDwell(frequencies_hz=(160,), sample_rate_hz=rate_hz, record_s=seconds)
    traces = MinMaxTrace(1.0), MinMaxTrace(1.0)
    arrivals: list[tuple[float, int]] = []
    scales = []

    def preview(event: object) -> None:
        if isinstance(event, StreamStarted):
            scales.extend(event.scales)
        if isinstance(event, BlockStored):
            arrivals.append((time.monotonic(), event.block.stop - event.block.start))
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
            recording = next(run.recordings())
            lost = round(seconds * rate_hz) - len(recording.drive_v)
            samples = run.trace.sample_count
        size = runner.path.stat().st_size
    busy = (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / took
    gap = max(b[0] - a[0] - b[1] / rate_hz for a, b in pairwise(arrivals))
    print(
        f"{rate_hz:>16.0f} x 2 {samples:>14} {max(lost, 0):>5} {100 * busy:>5.0f}% {1e3 * gap:>9.0f} ms {size / 1e6:>6.1f} MB",
        flush=True,
    )


if __name__ == "__main__":
    main()
