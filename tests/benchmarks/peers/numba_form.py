"""Numba: the closed form as generated Python, compiled by njit; one call per sample, and a compiled loop over arrays.

Timed: the compiled functions alone; `fast` lets the compiler reorder and contract (fastmath), which vectorises.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numba
import numpy as np

from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate
from textile_twin_core.expression.scalar import scalar_source

_INPUTS = ("theta", "omega", "alpha")


def candidates(scene: Workload) -> Iterator[Candidate]:
    """Build the closed form, with and without reordering."""
    source = scalar_source([scene.machine.model.output(name) for name in scene.outputs], _INPUTS)
    for method, fast in (("njit", False), ("njit, fast", True)):
        compiled = numba.njit(error_model="numpy", fastmath=fast)
        yield _candidate(scene, method, compiled(_function(source, "f")), compiled)


def _function(source: str, name: str, **names: Any) -> Callable[..., Any]:
    namespace = {"sqrt": math.sqrt, "sin": math.sin, "cos": math.cos, "atan2": math.atan2, **names}
    exec(compile(source, "<numba>", "exec"), namespace)
    return namespace[name]  # type: ignore[no-any-return]


def _candidate(scene: Workload, method: str, one: Any, compiled: Any) -> Candidate:
    stores = "\n".join(f"        out[{k}, i] = values[{k}]" for k in range(len(scene.outputs)))
    loop = (
        "def loop(theta, omega, alpha, out):\n    for i in range(theta.size):\n"
        f"        values = f(theta[i], omega[i], alpha[i])\n{stores}\n"
    )
    many = compiled(_function(loop, "loop", f=one))
    theta, omega, alpha = scene.motion
    out = np.empty((len(scene.outputs), scene.samples))
    first = (float(theta[0]), float(omega[0]), float(alpha[0]))
    return Candidate(
        method,
        "numba",
        batch=lambda: many(theta, omega, alpha, out),
        samples=scene.samples,
        single=lambda: one(*first),
        result=lambda: dict(zip(scene.outputs, out, strict=True)),
    )
