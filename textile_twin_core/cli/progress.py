"""A progress bar on long work, for people only: nothing where standard error is no terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_LONG = 50_000


@contextmanager
def progress(total: int, what: str) -> Iterator[Callable[[int], object] | None]:
    """A function to call with the number of samples just done; None when no bar is shown."""
    if total < _LONG or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=what, unit=" samples", unit_scale=True, leave=False) as bar:
        yield bar.update
