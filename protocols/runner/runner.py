"""Runner: runs one protocol on an armed bench, with pause, cancel and the way to rest."""

import contextlib
import importlib
import os
import threading
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from drivers import (
    DISPLACEMENT_CHANNEL,
    MEMORY_SHORT,
    ArmedBench,
    Bench,
    BenchError,
    LiveWarning,
    is_memory_short,
    live_warning,
    longest_unmoved_s,
    safety_statement,
)
from protocols.base import (
    BenchArmed,
    ChannelCalibration,
    EventBus,
    InterferenceLine,
    InterferenceMeasured,
    LogMessage,
    Operator,
    Quality,
    ReferenceModel,
    RunConditions,
    RunEnded,
    RunStarted,
    RunStatus,
    ShutdownStarted,
    SpecimenMayBeLive,
    StopOffered,
    StreamStarted,
)
from protocols.history import with_history
from protocols.rehearsal import AdaptedProtocol, CannotRunError, adapt_to_source, rehearse
from protocols.runfile import RunFileWriter, RunRecord, StorageError
from protocols.runner.acquisition import RunAcquisition
from protocols.runner.air import air_columns
from protocols.runner.conclusion import RunConclusion, describe_code_error, describe_end
from protocols.runner.entries import EntryRunner
from protocols.runner.executor import StepExecutor
from protocols.runner.operator_actions import OperatorActions, OperatorPrompts
from protocols.runner.plan_progress import PlanProgress
from protocols.runner.publisher import InterruptCheck, RunCancelled, RunRecorder
from protocols.runner.request import RunControl, RunRequest
from protocols.runner.unattended import check_unattended
from protocols.signals import find_lines, folded_frequencies, mark_folded

PRELOADED_MODULES = ("scipy.fft", "scipy.interpolate", "scipy.optimize")
"""Modules imported before the card runs: importing at the first fit would delay the run by a second or two."""

STATED_WAIT_S = 2.0
"""Duration above which the way to rest is announced."""

WAITING_TEXT = "This source can only wait for the end of its drive: at rest in {:.1f} s"

SECOND_RATE_SHARE = 0.87
"""Second rate divided by the run's; no small ratio of integers, at which a folded line could keep its frequency."""


def _adapted(request: RunRequest, bench: Bench) -> AdaptedProtocol:
    """Return the protocol that the source can play, with expected values from the specimen's history."""
    adapted = adapt_to_source(request.protocol, bench.amplifier)
    return with_history(adapted, request.folder, request.specimen, bench.simulated)


