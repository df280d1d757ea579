"""Progress bar for long work, shown only on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Never

from tqdm import tqdm

from textile_twin_core.cli.mistakes import is_collecting

_LONG = 5_000
"""Number of samples that takes about two seconds on a slow computer."""
_PARTS = 1000
Stage = Callable[[str, float, int], "Callable[[int], object] | None"]
"""Function that starts a stage (name, share of all work at its end, units) and returns a counter of finished units."""


def on_terminal() -> bool:
    """Return true if standard error is a terminal."""
    return sys.stderr.isatty() and not is_collecting()


@contextmanager
def progress(
    total: int, what: str, unit: str = " samples", long: int = _LONG
) -> Iterator[Callable[[int], object] | None]:
    """Yield a function to call with the number of finished units; None without a bar, as below `long` units."""
    if total < long or not on_terminal():
        yield None
        return
    with tqdm(total=total, desc=what, unit=unit, unit_scale=total >= _LONG, leave=False) as bar:
        yield bar.update


@contextmanager
def shares(what: str) -> Iterator[Callable[[float], None]]:
    """Yield a function to call with the finished share of the work, for work of unknown duration."""
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
    """Show one bar over several stages; yield a function that starts each stage. There is no bar below `_LONG`
    samples.
    """
    if total < _LONG or not on_terminal():
        yield lambda *_: None
        return
    # Show the bar from the first stage on, and update it with every finished unit.
    form = "{desc}: {percentage:3.0f}%|{bar}| [{elapsed}<{remaining}]"
    with tqdm(total=_PARTS, leave=False, bar_format=form, delay=1e-9, mininterval=0.0, miniters=1) as bar:
        yield _Stages(bar).begin


@contextmanager
def aside() -> Iterator[None]:
    """Hide the bars while text or a question is written to the same terminal."""
    if not on_terminal():
        yield
        return
    with tqdm.external_write_mode(sys.stderr):
        yield


class _Stages:
    """Present stage, from one position of a bar to another."""

    def __init__(self, bar: tqdm[Never]) -> None:
        self._bar, self._from, self._to = bar, 0.0, 0.0
        self._total, self._done = 1, 0

    def begin(self, what: str, until: float, total: int) -> Callable[[int], object]:
        """Start a stage and end the previous one."""
        self._move_to(self._to)
        self._from, self._to, self._total, self._done = self._to, until, total, 0
        self._bar.set_description_str(what)
        return self._count

    def _count(self, units: int) -> None:
        self._done += units
        self._move_to(self._from + (self._to - self._from) * self._done / self._total)

    def _move_to(self, share: float) -> None:
        self._bar.update(round(share * _PARTS) - self._bar.n)
