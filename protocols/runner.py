"""Carries one protocol out on an armed bench; owns storing, pausing, cancelling, prompting and the way to rest."""

import contextlib
import importlib
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import Any

from drivers.bench import Armed as ArmedBench
from drivers.bench import Bench
from drivers.errors import BenchError, UnsafeError
from drivers.ports import Block
from protocols.continuation import Continuation, drifted
from protocols.events import (
    Armed,
    AtRest,
    BlockTaken,
    CurveReady,
    EntryBegan,
    Event,
    GoingToRest,
    Noted,
    Paused,
    PointMeasured,
    Progressed,
    Resumed,
    RunEnded,
    RunStarted,
    Status,
    StreamStarted,
)
from protocols.executor import Executor
from protocols.operator import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE, Operator
from protocols.protocol import Protocol, extended
from protocols.rehearsal import rehearse
from protocols.runfile import RunFile
from protocols.steps import Prompt, Redo
from protocols.storing import StoreError
from protocols.values import Curve, Estimate, Planned, Recording

log = logging.getLogger(__name__)

Observer = Callable[[Event], None]

NUMERICS = ("scipy.fft", "scipy.optimize", "scipy.signal")
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

    Every event is stored first and then told to the observers. A store error fails the run; an observer error is
    logged and never does. `cancel` and `pause` may be set from any thread; they are looked at after every block and in
    every wait. A paused run goes to rest, and measures the interrupted entry from its beginning once it goes on.
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
    ) -> None:
        self._protocol, self._bench, self._store = protocol, bench, store
        self._observers = tuple(observers)
        self._cancel, self._pause = cancel or threading.Event(), pause or threading.Event()
        self._continuation = continuation or Continuation()
        self._prepare = tuple(prepare)
        self._begin_s = bench.clock.now()
        self._armed: ArmedBench | None = None
        self._store_error: StoreError | None = None
        self._plan: list[Planned] = []
        self._measured: dict[int, tuple[int, Any]] = {}
        """Row in the file and point, by entry."""
        self._curves: dict[int, tuple[Curve, ...]] = {}
        self._remarked: set[str] = set()
        self._without: list[str] = []
        """Entries that gave no point."""
        self._todo: list[int] = []
        self._setup: Prompt | None = None
        self._pausable = False
        self._expired = bench.sensor.expired(datetime.now(UTC).date())
        self._executor = Executor(bench, store, operator, self._publish, self._tell, self._look_up, self._expired)

    def run(self) -> tuple[Status, str]:
        """Carry the protocol out; how it ended and why, in a sentence. Never raises."""
        try:
            self._begin()
            protocol = self._protocol
            with self._bench.armed(
                protocol.sample_rate_hz, self._take, self, self._started, protocol.high_voltage
            ) as armed:
                self._publish(Armed(protocol.high_voltage))
                try:
                    self._carry_out(armed)
                finally:
                    self._tell(GoingToRest())
            status, reason = Status.COMPLETED, self._all_done()
        except Cancelled:
            done = f"{len(self._measured)} of {len(self._plan)} points"
            status, reason = Status.STOPPED, f"stopped by the operator after {done}"
        except UnsafeError as error:
            status, reason = Status.UNSAFE, str(error)
            if isinstance(error.__cause__, (BenchError, StoreError)):
                reason += f" The run had failed before: {error.__cause__}"
        except (BenchError, StoreError) as error:
            status, reason = Status.FAILED, str(error)
        except KeyboardInterrupt:
            status, reason = Status.STOPPED, f"interrupted after {len(self._measured)} points"
        except Exception as error:
            log.exception("the run failed by an error of this program")
            status, reason = Status.FAILED, f"an error of this program: {type(error).__name__}: {error}"
        return self._finish(status, reason)

    # -- the operator's switch: a HighVoltageSwitch whose hands are prompts --------------------------------------------

    def disable(self) -> None:
        self._executor.ask(DISABLE_HIGH_VOLTAGE)

    def enable(self) -> None:
        self._executor.ask(ENABLE_HIGH_VOLTAGE)

    # -- entries -------------------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        rehearsal = rehearse(
            self._protocol, self._bench.amplifier, meters=self._bench.meters, folder=self._store.path.parent
        )
        self._plan = list(self._protocol.plan(self._bench.amplifier.map.rest_v))
        path = str(self._store.path)
        self._publish(
            RunStarted(self._protocol.name, path, rehearsal.duration_s, rehearsal.entries, self._bench.simulated)
        )
        for words in (self._bench.watchdog.words, self._expired, self._continuation.words):
            if words:
                self._publish(Noted(words))
        for numerics in NUMERICS:
            importlib.import_module(numerics)
        for entry, point in self._continuation.points:
            self._keep(entry, point)
        for curve in self._continuation.curves:
            self._curves[curve.entry] = (*self._curves.get(curve.entry, ()), curve)
            self._tell(CurveReady(curve))

    def _carry_out(self, armed: ArmedBench) -> None:
        self._extend()
        again = self._continuation.again
        self._todo = [i for i in range(len(self._plan)) if i not in self._measured or i in again]
        self._progress()
        with self._hands(armed, any(prompt.hands_on for prompt in self._prepare)):
            for prompt in self._prepare:
                self._executor.ask(prompt)
        self._check_drift(armed)
        while self._todo:
            index = self._todo.pop(0)
            if self._entry(armed, index) is Redo.PREVIOUS and index > 0:
                self._todo[:0] = [index - 1, index]
            if not self._todo:
                self._todo = list(range(len(self._plan), self._extend()))
            self._progress()

    def _extend(self) -> int:
        """Ask the protocol for further entries while all so far are measured; the length of the plan."""
        points = {entry: point for entry, (_, point) in self._measured.items()}
        self._plan = list(extended(self._protocol, self._plan, points, self._bench.amplifier.map.rest_v))
        return len(self._plan)

    def _entry(self, armed: ArmedBench, index: int) -> Redo | None:
        """Measure one entry, as often as pauses and the protocol ask for it."""
        entry = self._plan[index]
        while True:
            try:
                self._set_up(armed, entry.setup)
                self._publish(EntryBegan(index, entry.label, entry.key))
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
            self._without.append(entry.label)
            self._publish(Noted(f"{entry.label} gives no point: {error}"))
        else:
            self._keep(index, point)
            self._curves[index] = self._curves_of(armed, index, entry, results)
            for curve in self._curves[index]:
                self._tell(CurveReady(curve))
            for words in self._protocol.remarks([self._measured[i][1] for i in sorted(self._measured)]):
                if words not in self._remarked:
                    self._remarked.add(words)
                    self._publish(Noted(words))

    def _curves_of(self, armed: ArmedBench, index: int, entry: Planned, results: Iterator[Any]) -> tuple[Curve, ...]:
        try:
            return tuple(replace(curve, entry=index) for curve in self._executor.think(armed, partial(tuple, results)))
        except ValueError as error:
            self._publish(Noted(f"{entry.label} gives no curve: {error}"))
            return ()

    def _keep(self, entry: int, point: Any) -> None:
        row = self._store.point(point, entry)
        replaces, _ = self._measured.get(entry, (None, None))
        if replaces is not None:
            self._store.supersede(replaces)
        self._measured[entry] = (row, point)
        self._publish(PointMeasured(row, point, entry, replaces))

    def _set_up(self, armed: ArmedBench, setup: Prompt | None) -> None:
        """Have a person set up what the entry needs, where that is not what stands there."""
        if setup is None or setup == self._setup:
            return
        self._setup = None
        with self._hands(armed, setup.hands_on):
            self._executor.ask(setup)
        self._setup = setup

    def _hands(self, armed: ArmedBench, on: bool) -> contextlib.AbstractContextManager[None]:
        """High voltage off while hands are on the specimen, where it has high voltage at all."""
        return armed.hands_on(self) if on and self._protocol.high_voltage else contextlib.nullcontext()

    def _wait_at_rest(self, armed: ArmedBench) -> None:
        rest = armed.to_rest()
        self._publish(Paused(rest.words))
        while self._pause.is_set():
            self._look_up()
            self._executor.skip(armed)
        self._publish(Resumed())

    def _check_drift(self, armed: ArmedBench) -> None:
        """After an interruption, measure the last good entry again before going on."""
        last = self._continuation.check
        if last is None or last in self._continuation.again:
            return
        _, before = self._measured[last]
        self._entry(armed, last)
        _, now = self._measured[last]
        words, question = drifted(self._protocol, self._plan[last].label, before, now)
        self._publish(Noted(words))
        if question is not None and self._executor.ask(question) != question.choices[0]:
            raise Cancelled

    def _all_done(self) -> str:
        if not self._without:
            return "all points measured"
        return f"{len(self._measured)} of {len(self._plan)} points; none from {', '.join(self._without)}"

    # -- blocks and events ---------------------------------------------------------------------------------------------

    def _started(self, armed: ArmedBench) -> None:
        self._armed = armed
        self._executor.started(armed)
        self._store.begin(armed.rate_hz, armed.scales)
        self._publish(StreamStarted(armed.rate_hz, armed.scales))

    def _take(self, block: Block) -> None:
        """The bench's sink: into the file, then to the observers."""
        row = self._store.block(block, self._now())
        self._tell(BlockTaken(block, row))

    def _now(self) -> float:
        return self._bench.clock.now() - self._begin_s

    def _progress(self) -> None:
        left = [self._plan[i] for i in self._todo]
        label = left[0].label if left else "done"
        left_s = sum(entry.expected_s for entry in left)
        self._publish(Progressed(len(self._plan) - len(left), len(self._plan), left_s, label))

    def _publish(self, event: Event) -> None:
        """Store an event, then tell it. After the store failed once, only tell."""
        if self._store_error is None:
            try:
                self._store.event(event, self._now())
            except StoreError as error:
                self._store_error = error
                raise
        self._tell(event)

    def _tell(self, event: Event) -> None:
        for observer in self._observers:
            try:
                observer(event)
            except Exception:
                log.exception("an observer failed on %s", type(event).__name__)

    def _look_up(self) -> None:
        """Whether somebody wants something else than to go on."""
        if self._cancel.is_set():
            raise Cancelled
        if self._pausable and self._pause.is_set():
            raise PauseAsked

    def _finish(self, status: Status, reason: str) -> tuple[Status, str]:
        """Say how it ended: in the file while it can be written, to the observers in any case."""
        rest = self._armed.rest if self._armed is not None else None
        if rest is not None:
            event = AtRest(rest.confirmed, rest.measured_v, rest.words)
            try:
                self._publish(event)
            except StoreError:
                self._tell(event)  # whether it is safe must be heard, full disk or not
        estimates: tuple[Estimate, ...] = ()
        try:
            estimates = self._protocol.estimates([self._measured[i][1] for i in sorted(self._measured)])
        except Exception as error:
            log.exception("the analysis failed")
            reason += f"; the analysis failed: {type(error).__name__}: {error}"
        try:
            curves = [curve for index in sorted(self._curves) for curve in self._curves[index]]
            reason = self._store.finish(status, reason, estimates, curves)
        except StoreError as error:
            if status in (Status.COMPLETED, Status.STOPPED):
                status, reason = Status.FAILED, str(error)
            with contextlib.suppress(StoreError):
                self._store.abandon()
        self._tell(RunEnded(status, reason, str(self._store.path), estimates))
        return status, reason
