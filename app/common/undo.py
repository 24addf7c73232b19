"""Undo and redo."""

from typing import Generic, TypeVar

T = TypeVar("T")


class History(Generic[T]):
    """States one can go back and forth among."""

    def __init__(self, state: T) -> None:
        self.now = state
        self._past: list[T] = []
        self._future: list[T] = []
        self._moving = ""

    def go(self, state: T, moving: str = "") -> None:
        """A new state; `moving` names what is moved on and on, as a slider: that is one step."""
        if state == self.now:
            return
        if not (moving and moving == self._moving):
            self._past.append(self.now)
        self._future.clear()
        self.now, self._moving = state, moving

    @property
    def can_undo(self) -> bool:
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        return bool(self._future)

    def undo(self) -> bool:
        """One step back; whether there was one."""
        return self._step(self._past, self._future)

    def redo(self) -> bool:
        """One step forth; whether there was one."""
        return self._step(self._future, self._past)

    def _step(self, back: list[T], forth: list[T]) -> bool:
        if not back:
            return False
        forth.append(self.now)
        self.now, self._moving = back.pop(), ""
        return True
