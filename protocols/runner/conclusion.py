"""Run conclusion: end of a run, verdict on its result, and last event, in the file and to the observers."""

import contextlib
import logging
import math
import sys
import time
import traceback
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from drivers import MANUAL_SHUTDOWN_INSTRUCTIONS, ArmedBench, BenchError, UnsafeError
from protocols.base import (
    INTERFERENCE_AT_REST,
    EstimatedQuantity,
    InterferenceMeasured,
    LogMessage,
    Outcome,
    Protocol,
    ReferenceModel,
    RestMeasured,
    RunEnded,
    RunStatus,
    Verdict,
    judge_ended,
)
from protocols.runfile import RunFileWriter, StorageError
from protocols.runner.plan_progress import PlanProgress
from protocols.runner.publisher import RunCancelled, RunRecorder

log = logging.getLogger(__name__)

CLOCK_CHANGE = timedelta(seconds=30)
"""Smallest reported difference between the computer's clock and the elapsed time; time servers correct less."""


class ComputerClockCheck:
    """Compares the computer's clock with the monotonic clock since its creation."""

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


def describe_end(
    error: RunCancelled | BenchError | StorageError | OSError | KeyboardInterrupt,
    progress: PlanProgress,
    stopped_by: str,
) -> tuple[RunStatus, str]:
    """Return status and reason of a run ended by `stopped_by` or by a failure of bench or file."""
    match error:
        case RunCancelled():  # with a reason: a simulated operator may have answered
            done = f"after {len(progress.measured)} of {len(progress.plan)} points"
            return RunStatus.STOPPED, f"stopped {done}: {error}" if error.args else f"stopped by {stopped_by} {done}"
        case KeyboardInterrupt():
            return RunStatus.STOPPED, f"interrupted after {len(progress.measured)} points"
        case UnsafeError(__cause__=BenchError() | StorageError() as earlier):
            return RunStatus.UNSAFE, f"{error} The run had failed before: {earlier}"
        case UnsafeError():
            return RunStatus.UNSAFE, str(error)
        case OSError():
            return RunStatus.FAILED, f"a file or a folder cannot be used: {error}"
        case _:
            return RunStatus.FAILED, str(error)


def describe_code_error(error: BaseException, protocol: Protocol) -> str:
    """Return an error in code in a sentence; it names the line of the laboratory's own protocol file, if the error is there.

    An error of this program is logged with its traceback.
    """
    module, what = type(protocol).__module__, f"{type(error).__name__}: {error}"
    file = getattr(sys.modules.get(module), "__file__", None)
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if frame.filename == file and not module.startswith("protocols.")]
    if lines:
        return f"an error in {file}, line {lines[-1]}: {what}"
    log.error("an error of this program", exc_info=error)
    return f"an error of this program: {what}"


class RunConclusion:
    """Concludes a run: publishes the measured rest, estimates and judges the result, and finishes the run file.

    Args:
        reference: model for comparison with the result.
    """

    def __init__(
        self,
        protocol: Protocol,
        reference: ReferenceModel,
        run_file: RunFileWriter,
        recorder: RunRecorder,
        progress: PlanProgress,
    ) -> None:
        self._protocol, self._reference, self._run_file = protocol, reference, run_file
        self._recorder, self._progress = recorder, progress
        self._clock_check = ComputerClockCheck()

    def conclude(
        self,
        status: RunStatus,
        reason: str,
        armed: ArmedBench | None,
        interference: InterferenceMeasured | None = None,
        air: Sequence[EstimatedQuantity] = (),
    ) -> RunEnded:
        """Record the end of the run: in the file if it is writable, and always to the observers.

        `interference` is measured at rest, and `air` through the run; its largest line and the air are among the results.
        """
        with contextlib.suppress(StorageError):
            self._recorder.publish_external()
        status, reason = self._publish_rest(status, reason, armed)
        estimates: tuple[EstimatedQuantity, ...] | None = None
        try:
            more = (*_interference_estimate(interference), *air)
            estimates = (*self._protocol.estimates(self._progress.points), *more)
        except BaseException as error:  # noqa: BLE001 - told in the reason
            reason += f"; the analysis failed by {describe_code_error(error, self._protocol)}"
        try:
            self._run_file.check_presence()
        except StorageError as error:
            status, reason = _storage_failure(error, status, reason)
        verdict = self._judge(status, reason, estimates)
        if message := self._clock_check.message():
            self._recorder.publish_always(LogMessage(message))
        try:
            reason = self._run_file.finish(status, reason, estimates or (), self._progress.series, verdict)
        except StorageError as error:
            status, reason = _storage_failure(error, status, reason)
            verdict = Verdict.of_status(status, reason, verdict.checks)
            with contextlib.suppress(StorageError):
                self._run_file.close_after_error()
        ended = RunEnded(status, reason, str(self._run_file.path), estimates or (), verdict, self._progress.warnings)
        self._recorder.notify(ended)
        return ended

    def _publish_rest(self, status: RunStatus, reason: str, armed: ArmedBench | None) -> tuple[RunStatus, str]:
        """Publish the rest measured at shutdown; return status and reason, unsafe if high voltage may be on without confirmed rest."""
        rest = armed.final_rest if armed is not None else None
        if rest is not None:
            self._recorder.publish_always(RestMeasured(rest.confirmed, rest.measured_v, rest.message))
        elif status is RunStatus.UNSAFE or (armed is not None and armed.high_voltage_may_be_on):
            if status is not RunStatus.UNSAFE:  # the shutdown itself was interrupted
                status, reason = RunStatus.UNSAFE, f"{MANUAL_SHUTDOWN_INSTRUCTIONS}. The run had ended before: {reason}"
            self._recorder.publish_always(RestMeasured(False, math.nan, "rest could not be measured"))
        return status, reason

    def _judge(self, status: RunStatus, reason: str, estimates: Sequence[EstimatedQuantity] | None) -> Verdict:
        progress, protocol = self._progress, self._protocol
        planned = len(progress.plan)
        try:
            return judge_ended(status, reason, protocol, progress.points, planned, self._reference, estimates)
        except Exception as error:  # noqa: BLE001 - told in the verdict
            what = describe_code_error(error, protocol)
            if status is not RunStatus.COMPLETED:
                return Verdict.of_status(status, reason)
            return Verdict(Outcome.DOUBTFUL, (f"the result could not be checked because of {what}",))


def _interference_estimate(interference: InterferenceMeasured | None) -> tuple[EstimatedQuantity, ...]:
    """Return the largest line of the displacement at rest; none without a significant line."""
    if interference is None or not interference.lines:
        return ()
    line = interference.lines[0]
    source = f"hum or another line at {line.frequency_hz:.2f} Hz in the displacement at rest, before the first entry"
    return (EstimatedQuantity.listed(INTERFERENCE_AT_REST, line.amplitude_m, line.error_m, source),)


def _storage_failure(error: StorageError, status: RunStatus, reason: str) -> tuple[RunStatus, str]:
    """Return status and reason of a run whose file cannot be written at its end."""
    return (RunStatus.FAILED, str(error)) if status in (RunStatus.COMPLETED, RunStatus.STOPPED) else (status, reason)
