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
from textile_twin_core.expression.graph import Expr, variable
from textile_twin_core.expression.interpret import interpret
from textile_twin_core.expression.piecewise_polynomial import along, piece, rows_of, searched
from textile_twin_core.expression.scalar import statements
from textile_twin_core.expression.traversal import substitute, topological_order

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
_SINGLE: Final = frozenset(("one", "first", "last"))
_PARTS: Final = frozenset(("before", "after"))
_PART: Final = 544
"""Samples of a part, whose values between the passes stay in the nearest cache."""
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
        vectors = next((k for n, k in _INTERLEAVE.items() if len(self._outputs) <= n), 0)
        scope = self.functions()
        for name in _SINGLE & scope.keys():
            scope[name] = compiled(scope[name], inlined=True)
        for name in _PARTS & scope.keys():
            scope[name] = compiled(scope[name], noalias=True, interleave=vectors, counted=False)
        one, run = scope["one"], compiled(scope["run"], noalias=True, interleave=vectors)
        read, written = np.empty(1), np.empty(1)
        read.flags.writeable = False
        compile_for(run, [read] * len(self._inputs) + [*self._tables.values()] + [written] * len(self._outputs))
        return _COMPILED.setdefault(self._code, (one, run))

    def functions(self) -> dict[str, Any]:
        """Return the namespace with the functions as Python.

        `one` takes one sample to the outputs and the number of angles out of range, `run` does so over arrays.
        """
        scope: dict[str, Any] = {"float64": np.float64, "int64": np.int64, "sqrt": math.sqrt, "__name__": __name__}
        scope |= {"sincos": inline.sincos, "atan2": inline.atan2, "FARTHEST": inline.FARTHEST, "empty": np.empty}
        scope |= {"align_stack": align_stack, "piece": piece, "along": along}
        for each in self._pieces:
            scope |= rows_of(each).arrays()
        exec(compile(self._source(), "<twin loop>", "exec"), scope)
        for name in ({"run"} | _SINGLE | _PARTS) & scope.keys():  # the compiler caches functions by name
            scope[name].__qualname__ = f"{name}_{self._code.hex()}"
        return scope

    def _source(self) -> str:
        inputs, tables = self._inputs, list(self._tables)
        outs = [f"out{k}" for k in range(len(self._outputs))]
        source = _single("one", [*inputs, *tables], self._outputs, self._prologue)
        if self._pieces:
            return source + self._source_in_parts(outs)
        head = [f"def run({', '.join([*inputs, *tables, *outs])}):"]
        return source + _pass(head, f"{inputs[0]}.shape[0]", "one", [*(f"{x}[i]" for x in inputs), *tables], outs)

    @cached_property
    def _pieces(self) -> list[Expr]:
        """Piecewise polynomials among the outputs' nodes, of which none lies over another one."""
        return [node for node in topological_order(searched(self._outputs)) if node.op == "piecewise"]

    def _source_in_parts(self, outs: Sequence[str]) -> str:
        """Write a loop in parts of the arrays: the expressions below the pieces, the pieces, and those above.

        A search for a piece among the rest would keep the compiler from vectorising it.
        """
        outputs = searched(self._outputs)
        above = set(self._pieces)
        for node in topological_order(outputs):
            if any(a in above for a in node.args):
                above.add(node)
        needed = [a for node in topological_order(outputs) if node in above for a in node.args]
        below = [e for e in dict.fromkeys(needed) if e not in above and not e.is_constant]
        name = {e: f"w{k}" for k, e in enumerate([*below, *self._pieces])}
        early, late = ([k for k, e in enumerate(outputs) if (e in above) == way] for way in (False, True))
        inputs, tables, work = list(self._inputs), list(self._tables), list(name.values())
        first = _single("first", [*inputs, *tables], [*below, *(outputs[k] for k in early)], self._prologue)
        new = {e: variable(each) for e, each in name.items()}
        last = _single("last", work, substitute([outputs[k] for k in late], new), ())
        kept, ready, made = work[: len(below)], [outs[k] for k in early], [outs[k] for k in late]

        def part(names: Sequence[str]) -> list[str]:
            return [f"{name}[start:end]" for name in names]

        before = [f"def before({', '.join([*inputs, *tables, *kept, *ready])}):"]
        after = [f"def after({', '.join([*work, *made])}):"]
        run = [
            f"def run({', '.join([*inputs, *tables, *outs])}):",
            "total = 0",
            f"work = empty(({len(work)}, {_PART}))",
            *(f"{each} = work[{k}]" for k, each in enumerate(work)),
            f"for start in range(0, {inputs[0]}.shape[0], {_PART}):",
            f"    end = min(start + {_PART}, {inputs[0]}.shape[0])",
            f"    total += before({', '.join([*part(inputs), *tables, *kept, *part(ready)])})",
        ]
        for node in self._pieces:
            place, condition = (name[a] for a in node.args)
            rows = rows_of(node).name
            run.append(f"    along({place}, {condition}, end - start, edges_{rows}, {rows}, {name[node]})")
        run += [f"    after({', '.join([*work, *part(made)])})", "return total"]
        at = [*(f"{x}[i]" for x in inputs), *tables]
        return "".join(
            [
                first,
                _pass(before, f"{inputs[0]}.shape[0]", "first", at, [*kept, *ready]),
                last,
                _pass(after, f"{made[0]}.shape[0]", "last", [f"{w}[i]" for w in work], made),
                "\n    ".join(run) + "\n",
            ]
        )

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


def _single(name: str, arguments: Sequence[str], outputs: Sequence[Expr], prologue: Sequence[str]) -> str:
    """Write a function of one sample to the outputs and the number of angles out of range."""
    lines, values = statements(outputs, deepest=0, paired=True)
    head = f"def {name}({', '.join(arguments)}):"
    return "\n    ".join([head, "far = 0", *prologue, *lines, f"return {', '.join([*values, 'far'])}"]) + "\n\n"


def _pass(head: Sequence[str], count: str, function: str, arguments: Sequence[str], arrays: Sequence[str]) -> str:
    """Write a loop that calls a function of one sample and stores its outputs in arrays."""
    found = [f"value{k}" for k in range(len(arrays))]
    lines = [
        *head,
        "align_stack()",
        "total = 0",
        f"for i in range({count}):",
        f"    {', '.join([*found, 'far'])} = {function}({', '.join(arguments)})",
        "    total += far",
        *(f"    {array}[i] = {value}" for array, value in zip(arrays, found, strict=True)),
    ]
    return "\n    ".join(lines) + "\n    return total\n\n"


class Numpy:
    """Functions for numpy arrays of any number type."""

    sqrt, sin, cos, atan2, where = np.sqrt, np.sin, np.cos, np.arctan2, np.where


def _slices(n: int, step: int) -> Iterator[slice]:
    return (slice(start, min(start + step, n)) for start in range(0, n, max(step, 1)))
