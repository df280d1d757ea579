"""Loops that tests want compiled, however short their blocks are."""

from __future__ import annotations

from textile_twin_core.expression import loop


def compile_at_once(made: loop.Loop) -> loop.Loop:
    """The loop, as if it had met very many samples."""
    made.compile_now()
    assert made.is_compiled
    return made
