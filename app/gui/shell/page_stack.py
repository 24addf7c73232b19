"""Page area of the main window: the pages, covers in their place, and drawers and cards over them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, TypeVar

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QApplication, QSizePolicy, QStackedWidget, QWidget
from shiboken6 import isValid

from app.gui import help as help_pages
from app.gui import specimen as specimen_pages
from app.gui.help import FirstRunHint, ShortcutSheet, TutorialBand, WelcomePage
from app.gui.shell.page_host import BENCH, MEASURE, TITLES
from app.gui.shell.tabs import MainTabs
from app.gui.widgets import OverlayHost, add_actions, choose_file, shortcuts_by_group

if TYPE_CHECKING:
    from app.archive import ProblemFacts
    from app.common import RecentErrors
    from app.session import WindowState

W = TypeVar("W", bound=QWidget)


class CentralStack(OverlayHost):
    """Shows the pages, or welcome page, sheet, identification or problem report in their place; over them drawers and cards."""

    bench_chosen = Signal(str)
    """Path of a bench file."""

    def __init__(self, tabs: MainTabs) -> None:
        self.stack = QStackedWidget()
        super().__init__(self.stack)
        self.tabs, self.shortcut_sheet, self.welcome, self.hint = tabs, ShortcutSheet(), WelcomePage(), FirstRunHint()
        self.tutorial = TutorialBand()
        self.stack.addWidget(tabs)
        self._add_cover(self.welcome)
        for overlay in (self.shortcut_sheet, self.hint, self.tutorial):
            self.add_overlay(overlay)
        self._previous_focus: QWidget | None = None
        tabs.sheets.pressed.connect(self.show_specimen)
        tabs.identification_requested.connect(self.show_identification)
        tabs.currentChanged.connect(lambda at: self.tutorial.set_page(TITLES[at]))
        self.shortcut_sheet.welcome_requested.connect(self.show_welcome)
        self.welcome.closed.connect(lambda: self.select_page(MEASURE))
        self.welcome.tutorial_requested.connect(self.start_tutorial)
        self.welcome.setup_button.clicked.connect(lambda: self.select_page(BENCH))
        self.welcome.browse_button.clicked.connect(
            lambda: choose_file(
                self, "Open a bench file", lambda path: self.bench_chosen.emit(str(path)), "Bench files (*.toml)"
            )
        )
        self.palette_entries: Callable[[], Iterable[help_pages.PaletteEntry]] = tuple
        """Returns the entries of the command palette."""
        self.settings: Callable[[], Sequence[help_pages.Setting]] = tuple
        """Returns the settings; called once."""
        self.problem_facts: Callable[[], tuple[ProblemFacts, RecentErrors]]
        """Returns the facts of this window for a problem report."""
        covers = {
            "shortcuts": ("shortcut_sheet", self.show_shortcuts),
            "palette": ("command_palette", self.show_palette),
            "settings": ("settings_page", self.show_settings),
            "specimen": ("specimen_page", self.show_specimen),
            "identification": ("identification_page", self.show_identification),
            "problem": ("problem_page", lambda: self._show_cover(self.problem_page).activate()),
        }
        add_actions(
            self,
            {
                **{f"page.{title.lower()}": partial(self.select_page, at) for at, title in enumerate(TITLES)},
                **{name: partial(self.toggle, cover, show) for name, (cover, show) in covers.items()},
            },
        )

    @cached_property
    def command_palette(self) -> help_pages.CommandPalette:
        """The command palette; created when first used."""
        return self.add_overlay(help_pages.CommandPalette())

    @cached_property
    def settings_page(self) -> help_pages.SettingsPage:
        """The settings page; created when first used."""
        return self.add_overlay(help_pages.SettingsPage(self.settings()))

    @cached_property
    def specimen_page(self) -> specimen_pages.SpecimenPage:
        """The page with the sheet of a specimen; created when first used."""
        page = self._add_cover(specimen_pages.SpecimenPage())
        page.saved.connect(self.tabs.sheets.update)
        page.saved.connect(self._outdate_identification)
        return page

    @cached_property
    def problem_page(self) -> help_pages.ProblemPage:
        """The page that saves a problem report; created when first used."""
        return self._add_cover(help_pages.ProblemPage(self.problem_facts))

    def toggle(self, cover: str, show: Callable[[], object]) -> None:
        """Show one of the covers, or the pages again where it is shown."""
        if cover in self.__dict__ and getattr(self, cover).isVisible():
            self.show_pages()
        else:
            show()

    def show_specimen(self) -> None:
        """Show the sheet of the specimen of the visible page."""
        self._show_cover(self.specimen_page).show_specimen(*self.tabs.subject.specimen)

    @cached_property
    def identification_page(self) -> specimen_pages.IdentificationPage:
        """The page that identifies a specimen; created when first used."""
        return self._add_cover(specimen_pages.IdentificationPage())

    def show_identification(self, subject: specimen_pages.IdentificationSubject | None = None) -> None:
        """Show the identification of a specimen; None: the visible page's."""
        self._show_cover(self.identification_page).show_subject(subject or self.tabs.subject.identification)

    def _outdate_identification(self) -> None:
        if "identification_page" in vars(self):
            self.identification_page.outdate()

    def _add_cover(self, cover: W) -> W:
        cover.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)  # it does not enlarge the window
        self.stack.addWidget(cover)
        cover.closed.connect(self.show_pages)  # type: ignore[attr-defined]
        return cover

    def start_tutorial(self, name: str) -> None:
        """Show a tutorial over the pages."""
        self.show_pages()
        self.tutorial.start(name)
        self.tutorial.set_page(self.tabs.title)

    def set_state(self, view: WindowState) -> None:
        self.hint.set_state(view)
        self.tutorial.set_state(view)

    def show_palette(self) -> None:
        """Show the command palette."""
        entries = list(self.palette_entries())
        palette = self.command_palette
        self._open_search(palette)
        palette.show_entries(entries)

    def show_settings(self, search: str = "") -> None:
        """Show the settings that match a search."""
        page = self.settings_page
        self._open_search(page)
        page.search_for(search)

    @property
    def _searches(self) -> list[help_pages.SearchOverlay]:
        """Help, settings or palette, if they are open."""
        return [each for each in self.opened if isinstance(each, help_pages.SearchOverlay)]

    @property
    def is_covered(self) -> bool:
        """Whether the pages are covered, or a drawer of this class lies over them."""
        return self.stack.currentWidget() is not self.tabs or bool(self._searches)

    def show_shortcuts(self) -> None:
        """Show the shortcuts of the visible page."""
        title = getattr(self.stack.currentWidget(), "title", "") or self.tabs.title
        self._open_search(self.shortcut_sheet)
        self.shortcut_sheet.show_shortcuts(shortcuts_by_group(self.window(), [title]))

    def show_welcome(self) -> None:
        """Show the welcome page."""
        self._show_cover(self.welcome).show_page(str(self.tabs.folder))

    def show_pages(self) -> bool:
        """Show the pages and return whether something lay over them."""
        if not self.is_covered:
            return False
        for each in self._searches:
            each.dismiss()
        if self.stack.currentWidget() is self.tabs:
            return True
        self.stack.setCurrentWidget(self.tabs)
        if self._previous_focus is not None and isValid(self._previous_focus):
            self._previous_focus.setFocus()
        else:
            self.tabs.current_page.activate()
        self._previous_focus = None
        return True

    def go_back(self) -> None:
        """Close what lies on top, or go one step back on the page."""
        if not self.close_topmost() and not self.show_pages():
            self.tabs.go_back()

    def _open_search(self, overlay: help_pages.SearchOverlay) -> None:
        for each in self._searches:
            each.dismiss()
        overlay.open()

    def _show_cover(self, widget: W) -> W:
        for each in self._searches:
            each.dismiss()
        if self.stack.currentWidget() is self.tabs:
            self._previous_focus = QApplication.focusWidget()
        self.stack.setCurrentWidget(widget)
        return widget

    def select_page(self, index: int) -> None:
        """Show a page above overlays and give it the focus."""
        self.show_pages()
        self.tabs.select_page(index)
