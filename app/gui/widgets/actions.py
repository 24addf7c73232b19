"""Actions of the window: one registry of texts, keyboard shortcuts and tooltips, and the `QAction` made of each.

The shortcut sheet, tooltips and button labels all read this registry.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QAction, QKeyEvent, QKeySequence, QShortcutEvent
from PySide6.QtWidgets import QAbstractButton, QApplication, QWidget
from shiboken6 import isValid

from app.session import WindowState

GLOBAL_GROUP = "Everywhere"
EVERY_PAGE = "*"
"""Page of an action that each page has in its own widgets."""

BURST_GAP_MS = 50
"""Keys that follow each other faster come from a barcode scanner."""

HOLD_MS = 2 * BURST_GAP_MS
"""A single key triggers its action after this time: longer than the gap, because the next key may be delivered late."""

ENTER_KEYS = (Qt.Key.Key_Return, Qt.Key.Key_Enter)
STOP_KEYS = (Qt.Key.Key_Escape, Qt.Key.Key_F12)
MODIFIER_KEYS = (Qt.Key.Key_Shift, Qt.Key.Key_Control, Qt.Key.Key_Alt, Qt.Key.Key_Meta, Qt.Key.Key_AltGr)
NO_TEXT = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier | Qt.KeyboardModifier.MetaModifier


def is_idle(state: WindowState) -> bool:
    """Return whether no run is active."""
    return not state.busy


@dataclass(frozen=True, slots=True)
class ActionInfo:
    """What an action is called, which shortcuts trigger it and where it works."""

    id: str
    text: str
    shortcuts: tuple[str, ...]
    """The first one is shown on buttons."""
    tooltip: str = ""
    """Of its button, without the shortcut; empty where the button's own text suffices."""
    page: str = ""
    """Title of the page whose widgets must have the keyboard; empty for an action of the whole window."""
    enabled_when: Callable[[WindowState], bool] | None = None
    """None for an action that is always enabled, or that its widget enables."""
    repeats: bool = False
    """Whether it is triggered again while its key is held down."""
    while_visible: bool = False
    """An action of a page that works wherever the keyboard is, as long as its widget is visible."""

    @property
    def shortcut(self) -> str:
        """The first shortcut."""
        return self.shortcuts[0]


