"""Keys, each with its words: the sheet that tells them is made from the shortcuts themselves, so that it cannot be wrong."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from PySide6.QtCore import QObject, Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QWidget

GLOBAL_GROUP = "Everywhere"
PAGE_CONTEXT = Qt.ShortcutContext.WidgetWithChildrenShortcut
"""A key of one page: it works while the page has the keyboard."""

KeySpec = Qt.Key | str


@dataclass(frozen=True, slots=True)
class ShortcutInfo:
    """One line of the sheet: what is done, and the keys that do it."""

    description: str
    keys: tuple[str, ...]


def bind_keys(
    parent: QWidget,
    description: str,
    callback: Callable[[], object],
    *keys: KeySpec,
    context: Qt.ShortcutContext = Qt.ShortcutContext.WindowShortcut,
    repeats: bool = False,
) -> list[QShortcut]:
    """Let keys do something; `words` say what, on the sheet of keys."""
    made = []
    for key in keys:
        shortcut = QShortcut(QKeySequence(key), parent, context=context)
        shortcut.setWhatsThis(description)
        shortcut.setAutoRepeat(repeats)
        shortcut.activated.connect(callback)
        made.append(shortcut)
    return made


def forward_keys(dialog: QWidget, *keys: KeySpec) -> None:
    """Let keys of the window work in a dialog over it as well."""
    over = dialog.parentWidget()
    assert over is not None
    window = over.window()
    for key in keys:
        for own in window.findChildren(QShortcut, options=Qt.FindChildOption.FindDirectChildrenOnly):
            if own.key() == QKeySequence(key):
                bind_keys(dialog, own.whatsThis(), own.activated.emit, key)


def shortcuts_by_group(window: QWidget, pages: Sequence[object]) -> dict[str, tuple[ShortcutInfo, ...]]:
    """Every key of a window in groups: those that work everywhere, and those of the pages given, by their titles."""
    groups: dict[str, dict[str, list[str]]] = {title: {} for title in (GLOBAL_GROUP, *map(_page_title, pages))}
    for shortcut in window.findChildren(QShortcut):
        owner = _owning_page(shortcut)
        title = GLOBAL_GROUP if owner is None else _page_title(owner)
        if owner is not None and owner not in pages:
            continue
        keys = groups.setdefault(title, {}).setdefault(shortcut.whatsThis(), [])
        name = shortcut.key().toString(QKeySequence.SequenceFormat.NativeText)
        if name not in keys:
            keys.append(name)
    return {
        title: tuple(ShortcutInfo(words, tuple(keys)) for words, keys in group.items())
        for title, group in groups.items()
        if group
    }


def _owning_page(shortcut: QObject) -> QObject | None:
    """The page that a shortcut belongs to; None for one of the window."""
    parent = shortcut.parent()
    while parent is not None and not _page_title(parent):
        parent = parent.parent()
    return parent


def _page_title(page: object) -> str:
    title = getattr(page, "title", "")
    return title if isinstance(title, str) else ""
