"""Runner: runs one protocol on an armed bench, with pause, cancel and the way to rest."""

import contextlib
import importlib
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import Any

from drivers import (
    MANUAL_SHUTDOWN_INSTRUCTIONS,
    ArmedBench,
    Bench,
    BenchError,
    LiveWarning,
    RestartableStream,
    ScansLostError,
    UnsafeError,
)
from protocols.base import (
    BenchArmed,
    CurveReady,
    EntryStarted,
    EstimatedQuantity,
    Event,
    EventBus,
    LevelExceeded,
    LogMessage,
    Operator,
    Outcome,
    PlanEntry,
    Quality,
    Recording,
    ReferenceModel,
    Repeat,
    RestMeasured,
    ResultCurve,
    RunEnded,
    RunPaused,
    RunResumed,
    RunStarted,
    RunStatus,
    ShutdownStarted,
    SpecimenMayBeLive,
    StreamStarted,
    Verdict,
    judge_ended,
)
from protocols.rehearsal import rehearse
from protocols.resume import ResumeState, assess_drift
from protocols.runfile.errors import StorageError
from protocols.runfile.layout import RunMetadata
from protocols.runfile.writer import RunFileWriter
from protocols.runner.computer_clock import ComputerClockCheck
from protocols.runner.executor import StepExecutor
from protocols.runner.ledger import PlanProgress
from protocols.runner.levels import LEVEL_ANSWERS, LevelQuestion, level_prompt
from protocols.runner.operator_actions import OperatorActions
from protocols.runner.publisher import RunRecorder
from protocols.runner.request import RunControl, RunRequest

log = logging.getLogger(__name__)

PRELOADED_MODULES = ("scipy.fft", "scipy.optimize")
"""Imported before the card runs: importing at the first fit would hold up the run for a second or two."""


class RunCancelled(Exception):
    """Stop was requested."""


class PauseInterrupt(Exception):
    """Pause was requested."""


def run_metadata(request: RunRequest, bench: Bench) -> RunMetadata:
    """Return what the run file holds before the run begins."""
    protocol = request.protocol
    return RunMetadata(
        protocol=protocol.name,
        title=protocol.title,
        parameters=protocol.model_dump(mode="json"),
        point_type=protocol.point_type,
        axes=protocol.axes,
        sensor=bench.sensor,
        bench=bench.configuration,
        simulated=bench.simulated,
        specimen=request.specimen,
        channels=bench.channels,
        resumed_from=request.resume.path if request.resume else None,
        reference=reference_model(request, bench).as_record(),
    )


def reference_model(request: RunRequest, bench: Bench) -> ReferenceModel:
    """Return the model of the free specimen, behind this bench's amplifier."""
    return replace(request.reference or ReferenceModel(), amplifier=bench.amplifier.map)


