"""CasADi: the closed form in its symbols, as generated C if a compiler is installed, otherwise interpreted.

Timed: calls through CasADi's buffers, without conversions. The batch is CasADi's `map` over arrays, which its
generated C
loops over; the single call takes one sample.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import casadi
import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate
from textile_twin_core.expression import interpret

_FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fPIC", "-shared")


class _Functions:
    sqrt, sin, cos, atan2, where = casadi.sqrt, casadi.sin, casadi.cos, casadi.atan2, casadi.if_else


def candidates(scene: Workload) -> Iterator[Candidate]:
    """Build the closed form, as generated C or interpreted."""
    names = ("theta", "omega", "alpha")
    inputs = {name: casadi.SX.sym(name) for name in names}
    expressions = [scene.machine.model.output(name) for name in scene.outputs]
    values = [casadi.SX(v) for v in interpret(expressions, inputs, _Functions)]
    one = casadi.Function("one", [inputs[n] for n in names], values)
    many = one.map(scene.samples, "serial")
    method, (one, many) = _compiled([one, many])
    out = np.empty((len(scene.outputs), scene.samples))
    few = np.empty((len(scene.outputs), 1))
    yield Candidate(
        method,
        "casadi",
        batch=_bound(many, scene.motion, out),
        samples=scene.samples,
        single=_bound(one, [x[:1].copy() for x in scene.motion], few),
        result=lambda: dict(zip(scene.outputs, out, strict=True)),
    )


def _compiled(functions: list[Any]) -> tuple[str, list[Any]]:
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return "interpreted", functions
    folder = Path(tempfile.mkdtemp(prefix="textile_twin_bench_"))
    try:
        generator = casadi.CodeGenerator("twin.c")
        for function in functions:
            generator.add(function)
        generator.generate(f"{folder}/")
        library = str(folder / "twin.so")
        done = subprocess.run(
            [compiler, *_FLAGS, "-o", library, str(folder / "twin.c"), "-lm"], capture_output=True, check=False
        )
        if done.returncode != 0:
            return "interpreted", functions
        return "generated C", [casadi.external(function.name(), library) for function in functions]
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _bound(function: Any, inputs: Sequence[FloatArray], out: FloatArray) -> Callable[[], object]:
    """Return a function that reads the inputs and writes the rows of `out` in place."""
    buffer, call = function.buffer()
    for k, values in enumerate(inputs):
        buffer.set_arg(k, values.data)
    for k, row in enumerate(out):
        buffer.set_res(k, row.data)
    kept = (buffer, inputs, out)  # CasADi stores bare addresses: the arrays must outlive the call

    def run(kept: object = kept) -> object:
        return call()

    return run
