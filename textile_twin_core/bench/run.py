"""Benchmark run: every candidate of every scene, timed in turns, as rows of speed and error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import numpy as np

from textile_twin_core.bench.c_limit import c_candidates
from textile_twin_core.bench.scenes import Workload, scenes
from textile_twin_core.bench.timing import Candidate, one_core, take_turns
from textile_twin_core.bench.yardsticks import yardsticks
from textile_twin_core.errors import SceneError
from textile_twin_core.machine import Machine
from textile_twin_core.twin import Twin, compile_rigid

_PEERS = "textile_twin_peers"
"""Name under which the package of other libraries is imported; it lies outside this package."""
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-13)


@dataclass(frozen=True)
class Row:
    """One candidate on one scene. All rows of a run are timed in the same rounds.

    Attributes:
        error_over_peak: Largest error over the peak of its output, against extended precision.
        ns_per_sample: Time of a batch of `batch` samples, median of `ns_per_round` [ns]; None if not supported.
        us_per_call: Time of one sample at a time, median of `us_per_round` [us]; None if not supported.
    """

    method: str
    peer: str | None
    outputs: str
    machine: str
    batch: int
    error_over_peak: float | None
    ns_per_sample: float | None
    us_per_call: float | None
    note: str = ""
    ns_per_round: tuple[float, ...] = ()
    us_per_round: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        """Method, and its library."""
        return self.method if self.peer is None else f"{self.peer}, {self.method}"


@one_core()
def run_bench(
    machine: Machine,
    with_peers: bool = False,
    rounds: int = 11,
    samples: int = 100_000,
    scene_names: Sequence[str] | None = None,
    progress: Callable[[int, int], object] = lambda done, total: None,
    say: Callable[[str], object] = lambda line: None,
) -> list[Row]:
    """Measure all scenes of a machine.

    `progress` is called with the numbers of finished and total steps, `say` with a line per skipped peer.
    """
    chosen = [s for s in scenes(machine, samples) if scene_names is None or s.name in scene_names]
    total, done = len(chosen) + rounds, 0
    said: set[str] = set()

    def say_once(line: str) -> None:
        if line not in said:
            said.add(line)
            say(line)

    def tick(count: int) -> None:
        nonlocal done
        done += count
        progress(done, total)

    candidates: list[tuple[Workload, Candidate]] = []
    for scene in chosen:
        found = [*c_candidates(scene), *own_candidates(scene), *yardsticks(scene)]
        if with_peers:
            found += load_peers().peer_candidates(scene, say_once)
        candidates += [(scene, candidate) for candidate in found]
        tick(1)
    take_turns([candidate for _, candidate in candidates], rounds, tick)
    return [_row(scene, candidate) for scene, candidate in candidates]


def load_peers() -> ModuleType:
    """Import the package that calls other libraries; only the repository has it.

    Raises:
        SceneError: Neither the folder that contains this package nor the current folder is the repository.
    """
    for repository in (Path(__file__).parents[2], Path.cwd()):
        source = repository / "tests/benchmarks/peers/__init__.py"
        if _PEERS not in sys.modules and source.is_file():
            spec = spec_from_file_location(_PEERS, source)
            assert spec is not None and spec.loader is not None
            sys.modules[_PEERS] = module_from_spec(spec)
            spec.loader.exec_module(sys.modules[_PEERS])
    if _PEERS not in sys.modules:
        raise SceneError(
            "the comparison with other libraries is in the repository of textile-twin alone: run `textile-twin bench"
            " --peers` there (tests/benchmarks/README.md)"
        )
    return sys.modules[_PEERS]


def _row(scene: Workload, candidate: Candidate) -> Row:
    error = None
    if candidate.error is not None:
        error = candidate.error()
    elif candidate.result is not None:
        error = scene.error(candidate.result())
    return Row(
        candidate.method,
        candidate.peer,
        scene.name,
        scene.machine.name,
        candidate.samples,
        error,
        candidate.ns_per_sample,
        candidate.us_per_call,
        candidate.note,
        tuple(seconds / candidate.samples * 1e9 for seconds in candidate.batch_times),
        tuple(seconds * 1e6 for seconds in candidate.single_times),
    )


def own_candidates(scene: Workload) -> Iterator[Candidate]:
    """Build the exact method, and tables where they reach their tolerance."""
    yield _candidate(scene, compile_rigid(scene.machine, scene.outputs, "exact"), "exact")
    for tolerance in TOLERANCES:
        try:
            twin = compile_rigid(scene.machine, scene.outputs, "table", tolerance)
        except SceneError:
            continue
        yield _candidate(scene, twin, f"table {tolerance:.0e}")


def _candidate(scene: Workload, twin: Twin, method: str) -> Candidate:
    out = dict(zip(scene.outputs, np.empty((len(scene.outputs), scene.samples)), strict=True))
    theta, omega, alpha = scene.motion
    one = (1.234, float(omega[0]), float(alpha[0]))
    return Candidate(
        method,
        None,
        batch=lambda: twin.evaluate(theta, omega, alpha, out=out),
        samples=scene.samples,
        single=lambda: twin.evaluate(*one),
        result=lambda: out,
    )