class Runner:
    r"""Runs one protocol once: created -> run() -> ended, in the thread that calls it.

    ::

        file open -> card running -> armed at rest -> entry after entry ... -> to rest, measured -> file finished
                 \_______________ any failure, Stop, Ctrl-C _______________/

    A storage error fails the run; an observer's error never does. A paused run goes to rest and, when resumed, measures
    the interrupted entry from its beginning.
    """

    def __init__(
        self,
        request: RunRequest,
        bench: Bench,
        operator: Operator,
        events: EventBus | None = None,
        control: RunControl | None = None,
    ) -> None:
        """Create the run file.

        Raises:
            StorageError: the file cannot be created.
        """
        self._protocol, self._bench = request.protocol, bench
        self._preparation, self._control = request.prepare, control or RunControl()
        self._resume_state = request.resume.resume_state if request.resume else ResumeState()
        self._reference, self._clock_check = reference_model(request, bench), ComputerClockCheck()
        self._run_file = RunFileWriter.new(request.folder, run_metadata(request, bench))
        self.path = self._run_file.path
        self._armed: ArmedBench | None = None
        self._pausable = False
        self._lost_scans: set[int] = set()
        """Entries that were measured again because scans were lost."""
        self._calibration_warning = bench.sensor.expiry_warning(datetime.now(UTC).date())
        self._recorder = RunRecorder(self._run_file, events or EventBus(), bench.clock, self._control.external_events)
        self._plan_progress = PlanProgress(self._protocol, self._run_file, bench.amplifier.map.rest_v)
        self._executor = StepExecutor(
            bench, self._run_file, operator, self._recorder, self._check_interrupts, self._calibration_warning
        )
        for level in self._protocol.diagnosed_levels:
            self._executor.levels.mute(level)
        self._operator_actions = OperatorActions(self._executor, self._protocol.high_voltage)

    def run(self) -> RunEnded:
        """Run the protocol; return how it ended and what it is worth. Never raises."""
        try:
            self._start()
            protocol = self._protocol
            with self._bench.armed(
                protocol.sample_rate_hz,
                self._recorder.store_block,
                self._operator_actions,
                self._on_stream_started,
                protocol.high_voltage,
                self._warn_of_live_specimen,
            ) as armed:
                self._recorder.publish(BenchArmed(protocol.high_voltage, armed.predicted_rest_s))
                try:
                    self._run_entries(armed)
                finally:
                    with contextlib.suppress(StorageError):
                        self._recorder.publish_external()
                    self._recorder.notify(ShutdownStarted())
            status, reason = RunStatus.COMPLETED, self._plan_progress.outcome_message()
        except RunCancelled as error:
            done = f"{len(self._plan_progress.measured)} of {len(self._plan_progress.plan)} points"
            status, reason = (
                RunStatus.STOPPED,
                f"stopped by the operator after {done}" + (f": {error}" if error.args else ""),
            )
        except UnsafeError as error:
            status, reason = RunStatus.UNSAFE, str(error)
            if isinstance(error.__cause__, (BenchError, StorageError)):
                reason += f" The run had failed before: {error.__cause__}"
        except (BenchError, StorageError) as error:
            status, reason = RunStatus.FAILED, str(error)
        except KeyboardInterrupt:
            status, reason = RunStatus.STOPPED, f"interrupted after {len(self._plan_progress.measured)} points"
        except BaseException as error:  # SystemExit too, which a driver may raise: the end of a run is always reported
            log.exception("the run failed by an error of this program")
            status, reason = RunStatus.FAILED, f"an error of this program: {type(error).__name__}: {error}"
        return self._finish(status, reason)

    def _warn_of_live_specimen(self, warning: LiveWarning) -> None:
        self._publish_always(SpecimenMayBeLive(warning.low_v, warning.high_v, warning.message))

    def _publish_always(self, event: Event) -> None:
        """Store and publish an event; only publish it if the disk is full, for safety must be reported."""
        try:
            self._recorder.publish(event)
        except StorageError:
            self._recorder.notify(event)

    def _start(self) -> None:
        rehearsal = rehearse(
            self._protocol, self._bench.amplifier, meters=self._bench.meters, folder=self._run_file.path.parent
        )
        self._plan_progress.build_plan()
        path = str(self._run_file.path)
        self._recorder.publish(
            RunStarted(self._protocol.name, path, rehearsal.duration_s, rehearsal.entries, self._bench.simulated)
        )
        self._recorder.publish_external()  # faults injected before the run
        for message in (self._bench.watchdog.inactive_reason, self._calibration_warning, self._resume_state.message):
            if message:
                self._recorder.publish(LogMessage(message))
        for numerics in PRELOADED_MODULES:
            importlib.import_module(numerics)
        for entry, point in self._resume_state.points:
            self._recorder.publish(self._plan_progress.add_point(entry, point))
        self._add_curves(self._resume_state.curves)

    def _run_entries(self, armed: ArmedBench) -> None:
        self._plan_progress.queue_remaining(self._resume_state.repeat_entries)
        self._recorder.publish(self._plan_progress.progress_event())
        self._operator_actions.prepare(armed, self._preparation)
        self._check_drift(armed)
        while (index := self._plan_progress.next_entry()) is not None:
            self._plan_progress.complete(index, self._measure_entry(armed, index))
            self._recorder.publish(self._plan_progress.progress_event())

    def _measure_entry(self, armed: ArmedBench, index: int) -> Repeat | None:
        """Measure one entry, again after a pause or if the protocol requests it."""
        entry = self._plan_progress.plan[index]
        while True:
            try:
                self._operator_actions.set_up(armed, entry.setup)
                self._recorder.publish(EntryStarted(index, entry.label, entry.key))
                self._pausable = True
                recordings, redo = self._executor.run_entry(self._protocol, index, entry, armed)
            except PauseInterrupt:
                self._pausable = False
                self._wait_at_rest(armed)
                continue
            except LevelQuestion as question:
                self._pausable = False
                self._ask_about_level(armed, question.event)
                continue
            except ScansLostError as error:
                self._pausable = False
                self._recover_from_lost_scans(armed, index, error)
                continue
            finally:
                self._pausable = False
            if redo is None and index not in self._lost_scans and any(r.quality & Quality.DROPPED for r in recordings):
                self._repeat_once(index, "scans are missing")
                continue
            if redo is not Repeat.THIS:
                break
        if redo is None:
            self._analyze_entry(armed, index, entry, recordings)
        return redo

    def _analyze_entry(self, armed: ArmedBench, index: int, entry: PlanEntry, recordings: Sequence[Recording]) -> None:
        results = self._protocol.results(entry.key, recordings, self._bench.simulated)
        try:
            point = self._executor.run_analysis(armed, partial(next, results))
        except ValueError as error:
            self._plan_progress.mark_failed(index)
            if entry.drives:
                self._executor.levels.point_measured(Quality.NO_RESPONSE)
            self._recorder.publish(LogMessage(f"{entry.label} gives no point: {error}"))
        else:
            self._recorder.publish(self._plan_progress.add_point(index, point))
            if entry.drives:
                self._executor.levels.point_measured(Quality(int(getattr(point, "quality", 0))))
            self._add_curves(self._analyze_curves(armed, index, entry, results))
            for warning in self._plan_progress.new_warnings():
                self._recorder.publish(LogMessage(warning))

    def _analyze_curves(
        self, armed: ArmedBench, index: int, entry: PlanEntry, results: Iterator[Any]
    ) -> tuple[ResultCurve, ...]:
        try:
            return tuple(
                replace(curve, entry=index) for curve in self._executor.run_analysis(armed, partial(tuple, results))
            )
        except ValueError as error:
            self._recorder.publish(LogMessage(f"{entry.label} gives no curve: {error}"))
            return ()

    def _add_curves(self, curves: Sequence[ResultCurve]) -> None:
        for curve in curves:
            self._plan_progress.add_curve(curve)
            self._recorder.notify(CurveReady(curve))

    def _recover_from_lost_scans(self, armed: ArmedBench, index: int, error: ScansLostError) -> None:
        """Start the acquisition again and return to rest, so that the entry can be measured again; once per entry."""
        if index in self._lost_scans or not isinstance(armed.stream, RestartableStream):
            raise error
        armed.stream.restart()
        armed.return_to_verified_rest()
        self._repeat_once(index, str(error))

    def _repeat_once(self, index: int, reason: str) -> None:
        self._lost_scans.add(index)
        label = self._plan_progress.plan[index].label
        self._recorder.publish(LogMessage(f"{label} is measured again, because scans were lost: {reason}"))

    def _wait_at_rest(self, armed: ArmedBench) -> None:
        rest = armed.return_to_verified_rest()
        self._recorder.publish(RunPaused(rest.message, self._protocol.high_voltage))
        while self._control.pause.is_set():
            self._check_interrupts()
            self._executor.discard_block(armed)
        self._recorder.publish(RunResumed())

    def _ask_about_level(self, armed: ArmedBench, event: LevelExceeded) -> None:
        """Return to rest and let the operator decide whether and how to proceed beyond an abort level."""
        rest = armed.return_to_verified_rest()
        self._recorder.publish(RunPaused(rest.message, self._protocol.high_voltage))
        answer = self._executor.ask_operator(level_prompt(event))
        if answer == LEVEL_ANSWERS[0]:
            raise RunCancelled(event.words)
        if answer == LEVEL_ANSWERS[2]:
            self._executor.levels.mute(event.level)
        self._recorder.publish(RunResumed())

    def _check_drift(self, armed: ArmedBench) -> None:
        """When resuming, measure the last good entry again to check for drift."""
        last = self._resume_state.drift_check_entry
        if last is None or last in self._resume_state.repeat_entries:
            return
        _, before = self._plan_progress.measured[last]
        self._measure_entry(armed, last)
        message, question = assess_drift(
            self._protocol, self._plan_progress.plan[last].label, before, self._plan_progress.measured[last][1]
        )
        self._recorder.publish(LogMessage(message))
        if question is not None and self._executor.ask_operator(question) != question.choices[0]:
            raise RunCancelled

    def _on_stream_started(self, armed: ArmedBench) -> None:
        self._armed = armed
        self._executor.attach(armed)
        self._run_file.start_stream(armed.rate_hz, armed.scales)
        self._recorder.publish(StreamStarted(armed.rate_hz, armed.scales))

    def _check_interrupts(self) -> None:
        """Publish external events; raise if cancel or pause is requested."""
        self._recorder.publish_external()
        if self._control.cancel.is_set():
            raise RunCancelled
        if self._pausable and self._control.pause.is_set():
            raise PauseInterrupt

    def _finish(self, status: RunStatus, reason: str) -> RunEnded:
        """Record how the run ended: in the file if it can be written, and always to the observers."""
        with contextlib.suppress(StorageError):
            self._recorder.publish_external()
        armed = self._armed
        rest = armed.final_rest if armed is not None else None
        if rest is not None:
            self._publish_always(RestMeasured(rest.confirmed, rest.measured_v, rest.message))
        elif status is RunStatus.UNSAFE or (armed is not None and armed.high_voltage_may_be_on):
            if status is not RunStatus.UNSAFE:  # the shutdown itself was interrupted
                status, reason = RunStatus.UNSAFE, f"{MANUAL_SHUTDOWN_INSTRUCTIONS}. The run had ended before: {reason}"
            self._publish_always(RestMeasured(False, math.nan, "rest could not be measured"))
        estimates: tuple[EstimatedQuantity, ...] = ()
        try:
            estimates = self._protocol.estimates(self._plan_progress.points)
        except BaseException as error:
            log.exception("the analysis failed")
            reason += f"; the analysis failed: {type(error).__name__}: {error}"
        try:
            self._run_file.check_presence()
        except StorageError as error:
            if status in (RunStatus.COMPLETED, RunStatus.STOPPED):
                status, reason = RunStatus.FAILED, str(error)
        verdict = self._judge(status, reason)
        self._report_clock_change()
        try:
            reason = self._run_file.finish(status, reason, estimates, self._plan_progress.curves, verdict)
        except StorageError as error:
            if status in (RunStatus.COMPLETED, RunStatus.STOPPED):
                status, reason = RunStatus.FAILED, str(error)
            verdict = Verdict.of_status(status, reason, verdict.checks)
            with contextlib.suppress(StorageError):
                self._run_file.close_after_error()
        self.path = self._run_file.path  # another one if the file was moved or deleted
        ended = RunEnded(status, reason, str(self.path), estimates, verdict)
        self._recorder.notify(ended)
        return ended

    def _report_clock_change(self) -> None:
        if message := self._clock_check.message():
            try:
                self._recorder.publish(LogMessage(message))
            except StorageError:
                self._recorder.notify(LogMessage(message))

    def _judge(self, status: RunStatus, reason: str) -> Verdict:
        progress = self._plan_progress
        try:
            return judge_ended(status, reason, self._protocol, progress.points, len(progress.plan), self._reference)
        except Exception as error:
            log.exception("the checks of the result failed")
            if status is not RunStatus.COMPLETED:
                return Verdict.of_status(status, reason)
            return Verdict(Outcome.DOUBTFUL, (f"the result could not be checked: {type(error).__name__}: {error}",))
