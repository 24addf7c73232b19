"""Skew and settling of the card's inputs, by a scan that converts each input directly after the drive, and the drive several times."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from drivers import DRIVE_CHANNEL, ArmedBench, Clock, DriveRejectedError, InstrumentError, Sine
from drivers.evidence import OutputCheck
from model import Array
from protocols.commissioning.exercise import TAIL_S, Trace
from protocols.commissioning.verdict import CheckedOutput

SCAN_RATE_HZ = 100e6 / 20011
"""Scans per second: slow enough for NI's default interval of conversions, and no multiple of the steps of a card's output, so
that these fall on all phases of a scan."""

FREQUENCY_HZ, PEAK_V = 100.0, 0.25
PLAYED_S, SETTLED_S, OBSERVED_S = 2.0, 0.1, 1.0
"""Duration of the sine, and of its evaluated part."""

SKEW_LIMIT_S = 1e-6
"""Largest deviation of a skew: a phase of 0.2 degrees at 500 Hz."""

SETTLING_LIMIT = 0.01
SEEN_V = 0.02
NAME = "inputs directly after the drive"


@dataclass(frozen=True, slots=True)
class CheckedInputs:
    """Checks of the card's inputs, and the recorded drive."""

    checks: tuple[CheckedOutput, ...]
    traces: tuple[Trace, ...]


def scan_order(channels: int) -> tuple[int, ...]:
    """Return the numbers of the channels in a scan: each input after the drive and again after itself, and the drive at the end."""
    others = (k for k in range(channels) if k != DRIVE_CHANNEL)
    return (*(slot for k in others for slot in (DRIVE_CHANNEL, k, k)), DRIVE_CHANNEL)


def exercise_inputs(
    bench: ArmedBench,
    clock: Clock,
    order: Sequence[int],
    rest_v: float,
    check_stop: Callable[[], object] = lambda: None,
) -> CheckedInputs:
    """Play a sine and measure the card's inputs during it; no check with a source that does not play sines.

    Args:
        bench: exercised with `order`, see `Bench.exercised`.
        clock: bench time.
        order: numbers of the channels in a scan.
        rest_v: level of rest.
        check_stop: called with every block that is read; raises to abandon.

    Raises:
        BenchError: the card does not answer.
    """
    drive = Sine(FREQUENCY_HZ, PEAK_V, rest_v, round(PLAYED_S * FREQUENCY_HZ))
    skew_s = settling = math.nan
    detail, traces = "", []
    for _ in range(2):  # repeated if it did not start
        try:
            trace = _recorded(bench, clock, drive, check_stop)
        except DriveRejectedError:
            return CheckedInputs((), ())
        traces.append(trace)
        slots = np.vstack([trace.volts, trace.others])
        first = round((trace.started_s + SETTLED_S - trace.start_s) * trace.rate_hz)
        slots = slots[:, first : first + round(OBSERVED_S * trace.rate_hz)]
        if trace.error or slots.shape[1] < round(OBSERVED_S * trace.rate_hz):
            continue
        tones = _tones(slots, trace.rate_hz)
        if abs(tones[0]) > SEEN_V:
            skew_s = _largest_skew_error_s(tones, order, [scale.skew_s for scale in bench.scales])
            settling, detail = _largest_share(tones, order)
            break
    return CheckedInputs(
        (
            CheckedOutput(
                OutputCheck.SKEW, skew_s, "s", -SKEW_LIMIT_S, SKEW_LIMIT_S, "against the interval that the card reports"
            ),
            CheckedOutput(OutputCheck.SETTLING, settling, "1", None, SETTLING_LIMIT, detail),
        ),
        tuple(traces),
    )


def _recorded(bench: ArmedBench, clock: Clock, drive: Sine, check_stop: Callable[[], object]) -> Trace:
    """Play the drive to its end and record it. Raises DriveRejectedError if this source does not play it."""
    blocks = [bench.read_block()]
    start_s = bench.stream.start_time_s

    def read_until(time_s: float) -> None:
        while start_s + blocks[-1].stop / bench.rate_hz < time_s:
            blocks.append(bench.read_block())
            check_stop()

    read_until(clock.now())
    del blocks[:-1]
    error = ""
    try:
        bench.amplifier.start_drive(drive)
    except InstrumentError as refused:
        error = str(refused)
    started_s = clock.now()
    read_until(started_s + drive.duration_s + TAIL_S)
    stop_s = clock.now()
    try:
        bench.amplifier.force_rest()
    except InstrumentError as refused:
        error = error or str(refused)
    return Trace.of_blocks(NAME, drive, bench, blocks, (), started_s, stop_s, clock.now(), error)


def _tones(slots: Array, rate_hz: float) -> Array:
    """Return the complex amplitude at the frequency of the drive in each place of the scans."""
    count = slots.shape[1]
    window = np.hanning(count)
    turning = window * np.exp(-2j * np.pi * FREQUENCY_HZ / rate_hz * np.arange(count))
    centred = slots - slots.mean(axis=1, keepdims=True)
    return np.asarray(2 * (centred @ turning) / window.sum())


def _largest_skew_error_s(tones: Array, order: Sequence[int], reported_s: Sequence[float]) -> float:
    """Return the largest difference of a measured skew of the drive from the reported one."""
    places = [place for place, channel in enumerate(order) if channel == DRIVE_CHANNEL][1:]
    delays = [float(np.angle(tones[place] / tones[0])) / (2 * np.pi * FREQUENCY_HZ) for place in places]
    errors = [delay_s - (reported_s[place] - reported_s[0]) for delay_s, place in zip(delays, places, strict=True)]
    return max(errors, key=abs)


def _largest_share(tones: Array, order: Sequence[int]) -> tuple[float, str]:
    """Return the largest share of the drive in an input converted directly after it, and the name of the input."""
    shares = [
        (abs(tones[place] / tones[place - 1]), abs(tones[place + 1] / tones[place - 1]), channel)
        for place, channel in enumerate(order)
        if place and channel != DRIVE_CHANNEL and order[place - 1] == DRIVE_CHANNEL
    ]
    directly, later, channel = max(shares)
    return float(directly), f"share of the drive in input {channel}, {later:.2g} at its second conversion"
