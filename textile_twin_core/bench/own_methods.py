"""Our methods as candidates: closed forms, and tables at several tolerances."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate
from textile_twin_core.errors import SceneError
from textile_twin_core.twin import Twin, compile_rigid

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-13)


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
