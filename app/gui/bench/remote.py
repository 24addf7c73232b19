"""Controller of the read-only web page: starts and stops its server in the background, and gives it what the window shows."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from PySide6.QtCore import QObject, QSettings, Signal

from app.gui.widgets import BackgroundWorker
from app.live import SessionAdapter
from app.remote.server import DEFAULT_PORT, RemoteView, new_token
from app.remote.snapshot import Snapshot, snapshot_record
from app.session import WindowState

OFF, THIS_COMPUTER, NETWORK = "off", "this computer", "network"
MODES = {OFF: "off", THIS_COMPUTER: "for this computer only", NETWORK: "for the network, with a token"}
"""Who can read the page, as stored in the settings."""
MODE_KEY, TOKEN_KEY, PORT_KEY = "remote/mode", "remote/token", "remote/port"


class RemoteController(QObject):
    """Owns the server of the page; off until it is chosen.

    Args:
        settings: where mode and token are stored.
        adapter: the bench of its session, and the time that was streamed.
        describe: returns specimen and next step of the campaign as texts.
    """

    changed = Signal()
    """`url` or `problem` has changed."""

    def __init__(
        self, settings: QSettings, adapter: SessionAdapter, describe: Callable[[], tuple[str, str]], parent: QObject
    ) -> None:
        super().__init__(parent)
        self._settings, self._adapter, self._describe = settings, adapter, describe
        self._snapshot: Snapshot | None = None
        self._beat_s = time.monotonic()
        self._worker = BackgroundWorker("web page", self)
        self.server = RemoteView(self._read)
        self.url = self.problem = ""
        mode = str(settings.value(MODE_KEY, OFF))
        self.mode = mode if mode in MODES else OFF
        if self.mode != OFF:
            self._apply()

    def set_mode(self, mode: str) -> None:
        """Choose who can read the page, now and for later starts."""
        self.mode = mode
        self._settings.setValue(MODE_KEY, mode)
        self._apply()

    def renew_token(self) -> None:
        """Make a new token: addresses with the present one are no longer valid."""
        self._settings.setValue(TOKEN_KEY, new_token())
        self._apply()

    def set_state(self, view: WindowState) -> None:
        """Show a window state."""
        self._snapshot = Snapshot(view, *self._describe())

    def beat(self) -> None:
        """Note that the window is alive."""
        self._beat_s = time.monotonic()

    def shutdown(self) -> None:
        """Close the server."""
        self._worker.close()
        self.server.stop()

    def _apply(self) -> None:
        mode, token = self.mode, ""
        if mode == NETWORK:
            token = str(self._settings.value(TOKEN_KEY, "")) or new_token()
            self._settings.setValue(TOKEN_KEY, token)
        port = int(str(self._settings.value(PORT_KEY, DEFAULT_PORT)))

        def work() -> str:
            self.server.stop()
            if mode != OFF:
                self.server.start(token, port)
            return self.server.url

        self._worker.submit(work, self._on_started, self._on_error, latest_only="server")

    def _on_started(self, url: str) -> None:
        self.url, self.problem = url, ""
        self.changed.emit()

    def _on_error(self, error: Exception) -> None:
        self.url, self.problem = "", str(error)
        self.changed.emit()

    def _read(self) -> dict[str, Any]:
        """Return the state; called in threads of the server."""
        snapshot = self._snapshot
        if snapshot is None:
            raise RuntimeError("the window has not been shown yet")
        session = self._adapter.session
        age_s = time.monotonic() - self._beat_s
        return snapshot_record(
            replace(snapshot, streamed_s=self._adapter.feed.streamed_s, bench=session.bench, age_s=age_s)
        )
