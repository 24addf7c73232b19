"""Measurement of the interlock: a level is held with high voltage on, the heartbeat ends, and the volts on the specimen must go."""

import math
from collections.abc import Callable

import numpy as np

from drivers import (
    DISPLACEMENT_CHANNEL,
    ArmedBench,
    Bench,
    BenchError,
    HighVoltageSwitch,
    Hold,
    UnsafeError,
    longest_unmoved_s,
)
from drivers.evidence import OutputCheck
from model import Array
from protocols.base import DriveStarted, Event, RestMeasured, ShutdownStarted
from protocols.commissioning.verdict import CheckedOutput

RATE_HZ = 2000.0
LEVEL_V = 0.5
"""Held level above rest at the amplifier's input: 300 V on the specimen with a slope of 600 V/V."""

SAFE_V = 60.0
"""Largest volts on the specimen that count as off."""

LONGEST_OFF_S = 1.0
"""Longest time from the monostable's end until high voltage is off."""

SETTLING_S, REFERENCE_S, SMOOTHING_S = 1.0, 0.3, 0.02
SEEN_NOISES = 10.0
"""Least response to the level, in standard deviations of its reference."""


def measure_interlock(
    bench: Bench,
    switch: HighVoltageSwitch,
    check_stop: Callable[[], object] = lambda: None,
    publish: Callable[[Event], object] = lambda _: None,
) -> CheckedOutput:
    """Return for how long high voltage remains after the last heartbeat, and the limit: the monostable's time and one second.

    Seen by the channel of kind `voltage-monitor`, or else by the displacement, as a share of its value under the level.

    Args:
        bench: bench with an interlock; its source is always brought to rest at the end.
        switch: switches high voltage.
        check_stop: called with every block that is read; raises to abandon.
        publish: callback with the level that begins, the way to rest, and rest as it is measured.

    Raises:
        UnsafeError: rest could not be confirmed.
    """
    limit_s = bench.interlock.monostable_s + LONGEST_OFF_S
    monitors = [row for row, channel in enumerate(bench.channels, 2) if channel.kind == "voltage-monitor"]
    value, detail = math.nan, f"by {'the voltage monitor' if monitors else 'the displacement'}"
    started: list[ArmedBench] = []
    try:
        with bench.armed(RATE_HZ, lambda _: None, switch, started.append) as armed:
            try:
                value = _remaining_s(bench, armed, (*monitors, DISPLACEMENT_CHANNEL)[0], limit_s, check_stop, publish)
            finally:
                publish(ShutdownStarted(longest_unmoved_s(bench.amplifier, armed.predicted_rest_s)))
    except UnsafeError as error:
        publish(RestMeasured(False, math.nan, str(error)))
        raise
    except BenchError as error:
        detail = str(error)
    for rest in [armed.final_rest for armed in started if armed.final_rest is not None]:
        publish(RestMeasured(rest.confirmed, rest.measured_v, rest.message))
    return CheckedOutput(OutputCheck.INTERLOCK, value, "s", None, limit_s, detail)


def _remaining_s(
    bench: Bench,
    armed: ArmedBench,
    row: int,
    limit_s: float,
    check_stop: Callable[[], object],
    publish: Callable[[Event], object],
) -> float:
    """Return for how long after the last heartbeat the specimen has more than SAFE_V; NaN if the level is not seen."""

    def record(seconds: float) -> tuple[Array, Array]:
        """Return times and volts of a channel, from now on for this time."""
        until_s, times, volts = bench.clock.now() + seconds, list[Array](), list[Array]()
        while not times or times[-1][-1] < until_s:
            block = armed.discard_block()
            check_stop()
            times.append(armed.stream.start_time_s + np.arange(block.start, block.stop) / armed.rate_hz)
            volts.append(armed.scales[row].to_volts(block.raw[row]))
        return np.concatenate(times), np.concatenate(volts)

    _, before = record(REFERENCE_S)
    level_v, watched_s = bench.amplifier.map.rest_v + LEVEL_V, limit_s + REFERENCE_S
    level = Hold(level_v, SETTLING_S + REFERENCE_S + watched_s + 1.0)
    armed.start_drive(level)
    publish(DriveStarted(level))
    record(SETTLING_S)
    _, under = record(REFERENCE_S)
    step = float(np.median(under) - np.median(before))
    if abs(step) < SEEN_NOISES * float(under.std()):
        return math.nan
    bench.interlock.end()
    ended_s = bench.clock.now() - bench.interlock.edge_age_s
    times, volts = record(watched_s)
    size = round(SMOOTHING_S * armed.rate_hz)
    share = np.convolve((volts - np.median(before)) / step, np.full(size, 1 / size), "same")[: 1 - size]
    specimen_v = np.abs(share * float(bench.amplifier.map.specimen_v(level_v)))
    on = np.flatnonzero(specimen_v > SAFE_V)
    return float(times[on[-1]] - ended_s) if on.size else 0.0