def initial_record(
    request: RunRequest, bench: Bench, reference: ReferenceModel, adapted: AdaptedProtocol | None = None
) -> RunRecord:
    """Return the record of the run file before the begin of the run."""
    adapted = adapted or AdaptedProtocol(request.protocol)
    protocol = adapted.protocol
    return RunRecord(
        protocol=protocol.name,
        title=f"{protocol.title} of {request.specimen}",
        parameters=protocol.model_dump(mode="json"),
        axes=protocol.axes,
        default_plot=protocol.default_plot,
        sensor=bench.sensor,
        configuration=bench.configuration,
        simulated=bench.simulated,
        specimen=request.specimen,
        requested=adapted.requested,
        # Relative, so that a folder of runs can be moved.
        continues=os.path.relpath(request.resume.path, request.folder) if request.resume else "",
        reference=reference.as_record(),
        mountings=request.mountings,
        conditions=request.conditions or RunConditions(),
    )


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
        # A resumed run keeps the parameters of its file.
        self._adapted = AdaptedProtocol(request.protocol) if request.resume else _adapted(request, bench)
        self._protocol, self._bench, self._preparation = self._adapted.protocol, bench, request.prepare
        self._resumed, self._specimen = request.resume, request.specimen
        # The model of the free specimen, behind this bench's amplifier.
        reference = replace(request.reference or ReferenceModel(), amplifier=bench.amplifier.map)
        record = initial_record(request, bench, reference, self._adapted)
        self._run_file = RunFileWriter.new(
            request.folder, record, self._protocol.point_type, bench.channels, bench.hold_s, air_columns(bench)
        )
        self.path = self._run_file.path
        self._armed: ArmedBench | None = None
        self._ended: RunEnded | None = None
        self._concluding = threading.Lock()
        self.at_end = False
        """Whether the run computes or stores its result. Any thread."""
        warnings = (bench.sensor.expiry_warning(datetime.now(UTC).date()), request.calibration_warning)
        self._calibration_warning = ". ".join(filter(None, warnings))
        self._notes = request.notes
        self._control = control = control or RunControl()
        self._recorder = RunRecorder(self._run_file, events or EventBus(), bench.clock, control.external_events)
        self._plan_progress = PlanProgress(self._protocol, self._run_file, bench.amplifier.map.rest_v)
        self._interrupts = interrupts = InterruptCheck(control, self._recorder)
        self._acquisition = RunAcquisition(bench, self._recorder, interrupts.check)
        for level in self._protocol.diagnosed_levels:
            self._acquisition.levels.mute(level)
        who = record.conditions.operator
        self._prompts = prompts = OperatorPrompts(operator, self._recorder, self._acquisition, who)
        self._operator_actions = OperatorActions(prompts, self._protocol.high_voltage)
        self._executor = StepExecutor(
            bench, self._run_file, self._recorder, self._acquisition, prompts, self._calibration_warning
        )
        self._entries = EntryRunner(
            self._protocol,
            bench.simulated,
            self._acquisition,
            prompts,
            self._executor,
            self._recorder,
            self._plan_progress,
            self._operator_actions,
            interrupts,
        )
        self._conclusion = RunConclusion(self._protocol, reference, self._run_file, self._recorder, self._plan_progress)

    @property
    def may_be_live(self) -> bool:
        """Whether high voltage may be on, and rest has not been measured at the end. Any thread."""
        armed = self._armed
        if armed is None:
            return self._bench.high_voltage_enabled and not self.at_end
        return armed.high_voltage_may_be_on and armed.final_rest is None

    def live_warning(self, reason: str) -> SpecimenMayBeLive:
        """Return the warning that the specimen may be live, for another thread. It is not stored: the disk may hang, too."""
        warning = live_warning(reason, self._bench.reading, self._bench.amplifier.map)
        return SpecimenMayBeLive(warning.low_v, warning.high_v, warning.message, warning.part, warning.age_s)

    def give_up(self, status: RunStatus, reason: str) -> RunEnded:
        """Conclude from another thread a run whose own thread does not return; it publishes nothing afterwards."""
        ended = self._conclude(status, reason)
        self._recorder.notify = EventBus().publish
        return ended

    def _conclude(self, status: RunStatus, reason: str) -> RunEnded:
        """Conclude the run, once."""
        with self._concluding:
            self.at_end = True
            if self._ended is None:
                measured = self._executor.interference, self._executor.air.estimates()
                self._ended = self._conclusion.conclude(status, reason, self._armed, *measured)
                self._acquisition.close()
                self._executor.air.close()
                self.path = self._run_file.path  # another one if the file was moved or deleted
        return self._ended

    def run(self) -> RunEnded:
        """Run the protocol; return the end and the verdict. Errors end the run and are reported in the result, not raised."""
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
                bench = self._bench
                statement = safety_statement(bench.amplifier, bench.watchdog, bench.interlock, armed.predicted_rest_s)
                self._recorder.publish(
                    BenchArmed(
                        protocol.high_voltage, armed.predicted_rest_s, statement if protocol.high_voltage else ""
                    )
                )
                try:
                    self._entries.run(armed, self._preparation, self._resumed)
                finally:
                    with contextlib.suppress(StorageError):
                        self._recorder.publish_external()
                    unmoved_s = longest_unmoved_s(self._bench.amplifier, armed.predicted_rest_s)
                    self._recorder.notify(ShutdownStarted(unmoved_s))
                    if (wait_s := self._bench.amplifier.stop_wait_s) > STATED_WAIT_S:
                        self._recorder.notify(LogMessage(WAITING_TEXT.format(wait_s)))
            self._report_folded_lines()
            status, reason = RunStatus.COMPLETED, self._plan_progress.outcome_message()
        except (RunCancelled, BenchError, StorageError, OSError, KeyboardInterrupt) as error:
            status, reason = describe_end(error, self._plan_progress, self._recorder.stopped_by)
        except BaseException as error:  # noqa: BLE001 - also SystemExit of a driver: the end of a run is always reported
            status, reason = RunStatus.FAILED, MEMORY_SHORT
            if not is_memory_short(error):
                reason = describe_code_error(error, self._protocol)
        return self._conclude(status, reason)

    def _report_folded_lines(self) -> None:
        """Measure the interference at a second sample rate, after confirmed rest; flag points at folded lines."""
        interference, armed = self._executor.interference, self._armed
        if interference is None or not interference.lines or armed is None:
            return
        try:
            lines = separate_folded_lines(self._bench, interference.lines, armed.rate_hz, self._protocol.rest_record_s)
        except (BenchError, ValueError) as error:
            self._recorder.publish(LogMessage(f"The test for interference folded back by sampling failed: {error}"))
            return
        if folded := tuple(line for line in lines if line.folded):
            self._recorder.publish(InterferenceMeasured(interference.rows, folded))
            labels = self._plan_progress.flag_points(
                Quality.FOLDED, lambda point: self._protocol.folded_onto(point, folded)
            )
            which = f" It lies on {', '.join(labels)}; their errors include it." if labels else ""
            self._recorder.publish(
                LogMessage(
                    f"Interference from above half the sample rate is folded back.{which} Measure with another sample rate, or "
                    "with a filter before the card"
                )
            )

    def _start(self) -> None:
        rehearsal = rehearse(
            self._protocol,
            self._bench.amplifier,
            sensor=self._bench.sensor,
            meters=self._bench.meters,
            channels=self._bench.channels,
            folder=self._run_file.path.parent,
            adapt=False,
        )
        unattended, stop_url = check_unattended(self._protocol, self._bench, self._control.offer_stop)
        if self._protocol.air_target and "air_temperature" not in air_columns(self._bench):
            raise CannotRunError(
                f"the run is to wait for {self._protocol.air_target}, and the bench has no sensor of the air: add [environment], or a channel of "
                "the kind temperature, to the bench file, or set air_within_k to 0"
            )
        self._limit_duration()
        self._plan_progress.build_plan()
        path = str(self._run_file.path)
        self._recorder.publish(
            RunStarted(
                self._protocol.name,
                path,
                rehearsal.duration_s,
                rehearsal.entries,
                self._bench.simulated,
                self._specimen,
            )
        )
        self._recorder.publish_external()  # faults injected before the begin of the run
        bench = self._bench
        for message in (
            bench.watchdog.inactive_reason,
            bench.suspend_warning,
            bench.panel_warning,
            bench.commissioning_note if self._protocol.high_voltage else "",
            self._calibration_warning,
            *self._notes,
            self._adapted.message,
            self._resumed.message if self._resumed else "",
            unattended or self._unattended_message(),
        ):
            if message:
                self._recorder.publish(LogMessage(message))
        if stop_url:
            self._recorder.notify(StopOffered(stop_url))
        for numerics in PRELOADED_MODULES:
            importlib.import_module(numerics)
        if self._resumed is not None:
            for entry, point in self._resumed.points:
                air = self._resumed.air.get(entry, {}) if air_columns(bench) else {}
                self._recorder.publish(self._plan_progress.add_point(entry, point, air))
            self._entries.add_series(self._resumed.series)

    def _limit_duration(self) -> None:
        """End the run at its longest duration, where it has one."""
        if (limit := self._protocol.unattended_run) is None:
            return
        end_s, clock = self._bench.clock.now() + limit.longest_s, self._bench.clock
        reason = f"the unattended run has lasted its longest duration of {limit.longest_s:g} s; resume it, or state a longer one"
        self._interrupts.overtime = lambda: reason if clock.now() > end_s else ""

    def _unattended_message(self) -> str:
        """Return the consequence of an unreachable operator as text; empty if the operator can be asked, or no abort level asks."""
        why, asking = self._prompts.unreachable_reason, self._bench.levels.asking
        if not (why and asking):
            return ""
        return f"Nobody can answer: {why}. An abort level with the action 'ask' ({', '.join(asking)}) ends this run at rest"

    def _on_stream_started(self, armed: ArmedBench) -> None:
        self._armed = armed
        self._acquisition.attach(armed)
        self._run_file.start_stream(armed.rate_hz, armed.scales)
        self._recorder.publish(StreamStarted(armed.rate_hz, armed.scales))

    def _warn_of_live_specimen(self, warning: LiveWarning) -> None:
        self._recorder.publish_always(
            SpecimenMayBeLive(warning.low_v, warning.high_v, warning.message, warning.part, warning.age_s)
        )


