"""Points chosen with the mouse, to be measured again."""

from collections.abc import Callable, Sequence
from typing import Any

from PySide6.QtWidgets import QPushButton


class Selection:
    """Entries of the plan, and the button that measures them again: it is there while something is chosen.

    Args:
        button: measures again.
        changed: called when other entries are chosen.
    """

    def __init__(self, button: QPushButton, changed: Callable[[], None]) -> None:
        self._button, self._changed = button, changed
        self._allowed = False
        self.entries: frozenset[int] = frozenset()
        button.setToolTip("A run that goes on with this one, and measures the chosen points again")
        button.hide()

    def toggle(self, entries: Sequence[int], spots: Sequence[Any]) -> None:
        """A click on points: choose them, or not any more."""
        at = {entries[spot.index()] for spot in spots if spot.index() < len(entries)}
        self._become(self.entries ^ at)

    def keep(self, entries: Sequence[int]) -> None:
        """Other points are shown: what is not among them is not chosen."""
        self._become(self.entries & set(entries))

    def allow(self, allowed: bool) -> None:
        """Whether a run may begin."""
        self._allowed = allowed
        self._show()

    def take(self) -> tuple[int, ...]:
        """What was chosen, which is then done with."""
        taken = tuple(sorted(self.entries))
        self._become(frozenset())
        return taken

    def _become(self, entries: frozenset[int] | set[int]) -> None:
        if entries != self.entries:
            self.entries = frozenset(entries)
            self._show()
            self._changed()

    def _show(self) -> None:
        count = len(self.entries)
        self._button.setText(f"Measure {'this point' if count == 1 else f'these {count} points'} again")
        self._button.setVisible(count > 0)
        self._button.setEnabled(self._allowed)
