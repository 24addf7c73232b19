"""Session controller: operator commands to the session, session events to the window state."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Signal

from app.identification import reference_model
from app.live import SessionAdapter
from app.session import OperatorAction, RunRequested, TimedEvent, WindowEvent, WindowState, protocol_title, reduce
from protocols.base import Protocol
from protocols.runner.request import RunRequest

if TYPE_CHECKING:
    from app.campaign import CampaignRunner


class SessionController(QObject):
    """Forwards commands to the session; starts nothing while the window is closing."""

    changed = Signal()
    """Emitted when `state` has changed."""

    def __init__(self, adapter: SessionAdapter, state: WindowState, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.adapter, self.state, self.closing, self._reconnecting = adapter, state, False, False

    @property
    def can_start(self) -> bool:
        """Whether a run may begin."""
        return self.state.can_run and not self.closing

    def process_events(self) -> None:
        """Reduce the events since the last call to the window state; give up a stopped session that hangs in a driver."""
        self.adapter.session.abandon_if_hung()
        if self._reconnecting and not self.closing and self.adapter.reconnect():
            self._reconnecting = False
            self.adapter.session.start()
        view = self.state
        for event in self.adapter.pending_events():
            view = reduce(view, event)
        if view is not self.state:
            self.state = view
            self.changed.emit()

    # -- commands ---------------------------------------------------------------------------------------

    def start_run(self, protocol: Protocol, folder: Path, specimen: str) -> None:
        """Start a run."""
        if self.can_start:
            self._apply(RunRequested(protocol.title))
            self._set_in_campaign(False)
            name = specimen or "unnamed"
            self.adapter.session.run(RunRequest(protocol, folder, name, reference=reference_model(folder, name)))

    def start_campaign_run(self, request: RunRequest, runner: CampaignRunner) -> None:
        """Start a run of a campaign."""
        self._apply(RunRequested(request.protocol.title))
        self._set_in_campaign(True)
        runner.submit(self.adapter.session, request)

    def repeat_entries(self, entries: tuple[int, ...], folder: Path) -> None:
        """Measure some entries of the last run again, in a run that continues it."""
        outcome = self.state.outcome
        if outcome is not None and outcome.path and self.can_start:
            path = Path(outcome.path)
            self._set_in_campaign(False)
            self._apply(RunRequested(protocol_title(self.state.protocol), resumed_file=path.name))
            self.adapter.session.repeat_entries(path, entries, folder)

    def stop(self) -> None:
        """Go to rest and end the run; the session is called before the window is updated."""
        self.adapter.session.stop()
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
        """Answer the present prompt."""
        if self.state.prompt is not None and self.adapter.mailbox.pending_id == self.state.prompt.ask_id:
            self.adapter.mailbox.reply(self.state.prompt.ask_id, choice)

    def acknowledge(self) -> None:
        """Acknowledge the unsafe message or the problem."""
        self._apply(OperatorAction.ACKNOWLEDGE)

    def reconnect(self) -> None:
        """Open the bench again."""
        if self.adapter.reconnect():
            self._apply(OperatorAction.RECONNECT)
            self.adapter.session.start()

    def change_speed(self, speed: float | None) -> None:
        """Connect to the simulated bench again at another speed, once the present session has released it."""
        if self.adapter.simulation is not None and self.can_start and speed != self.adapter.simulation.speed:
            self.adapter.simulation.speed = speed
            self._apply(OperatorAction.RECONNECT)
            self._reconnecting = True

    def close(self) -> None:
        """Go to rest and release the bench; returns immediately."""
        self.closing = True
        self._apply(OperatorAction.STOP)
        self.adapter.session.close(0.0)

    def _set_in_campaign(self, in_campaign: bool) -> None:
        if self.adapter.simulation is not None:
            self.adapter.simulation.in_campaign = in_campaign

    def _apply(self, event: WindowEvent) -> None:
        self.state = reduce(self.state, TimedEvent(event, datetime.now().astimezone(), self.adapter.feed.streamed_s))
        self.changed.emit()
