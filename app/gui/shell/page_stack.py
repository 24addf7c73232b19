"""Central widget of the main window: the pages, and shortcut sheet, command palette, settings or welcome page over them."""

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
from app.gui.shell.page_host import BENCH, TITLES
from app.gui.shell.tabs import MainTabs
from app.gui.widgets import add_actions, choose_files, column, shortcuts_by_group

if TYPE_CHECKING:
    from app.archive import ProblemFacts
    from app.common import RecentErrors
    from app.gui.widgets import WindowTheme
    from app.session import WindowState

W = TypeVar("W", bound=QWidget)


class CentralStack(QWidget):
    """Shows the pages, or the shortcut sheet or welcome page over them; Escape returns to the pages."""

    bench_chosen = Signal(str)
    """Path of a bench file."""

    def __init__(self, tabs: MainTabs, theme: WindowTheme) -> None:
        super().__init__()
        self._theme = theme
        self.tabs, self.shortcut_sheet, self.welcome, self.hint = tabs, ShortcutSheet(), WelcomePage(), FirstRunHint()
        self.tutorial, self.stack = TutorialBand(), QStackedWidget()
        self.stack.addWidget(tabs)
        for cover in (self.shortcut_sheet, self.welcome):
            self._add_cover(cover)
        column(self.hint, self.tutorial, (self.stack, 1), parent=self, margins=(10, 0, 10, 8), spacing=6)
        self._previous_focus: QWidget | None = None
        tabs.sheets.pressed.connect(self.show_specimen)
        tabs.identification_requested.connect(self.show_identification)
        tabs.currentChanged.connect(lambda at: self.tutorial.set_page(tabs.tabText(at)))
        self.shortcut_sheet.welcome_requested.connect(self.show_welcome)
        self.welcome.tutorial_requested.connect(self.start_tutorial)
        self.welcome.setup_button.clicked.connect(lambda: self._select_page(BENCH))
        self.welcome.browse_button.clicked.connect(self._choose_bench_file)
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
            "problem": ("problem_page", self.show_problem),
        }
        add_actions(
            self,
            {
                **{f"page.{title.lower()}": partial(self._select_page, at) for at, title in enumerate(TITLES)},
                **{name: partial(self.toggle, cover, show) for name, (cover, show) in covers.items()},
            },
        )

    @cached_property
    def command_palette(self) -> help_pages.CommandPalette:
        """The command palette; created when first used."""
        return self._add_cover(help_pages.CommandPalette())

    @cached_property
    def settings_page(self) -> help_pages.SettingsPage:
        """The settings page; created when first used."""
        return self._add_cover(help_pages.SettingsPage(self.settings()))

    @cached_property
    def specimen_page(self) -> specimen_pages.SpecimenPage:
        """The page with the sheet of a specimen; created when first used."""
        page = self._add_cover(specimen_pages.SpecimenPage())
        page.saved.connect(self._on_sheet_saved)
        return page

    @cached_property
    def problem_page(self) -> help_pages.ProblemPage:
        """The page that saves a problem report; created when first used."""
        return self._add_cover(help_pages.ProblemPage(self.problem_facts))

    def toggle(self, cover: str, show: Callable[[], object]) -> None:
        """Show one of the covers, or the pages again where it is shown."""
        if cover in self.__dict__ and self.stack.currentWidget() is getattr(self, cover):
            self.show_pages()
        else:
            show()

    def show_problem(self) -> None:
        """Show the page that saves a problem report."""
        self._show_cover(self.problem_page).activate()

    def show_specimen(self) -> None:
        """Show the sheet of the specimen of the visible page."""
        self._show_cover(self.specimen_page).show_specimen(*self.tabs.subject.specimen)

    @cached_property
    def identification_page(self) -> specimen_pages.IdentificationPage:
        """The page that identifies a specimen; created when first used."""
        return self._add_cover(specimen_pages.IdentificationPage(self._theme))

    def show_identification(self, subject: specimen_pages.IdentificationSubject | None = None) -> None:
        """Show the identification of a specimen; None: the visible page's."""
        self._show_cover(self.identification_page).show_subject(subject or self.tabs.subject.identification)

    def shutdown(self) -> None:
        """Stop background threads; files that are being written are finished."""
        for name in ("specimen_page", "identification_page", "problem_page"):
            if name in self.__dict__:
                getattr(self, name).shutdown()

    def _on_sheet_saved(self) -> None:
        self.tabs.sheets.update()
        if "identification_page" in self.__dict__:
            self.identification_page.outdate()

    def _add_cover(self, cover: W) -> W:
        cover.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)  # it does not enlarge the window
        self.stack.addWidget(cover)
        cover.closed.connect(self.show_pages)  # type: ignore[attr-defined]
        return cover

    def start_tutorial(self, name: str) -> None:
        """Show a tutorial above the pages."""
        self.show_pages()
        self.tutorial.start(name)
        self.tutorial.set_page(self.tabs.tabText(self.tabs.currentIndex()))

    def set_state(self, view: WindowState) -> None:
        self.hint.set_state(view)
        self.tutorial.set_state(view)

    def show_palette(self) -> None:
        """Show the command palette."""
        entries = list(self.palette_entries())
        self._show_cover(self.command_palette).show_entries(entries)

    def show_settings(self, search: str = "") -> None:
        """Show the settings that match a search."""
        self._show_cover(self.settings_page).search_for(search)

    @property
    def is_covered(self) -> bool:
        """Whether the pages are covered."""
        return self.stack.currentWidget() is not self.tabs

    def show_shortcuts(self) -> None:
        """Show the shortcuts of the visible page."""
        shown = self.stack.currentWidget()
        title = getattr(shown, "title", "") or self.tabs.tabText(self.tabs.currentIndex())
        self._show_cover(self.shortcut_sheet).show_shortcuts(shortcuts_by_group(self.window(), [title]))

    def show_welcome(self) -> None:
        """Show the welcome page."""
        self._show_cover(self.welcome).show_page(str(self.tabs.folder))

    def show_pages(self) -> bool:
        """Show the pages and return whether they were covered."""
        if not self.is_covered:
            return False
        self.stack.setCurrentWidget(self.tabs)
        if self._previous_focus is not None and isValid(self._previous_focus):
            self._previous_focus.setFocus()
        else:
            self.tabs.current_page.activate()
        self._previous_focus = None
        return True

    def go_back(self) -> None:
        """Go one step back."""
        if not self.show_pages():
            self.tabs.go_back()

    def _show_cover(self, widget: W) -> W:
        if not self.is_covered:
            self._previous_focus = QApplication.focusWidget()
        self.stack.setCurrentWidget(widget)
        return widget

    def _select_page(self, index: int) -> None:
        """Show a page above covers."""
        self.show_pages()
        self.tabs.select_page(index)

    def _choose_bench_file(self) -> None:
        choose_files(
            self, "Open a bench file", lambda paths: self.bench_chosen.emit(str(paths[0])), "Bench files (*.toml)"
        )
