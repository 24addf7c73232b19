"""Actions of the window: one registry of texts, keyboard shortcuts and tooltips, and the `QAction` made of each.

The shortcut sheet, tooltips and button labels all read this registry.
"""

import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files

from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QAction, QKeySequence, QShortcutEvent
from PySide6.QtWidgets import QWidget

from app.gui.widgets.barcode_scanner import KeyBurstFilter
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
    tip: str = ""
    """Tooltip of its button, without the shortcuts, where the text does not suffice."""

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


TABLE = tomllib.loads(files("app.gui.widgets").joinpath("actions.toml").read_text("utf-8"))
ACTIONS = {
    name: ActionInfo(
        name, each["text"], tuple(each["keys"].split()), "" if page == GLOBAL_GROUP else page, each.get("tip", "")
    )
    for page, group in TABLE.items()
    for name, each in group.items()
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
    return f"{text or info.tip or info.text}: {' or '.join(info.shortcuts)}"


def share_action(dialog: QWidget, action_id: str) -> None:
    """Make an action of the parent's window available in a dialog as well."""
    parent = dialog.parentWidget()
    assert parent is not None
    if (action := parent.window().findChild(QAction, action_id)) is not None:
        dialog.addAction(action)