ACTIONS = {
    info.id: info
    for info in (
        ActionInfo("escape", "Stop: go to rest and end the run; otherwise one step back", ("Esc",)),
        ActionInfo("stop", "Stop: go to rest and end the run", ("F12",), "Go to rest and end the run"),
        ActionInfo("run", "Run the protocol or item that is shown", ("F5", "Ctrl+R"), "Start the run"),
        ActionInfo("pause", "Pause at rest, or resume", ("F8",)),
        ActionInfo("page.measure", "Page Measure", ("Ctrl+1",)),
        ActionInfo("page.campaign", "Page Campaign", ("Ctrl+2",)),
        ActionInfo("page.explore", "Page Explore", ("Ctrl+3",)),
        ActionInfo("page.runs", "Page Runs", ("Ctrl+4",)),
        ActionInfo("page.bench", "Page Bench", ("Ctrl+5",)),
        ActionInfo("page.laboratory", "Page Laboratory", ("Ctrl+6",)),
        ActionInfo("answer", "Answer the prompt above the pages", ("Return", "Enter")),
        ActionInfo("acknowledge", "Acknowledge or dismiss a message", ("F4",)),
        ActionInfo("palette", "Find a command, protocol, run or setting, or close the list", ("Ctrl+K",)),
        ActionInfo(
            "specimen",
            "Specimen sheet: dimensions and masses, or close it",
            ("F7",),
            "Dimensions and masses of this specimen, with their uncertainties",
        ),
        ActionInfo(
            "identification",
            "Identification: parameters, uncertainty budget and acceptance, or close it",
            ("Shift+F7",),
            "Parameters from these runs with their uncertainty budget, and acceptance",
        ),
        ActionInfo("sheet.undo", "Undo in the sheet", ("Ctrl+Z",), page="Specimen sheet", repeats=True),
        ActionInfo("sheet.redo", "Redo in the sheet", ("Ctrl+Shift+Z", "Ctrl+Y"), page="Specimen sheet", repeats=True),
        ActionInfo("settings", "Settings, or close them", ("Ctrl+,",)),
        ActionInfo("reconnect", "Connect to the bench again", ("F6",)),
        ActionInfo(
            "faults.toggle",
            "Speed, prompts and faults of the simulated bench, or close the list",
            ("F9",),
            "Speed and prompts of the simulated bench, and faults, to see how the program reacts",
        ),
        ActionInfo("faults.clear", "Clear all faults", ("Shift+F9",)),
        ActionInfo("shortcuts", "Help: safety, words, how-tos and keys, or close it", ("F1", "?")),
        ActionInfo("problem", "Save a problem report, or close its page", ("Ctrl+F1",)),
        ActionInfo("measure.undo", "Undo in the form", ("Ctrl+Z",), page="Measure", repeats=True),
        ActionInfo("measure.redo", "Redo in the form", ("Ctrl+Shift+Z", "Ctrl+Y"), page="Measure", repeats=True),
        ActionInfo(
            "campaign.queue",
            "Run all measurements without manual steps, or stop after the present one",
            ("Ctrl+F5",),
            page="Campaign",
        ),
        ActionInfo("campaign.undo", "Undo", ("Ctrl+Z",), page="Campaign"),
        ActionInfo("campaign.redo", "Redo", ("Ctrl+Shift+Z", "Ctrl+Y"), page="Campaign"),
        ActionInfo(
            "campaign.add", "Add a measurement, or a series over a parameter", ("Ctrl+Shift+N",), page="Campaign"
        ),
        ActionInfo("campaign.new", "Create another campaign", ("Ctrl+N",), page="Campaign"),
        ActionInfo("campaign.open", "Open a campaign", ("Ctrl+O",), page="Campaign"),
        # An answer to a prompt may have the same letter as one of these: they are disabled during a run.
        *(
            ActionInfo(f"campaign.item.{name}", text, (key,), tip, "Campaign", is_idle, repeats)
            for name, text, key, tip, repeats in (
                ("run", "Run the selected measurement", "Shift+F5", "Measure this item now", False),
                (
                    "skip",
                    "Skip the selected measurement, or include it again",
                    "S",
                    "Skip the item, or include it again",
                    False,
                ),
                (
                    "repeat",
                    "Measure the selected one again",
                    "M",
                    "Measure it again: what counts now counts until the new result is accepted",
                    False,
                ),
                ("accept", "Accept the result of the selected item (also Enter)", "A", "", False),
                (
                    "reject",
                    "Reject the result of the selected item",
                    "X",
                    "The run that counts now is no longer used",
                    False,
                ),
                ("open", "Open the run of the selected one", "O", "Show the run on the Runs page", False),
                (
                    "explore",
                    "Overlay the run of the selected one on the model",
                    "E",
                    "Overlay the run on the model's curve on the Explore page",
                    False,
                ),
                ("up", "Move the selected one up", "Alt+Up", "", True),
                ("down", "Move the selected one down", "Alt+Down", "", True),
            )
        ),
        *(
            ActionInfo(f"explore.{name}", text, keys, tip, "Explore", repeats=True)
            for name, text, keys, tip in (
                ("undo", "Undo", ("Ctrl+Z",), "Undo"),
                ("redo", "Redo", ("Ctrl+Shift+Z", "Ctrl+Y"), "Redo"),
                (
                    "keep",
                    "Keep the present curve",
                    ("Ctrl+Shift+K",),
                    "Keep the present curve while the sliders are moved",
                ),
                (
                    "copy-json",
                    "Copy every parameter as JSON",
                    ("Ctrl+Shift+C",),
                    "Every parameter as JSON for --set",
                ),
                ("overlay", "Overlay a run on the curves", ("Ctrl+O",), "Measured points over the curves"),
                (
                    "fit",
                    "Fit the model to the overlaid runs, or cancel the fit",
                    ("Ctrl+F",),
                    "Fit the sliders to the overlaid runs",
                ),
                ("skin", "Free, or on skin", ("Ctrl+T",), ""),
                (
                    "study",
                    "Save as a study",
                    ("Ctrl+S",),
                    "The parameters that differ between the kept curves, or else the slider moved last, as HDF5 or CSV",
                ),
            )
        ),
        *(
            ActionInfo(f"runs.{name}", text, keys, tip, "Runs", repeats=True)
            for name, text, keys, tip in (
                ("search", "Search", ("/", "Ctrl+F"), ""),
                ("explore", "Overlay the selected runs on the model's curve", ("E",), "Overlay on the model's curve"),
                ("export", "Export the selected runs", ("Ctrl+E",), ""),
                ("notes", "Tags and note", ("F2",), ""),
                ("copy-paths", "Copy the paths of the selected runs", ("Ctrl+C",), ""),
                ("continue", "Continue the selected run, which was stopped", ("Ctrl+Return",), ""),
                ("show-folder", "Show the folder of the selected run", ("Ctrl+L",), ""),
                ("import", "Import run files and tables …", ("Ctrl+I",), "Copy run files and tables into this folder"),
                ("trash", "Move the selected runs to the trash", ("Del",), ""),
                ("undo", "Take the runs of the last deletion out of the trash", ("Ctrl+Z",), ""),
            )
        ),
        *(
            ActionInfo(f"traces.{name}", text, keys, page="Runs", repeats=True, while_visible=True)
            for name, text, keys in (
                ("zoom-in", "Traces of the open run: closer", ("Ctrl++", "Ctrl+=")),
                ("zoom-out", "Traces: further away", ("Ctrl+-",)),
                ("whole", "Traces: the whole run", ("Ctrl+0",)),
                ("later", "Traces: later", ("Ctrl+Right",)),
                ("earlier", "Traces: earlier", ("Ctrl+Left",)),
            )
        ),
        ActionInfo(
            "plot.copy-picture",
            "Copy the focused plot as a picture",
            ("Ctrl+P",),
            "This plot as a picture on the clipboard",
            EVERY_PAGE,
        ),
        ActionInfo(
            "plot.copy-data",
            "Copy the focused plot as a table",
            ("Ctrl+D",),
            "The data of this plot as a table on the clipboard",
            EVERY_PAGE,
        ),
        *(
            ActionInfo(f"plot.{name}", text, keys, page=EVERY_PAGE, repeats=repeats)
            for name, text, keys, repeats in (
                ("save-picture", "Save the focused plot as a picture …", ("Ctrl+Shift+P",), False),
                ("save-data", "Save the data of the focused plot …", ("Ctrl+Shift+D",), False),
                ("whole", "Focused plot: show everything (also a double click)", ("Home",), False),
                (
                    "closer",
                    "Focused plot: closer (also the wheel, or a box drawn with the left button)",
                    ("+", "="),
                    True,
                ),
                ("further", "Focused plot: further away", ("-",), True),
                ("log-x", "Focused plot: logarithmic x axis, or a linear one", ("Ctrl+Shift+X",), False),
                ("log-y", "Focused plot: logarithmic y axis, or a linear one", ("Ctrl+Shift+Y",), False),
                ("peak", "Focused plot: marker to the highest point", ("P",), False),
                ("marker-left", "Focused plot: marker to the point before", ("Left",), True),
                ("marker-right", "Focused plot: marker to the next point", ("Right",), True),
            )
        ),
    )
}
"""Every action by its id, in the order of the shortcut sheet."""


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


