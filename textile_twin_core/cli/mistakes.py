"""Mistakes on the command line, the nearest words that would be right, and what a person is to be told."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from difflib import get_close_matches

from textile_twin_core.errors import TwinError

_MOST_WORDS = 12


class UsageError(TwinError):
    """The command line itself is wrong."""


class BeyondLimitError(TwinError):
    """The work is done, and a result lies beyond a limit that was given: exit code 3, for scripts."""


def tell(*notices: str) -> None:
    """Each notice as one line on stderr, beside what the command gives."""
    for notice in notices:
        print("textile-twin: " + " ".join(notice.split()), file=sys.stderr)


def nearest(given: str, known: Iterable[str]) -> str:
    """Half a sentence that names the nearest of the known words, or all of them."""
    words = list(known)
    near = get_close_matches(given, words, n=3, cutoff=0.5)
    if near:
        return f"did you mean {' or '.join(near)}?"
    more = f" and {len(words) - _MOST_WORDS} more" if len(words) > _MOST_WORDS else ""
    return f"there are: {', '.join(words[:_MOST_WORDS])}{more}"
