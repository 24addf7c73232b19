"""Computer clock check: reports a clock that was set back or forward during a run."""

import time
from datetime import UTC, datetime, timedelta

CLOCK_CHANGE = timedelta(seconds=30)
"""A larger difference between the computer's clock and the elapsed time is reported; time servers correct less."""


class ComputerClockCheck:
    """Compares the computer's clock with the monotonic clock, from its creation on."""

    def __init__(self) -> None:
        self._started_at, self._started_s = datetime.now(UTC), time.monotonic()

    def message(self) -> str:
        """Return the report of a change; empty without a change."""
        lasted = timedelta(seconds=time.monotonic() - self._started_s)
        change = datetime.now(UTC) - (self._started_at + lasted)
        if abs(change) <= CLOCK_CHANGE:
            return ""
        way = "back" if change < timedelta(0) else "forward"
        return (
            f"The computer's clock was set {way} by {_format_span(abs(change))} during the run, which lasted "
            f"{_format_span(lasted)}: the run's end_time is its start plus that duration. Check the clock before the next run"
        )


def _format_span(span: timedelta) -> str:
    seconds = span.total_seconds()
    for length, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.3g} s"