class _KeyAction(QAction):
    """An action whose shortcut is ignored within a scan."""

    def event(self, event: QEvent) -> bool:
        if isinstance(event, QShortcutEvent) and not event.isAmbiguous():
            widget = self.parent()
            assert isinstance(widget, QWidget)
            bursts = widget.window().findChild(KeyBurstFilter, options=Qt.FindChildOption.FindDirectChildrenOnly)
            if bursts is not None and bursts.hold(self):
                return True
        return super().event(event)


def add_action(widget: QWidget, info: ActionInfo, callback: Callable[[], object]) -> QAction:
    """Make the `QAction` of an action and add it to the widget in which its shortcuts work."""
    action = _KeyAction(info.text, widget)
    action.setObjectName(info.id)
    action.setData(info)
    action.setShortcuts([QKeySequence(key) for key in info.shortcuts])
    in_widget = info.page and not info.while_visible
    action.setShortcutContext(
        Qt.ShortcutContext.WidgetWithChildrenShortcut if in_widget else Qt.ShortcutContext.WindowShortcut
    )
    action.setAutoRepeat(info.repeats)
    action.triggered.connect(lambda _checked=False: callback())
    widget.addAction(action)
    return action


def add_actions(widget: QWidget, callbacks: Mapping[str, Callable[[], object]]) -> None:
    """Add registered actions, by their ids, to the widget in which their shortcuts work."""
    for name, callback in callbacks.items():
        add_action(widget, ACTIONS[name], callback)


def update_actions(widget: QWidget, state: WindowState) -> None:
    """Enable or disable a widget's actions for a window state."""
    for info, action in actions_of([widget]):
        if info.enabled_when is not None:
            action.setEnabled(info.enabled_when(state))


def actions_of(widgets: list[QWidget]) -> Iterator[tuple[ActionInfo, QAction]]:
    """Return the actions of widgets in the order of the registry; actions made at run time come last."""
    order = {name: at for at, name in enumerate(ACTIONS)}
    found = [(a.data(), a) for widget in widgets for a in widget.actions() if isinstance(a.data(), ActionInfo)]
    yield from sorted(found, key=lambda pair: order.get(pair[0].id, len(order)))


def shortcuts_by_group(window: QWidget, page_titles: list[str]) -> dict[str, tuple[ActionInfo, ...]]:
    """Return the actions that a window has, by group: the whole window first, then the given pages."""
    present = {info.id: info for info, _ in actions_of([window, *window.findChildren(QWidget)])}
    titles = {GLOBAL_GROUP: ("",)} | {title: (title, EVERY_PAGE) for title in page_titles}
    groups = {title: tuple(i for i in present.values() if i.page in pages) for title, pages in titles.items()}
    return {title: group for title, group in groups.items() if group}


def tooltip(action_id: str, text: str = "") -> str:
    """Return a tooltip that ends with the shortcuts of an action."""
    info = ACTIONS[action_id]
    return f"{text or info.tooltip or info.text}: {' or '.join(info.shortcuts)}"


def shortcut_label(text: str, action_id: str) -> str:
    """Return the text of a button with the shortcut of an action."""
    return f"{text}   ({ACTIONS[action_id].shortcut})"


def name_button(button: QAbstractButton, action_id: str, text: str) -> None:
    """Name the shortcut of an action on a button and in its tooltip."""
    button.setText(shortcut_label(text, action_id))
    button.setToolTip(tooltip(action_id))


def share_action(dialog: QWidget, action_id: str) -> None:
    """Make an action of the parent's window available in a dialog as well."""
    parent = dialog.parentWidget()
    assert parent is not None
    if (action := parent.window().findChild(QAction, action_id)) is not None:
        dialog.addAction(action)
