"""First analysis of a machine with impacts, which compiles its loops once per computer, in the background.

It runs in a separate process, which leaves the compiled loops in the cache, so that no slider waits for the compiler. A
mark in the cache records that this has been done for the present code.
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
from textile_twin_core.explore.analysis_of_contact import analyse_transfer

_PATIENCE_S = 2.0
"""Longest wait; loops in the cache load faster."""
_BESIDE = f"import os; os.nice(5); from {__name__} import look; look()"


class NotYetCompiledError(TwinError):
    """Error while the loops are being compiled; `begun` is the start time by time.monotonic()."""

    def __init__(self, begun: float) -> None:
        super().__init__("the loops of machines with impacts are being compiled; look again in a minute")
        self.begun = begun


def look() -> None:
    """Analyse a machine with impacts, which compiles or loads its loops."""
    analyse_transfer(machines.needle_transfer())


@cache
def first_look() -> tuple[Future[None], float]:
    """Start the first analysis once; return its future, shared by all callers, and its start time."""
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
    """Wait for the compiled loops.

    Raises:
        NotYetCompiledError: Compiling takes longer than a person waits.
    """
    looked, begun = first_look()
    try:
        looked.result(_PATIENCE_S if time.monotonic() - begun < _PATIENCE_S else 0.0)
    except TakesLonger:
        raise NotYetCompiledError(begun) from None


def _mark() -> Path:
    """Return the path of the mark for the loops of the present code."""
    digest = sha256(sys.version.encode())
    for source in sorted(files("textile_twin_core.contact").iterdir(), key=lambda f: f.name):
        if source.name.endswith(".py"):
            digest.update(source.read_bytes())
    return cache_directory() / f"first_look-{digest.hexdigest()[:32]}"
