"""Limit of the speed: the same closed form in C, compiled on the spot, vectorised and as a plain loop over libm."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate
from textile_twin_core.expression import Expr, substitute, variable
from textile_twin_core.expression.c_source import PLAIN_SINCOS, c_statements

_HEAD = """#include <math.h>
#include <stddef.h>
"""

# Cody-Waite reduction by pi/2 and minimax polynomials (Muller 2016, ch. 11), for angles up to 1e9; no branch, and the
# quadrant from the bits of the rounded quotient: conversions to integers have no vector form before AVX-512
_SINCOS = """static inline __attribute__((always_inline)) void both(double x, double *s, double *c) {
    double shifted = __builtin_fma(x, 0.63661977236758134308, 6755399441055744.0);
    double k = shifted - 6755399441055744.0;
    double r = __builtin_fma(-k, 1.570796251296997, x);
    r = __builtin_fma(-k, 7.549789415861596e-08, r);
    r = __builtin_fma(-k, 5.390302858158119e-15, r);
    double z = r * r, w = z * z;
    double p = __builtin_fma(1.58962301576546568060e-10, z, -2.50507477628578072866e-8);
    p = __builtin_fma(p, w, __builtin_fma(2.75573136213857245213e-6, z, -1.98412698295895385996e-4));
    p = __builtin_fma(p, w, __builtin_fma(8.33333333332211858878e-3, z, -1.66666666666666307295e-1));
    double sine = __builtin_fma(p, z * r, r);
    double q = __builtin_fma(-1.13585365213876817300e-11, z, 2.08757008419747316778e-9);
    q = __builtin_fma(q, w, __builtin_fma(-2.75573141792967388112e-7, z, 2.48015872888517045348e-5));
    q = __builtin_fma(q, w, __builtin_fma(-1.38888888888730564116e-3, z, 4.16666666666665929218e-2));
    double cosine = 1.0 - __builtin_fma(-q, w, 0.5 * z);
    union { double d; long long i; } bits = { shifted };
    long long n = bits.i;
    double a = (n & 1) ? cosine : sine, b = (n & 1) ? -sine : cosine;
    *s = (n & 2) ? -a : a;
    *c = (n & 2) ? -b : b;
}
"""
_PACKED = re.compile(r"\bv?mulpd\b|\bvfn?m(add|sub)\d+pd\b|\bfml[as]\s+v\d+\.2d|\bfmul\s+v\d+\.2d|\bfml[as]\s+z\d+\.d")
"""Vector multiplications of doubles in the assembly of x86-64 and of AArch64."""


def c_source(outputs: Sequence[Expr], vectorised: bool) -> str:
    """Generate a C function `run(n, theta, omega, alpha, out0, out1, ..)` of the outputs."""
    inputs = ("theta", "omega", "alpha")
    lines, values = c_statements(substitute(outputs, {variable(x): variable(f"{x}[i]") for x in inputs}))
    stores = [f"        out{k}[i] = {value};" for k, value in enumerate(values)]
    arrays = [f"const double *restrict {name}" for name in inputs]
    arrays += [f"double *restrict out{k}" for k in range(len(outputs))]
    signature = f"void run(size_t n, {', '.join(arrays)})"
    body = "\n".join(["    for (size_t i = 0; i < n; ++i) {", *(f"        {line}" for line in lines), *stores, "    }"])
    return f"{_HEAD}{_SINCOS if vectorised else PLAIN_SINCOS}{signature} {{\n{body}\n}}\n"


def c_candidates(scene: Workload) -> Iterator[Candidate]:
    """Build the vectorised limit and the plain loop, if a C compiler is installed."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return
    outputs = [scene.machine.model.output(name) for name in scene.outputs]
    fast = ["-O3", "-march=native", "-mprefer-vector-width=512", "-fno-math-errno", "-fno-trapping-math"]
    for method, vectorised, flags in (
        ("vectorised", True, [*fast, "-ffp-contract=fast"]),
        ("libm loop", False, ["-O2"]),
    ):
        made = _compile(compiler, c_source(outputs, vectorised), flags)
        if made is not None:
            function, packed = made
            yield _candidate(scene, function, method, "" if packed or not vectorised else "the compiler left it scalar")


def _compile(compiler: str, source: str, flags: Sequence[str]) -> tuple[ctypes._NamedFuncPointer, bool] | None:
    """Compile the function `run`; return it, and whether its assembly has vector multiplications."""
    folder = Path(tempfile.mkdtemp(prefix="textile_twin_bench_"))
    try:
        (folder / "twin.c").write_text(source)
        library, assembly = folder / "twin.so", folder / "twin.s"
        command = [compiler, *flags, "-fPIC", str(folder / "twin.c")]
        for result in (["-S", "-o", str(assembly)], ["-shared", "-o", str(library), "-lm"]):
            if subprocess.run([*command, *result], capture_output=True, check=False).returncode != 0:
                preferring = [f for f in flags if f.startswith("-mprefer")]
                return _compile(compiler, source, [f for f in flags if f not in preferring]) if preferring else None
        packed = _PACKED.search(assembly.read_text()) is not None
        return ctypes.CDLL(str(library)).run, packed
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _candidate(scene: Workload, function: ctypes._NamedFuncPointer, method: str, note: str) -> Candidate:
    pointer = ctypes.POINTER(ctypes.c_double)
    function.argtypes = [ctypes.c_size_t, *[pointer] * (3 + len(scene.outputs))]
    function.restype = None
    out = np.empty((len(scene.outputs), scene.samples))
    arguments = [a.ctypes.data_as(pointer) for a in (*scene.motion, *out)]
    few = np.empty((len(scene.outputs), 1))
    one = [*arguments[:3], *(a.ctypes.data_as(pointer) for a in few)]

    def result() -> dict[str, FloatArray]:
        return dict(zip(scene.outputs, out, strict=True))

    return Candidate(
        method,
        "C",
        batch=lambda: function(scene.samples, *arguments),
        samples=scene.samples,
        single=lambda: function(1, *one),
        result=result,
        note=note,
    )
