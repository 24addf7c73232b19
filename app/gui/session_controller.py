"""What the operator wants, told to the bench first and then to the screen; and what the bench tells, as the view to be shown."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Signal

from app.live.session_link import Link
from app.session.messages import title_of
from app.session.reducer import reduce
from app.session.state import Acknowledged, ConnectAsked, Heard, PauseAsked, RunAsked, StopAsked, View, ViewEvent
from protocols.base.protocol import Protocol

if TYPE_CHECKING:
    from app.campaign.queue import Conductor, Order


class Helm(QObject):
    """Between window and session. Nothing new is begun once somebody is leaving."""

    changed = Signal()
    """`view` is another one."""

    def __init__(self, link: Link, view: View, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.link, self.view, self.leaving = link, view, False

    @property
    def ready(self) -> bool:
        """Whether a run may begin."""
        return self.view.can_run and not self.leaving

    def hear(self) -> None:
        """Take what happened since this was last called."""
        view = self.view
        for heard in self.link.heard():
            view = reduce(view, heard)
        if view is not self.view:
            self.view = view
            self.changed.emit()

    # -- what the operator wants ---------------------------------------------------------------------------------------

    def run(self, protocol: Protocol, folder: Path, specimen: str) -> None:
        """Begin a run."""
        if self.ready:
            self._tell(RunAsked(protocol.title))
            self.link.session.run(protocol, folder, specimen or "unnamed")

    def carry_out(self, order: Order, conductor: Conductor) -> None:
        """Begin a run of a campaign."""
        self._tell(RunAsked(order.protocol.title))
        conductor.give(self.link.session, order)

    def measure_again(self, entries: tuple[int, ...], folder: Path) -> None:
        """Measure some points of the last run again, into a run that goes on with it. The session reads that run."""
        outcome = self.view.outcome
        if outcome is not None and outcome.path and self.ready:
            path = Path(outcome.path)
            self._tell(RunAsked(title_of(self.view.protocol), reads=path.name))
            self.link.session.measure_again(path, entries, folder)

    def stop(self) -> None:
        """Go to rest and end the run. The bench hears it first, then the screen."""
        self.link.session.stop()
        self._tell(StopAsked())

    def pause(self) -> None:
        """Go to rest and wait there, or go on."""
        if not self.view.can_pause or self.view.pausing:
            return
        if self.view.paused:
            self.link.session.resume()
        else:
            self.link.session.pause()
        self._tell(PauseAsked())

    def answer(self, words: str = "done") -> None:
        """The operator has done what the prompt says, or chosen another of its answers."""
        if self.view.prompt is not None and self.link.mailbox.waiting == self.view.prompt.ask_id:
            self.link.mailbox.reply(self.view.prompt.ask_id, words)

    def acknowledge(self) -> None:
        """The operator has read the unsafe sentence, or why something failed."""
        self._tell(Acknowledged())

    def connect_again(self) -> None:
        """Open the bench once more."""
        if self.link.reconnect():
            self._tell(ConnectAsked())
            self.link.session.start()

    def leave(self) -> None:
        """Go to rest and let go of the bench; returns at once."""
        self.leaving = True
        self._tell(StopAsked())
        self.link.session.close(0.0)

    def _tell(self, event: ViewEvent) -> None:
        self.view = reduce(self.view, Heard(event, datetime.now().astimezone(), self.link.feed.streamed_s))
        self.changed.emit()
