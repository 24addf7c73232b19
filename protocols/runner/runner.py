"""Carries one protocol out on an armed bench: the order of things, pausing, cancelling, and the way to rest."""

import contextlib
import importlib
import logging
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from queue import SimpleQueue
from typing import Any

from drivers.bench.bench import Armed as ArmedBench
from drivers.bench.bench import Bench
from drivers.errors import BenchError, UnsafeError
from protocols.base.events import (
    Armed,
    AtRest,
    CurveReady,
    EntryBegan,
    Event,
    GoingToRest,
    Noted,
    Paused,
    Resumed,
    RunEnded,
    RunStarted,
    Status,
    StreamStarted,
)
from protocols.base.operator import Operator
from protocols.base.protocol import Protocol
from protocols.base.records import Curve, Estimate, Planned, Recording
from protocols.base.steps import Prompt, Redo
from protocols.rehearsal import rehearse
from protocols.resume import Continuation, drifted
from protocols.runfile.errors import StoreError
from protocols.runfile.writer import RunFile
from protocols.runner.executor import Executor
from protocols.runner.ledger import Ledger
from protocols.runner.operator_actions import Hands
from protocols.runner.publisher import Observer, Publisher

log = logging.getLogger(__name__)

NUMERICS = ("scipy.fft", "scipy.optimize")
"""Imported before the card runs: the first fit in mid-run would hold everything up for a second or two."""


class Cancelled(Exception):
    """Somebody asked the run to stop."""


class PauseAsked(Exception):
    """Somebody asked the run to pause."""


