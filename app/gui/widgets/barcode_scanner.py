"""Filter for the keys of a barcode scanner, which are recognized by the short intervals between their timestamps."""

from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QAction, QKeyEvent
from PySide6.QtWidgets import QApplication, QWidget
from shiboken6 import isValid

BURST_GAP_MS = 50
"""Keys that follow each other faster come from a barcode scanner."""

HOLD_MS = 2 * BURST_GAP_MS
"""A single key triggers its action after this time: longer than the gap, because the next key may be delivered late."""

ENTER_KEYS = (Qt.Key.Key_Return, Qt.Key.Key_Enter)
STOP_KEYS = (Qt.Key.Key_Escape, Qt.Key.Key_F12)
MODIFIER_KEYS = (Qt.Key.Key_Shift, Qt.Key.Key_Control, Qt.Key.Key_Alt, Qt.Key.Key_Meta, Qt.Key.Key_AltGr)
NO_TEXT = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier | Qt.KeyboardModifier.MetaModifier


class KeyBurstFilter(QObject):
    """Keeps the keys of a barcode scanner, recognized by their timestamps, from answering prompts and triggering actions.

    A scanner is a keyboard that types a text within milliseconds and ends with Enter; some begin with Enter, too. A scan must never answer a
    prompt ("high voltage must be ON now"), also where the cursor is in a field: its keys go to fields alone. Esc and F12, which stop
    the run, are never delayed or ignored.

    Args:
        window: whose keys are filtered, before any of its widgets receives them.
    """

    def __init__(self, window: QWidget) -> None:
        super().__init__(window)
        self._window = window
        self._last_ms = -BURST_GAP_MS
        self._in_burst = self._may_begin_burst = False
        self._held: Callable[[], object] | None = None
        self._hold_timer = QTimer(self, singleShot=True, interval=HOLD_MS)
        # Keys that wait behind a long paint are delivered before the action is triggered, and may belong to a scan.
        self._release_timer = QTimer(self, singleShot=True, interval=0)
        self._hold_timer.timeout.connect(self._release_timer.start)
        self._release_timer.timeout.connect(self._trigger_held)

    def watch(self) -> None:
        """Filter the keys of the native window, which receives them first; it exists once the window is shown."""
        if (native := self._window.windowHandle()) is not None:
            native.removeEventFilter(self)
            native.installEventFilter(self)

    def eventFilter(self, _watched: QObject, event: QEvent) -> bool:
        return isinstance(event, QKeyEvent) and self._filter_key(event)

    def hold(self, action: QAction) -> bool:
        """Return whether an action waits for `HOLD_MS`, because its key may be the first one of a scan."""

        def trigger() -> None:
            if isValid(action):
                action.trigger()

        if self._may_begin_burst:
            self._hold(trigger)
        return self._may_begin_burst

    def _hold(self, effect: Callable[[], object]) -> None:
        self._held = effect
        self._hold_timer.start()

    def _hold_enter(self, event: QKeyEvent) -> bool:
        """Return whether Enter, which no shortcut took, waits as well: in a list it accepts or opens the selected entry."""
        widget = QApplication.focusWidget()
        if event.key() not in ENTER_KEYS or widget is None or _takes_text(widget):
            return False
        press = QKeyEvent(event.type(), event.key(), event.modifiers(), event.text())
        self._hold(lambda: isValid(widget) and QApplication.sendEvent(widget, press))
        return True

    def _filter_key(self, event: QKeyEvent) -> bool:
        if event.type() == QEvent.Type.KeyRelease or event.isAutoRepeat() or event.key() in MODIFIER_KEYS:
            return False
        # It precedes the shortcut, or the key where there is no shortcut.
        is_override = event.type() == QEvent.Type.ShortcutOverride
        if is_override or event.timestamp() != self._last_ms:
            self._in_burst = 0 <= event.timestamp() - self._last_ms < BURST_GAP_MS
            self._last_ms = event.timestamp()
            if self._in_burst:
                self._held = None
            self._trigger_held()
        is_stop = event.key() in STOP_KEYS
        # A scan begins with text or with Enter: other keys need not wait.
        begins = bool(event.text()) or event.key() in ENTER_KEYS
        self._may_begin_burst = begins and not is_stop and not event.modifiers() & NO_TEXT
        if not self._in_burst or is_stop:
            return not is_override and not is_stop and self._hold_enter(event)
        event.accept()  # of an override: no shortcut is triggered, the key itself follows
        return is_override or not _takes_text(QApplication.focusWidget())

    def _trigger_held(self) -> None:
        self._hold_timer.stop()
        self._release_timer.stop()
        effect, self._held = self._held, None
        if effect is not None:
            effect()


def _takes_text(widget: QWidget | None) -> bool:
    return widget is not None and widget.testAttribute(Qt.WidgetAttribute.WA_InputMethodEnabled)
