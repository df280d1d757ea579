"""Other libraries on the same task, each with its fastest interface; missing ones are skipped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec

from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate

MODULES: Mapping[str, str] = {
    "pinocchio": "pinocchio_tree",
    "mujoco": "mujoco_tree",
    "pydrake": "drake_tree",
    "exudyn": "exudyn_stepping",
    "casadi": "casadi_form",
    "jax": "jax_form",
    "numba": "numba_form",
    "pylinkage": "pylinkage_positions",
}
"""Import name of each library, and the module here that calls it."""


def peer_candidates(scene: Workload, say: Callable[[str], object] = lambda _: None) -> list[Candidate]:
    """Build the candidates of every installed peer that supports the scene; `say` is called with a line per
    skipped peer.
    """
    found: list[Candidate] = []
    for library, module in MODULES.items():
        if find_spec(library) is None:
            say(f"{library} is left out: not installed (pip install -r requirements-peers.lock)")
            continue
        try:
            make: Callable[[Workload], Iterator[Candidate]] = import_module(f"{__name__}.{module}").candidates
            found += [tried(candidate) for candidate in make(scene)]
        except Exception as error:  # a failure in another library skips its rows only
            cause = " ".join(str(error).split()) or type(error).__name__
            say(f"{library} is left out of '{scene.name}': {cause[:200]}")
    return found


def tried(candidate: Candidate) -> Candidate:
    """Run a candidate once with all its functions, so that failures show here, and return it."""
    for work in (candidate.batch, candidate.single, candidate.result, candidate.error):
        if work is not None:
            work()
    return candidate
