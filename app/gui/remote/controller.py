"""Controller of the read-only web page: starts and stops its server in the background, and sends it snapshots of the window.

It also knows the address at which a phone can stop the present run, if that is enabled; the page of that is another one.
"""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject, QSettings, Signal

from app.gui.widgets import BackgroundWorker, at_end
from app.live import SessionAdapter
from app.session import SessionEvent, WindowState
from protocols.base import RunEnded, StopOffered

if TYPE_CHECKING:
    from app.remote import RemoteView

OFF, THIS_COMPUTER, NETWORK = "off", "this computer", "network"
MODES = {OFF: "off", THIS_COMPUTER: "for this computer only", NETWORK: "for the network, with a token"}
"""Who can read the page, as stored in the settings."""
DEFAULT_PORT, TOKEN_BYTES = 8462, 16
MODE_KEY, TOKEN_KEY, PORT_KEY = "remote/mode", "remote/token", "remote/port"


class RemoteController(QObject):
    """Owns the server of the page; off until it is chosen.

    Args:
        settings: where mode and token are stored.
        adapter: the bench of its session, and the time that was streamed.
        describe: returns specimen and next step of the campaign as texts.
    """

    changed = Signal()
    """`url`, `stop_url` or `problem` has changed."""

    def __init__(
        self, settings: QSettings, adapter: SessionAdapter, describe: Callable[[], tuple[str, str]], parent: QObject
    ) -> None:
        super().__init__(parent)
        self._settings, self._adapter, self._describe = settings, adapter, describe
        self._shown: tuple[WindowState, str, str] | None = None
        self._beat_s = time.monotonic()
        self._worker = BackgroundWorker("web page", self)
        at_end(self, self._stop_server)  # after its worker
        self.server: RemoteView | None = None
        """Made in the background when the page is first opened: its imports take some hundredths of a second."""
        self.url = self.stop_url = self.problem = ""
        mode = str(settings.value(MODE_KEY, OFF))
        self.mode = mode if mode in MODES else OFF
        adapter.events.subscribe(self._note_stop)
        if self.mode != OFF:
            self._apply()

    def set_mode(self, mode: str) -> None:
        """Choose who can read the page, now and for later starts."""
        self.mode = mode
        self._settings.setValue(MODE_KEY, mode)
        self._apply()

    def renew_token(self) -> None:
        """Make a new token: addresses with the present one are no longer valid."""
        self._settings.setValue(TOKEN_KEY, "")
        self._apply()

    def set_state(self, view: WindowState) -> None:
        """Show a window state."""
        self._shown = (view, *self._describe())

    def _note_stop(self, event: SessionEvent) -> None:
        """Note in the bench thread where the present run can be stopped."""
        url = event.url if isinstance(event, StopOffered) else "" if isinstance(event, RunEnded) else self.stop_url
        if url != self.stop_url:
            self.stop_url = url
            self.changed.emit()  # queued: it is another thread

    def _stop_server(self) -> None:
        if self.server is not None:
            self.server.stop()

    def beat(self) -> None:
        """Note that the window is alive."""
        self._beat_s = time.monotonic()

    def _apply(self) -> None:
        from secrets import token_urlsafe

        mode, token = self.mode, ""
        if mode == NETWORK:
            token = str(self._settings.value(TOKEN_KEY, "")) or token_urlsafe(TOKEN_BYTES)
            self._settings.setValue(TOKEN_KEY, token)
        port = int(str(self._settings.value(PORT_KEY, DEFAULT_PORT)))

        def work() -> str:
            from app.remote import RemoteView

            self.server = self.server or RemoteView(self._read)
            self.server.stop()
            if mode != OFF:
                self.server.start(token, port)
            return self.server.url

        def show(url: str, problem: str = "") -> None:
            self.url, self.problem = url, problem
            self.changed.emit()

        self._worker.submit(work, show, lambda error: show("", str(error)), latest_only="server")

    def _read(self) -> dict[str, Any]:
        """Return the state; called in threads of the server."""
        from app.remote import Snapshot, snapshot_record

        if self._shown is None:
            raise RuntimeError("the window has not been shown yet")
        adapter, now_s = self._adapter, time.monotonic()
        streamed_s, bench, age_s = adapter.feed.streamed_s, adapter.session.bench, now_s - self._beat_s
        return snapshot_record(Snapshot(*self._shown, streamed_s, bench, age_s, adapter.observation, now_s))
