"""Expressions over arrays: a compiled loop for long blocks, numpy for blocks too short to be worth compiling."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from hashlib import blake2b
from typing import Any, Final

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import align_stack, compile_for, compiled, is_available
from textile_twin_core.expression import inline
from textile_twin_core.expression.graph import Expr
from textile_twin_core.expression.interpret import interpret
from textile_twin_core.expression.scalar import statements
from textile_twin_core.expression.traversal import topological_order

LONG: Final = 1024
"""Smallest block [samples] that counts towards compilation; the blocks of a live machine are shorter."""
WORTH: Final = 65_536
"""Samples in long blocks from which compilation pays; compiled code is cached for other processes."""
_NODES: Final = 500
"""Graph size [nodes] above which the required number of samples grows in proportion."""
_CHUNK: Final = 8192
"""Samples interpreted at a time, so that intermediate results stay in the cache."""
_INTERLEAVE: Final = {12: 4, 24: 2}
"""Interleaved vectors of samples, by the largest number of outputs; with more outputs memory is the limit."""
_MET: Final[Counter[bytes]] = Counter()
"""Samples in long blocks so far, by code."""
_COMPILED: Final[dict[bytes, tuple[Any, Any]]] = {}


class Loop:
    """Outputs as functions of input arrays.

    `prologue` is source that precedes the expressions and defines further variables from the inputs and from the arrays
    in `tables`. Without a compiled loop the outputs of `plain` are evaluated instead.
    """

    def __init__(
        self,
        outputs: Sequence[Expr],
        inputs: Sequence[str],
        prologue: Sequence[str] = (),
        tables: Mapping[str, Any] | None = None,
        plain: Sequence[Expr] | None = None,
    ) -> None:
        self._outputs, self._inputs = tuple(outputs), tuple(inputs)
        self._prologue, self._tables = prologue, dict(tables or {})
        self._plain = self._outputs if plain is None else tuple(plain)

    def __call__(self, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray], cores: int = 1) -> None:
        """Evaluate one-dimensional inputs of equal length (broadcast views allowed) into contiguous float64 outputs.

        `cores` threads share the samples. NaN propagates. Raises ValueError for other outputs.
        """
        if not all(a.flags.c_contiguous and a.dtype == np.float64 for a in outputs):
            raise ValueError("outputs of a loop must be contiguous arrays of float64")
        n = inputs[0].shape[0]
        if n >= LONG:
            _MET[self._code] += n
        if cores == 1 or n < LONG * cores or not self.is_compiled:
            self._fill(inputs, outputs)
            return
        parts = [([a[p] for a in inputs], [a[p] for a in outputs]) for p in _slices(n, -(-n // cores))]
        with ThreadPoolExecutor(cores) as pool:
            list(pool.map(lambda part: self._fill(*part), parts))

    @property
    def is_compiled(self) -> bool:
        """Return whether blocks use the compiled loop, after compiling it if enough samples have been seen."""
        return 0 < _MET[self._code] >= self._worth and self._compiled is not None

    def compile_now(self) -> None:
        """Compile regardless of the number of samples seen; without a compiler nothing changes."""
        _MET[self._code] = max(_MET[self._code], math.ceil(self._worth))
        _ = self._compiled

    @cached_property
    def _code(self) -> bytes:
        """Return a key of the code, by which twins of similar machines share one loop."""
        parts = [*(e.rank for e in self._outputs), repr((self._inputs, self._prologue)).encode()]
        return blake2b(b"".join(parts), digest_size=12).digest()

    @cached_property
    def _worth(self) -> float:
        return WORTH * max(1.0, len(topological_order(self._outputs)) / _NODES)

    def single(self) -> Any:
        """Compiled function of one sample of floats: a tuple of the outputs and the number of angles out of range."""
        return self._compiled[0] if self.is_compiled and self._compiled else None

    @cached_property
    def _compiled(self) -> tuple[Any, Any] | None:
        """Compile the function of one sample and the loop over arrays; None without a compiler."""
        if not is_available():
            return None
        if self._code in _COMPILED:
            return _COMPILED[self._code]
        one, run = self.functions()
        one = run.__globals__["one"] = compiled(one, inlined=True)
        run = compiled(
            run, noalias=True, interleave=next((k for n, k in _INTERLEAVE.items() if len(self._outputs) <= n), 0)
        )
        read, written = np.empty(1), np.empty(1)
        read.flags.writeable = False
        compile_for(run, [read] * len(self._inputs) + [*self._tables.values()] + [written] * len(self._outputs))
        return _COMPILED.setdefault(self._code, (one, run))

    def functions(self) -> tuple[Any, Any]:
        """Return both functions as Python: one sample to outputs and count of angles out of range; and over arrays."""
        scope: dict[str, Any] = {"float64": np.float64, "int64": np.int64, "sqrt": math.sqrt, "__name__": __name__}
        scope |= {"sincos": inline.sincos, "atan2": inline.atan2, "FARTHEST": inline.FARTHEST}
        scope["align_stack"] = align_stack
        exec(compile(self._source(), "<twin loop>", "exec"), scope)
        for name in ("one", "run"):  # the compiler caches functions by name: each code needs a unique name
            scope[name].__qualname__ = f"{name}_{self._code.hex()}"
        return scope["one"], scope["run"]

    def _source(self) -> str:
        lines, values = statements(self._outputs, deepest=0, paired=True)
        one = [
            f"def one({', '.join([*self._inputs, *self._tables])}):",
            "far = 0",
            *self._prologue,
            *lines,
            f"return {', '.join(values)}, far",
        ]
        outs, found = [f"out{k}" for k in range(len(values))], [f"value{k}" for k in range(len(values))]
        run = [
            f"def run({', '.join([*self._inputs, *self._tables, *outs])}):",
            "align_stack()",
            "total = 0",
            f"for i in range({self._inputs[0]}.shape[0]):",
            f"    {', '.join(found)}, far = one({', '.join([*(f'{x}[i]' for x in self._inputs), *self._tables])})",
            "    total += far",
            *(f"    {out}[i] = {value}" for out, value in zip(outs, found, strict=True)),
        ]
        return "\n    ".join(one) + "\n\n" + "\n    ".join(run) + "\n    return total\n"

    def _fill(self, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray]) -> None:
        if not self.is_compiled or self._compiled is None:
            self._interpret(inputs, outputs)
            return
        parts: Iterable[Any] = [(inputs, outputs)]
        if not all(a.flags.c_contiguous and a.flags.aligned for a in inputs):
            chunks = _slices(inputs[0].shape[0], _CHUNK)
            parts = (([np.require(a[p], float, ["C", "A"]) for a in inputs], [a[p] for a in outputs]) for p in chunks)
        for read, written in parts:
            if self._compiled[1](*read, *self._tables.values(), *written):  # angles out of range
                self._interpret(read, written)

    def _interpret(self, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray]) -> None:
        with np.errstate(all="ignore"):
            for p in _slices(inputs[0].shape[0], _CHUNK):
                read = {name: a[p] for name, a in zip(self._inputs, inputs, strict=True)}
                for a, values in zip(outputs, interpret(self._plain, read, Numpy), strict=True):
                    a[p] = values


class Numpy:
    """Functions for numpy arrays of any number type."""

    sqrt, sin, cos, atan2, where = np.sqrt, np.sin, np.cos, np.arctan2, np.where


def _slices(n: int, step: int) -> Iterator[slice]:
    return (slice(start, min(start + step, n)) for start in range(0, n, max(step, 1)))
