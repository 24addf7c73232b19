"""Heartbeat of the main window: a tick for every frame while something moves or is operated, and a slow one at rest."""

import time
from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtWidgets import QWidget

from app.gui.widgets import at_end

FRAME_MS = 16
REST_MS = 250
"""Longest interval at rest. Every block of the card triggers a tick by itself."""

LIVELY_S = 2.0
"""How long after an input of the user every frame is ticked: what was typed or dragged is drawn at once."""

INPUTS = (QEvent.Type.KeyPress, QEvent.Type.MouseButtonPress, QEvent.Type.MouseButtonRelease, QEvent.Type.Wheel)


class Heartbeat(QObject):
    """Calls `tick`.

    Args:
        window: whose inputs make it lively.
        tick: refreshes what changes between events.
        is_moving: whether every frame is drawn.
    """

    _woken = Signal()

    def __init__(self, window: QWidget, tick: Callable[[], object], is_moving: Callable[[], bool]) -> None:
        super().__init__(window)
        self._window, self._tick, self._is_moving = window, tick, is_moving
        self._lively_until_s = time.monotonic() + LIVELY_S
        self._is_woken = False
        self._timer = QTimer(self, interval=FRAME_MS, timerType=Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._beat)
        self._timer.start()
        at_end(self, self._timer.stop)
        self._woken.connect(self._beat, Qt.ConnectionType.QueuedConnection)

    def watch(self) -> None:
        """See the inputs of the native window; it exists once the window is shown."""
        if (native := self._window.windowHandle()) is not None:
            native.removeEventFilter(self)
            native.installEventFilter(self)

    def wake(self) -> None:
        """Tick at once; from any thread."""
        if not self._is_woken:
            self._is_woken = True
            self._woken.emit()

    def eventFilter(self, _watched: QObject, event: QEvent) -> bool:
        if event.type() in INPUTS:
            self._lively_until_s = time.monotonic() + LIVELY_S
            self._set_interval(FRAME_MS)
        return False

    def _beat(self) -> None:
        self._is_woken = False
        if not self._timer.isActive():
            return
        self._tick()
        moves = self._is_moving() or time.monotonic() < self._lively_until_s
        if moves:
            self._set_interval(FRAME_MS)
        else:
            self._timer.start(REST_MS)  # counted from this beat: a block that comes in time spares the next one

    def _set_interval(self, milliseconds: int) -> None:
        if self._timer.interval() != milliseconds:
            self._timer.setInterval(milliseconds)
