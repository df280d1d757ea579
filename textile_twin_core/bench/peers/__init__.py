"""Other libraries doing the same work, each in its own best way; those not installed are left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec

from textile_twin_core.bench.scenes import Scene
from textile_twin_core.bench.timing import Candidate

MODULES: Mapping[str, str] = {}
"""Import name of each library and the module here that drives it."""


def peer_candidates(scene: Scene) -> list[Candidate]:
    """Candidates of every peer that is installed and can do the scene."""
    found: list[Candidate] = []
    for library, module in MODULES.items():
        if find_spec(library) is not None:
            make: Callable[[Scene], Iterator[Candidate]] = import_module(f"{__name__}.{module}").candidates
            found += make(scene)
    return found
