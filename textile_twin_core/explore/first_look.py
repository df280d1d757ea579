"""The first look at a machine with impacts: its loops are compiled once on a computer, beside all else.

In a process of its own, which leaves them in the cache, so that no slider waits for the compiler; a mark in the cache
says that it has been done for this code.
"""

from __future__ import annotations

import subprocess
import sys
import time
from concurrent.futures import Future
from concurrent.futures import TimeoutError as TakesLonger
from functools import cache
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from threading import Thread

from textile_twin_core import machines
from textile_twin_core.compiling import cache_directory
from textile_twin_core.errors import TwinError
from textile_twin_core.explore.analysis_of_transfer import analyse_transfer

_PATIENCE_S = 2.0
"""Loops that were compiled before are read in less."""
_BESIDE = f"import os; os.nice(5); from {__name__} import look; look()"


class NotYetCompiledError(TwinError):
    """The loops are being compiled; `begun` is when that began, as time.monotonic() counts."""

    def __init__(self, begun: float) -> None:
        super().__init__("the loops of machines with impacts are being compiled; look again in a minute")
        self.begun = begun


def look() -> None:
    """Look at a machine with impacts; what that needs is compiled, or read."""
    analyse_transfer(machines.needle_transfer())


@cache
def first_look() -> tuple[Future[None], float]:
    """The first look, the same for everybody who waits for it, and when it began."""
    looked: Future[None] = Future()

    def run() -> None:
        try:
            mark = _mark()
            if not mark.exists():
                subprocess.run([sys.executable, "-c", _BESIDE], check=False)
            look()
            if mark.parent.is_dir():
                mark.touch()
            looked.set_result(None)
        except Exception as error:
            looked.set_exception(error)

    Thread(target=run, name="first-look", daemon=True).start()
    return looked, time.monotonic()


def await_first_look() -> None:
    """Return once the loops are there. Raises NotYetCompiledError where that takes longer than a person waits."""
    looked, begun = first_look()
    try:
        looked.result(_PATIENCE_S if time.monotonic() - begun < _PATIENCE_S else 0.0)
    except TakesLonger:
        raise NotYetCompiledError(begun) from None


def _mark() -> Path:
    """Where it stands that the loops of this code have been compiled."""
    told = sha256(sys.version.encode())
    for source in sorted(files("textile_twin_core.contact").iterdir(), key=lambda f: f.name):
        if source.name.endswith(".py"):
            told.update(source.read_bytes())
    return cache_directory() / f"first_look-{told.hexdigest()[:32]}"
