"""Undo and redo: the states that a person has been through."""

from __future__ import annotations

from typing import Generic, TypeVar

State = TypeVar("State")
_MOST = 500


class History(Generic[State]):
    """A line of states with a present one; what was undone can be redone until something new is done.

    `put` with the same `gesture` as the last replaces it, so that one drag of a slider is one step.
    """

    def __init__(self, state: State) -> None:
        self._past: list[State] = []
        self._future: list[State] = []
        self._present = state
        self._gesture: str | None = None

    @property
    def present(self) -> State:
        """The state now."""
        return self._present

    @property
    def can_undo(self) -> bool:
        """Whether there is a state before."""
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        """Whether something was undone."""
        return bool(self._future)

    def put(self, state: State, gesture: str | None = None) -> None:
        """A new state."""
        if gesture is None or gesture != self._gesture:
            self._past.append(self._present)
            del self._past[:-_MOST]
        self._future.clear()
        self._present, self._gesture = state, gesture

    def undo(self) -> State:
        """Back by one step, or where we are."""
        if self._past:
            self._future.append(self._present)
            self._present, self._gesture = self._past.pop(), None
        return self._present

    def redo(self) -> State:
        """Forward again by one step, or where we are."""
        if self._future:
            self._past.append(self._present)
            self._present, self._gesture = self._future.pop(), None
        return self._present