class Runner:
    r"""Runs one protocol once: created -> run() -> ended, in the thread that calls it.

    ::

        file open -> card running -> armed at rest -> entry after entry ... -> to rest, measured -> file finished
                 \_______________ any failure, Stop, Ctrl-C _______________/

    A store error fails the run; an observer's error never does (protocols.runner.publisher). `cancel` and `pause` may be set
    from any thread; they are looked at after every block and in every wait. A paused run goes to rest, and measures the
    interrupted entry from its beginning once it goes on.

    What happens to the bench from outside (`outside`: faults that somebody sets on purpose) is stored and told within a
    block.
    """

    def __init__(
        self,
        protocol: Protocol,
        bench: Bench,
        store: RunFile,
        operator: Operator,
        observers: Sequence[Observer] = (),
        cancel: threading.Event | None = None,
        pause: threading.Event | None = None,
        continuation: Continuation | None = None,
        prepare: Sequence[Prompt] = (),
        outside: SimpleQueue[Event] | None = None,
    ) -> None:
        self._protocol, self._bench, self._store = protocol, bench, store
        self._cancel, self._pause = cancel or threading.Event(), pause or threading.Event()
        self._continuation = continuation or Continuation()
        self._prepare = tuple(prepare)
        self._armed: ArmedBench | None = None
        self._pausable = False
        self._expired = bench.sensor.expired(datetime.now(UTC).date())
        self._events = Publisher(store, observers, bench.clock, outside)
        self._ledger = Ledger(protocol, store, bench.amplifier.map.rest_v)
        self._executor = Executor(bench, store, operator, self._events, self._look_up, self._expired)
        self._hands = Hands(self._executor, protocol.high_voltage)

    def run(self) -> tuple[Status, str]:
        """Carry the protocol out; how it ended and why, in a sentence. Never raises."""
        try:
            self._begin()
            protocol = self._protocol
            with self._bench.armed(
                protocol.sample_rate_hz, self._events.take, self._hands, self._started, protocol.high_voltage
            ) as armed:
                self._events.publish(Armed(protocol.high_voltage))
                try:
                    self._carry_out(armed)
                finally:
                    with contextlib.suppress(StoreError):
                        self._events.publish_outside()
                    self._events.tell(GoingToRest())
            status, reason = Status.COMPLETED, self._ledger.outcome()
        except Cancelled:
            done = f"{self._ledger.measured} of {self._ledger.planned} points"
            status, reason = Status.STOPPED, f"stopped by the operator after {done}"
        except UnsafeError as error:
            status, reason = Status.UNSAFE, str(error)
            if isinstance(error.__cause__, (BenchError, StoreError)):
                reason += f" The run had failed before: {error.__cause__}"
        except (BenchError, StoreError) as error:
            status, reason = Status.FAILED, str(error)
        except KeyboardInterrupt:
            status, reason = Status.STOPPED, f"interrupted after {self._ledger.measured} points"
        except Exception as error:
            log.exception("the run failed by an error of this program")
            status, reason = Status.FAILED, f"an error of this program: {type(error).__name__}: {error}"
        return self._finish(status, reason)

    def _begin(self) -> None:
        rehearsal = rehearse(
            self._protocol, self._bench.amplifier, meters=self._bench.meters, folder=self._store.path.parent
        )
        self._ledger.begin()
        path = str(self._store.path)
        self._events.publish(
            RunStarted(self._protocol.name, path, rehearsal.duration_s, rehearsal.entries, self._bench.simulated)
        )
        self._events.publish_outside()  # what was broken before
        for words in (self._bench.watchdog.words, self._expired, self._continuation.words):
            if words:
                self._events.publish(Noted(words))
        for numerics in NUMERICS:
            importlib.import_module(numerics)
        for entry, point in self._continuation.points:
            self._events.publish(self._ledger.keep(entry, point))
        self._keep_curves(self._continuation.curves)

    def _carry_out(self, armed: ArmedBench) -> None:
        self._ledger.leave(self._continuation.again)
        self._events.publish(self._ledger.progress())
        self._hands.prepare(armed, self._prepare)
        self._check_drift(armed)
        while (index := self._ledger.next()) is not None:
            self._ledger.done(index, self._entry(armed, index))
            self._events.publish(self._ledger.progress())

    def _entry(self, armed: ArmedBench, index: int) -> Redo | None:
        """Measure one entry, as often as pauses and the protocol ask for it."""
        entry = self._ledger.entry(index)
        while True:
            try:
                self._hands.set_up(armed, entry.setup)
                self._events.publish(EntryBegan(index, entry.label, entry.key))
                self._pausable = True
                recordings, redo = self._executor.carry_out(self._protocol, index, entry, armed)
            except PauseAsked:
                self._pausable = False
                self._wait_at_rest(armed)
                continue
            finally:
                self._pausable = False
            if redo is not Redo.THIS:
                break
        if redo is None:
            self._make_point(armed, index, entry, recordings)
        return redo

    def _make_point(self, armed: ArmedBench, index: int, entry: Planned, recordings: Sequence[Recording]) -> None:
        results = self._protocol.results(entry.key, recordings, self._bench.simulated)
        try:
            point = self._executor.think(armed, partial(next, results))
        except ValueError as error:
            self._ledger.give_up(index)
            self._events.publish(Noted(f"{entry.label} gives no point: {error}"))
        else:
            self._events.publish(self._ledger.keep(index, point))
            self._keep_curves(self._curves_of(armed, index, entry, results))
            for words in self._ledger.remarks():
                self._events.publish(Noted(words))

    def _curves_of(self, armed: ArmedBench, index: int, entry: Planned, results: Iterator[Any]) -> tuple[Curve, ...]:
        try:
            return tuple(replace(curve, entry=index) for curve in self._executor.think(armed, partial(tuple, results)))
        except ValueError as error:
            self._events.publish(Noted(f"{entry.label} gives no curve: {error}"))
            return ()

    def _keep_curves(self, curves: Sequence[Curve]) -> None:
        for curve in curves:
            self._ledger.keep_curve(curve)
            self._events.tell(CurveReady(curve))

    def _wait_at_rest(self, armed: ArmedBench) -> None:
        rest = armed.to_rest()
        self._events.publish(Paused(rest.words, self._protocol.high_voltage))
        while self._pause.is_set():
            self._look_up()
            self._executor.skip(armed)
        self._events.publish(Resumed())

    def _check_drift(self, armed: ArmedBench) -> None:
        """After an interruption, measure the last good entry again before going on."""
        last = self._continuation.check
        if last is None or last in self._continuation.again:
            return
        before = self._ledger.point(last)
        self._entry(armed, last)
        words, question = drifted(self._protocol, self._ledger.entry(last).label, before, self._ledger.point(last))
        self._events.publish(Noted(words))
        if question is not None and self._executor.ask(question) != question.choices[0]:
            raise Cancelled

    def _started(self, armed: ArmedBench) -> None:
        self._armed = armed
        self._executor.started(armed)
        self._store.begin(armed.rate_hz, armed.scales)
        self._events.publish(StreamStarted(armed.rate_hz, armed.scales))

    def _look_up(self) -> None:
        """Whether somebody wants something else than to go on."""
        self._events.publish_outside()
        if self._cancel.is_set():
            raise Cancelled
        if self._pausable and self._pause.is_set():
            raise PauseAsked

    def _finish(self, status: Status, reason: str) -> tuple[Status, str]:
        """Say how it ended: in the file while it can be written, to the observers in any case."""
        with contextlib.suppress(StoreError):
            self._events.publish_outside()
        rest = self._armed.rest if self._armed is not None else None
        if rest is not None:
            event = AtRest(rest.confirmed, rest.measured_v, rest.words)
            try:
                self._events.publish(event)
            except StoreError:
                self._events.tell(event)  # whether it is safe must be heard, full disk or not
        estimates: tuple[Estimate, ...] = ()
        try:
            estimates = self._protocol.estimates(self._ledger.points)
        except Exception as error:
            log.exception("the analysis failed")
            reason += f"; the analysis failed: {type(error).__name__}: {error}"
        try:
            reason = self._store.finish(status, reason, estimates, self._ledger.curves)
        except StoreError as error:
            if status in (Status.COMPLETED, Status.STOPPED):
                status, reason = Status.FAILED, str(error)
            with contextlib.suppress(StoreError):
                self._store.abandon()
        self._events.tell(RunEnded(status, reason, str(self._store.path), estimates))
        return status, reason
