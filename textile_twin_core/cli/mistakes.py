"""Mistakes on the command line, suggestions of valid words, and notices to the user."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from difflib import get_close_matches

from textile_twin_core.errors import TwinError

_MOST_WORDS = 12
_COLLECTED: ContextVar[list[str] | None] = ContextVar("collected", default=None)


class UsageError(TwinError):
    """Error in the command line itself."""


class BeyondLimitError(TwinError):
    """Result beyond a given limit after successful work: exit code 3, for scripts."""


def tell(*notices: str) -> None:
    """Print each notice as one line on stderr, beside the output of the command."""
    lines = [" ".join(notice.split()) for notice in notices]
    collected = _COLLECTED.get()
    if collected is not None:
        collected += lines
        return
    for line in lines:
        print(f"textile-twin: {line}", file=sys.stderr)


@contextmanager
def collected() -> Iterator[list[str]]:
    """Collect notices in a list, and show no progress: for work on one recording of many."""
    notices: list[str] = []
    token = _COLLECTED.set(notices)
    try:
        yield notices
    finally:
        _COLLECTED.reset(token)


def is_collecting() -> bool:
    """Return true while notices are collected."""
    return _COLLECTED.get() is not None


def nearest(given: str, known: Iterable[str]) -> str:
    """Suggest the nearest of the known words, or list all of them."""
    words = list(known)
    near = get_close_matches(given, words, n=3, cutoff=0.5)
    if near:
        return f"did you mean {' or '.join(near)}?"
    more = f" and {len(words) - _MOST_WORDS} more" if len(words) > _MOST_WORDS else ""
    return f"available: {', '.join(words[:_MOST_WORDS])}{more}"
