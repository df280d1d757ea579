"""Other libraries doing the same work, each in its own best way; those not installed are left out."""

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
"""Import name of each library and the module here that drives it."""


def peer_candidates(scene: Workload, say: Callable[[str], object] = lambda _: None) -> list[Candidate]:
    """Candidates of every peer that is installed and can do the scene; `say` hears, in a line, what is left out."""
    found: list[Candidate] = []
    for library, module in MODULES.items():
        if find_spec(library) is None:
            say(f"{library} is left out: not installed (pip install -r requirements-peers.lock)")
            continue
        try:
            make: Callable[[Workload], Iterator[Candidate]] = import_module(f"{__name__}.{module}").candidates
            found += [tried(candidate) for candidate in make(scene)]
        except Exception as error:  # whatever fails in another library costs its own rows, not the bench
            cause = " ".join(str(error).split()) or type(error).__name__
            say(f"{library} is left out of '{scene.name}': {cause[:200]}")
    return found


def tried(candidate: Candidate) -> Candidate:
    """The candidate after one run of all it offers, so that what fails does so here."""
    for work in (candidate.batch, candidate.single, candidate.result, candidate.error):
        if work is not None:
            work()
    return candidate
