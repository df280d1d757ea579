"""A progress bar on long work, for people only: nothing where standard error is no terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Never

from tqdm import tqdm

from textile_twin_core.cli.mistakes import is_collecting

_LONG = 5_000
"""Samples that take about two seconds on a slow computer."""
_PARTS = 1000
Stage = Callable[[str, float, int], "Callable[[int], object] | None"]
"""Begins a stage: its name, the share of all work at which it ends, its units; what counts units as they are done."""


def on_terminal() -> bool:
    """Whether there is somebody to show a bar to."""
    return sys.stderr.isatty() and not is_collecting()


@contextmanager
def progress(
    total: int, what: str, unit: str = " samples", long: int = _LONG
) -> Iterator[Callable[[int], object] | None]:
    """A function to call with the number of units just done; None when no bar is shown, as below `long` units."""
    if total < long or not on_terminal():
        yield None
        return
    with tqdm(total=total, desc=what, unit=unit, unit_scale=total >= _LONG, leave=False) as bar:
        yield bar.update


@contextmanager
def shares(what: str) -> Iterator[Callable[[float], None]]:
    """A function to call with the share of the work that is done, for work of which nobody knows how long it takes."""
    with progress(_PARTS, what, "", long=0) as bar:
        done = 0

        def report(share: float) -> None:
            nonlocal done
            if bar and int(share * _PARTS) > done:
                bar(int(share * _PARTS) - done)
                done = int(share * _PARTS)

        yield report


@contextmanager
def stages(total: int) -> Iterator[Stage]:
    """One bar over stages of different kinds: a function to call as each begins; no bar below `_LONG` samples."""
    if total < _LONG or not on_terminal():
        yield lambda *_: None
        return
    # Not before its first stage has a name, and from then on with every part that is done.
    form = "{desc}: {percentage:3.0f}%|{bar}| [{elapsed}<{remaining}]"
    with tqdm(total=_PARTS, leave=False, bar_format=form, delay=1e-9, mininterval=0.0, miniters=1) as bar:
        yield _Stages(bar).begin


@contextmanager
def aside() -> Iterator[None]:
    """Bars give way to words, or to a question, on the same terminal, and come back after them."""
    if not on_terminal():
        yield
        return
    with tqdm.external_write_mode(sys.stderr):
        yield


class _Stages:
    """The stage at hand, from one place of a bar to another."""

    def __init__(self, bar: tqdm[Never]) -> None:
        self._bar, self._from, self._to = bar, 0.0, 0.0
        self._total, self._done = 1, 0

    def begin(self, what: str, until: float, total: int) -> Callable[[int], object]:
        """Begin a stage; the one before is over."""
        self._move_to(self._to)
        self._from, self._to, self._total, self._done = self._to, until, total, 0
        self._bar.set_description_str(what)
        return self._count

    def _count(self, units: int) -> None:
        self._done += units
        self._move_to(self._from + (self._to - self._from) * self._done / self._total)

    def _move_to(self, share: float) -> None:
        self._bar.update(round(share * _PARTS) - self._bar.n)
