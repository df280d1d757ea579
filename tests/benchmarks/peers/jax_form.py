"""JAX: the closed form in jax.numpy, 64 bits, compiled by jit; one call per sample, and vmap over arrays.

Timed: the compiled functions until their results are available; the arrays are on the device already.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import numpy as np

from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate
from textile_twin_core.expression import interpret


class _Functions:
    sqrt, sin, cos = jax.numpy.sqrt, jax.numpy.sin, jax.numpy.cos
    atan2, where = jax.numpy.arctan2, jax.numpy.where


def candidates(scene: Workload) -> Iterator[Candidate]:
    """Build the closed form, jitted and mapped."""
    jax.config.update("jax_enable_x64", True)
    expressions = [scene.machine.model.output(name) for name in scene.outputs]

    def form(theta: Any, omega: Any, alpha: Any) -> Any:
        return interpret(expressions, {"theta": theta, "omega": omega, "alpha": alpha}, _Functions)

    one, many = jax.jit(form), jax.jit(jax.vmap(form))
    arrays = [jax.numpy.asarray(x) for x in scene.motion]
    first = [jax.numpy.asarray(float(x[0])) for x in scene.motion]
    yield Candidate(
        "jit, vmap",
        "jax",
        batch=lambda: jax.block_until_ready(many(*arrays)),
        samples=scene.samples,
        single=lambda: jax.block_until_ready(one(*first)),
        result=lambda: dict(zip(scene.outputs, map(np.asarray, many(*arrays)), strict=True)),
    )