def separate_folded_lines(
    bench: Bench, lines: tuple[InterferenceLine, ...], rate_hz: float, duration_s: float
) -> tuple[InterferenceLine, ...]:
    """Return the lines with the true frequencies of lines folded by the sample rate, by a recording at a second rate.

    The card is read again after the run, at confirmed rest: a folded line has another frequency at another rate. Nothing is
    commanded; the displacement is read for `duration_s`.

    Raises:
        BenchError: the card cannot be read at the second rate, or the displacement is not valid.
    """
    parts, quality, count = [], Quality.GOOD, 0
    with bench.open_stream(SECOND_RATE_SHARE * rate_hz) as stream:
        channel = ChannelCalibration.pair(stream.scales, bench.sensor)[DISPLACEMENT_CHANNEL]
        while count < duration_s * stream.rate_hz:
            counts = stream.read().raw[DISPLACEMENT_CHANNEL]
            quality |= channel.quality(counts)
            parts.append(channel.to_si(counts))
            count += counts.size
        second_rate_hz = stream.rate_hz
    if not quality.usable:
        raise BenchError(f"the displacement at rest is {quality.description}")
    seen = find_lines(np.concatenate(parts), second_rate_hz)
    return mark_folded(lines, folded_frequencies(lines, rate_hz, seen, second_rate_hz, 1 / duration_s))
