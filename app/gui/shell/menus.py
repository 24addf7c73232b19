"""Menu bar of the main window and entries of its command palette, both from the actions of the registry."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import QMainWindow, QMenuBar, QWidget

from app.gui.face import APPEARANCES
from app.gui.help import TUTORIALS
from app.gui.shell.page_host import MEASURE, RUNS, TITLES
from app.gui.shell.page_stack import CentralStack
from app.gui.widgets import Menu, actions_of
from protocols import PROTOCOLS

if TYPE_CHECKING:
    from app.gui.help import PaletteEntry

MENUS = {
    "&File": ("runs.import", "campaign.add", "campaign.new", "campaign.open", "", "settings"),
    "&Run": ("run", "pause", "stop", "", "reconnect", "faults.toggle", "faults.clear"),
    "&View": (*(f"page.{title.lower()}" for title in TITLES), "", "specimen", "identification", "palette", "log"),
}
"""Actions of the first menus; an empty name is a separator. The menu of the page has the actions of the visible page."""

NOT_LISTED = ("answer", "escape", "palette")
PREFIXES_NOT_LISTED = ("plot.", "traces.")
"""Actions that need a focused plot."""


class MainMenus:
    """Fills the menus when they are opened, so that the first paint does not wait for them.

    Args:
        window: the main window, whose actions are listed.
        central: the pages and their covers.
        set_appearance: function that applies `system`, `light` or `dark`.
    """

    def __init__(self, window: QMainWindow, central: CentralStack, set_appearance: Callable[[str], object]) -> None:
        self._window, self._central, self._set_appearance = window, central, set_appearance
        self._tabs = central.tabs
        self.bar = bar = QMenuBar()
        for title in (*MENUS, "&Page", "&Help"):
            menu = Menu(title, window)
            menu.setObjectName(f"menu.{title.strip('&').lower()}")
            menu.aboutToShow.connect(partial(self.fill, menu, title))
            bar.addMenu(menu)

    def fill(self, menu: Menu, title: str) -> None:
        """Fill a menu with the actions that exist now."""
        menu.clear()
        if title == "&Page":
            widgets = [self._window, *self._window.findChildren(QWidget)]
            menu.addActions([action for info, action in actions_of(widgets) if info.page == self._tabs.title])
            return
        if title == "&Help":
            menu.add_named(self._window, ("shortcuts", "palette", "problem"))
            menu.addAction("First steps …", self._central.show_welcome)
            for name, tutorial in TUTORIALS.items():
                menu.addAction(f"Tutorial: {tutorial.title}", partial(self._central.start_tutorial, name))
            return
        if title == "&File":
            self._tabs.page(RUNS)  # whose actions are listed
        menu.add_named(self._window, MENUS[title])
        if title == "&View":
            menu.addSeparator()
            for name, text in APPEARANCES.items():
                menu.addAction(f"Appearance: {text}", partial(self._set_appearance, name))

    def palette_entries(self) -> Iterator[PaletteEntry]:
        """Return the present entries of the command palette."""
        from app.gui.help import PaletteEntry

        listed = set[str]()
        for info, action in actions_of([self._window, *self._window.findChildren(QWidget)]):
            hidden = info.id in (*NOT_LISTED, *listed) or info.id.startswith(PREFIXES_NOT_LISTED)
            if hidden or not action.isEnabled() or info.page not in ("", self._tabs.title):
                continue
            listed.add(info.id)
            keys = " or ".join(
                QKeySequence(key).toString(QKeySequence.SequenceFormat.NativeText) for key in info.shortcuts
            )
            yield PaletteEntry("command", info.text, action.trigger, keys)
        for name in PROTOCOLS:
            yield PaletteEntry(
                "protocol", f"Measure: {PROTOCOLS.title(name)}", partial(self._choose_protocol, name), "protocol"
            )
        for name, tutorial in TUTORIALS.items():
            yield PaletteEntry(
                "command", f"Tutorial: {tutorial.title}", partial(self._central.start_tutorial, name), "help"
            )
        for name, text in APPEARANCES.items():
            yield PaletteEntry("setting", f"Appearance: {text}", partial(self._set_appearance, name), "setting")
        yield PaletteEntry("setting", "Folder for run files", partial(self._central.show_settings, "folder"), "setting")
        yield PaletteEntry("setting", "Specimen", partial(self._central.show_settings, "specimen"), "setting")
        for run in self._tabs.runs.list.folder_model.summaries:
            path = self._tabs.runs.list.folder_model.path / run.path
            begun = f"{run.started_at:%Y-%m-%d %H:%M}" if run.started_at else ""
            yield PaletteEntry(
                "run",
                f"Run: {run.specimen} {run.protocol} {begun}",
                partial(self._tabs.results.open_run, path),
                run.verdict_text,
            )

    def _choose_protocol(self, name: str) -> None:
        self._tabs.setCurrentIndex(MEASURE)
        self._tabs.measure.run_panel.choose_protocol(name)
