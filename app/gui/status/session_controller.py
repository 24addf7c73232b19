"""Session controller: operator commands to the session, session events to the window state."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Signal

from app.identification import reference_model
from app.live import CommissioningJob, SessionAdapter
from app.session import (
    BenchFailed,
    BenchOpened,
    CommissioningEnded,
    OperatorAction,
    RunRequested,
    StripView,
    WindowEvent,
    WindowState,
    observe,
    protocol_title,
    reduce,
    strip_view,
)
from protocols.base import UNNAMED, Protocol
from protocols.runner import RunRequest

if TYPE_CHECKING:
    from app.campaign import CampaignRunner


class SessionController(QObject):
    """Forwards commands to the session; starts nothing while the window is closing."""

    changed = Signal()
    """Emitted when `state` has changed."""

    def __init__(self, adapter: SessionAdapter, state: WindowState, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.adapter, self.state, self.closing, self._reconnecting = adapter, state, False, False
        self._queued: Callable[[], None] | None = None
        """Starts the run that begins when the bench is connected."""
        self.commissioning: CommissioningJob | None = None
        """The commissioning that has the bench; None if the session has it."""

    @property
    def can_start(self) -> bool:
        """Whether a run may begin."""
        return self.state.can_run and not self.closing

    def process_events(self) -> None:
        """Reduce the events since the last call to the window state."""
        if self.commissioning is not None:
            self._follow_commissioning(self.commissioning)
        if self.adapter.session.abandoned:
            self._reconnecting = False
        released = self._reconnecting and not self.closing and self.adapter.session.close(0.0)
        view = self.state
        for event in self.adapter.pending_events():
            if not (self._reconnecting and isinstance(event.event, BenchOpened)):  # the session that is being closed
                view = reduce(view, event)
        view = observe(view, self.adapter.observation, time.monotonic(), datetime.now().astimezone())
        if view is not self.state:
            self.state = view
            self.changed.emit()
        if released and self.adapter.reconnect():
            self._reconnecting = False
            self.adapter.session.start()
        if self._queued is not None and (self.can_start or not self.state.queued):
            start, self._queued = self._queued, None
            if self.state.queued:
                start()

    def strip(self) -> StripView:
        """Return the present contents of the strip."""
        adapter = self.adapter
        return strip_view(
            self.state, adapter.observation, time.monotonic(), adapter.feed.streamed_s, adapter.session.bench
        )

    @property
    def released(self) -> bool:
        """Whether the bench is released, after `close`."""
        session = self.adapter.session
        return self.commissioning is None and (session.close(0.0) or session.abandoned)

    def _follow_commissioning(self, job: CommissioningJob) -> None:
        """Start the commissioning when the session has released the bench, and connect again after it."""
        if not job.started:
            if self.adapter.session.abandoned:
                self.commissioning = None
            elif self.adapter.session.close(0.0):
                job.start()
        elif job.ended:
            self.commissioning = None
            if job.result is None:
                message, passed = f"Commissioning: {job.error}", False
            else:
                from protocols.commissioning import OutputVerdict, worst_verdict  # the job has imported it

                verdict = worst_verdict(job.result.result.checks)
                message, passed = f"Commissioning of {job.result.identity}: {verdict}", verdict is OutputVerdict.PASS
            self._apply(CommissioningEnded(message, passed))
            self._reconnecting = True

    # -- commands ---------------------------------------------------------------------------------------

    def start_run(self, protocol: Protocol, folder: Path, specimen: str) -> None:
        """Start a run; where the bench is still being connected, it begins then."""
        if self.state.can_queue and not self.closing:
            self._queued = partial(self.start_run, protocol, folder, specimen)
            self._apply(RunRequested(protocol.title))
        elif self.can_start:
            self._apply(RunRequested(protocol.title))
            self._set_in_campaign(False)
            name = specimen or UNNAMED
            self.adapter.session.run(RunRequest(protocol, folder, name, reference=reference_model(folder, name)))

    def start_campaign_run(self, request: RunRequest, runner: CampaignRunner) -> None:
        self._apply(RunRequested(request.protocol.title))
        self._set_in_campaign(True)
        runner.submit(self.adapter.session, request)

    def repeat_entries(self, entries: tuple[int, ...], folder: Path) -> None:
        """Measure some entries of the last run again, in a run that continues it."""
        outcome = self.state.outcome
        if outcome is not None and outcome.path:
            self.continue_run(Path(outcome.path), entries, folder, protocol_title(self.state.protocol))

    def continue_run(self, path: Path, entries: tuple[int, ...], folder: Path, title: str = "") -> None:
        """Measure the missing entries of a run, or some again, in a run that continues it."""
        if self.can_start:
            self._set_in_campaign(False)
            self._apply(RunRequested(title, resumed_file=path.name))
            self.adapter.session.repeat_entries(path, entries, folder)

    def commission(self, job: CommissioningJob) -> None:
        """Release the bench for a commissioning, and connect again after it."""
        if self.can_start:
            self._apply(RunRequested("Commissioning"))
            self.commissioning = job
            self.adapter.session.close(0.0)

    def stop(self) -> None:
        """Go to rest and end the run; the session is called before the window is updated."""
        self.adapter.session.stop()
        if self.commissioning is not None:
            self.commissioning.stop()
        self._apply(OperatorAction.STOP)

    def toggle_pause(self) -> None:
        """Pause at rest, or resume."""
        if not self.state.can_pause or self.state.pause_requested:
            return
        if self.state.paused:
            self.adapter.session.resume()
        else:
            self.adapter.session.pause()
        self._apply(OperatorAction.PAUSE)

    def answer_prompt(self, choice: str = "done") -> None:
        if self.state.prompt is not None and self.adapter.mailbox.pending_id == self.state.prompt.ask_id:
            self.adapter.mailbox.reply(self.state.prompt.ask_id, choice)

    def acknowledge(self) -> None:
        """Acknowledge the unsafe message or the problem."""
        self._apply(OperatorAction.ACKNOWLEDGE)

    def reconnect(self) -> None:
        """Open the bench again, once the present session has released it; not during a run."""
        if self.state.busy or self.closing or self._reconnecting:
            return
        if not self.adapter.session.close(0.0) and self.adapter.session.abandoned:
            self._apply(BenchFailed("A driver still hangs in this program: end it and start it again"))
            return
        self._reconnecting = True
        self._apply(OperatorAction.RECONNECT)

    def change_speed(self, speed: float | None) -> None:
        """Connect to the simulated bench again at another speed, once the present session has released it."""
        if self.adapter.simulation is not None and self.can_start and speed != self.adapter.simulation.speed:
            self.adapter.simulation.speed = speed
            self.reconnect()

    def close(self) -> None:
        """Go to rest and release the bench; returns immediately."""
        self.closing = True
        if self.commissioning is not None:
            self.commissioning.stop()
        self._apply(OperatorAction.STOP)
        self.adapter.session.close(0.0)

    def _set_in_campaign(self, in_campaign: bool) -> None:
        if self.adapter.simulation is not None:
            self.adapter.simulation.in_campaign = in_campaign

    def _apply(self, event: WindowEvent) -> None:
        self.state = reduce(self.state, self.adapter.timed(event))
        self.changed.emit()
