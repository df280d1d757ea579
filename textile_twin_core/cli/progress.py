"""A progress bar on long work, for people only: nothing where standard error is no terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_LONG = 50_000


@contextmanager
def progress(
    total: int, what: str, unit: str = " samples", long: int = _LONG
) -> Iterator[Callable[[int], object] | None]:
    """A function to call with the number of units just done; None when no bar is shown, as below `long` units."""
    if total < long or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=what, unit=unit, unit_scale=total >= _LONG, leave=False) as bar:
        yield bar.update
