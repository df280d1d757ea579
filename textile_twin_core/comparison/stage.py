"""How long work tells how far it is."""

from __future__ import annotations

from collections.abc import Callable

Begin = Callable[[str, float], object]
"""Hears of each stage as it begins: its name, and the share of all work at which it ends."""


def unheard(_what: str, _until: float) -> None:
    """For work that nobody waits for."""
