"""Undo and redo history."""

from typing import Generic, TypeVar

T = TypeVar("T")


class UndoHistory(Generic[T]):
    """A history of states with undo and redo."""

    def __init__(self, state: T) -> None:
        self.current = state
        self._past: list[T] = []
        self._future: list[T] = []
        self._merge_key = ""

    def push(self, state: T, merge_key: str = "") -> None:
        """Add a state; consecutive states of one `merge_key`, as of a dragged slider, are a single step."""
        if state == self.current:
            return
        if not (merge_key and merge_key == self._merge_key):
            self._past.append(self.current)
        self._future.clear()
        self.current, self._merge_key = state, merge_key

    @property
    def can_undo(self) -> bool:
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        return bool(self._future)

    def undo(self) -> bool:
        """Go one step back; return whether there was one."""
        return self._step(self._past, self._future)

    def redo(self) -> bool:
        """Go one step forward; return whether there was one."""
        return self._step(self._future, self._past)

    def _step(self, back: list[T], forth: list[T]) -> bool:
        if not back:
            return False
        forth.append(self.current)
        self.current, self._merge_key = back.pop(), ""
        return True
