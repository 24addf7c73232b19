"""Waiting of tests for an event, however busy the computer is."""

import time
from collections.abc import Callable

from sim_hardware.plant import VoltageReport

PATIENCE_S = 60.0


def wait_until(condition: Callable[[], object], seconds: float = PATIENCE_S) -> bool:
    """Return whether the condition became true within `seconds` of wall clock."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def report_at_rest(report: Callable[[], VoltageReport]) -> VoltageReport:
    """Return the report of the volts when they are at rest: a served bench carries out what was sent to it a little later."""
    wait_until(lambda: report().ends_at_rest)
    return report()
