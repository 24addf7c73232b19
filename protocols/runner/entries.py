"""Entry runner: measures and analyses the entries of a plan, repeated after a pause, a question or lost scans."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivers import ArmedBench, LevelAction, ScansLostError
from protocols.base import (
    CyclesInterrupted,
    EntryStarted,
    LevelExceeded,
    LogMessage,
    PlanEntry,
    Prompt,
    Protocol,
    Quality,
    Recording,
    Repeat,
    RunPaused,
    RunResumed,
    Series,
    SeriesReady,
    point_quality,
)
from protocols.runner.abort_levels import LEVEL_ANSWERS, LevelExceededError, LevelQuestion, level_prompt, limit_prompt
from protocols.runner.acquisition import RunAcquisition
from protocols.runner.air import mean_air
from protocols.runner.executor import StepExecutor
from protocols.runner.operator_actions import OperatorActions, OperatorPrompts
from protocols.runner.plan_progress import PlanProgress
from protocols.runner.publisher import InterruptCheck, PauseInterrupt, RunCancelled, RunRecorder

if TYPE_CHECKING:
    from protocols.resume import ResumableRun


class EntryRunner:
    """Measures the entries of a plan one after the other.

    Args:
        simulated: whether the bench is simulated; then every point has a flag.
    """

    def __init__(
        self,
        protocol: Protocol,
        simulated: bool,
        acquisition: RunAcquisition,
        prompts: OperatorPrompts,
        executor: StepExecutor,
        recorder: RunRecorder,
        progress: PlanProgress,
        operator_actions: OperatorActions,
        interrupts: InterruptCheck,
    ) -> None:
        self._protocol, self._simulated = protocol, simulated
        self._acquisition, self._prompts, self._executor = acquisition, prompts, executor
        self._recorder, self._progress = recorder, progress
        self._operator_actions, self._interrupts = operator_actions, interrupts
        self._lost_scans: set[int] = set()
        """Entries measured again because of lost scans."""

    def run(self, armed: ArmedBench, preparation: Sequence[Prompt], resumed: "ResumableRun | None") -> None:
        """Measure every entry without a point, and the entries to repeat."""
        self._progress.queue_remaining(resumed.repeat_entries if resumed else ())
        for entry, driven in (resumed.driven if resumed else {}).items():
            self._executor.driven[entry] = driven
            self._recorder.publish(CyclesInterrupted(entry, driven))
        self._recorder.publish(self._progress.progress_event())
        self._operator_actions.prepare(armed, preparation)
        if (target := self._protocol.air_target) is not None:
            self._executor.wait_for_air(armed, target, self._tell_wait)
        if self._protocol.rest_record_s:
            self._executor.measure_interference(armed, self._protocol.rest_record_s)
        if resumed is not None:
            self._check_drift(armed, resumed)
        while (index := self._progress.next_entry()) is not None:
            self._progress.complete(index, self._measure_entry(armed, index))
            self._recorder.publish(self._progress.progress_event())

    def _tell_wait(self, text: str, left_s: float) -> None:
        """Publish the progress of a wait before the first entry, with the longest time that it may still take."""
        progress = self._progress.progress_event()
        self._recorder.notify(replace(progress, label=text, left_s=progress.left_s + left_s))

    def add_series(self, series: Sequence[Series]) -> None:
        """Store series of entries and publish them."""
        for one in series:
            self._progress.add_series(one)
            self._recorder.notify(SeriesReady(one))

    def _measure_entry(self, armed: ArmedBench, index: int) -> Repeat | None:
        """Measure one entry, repeated after a pause or on request of the protocol."""
        entry = self._progress.plan[index]
        while True:
            try:
                self._operator_actions.set_up(armed, entry.setup)
                self._recorder.publish(EntryStarted(index, entry.label, entry.key))
                self._interrupts.pausable = True
                recordings, redo = self._executor.run_entry(self._protocol, index, entry, armed)
            except PauseInterrupt:
                self._interrupts.pausable = False
                self._wait_at_rest(armed)
                continue
            except LevelQuestion as question:
                self._interrupts.pausable = False
                self._ask_about_level(armed, question.event)
                continue
            except ScansLostError as error:
                self._interrupts.pausable = False
                self._recover_from_lost_scans(armed, index, error)
                continue
            finally:
                self._interrupts.pausable = False
            if redo is None and index not in self._lost_scans and any(r.quality & Quality.DROPPED for r in recordings):
                self._repeat_once(index, "scans are missing")
                continue
            if redo is not Repeat.THIS:
                break
        if redo is None:
            self._analyze_entry(armed, index, entry, recordings)
        return redo

    # -- analysis ------------------------------------------------------------------------------------------------------

    def _analyze_entry(self, armed: ArmedBench, index: int, entry: PlanEntry, recordings: Sequence[Recording]) -> None:
        results = self._protocol.results(entry.key, recordings, self._simulated)
        recorded_s = sum((recording.rows[1] - recording.rows[0]) / recording.rate_hz for recording in recordings)
        try:
            point = self._acquisition.run_analysis(armed, partial(next, results), recorded_s)
        except ValueError as error:
            self._progress.mark_failed(index)
            if entry.drives:
                self._acquisition.levels.point_measured(Quality.NO_RESPONSE)
            self._recorder.publish(LogMessage(f"{entry.label} gives no point: {error}"))
        else:
            self._recorder.publish(self._progress.add_point(index, point, mean_air(recordings)))
            if entry.drives:
                self._acquisition.levels.point_measured(point_quality(point))
            self.add_series(self._analyze_series(armed, index, entry, results))
            for one in self._progress.drifts():
                self._recorder.notify(SeriesReady(one))
            for warning in self._progress.new_warnings():
                self._recorder.publish(LogMessage(warning))
            self._act_on_limits(armed)

    def _act_on_limits(self, armed: ArmedBench) -> None:
        """Act on the limits of the protocol's figures that are exceeded now, each once.

        Raises:
            LevelExceededError: the run ends.
            RunCancelled: the operator stops the run.
        """
        for event in self._progress.new_limits():
            self._recorder.publish(event)
            if event.action == LevelAction.REST:
                raise LevelExceededError(event.words)
            if event.action == LevelAction.ASK:
                self._ask_about_level(armed, event, limit_prompt(event))

    def _analyze_series(
        self, armed: ArmedBench, index: int, entry: PlanEntry, results: Iterator[Any]
    ) -> tuple[Series, ...]:
        try:
            return tuple(
                replace(one, entry=index) for one in self._acquisition.run_analysis(armed, partial(tuple, results))
            )
        except ValueError as error:
            self._recorder.publish(LogMessage(f"{entry.label} gives no series: {error}"))
            return ()

    def _check_drift(self, armed: ArmedBench, resumed: "ResumableRun") -> None:
        """Measure the last good entry again to check for drift."""
        last = resumed.drift_check_entry
        if last is None:
            return
        _, before = self._progress.measured[last]
        self._measure_entry(armed, last)
        message, question = resumed.assess_drift(
            self._progress.plan[last].label, before, self._progress.measured[last][1]
        )
        self._recorder.publish(LogMessage(message))
        if question is not None and self._prompts.ask(question) != question.choices[0]:
            raise RunCancelled

    # -- interruptions -------------------------------------------------------------------------------------------------

    def _wait_at_rest(self, armed: ArmedBench) -> None:
        rest = armed.return_to_verified_rest()
        self._recorder.publish(RunPaused(rest.message, self._protocol.high_voltage))
        while self._interrupts.is_pause_requested:
            self._interrupts.check()
            self._acquisition.discard_block(armed)
        self._recorder.publish(RunResumed())

    def _ask_about_level(self, armed: ArmedBench, event: LevelExceeded, prompt: Prompt | None = None) -> None:
        """Return to rest and ask the operator how to proceed after an exceeded abort level.

        Raises:
            LevelExceededError: the operator cannot be asked.
            RunCancelled: the operator stops the run.
        """
        rest = armed.return_to_verified_rest()
        if why := self._prompts.unreachable_reason:
            raise LevelExceededError(f"{event.words}. Nobody can answer how to proceed: {why}")
        self._recorder.publish(RunPaused(rest.message, self._protocol.high_voltage))
        answer = self._prompts.ask(prompt or level_prompt(event))
        if answer == LEVEL_ANSWERS[0]:
            raise RunCancelled(event.words)
        if answer == LEVEL_ANSWERS[2]:
            self._acquisition.levels.mute(event.level)
        self._recorder.publish(RunResumed())

    def _recover_from_lost_scans(self, armed: ArmedBench, index: int, error: ScansLostError) -> None:
        """Return to rest, so that the entry can be measured again; once per entry."""
        if index in self._lost_scans:
            raise error
        armed.return_to_verified_rest()
        self._repeat_once(index, str(error))

    def _repeat_once(self, index: int, reason: str) -> None:
        self._lost_scans.add(index)
        label = self._progress.plan[index].label
        self._recorder.publish(LogMessage(f"{label} is measured again, because scans were lost: {reason}"))
