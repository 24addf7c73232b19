"""Safety statement: time to rest of an armed bench after a stop, and after the death of program and watchdog."""

import math

from drivers.bench.amplifier import HvAmplifier
from drivers.bench.watchdog_interface import Watchdog


def safety_statement(amplifier: HvAmplifier, watchdog: Watchdog, predicted_rest_s: float) -> str:
    """Return the statement for the log of a run; empty if nothing can be stated.

    Args:
        amplifier: amplifier with the source.
        watchdog: watchdog of the bench.
        predicted_rest_s: duration of the way to rest from the farthest level, NaN if unknown.
    """
    clauses = []
    if math.isfinite(predicted_rest_s):
        measured = (
            f" (Stop measured {amplifier.measured_stop_s:.2f} s at commissioning)" if amplifier.measured_stop_s else ""
        )
        waits = ", once the drive has ended by itself" if amplifier.plays_to_the_end else ""
        clauses.append(f"the way to rest takes up to {predicted_rest_s:.1f} s{measured}{waits}")
    if math.isfinite(watchdog.notices_after_s):
        clauses.append(f"if this program dies or hangs, the watchdog takes it after {watchdog.notices_after_s:g} s")
    if amplifier.unattended_end:
        both = "program and watchdog die" if math.isfinite(watchdog.notices_after_s) else "this program dies"
        clauses.append(f"if {both}, {amplifier.unattended_end}")
    return "; ".join(clauses)
