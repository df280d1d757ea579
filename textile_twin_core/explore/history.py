"""Undo and redo of designs."""

from __future__ import annotations

from typing import Generic, TypeVar

State = TypeVar("State")
_MOST = 500


class History(Generic[State]):
    """Sequence of states with a present one. Undone states can be redone until a new one is added.

    `put` with the same `gesture` as the last replaces the present state, so that one drag of a slider is one step.
    """

    def __init__(self, state: State) -> None:
        self._past: list[State] = []
        self._future: list[State] = []
        self._present = state
        self._gesture: str | None = None

    @property
    def present(self) -> State:
        """Present state."""
        return self._present

    @property
    def can_undo(self) -> bool:
        """True if there is an earlier state."""
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        """True if there is an undone state."""
        return bool(self._future)

    def put(self, state: State, gesture: str | None = None) -> None:
        """Add a state."""
        if gesture is None or gesture != self._gesture:
            self._past.append(self._present)
            del self._past[:-_MOST]
        self._future.clear()
        self._present, self._gesture = state, gesture

    def undo(self) -> State:
        """Go back by one step if possible, and return the present state."""
        if self._past:
            self._future.append(self._present)
            self._present, self._gesture = self._past.pop(), None
        return self._present

    def redo(self) -> State:
        """Go forward by one step if possible, and return the present state."""
        if self._future:
            self._past.append(self._present)
            self._present, self._gesture = self._future.pop(), None
        return self._present
