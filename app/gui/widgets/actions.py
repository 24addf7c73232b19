"""Actions of the window: one registry of texts, keyboard shortcuts and tooltips, and the `QAction` made of each.

The shortcut sheet, tooltips and button labels all read this registry.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QAction, QKeySequence, QShortcutEvent
from PySide6.QtWidgets import QAbstractButton, QWidget

from app.gui.widgets.barcode_scanner import KeyBurstFilter
from app.gui.widgets.key_caps import show_key
from app.session import WindowState

GLOBAL_GROUP = "Everywhere"
EVERY_PAGE = "*"
"""Page of an action that each page has in its own widgets."""

REPEATING_PAGES = ("Specimen sheet", "Measure", "Explore", "Runs")
REPEATING_ITEMS = ("campaign.item.up", "campaign.item.down")
REPEATING_KEYS = ("plot.closer", "plot.further", "plot.marker-left", "plot.marker-right", *REPEATING_ITEMS)


@dataclass(frozen=True, slots=True)
class ActionInfo:
    """Name, shortcuts and context of an action."""

    id: str
    text: str
    shortcuts: tuple[str, ...]
    """The first one is shown on buttons."""
    page: str = ""
    """Title of the page whose widgets must have the keyboard; empty for an action of the whole window."""

    @property
    def repeats(self) -> bool:
        """Whether it is triggered again while its key is held down."""
        return self.page in REPEATING_PAGES or self.id in REPEATING_KEYS

    @property
    def needs_idle(self) -> bool:
        """Whether it is disabled during a run: an answer to a prompt may have the same letter as its shortcut."""
        return self.id.startswith("campaign.item.")

    @property
    def while_visible(self) -> bool:
        """Whether an action of a page works wherever the keyboard is, as long as its widget is visible."""
        return self.id.startswith("traces.")

    @property
    def shortcut(self) -> str:
        """The first shortcut."""
        return self.shortcuts[0]


SHORTCUTS: dict[str, dict[str, tuple[str, str]]] = {
    "": {
        "escape": (
            "Esc",
            "During a run stop: go to rest and end it; otherwise close what lies on top, or one step back",
        ),
        "stop": ("F12", "Stop: go to rest and end the run"),
        "run": ("F5 Ctrl+R", "Run the protocol or item that is shown"),
        "pause": ("F8", "Pause at rest, or resume"),
        "page.measure": ("Ctrl+1", "Page Measure"),
        "page.campaign": ("Ctrl+2", "Page Campaign"),
        "page.explore": ("Ctrl+3", "Page Explore"),
        "page.runs": ("Ctrl+4", "Page Runs"),
        "page.bench": ("Ctrl+5", "Page Bench"),
        "page.laboratory": ("Ctrl+6", "Page Laboratory"),
        "answer": ("Return Enter", "Answer the prompt over the page"),
        "acknowledge": ("F4", "Acknowledge or dismiss a message"),
        "palette": ("Ctrl+K", "Find a command, protocol, run or setting, or close the list"),
        "specimen": ("F7", "Specimen sheet: dimensions and masses, or close it"),
        "identification": ("Shift+F7", "Identification: parameters, uncertainty budget and acceptance, or close it"),
        "log": ("Ctrl+J", "Log, or close it"),
        "settings": ("Ctrl+,", "Settings, or close them"),
        "reconnect": ("F6", "Connect to the bench again"),
        "faults.toggle": ("F9", "Speed, prompts and faults of the simulated bench, or close the list"),
        "faults.clear": ("Shift+F9", "Clear all faults"),
        "shortcuts": ("F1 ?", "Help: safety, words, how-tos and keys, or close it"),
        "problem": ("Ctrl+F1", "Save a problem report, or close its page"),
    },
    "Specimen sheet": {
        "sheet.undo": ("Ctrl+Z", "Undo in the sheet"),
        "sheet.redo": ("Ctrl+Shift+Z Ctrl+Y", "Redo in the sheet"),
    },
    "Measure": {
        "measure.undo": ("Ctrl+Z", "Undo in the form"),
        "measure.redo": ("Ctrl+Shift+Z Ctrl+Y", "Redo in the form"),
    },
    "Campaign": {
        "campaign.queue": ("Ctrl+F5", "Run all measurements without manual steps, or stop after the present one"),
        "campaign.undo": ("Ctrl+Z", "Undo"),
        "campaign.redo": ("Ctrl+Shift+Z Ctrl+Y", "Redo"),
        "campaign.add": ("Ctrl+Shift+N", "Add a measurement, or a series over a parameter"),
        "campaign.new": ("Ctrl+N", "Create another campaign"),
        "campaign.open": ("Ctrl+O", "Open a campaign"),
        "campaign.item.run": ("Shift+F5", "Run the selected measurement"),
        "campaign.item.skip": ("S", "Skip the selected measurement, or include it again"),
        "campaign.item.repeat": ("M", "Measure the selected one again"),
        "campaign.item.accept": ("A", "Accept the result of the selected item (also Enter)"),
        "campaign.item.reject": ("X", "Reject the result of the selected item"),
        "campaign.item.open": ("O", "Open the run of the selected one"),
        "campaign.item.explore": ("E", "Overlay the run of the selected one on the model"),
        "campaign.item.up": ("Alt+Up", "Move the selected one up"),
        "campaign.item.down": ("Alt+Down", "Move the selected one down"),
    },
    "Explore": {
        "explore.undo": ("Ctrl+Z", "Undo"),
        "explore.redo": ("Ctrl+Shift+Z Ctrl+Y", "Redo"),
        "explore.keep": ("Ctrl+Shift+K", "Keep the present curve"),
        "explore.copy-json": ("Ctrl+Shift+C", "Copy every parameter as JSON"),
        "explore.overlay": ("Ctrl+O", "Overlay a run on the curves"),
        "explore.fit": ("Ctrl+F", "Fit the model to the overlaid runs, or cancel the fit"),
        "explore.skin": ("Ctrl+T", "Free, or on skin"),
        "explore.study": ("Ctrl+S", "Save as a study"),
    },
    "Runs": {
        "runs.search": ("/ Ctrl+F", "Search"),
        "runs.explore": ("E", "Overlay the selected runs on the model's curve"),
        "runs.export": ("Ctrl+E", "Export the selected runs"),
        "runs.notes": ("F2", "Tags and note"),
        "runs.copy-paths": ("Ctrl+C", "Copy the paths of the selected runs"),
        "runs.continue": ("Ctrl+Return", "Continue the selected run, which was stopped"),
        "runs.show-folder": ("Ctrl+L", "Show the folder of the selected run"),
        "runs.import": ("Ctrl+I", "Import run files and tables …"),
        "runs.trash": ("Del", "Move the selected runs to the trash"),
        "runs.undo": ("Ctrl+Z", "Take the runs of the last deletion out of the trash"),
        "traces.zoom-in": ("Ctrl++ Ctrl+=", "Traces of the open run: closer"),
        "traces.zoom-out": ("Ctrl+-", "Traces: further away"),
        "traces.whole": ("Ctrl+0", "Traces: the whole run"),
        "traces.later": ("Ctrl+Right", "Traces: later"),
        "traces.earlier": ("Ctrl+Left", "Traces: earlier"),
    },
    EVERY_PAGE: {
        "plot.copy-picture": ("Ctrl+P", "Copy the plot as a picture"),
        "plot.copy-data": ("Ctrl+D", "Copy the plot as a table"),
        "plot.save-picture": ("Ctrl+Shift+P", "Save the plot as a picture …"),
        "plot.save-data": ("Ctrl+Shift+D", "Save the data of the plot …"),
        "plot.whole": ("Home", "Plot: show everything (also a double click)"),
        "plot.closer": ("+ =", "Plot: closer (also the wheel, or a box drawn with the left button)"),
        "plot.further": ("-", "Plot: further away"),
        "plot.log-x": ("Ctrl+Shift+X", "Plot: logarithmic x axis, or a linear one"),
        "plot.log-y": ("Ctrl+Shift+Y", "Plot: logarithmic y axis, or a linear one"),
        "plot.peak": ("P", "Plot: cursor to the highest point (also a click)"),
        "plot.second": ("D", "Plot: second cursor here, for differences (also a click with Shift)"),
        "plot.marker-left": ("Left", "Plot: cursor to the point before"),
        "plot.marker-right": ("Right", "Plot: cursor to the next point"),
    },
}
"""Shortcuts and text of every action, by its page and id in the order of the shortcut sheet."""

TOOLTIPS = {
    "stop": "Go to rest and end the run",
    "run": "Start the run",
    "specimen": "Dimensions and masses of this specimen, with their uncertainties",
    "identification": "Parameters from these runs with their uncertainty budget, and acceptance",
    "faults.toggle": "Speed and prompts of the simulated bench, and faults, to see how the program reacts",
    "campaign.item.run": "Measure this item now",
    "campaign.item.skip": "Skip the item, or include it again",
    "campaign.item.repeat": "Measure it again: the present result counts until the new one is accepted",
    "campaign.item.reject": "The run that counts now is no longer used",
    "campaign.item.open": "Show the run on the Runs page",
    "campaign.item.explore": "Overlay the run on the model's curve on the Explore page",
    "explore.keep": "Keep the present curve while the sliders are moved",
    "explore.copy-json": "Every parameter as JSON for --set",
    "explore.overlay": "Measured points over the curves",
    "explore.fit": "Fit the sliders to the overlaid runs",
    "explore.study": "The parameters that differ between the kept curves, or else the slider moved last, as HDF5 or CSV",
    "runs.explore": "Overlay on the model's curve",
    "runs.import": "Copy run files and tables into this folder",
    "plot.copy-picture": "This plot as a picture on the clipboard",
    "plot.copy-data": "The data of this plot as a table on the clipboard",
}
"""Of the buttons of actions whose text does not suffice, without the shortcuts."""

ACTIONS = {
    name: ActionInfo(name, text, tuple(keys.split()), page)
    for page, group in SHORTCUTS.items()
    for name, (keys, text) in group.items()
}
"""Every action by its id."""


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
        if info.needs_idle:
            action.setEnabled(not state.busy)


def actions_of(widgets: list[QWidget]) -> Iterator[tuple[ActionInfo, QAction]]:
    """Return the actions of widgets in the order of the registry; actions made at run time come last."""
    order = {name: at for at, name in enumerate(ACTIONS)}
    actions = [(a.data(), a) for widget in widgets for a in widget.actions() if isinstance(a.data(), ActionInfo)]
    yield from sorted(actions, key=lambda pair: order.get(pair[0].id, len(order)))


def shortcuts_by_group(window: QWidget, page_titles: list[str]) -> dict[str, tuple[ActionInfo, ...]]:
    """Return the actions that a window has, by group: the whole window first, then the given pages."""
    present = {info.id: info for info, _ in actions_of([window, *window.findChildren(QWidget)])}
    titles = {GLOBAL_GROUP: ("",)} | {title: (title, EVERY_PAGE) for title in page_titles}
    groups = {title: tuple(i for i in present.values() if i.page in pages) for title, pages in titles.items()}
    return {title: group for title, group in groups.items() if group}


def tooltip(action_id: str, text: str = "") -> str:
    """Return a tooltip that ends with the shortcuts of an action."""
    info = ACTIONS[action_id]
    return f"{text or TOOLTIPS.get(action_id, info.text)}: {' or '.join(info.shortcuts)}"


def name_button(button: QAbstractButton, action_id: str, text: str) -> None:
    """Show the shortcut of an action on a button and in its tooltip."""
    button.setText(text)
    show_key(button, ACTIONS[action_id].shortcut)
    button.setToolTip(tooltip(action_id))


def share_action(dialog: QWidget, action_id: str) -> None:
    """Make an action of the parent's window available in a dialog as well."""
    parent = dialog.parentWidget()
    assert parent is not None
    if (action := parent.window().findChild(QAction, action_id)) is not None:
        dialog.addAction(action)
