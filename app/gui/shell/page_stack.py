"""Page area of the main window: the pages, covers in their place, and drawers and cards over them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, TypeVar

from PySide6.QtCore import QEvent, QObject, Signal
from PySide6.QtWidgets import QApplication, QSizePolicy, QStackedWidget, QWidget
from shiboken6 import isValid

from app.gui import help as help_pages
from app.gui import specimen as specimen_pages
from app.gui.help import FirstRunHint, ShortcutSheet, TutorialBand, WelcomePage
from app.gui.shell.page_host import BENCH, MEASURE, TITLES
from app.gui.shell.tabs import MainTabs
from app.gui.widgets import Overlay, OverlayHost, Place, add_actions, choose_files, shortcuts_by_group

if TYPE_CHECKING:
    from app.archive import ProblemFacts
    from app.common import RecentErrors
    from app.session import WindowState

W = TypeVar("W", bound=QWidget)


class _Follower(QObject):
    """Shows and hides a card with its content."""

    def __init__(self, content: QWidget, card: Overlay) -> None:
        super().__init__(content)
        self._card = card

    def eventFilter(self, _watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.ShowToParent:
            self._card.open()
        elif event.type() == QEvent.Type.HideToParent:
            self._card.hide()
        return False


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
        self._drawers: dict[QWidget, Overlay] = {}
        """Overlays of help, settings and palette, by their content."""
        self._add_drawer(self.shortcut_sheet)
        for content in (self.hint, self.tutorial):
            self._add_hint(content)
        self._previous_focus: QWidget | None = None
        tabs.sheets.pressed.connect(self.show_specimen)
        tabs.identification_requested.connect(self.show_identification)
        tabs.currentChanged.connect(lambda at: self.tutorial.set_page(TITLES[at]))
        self.shortcut_sheet.welcome_requested.connect(self.show_welcome)
        self.welcome.closed.connect(lambda: self.select_page(MEASURE))
        self.welcome.tutorial_requested.connect(self.start_tutorial)
        self.welcome.setup_button.clicked.connect(lambda: self.select_page(BENCH))
        self.welcome.browse_button.clicked.connect(self._choose_bench_file)
        self.palette_entries: Callable[[], Iterable[help_pages.PaletteEntry]] = tuple
        """Returns what the command palette offers."""
        self.settings: Callable[[], Sequence[help_pages.Setting]] = tuple
        """Returns the settings; called once."""
        self.problem_facts: Callable[[], tuple[ProblemFacts, RecentErrors]]
        """Returns what a problem report has of this window."""
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
                **{f"page.{title.lower()}": partial(self.select_page, at) for at, title in enumerate(TITLES)},
                **{name: partial(self.toggle, cover, show) for name, (cover, show) in covers.items()},
            },
        )

    @cached_property
    def command_palette(self) -> help_pages.CommandPalette:
        """The command palette; created when first used."""
        return self._add_drawer(help_pages.CommandPalette(), Place.TOP)

    @cached_property
    def settings_page(self) -> help_pages.SettingsPage:
        """The settings page; created when first used."""
        return self._add_drawer(help_pages.SettingsPage(self.settings()))

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
        if cover in self.__dict__ and getattr(self, cover).isVisible():
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
        return self._add_cover(specimen_pages.IdentificationPage())

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

    def _add_drawer(self, content: W, place: Place = Place.RIGHT) -> W:
        overlay = self.add_overlay(Overlay(f"drawer.{type(content).__name__}", content, place))
        self._drawers[content] = overlay
        content.closed.connect(self.show_pages)  # type: ignore[attr-defined]
        return content

    def _add_hint(self, content: QWidget) -> None:
        """Let a card be as visible as its content."""
        overlay = self.add_overlay(Overlay(f"hint.{content.objectName()}", content, Place.HINT, closable=False))
        content.installEventFilter(_Follower(content, overlay))
        overlay.setVisible(not content.isHidden())

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
        self._open_drawer(palette)
        palette.show_entries(entries)

    def show_settings(self, search: str = "") -> None:
        """Show the settings that match a search."""
        page = self.settings_page
        self._open_drawer(page)
        page.search_for(search)

    @property
    def is_covered(self) -> bool:
        """Whether the pages are covered, or a drawer of this class lies over them."""
        return self.stack.currentWidget() is not self.tabs or any(
            not each.isHidden() for each in self._drawers.values()
        )

    def show_shortcuts(self) -> None:
        """Show the shortcuts of the visible page."""
        title = getattr(self.stack.currentWidget(), "title", "") or self.tabs.title
        self._open_drawer(self.shortcut_sheet)
        self.shortcut_sheet.show_shortcuts(shortcuts_by_group(self.window(), [title]))

    def show_welcome(self) -> None:
        """Show the welcome page."""
        self._show_cover(self.welcome).show_page(str(self.tabs.folder))

    def show_pages(self) -> bool:
        """Show the pages and return whether something lay over them."""
        if not self.is_covered:
            return False
        for drawer in self._drawers.values():
            drawer.dismiss()
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

    def _open_drawer(self, content: QWidget) -> None:
        for each in self._drawers:
            if each is not content:
                self._drawers[each].dismiss()
        self._drawers[content].open()

    def _show_cover(self, widget: W) -> W:
        for drawer in self._drawers.values():
            drawer.dismiss()
        if self.stack.currentWidget() is self.tabs:
            self._previous_focus = QApplication.focusWidget()
        self.stack.setCurrentWidget(widget)
        return widget

    def select_page(self, index: int) -> None:
        """Show a page, whatever lies over the pages, and give it the focus."""
        self.show_pages()
        self.tabs.select_page(index)

    def _choose_bench_file(self) -> None:
        choose_files(
            self, "Open a bench file", lambda paths: self.bench_chosen.emit(str(paths[0])), "Bench files (*.toml)"
        )
