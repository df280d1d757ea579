"""Expressions over long arrays: numpy operations in place on a few chunk-sized buffers.

Each node is one ufunc call that writes into a buffer of the chunk's length; a buffer is given back
when its node was used for the last time, so the working set stays in the processor's cache and
nothing of the arrays' full length is allocated.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.expression.graph import Expr, topological_order

CHUNK = 4096
"""Samples per chunk: large enough to hide the cost of a numpy call, small enough for the cache."""

_UFUNCS: Mapping[str, Any] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.true_divide,
    "neg": np.negative,
    "square": np.square,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "abs": np.absolute,
    "sign": np.sign,
    "atan2": np.arctan2,
    "at_least": np.greater_equal,
}


def _select(condition: Any, yes: Any, no: Any, out: FloatArray) -> None:
    np.copyto(out, no)
    np.copyto(out, yes, where=np.asarray(condition, dtype=bool))


class BlockProgram:
    """Outputs as functions of input arrays, evaluated chunk by chunk.

    `operations` is the number of array operations for each sample.
    """

    def __init__(self, outputs: Sequence[Expr], inputs: Sequence[str], chunk: int = CHUNK) -> None:
        self.inputs = tuple(inputs)
        self.chunk = chunk
        source, self._constants, self.buffer_count, self.operations = _program(list(outputs), self.inputs)
        namespace: dict[str, Any] = {f"np_{op}": ufunc for op, ufunc in _UFUNCS.items()}
        namespace["np_select"], namespace["np_copy"] = _select, np.copyto
        exec(compile(source, "<twin blocks>", "exec"), namespace)
        self._run: Callable[..., None] = namespace["run"]
        self._local = threading.local()

    def __call__(self, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray]) -> None:
        """Evaluate one-dimensional inputs of equal length (broadcast views allowed) into the outputs.

        NaN goes through; numpy's warnings about it are the caller's to keep or silence.
        """
        n = inputs[0].shape[0]
        step = self.chunk
        buffers = self._buffers()
        for start in range(0, n, step):
            stop = min(start + step, n)
            self._run(
                [a[start:stop] for a in inputs],
                [a[start:stop] for a in outputs],
                buffers if stop - start == step else [b[: stop - start] for b in buffers],
                self._constants,
            )

    def run_chunk(self, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray]) -> None:
        """Evaluate at most a chunk."""
        n = inputs[0].shape[0]
        buffers = self._buffers()
        self._run(inputs, outputs, buffers if n == self.chunk else [b[:n] for b in buffers], self._constants)

    def _buffers(self) -> list[FloatArray]:
        held: list[FloatArray] | None = getattr(self._local, "buffers", None)
        if held is None:
            held = self._local.buffers = list(np.empty((self.buffer_count, self.chunk)))
        return held


def _program(outputs: list[Expr], inputs: tuple[str, ...]) -> tuple[str, list[FloatArray], int, int]:
    order = topological_order(outputs)
    last_use: dict[Expr, int] = {}
    for i, node in enumerate(order):
        for a in node.args:
            last_use[a] = i
    constants: dict[Expr, str] = {}
    place: dict[Expr, str] = {}
    target = {e: f"o{k}" for k, e in reversed(list(enumerate(outputs)))}
    held: dict[Expr, int] = {}
    free: list[int] = []
    count = operations = 0
    lines: list[str] = []
    for i, node in enumerate(order):
        if node.op == "const":
            constants[node] = place[node] = f"c{len(constants)}"
            continue
        if node.op == "variable":
            place[node] = str(node.payload)
            continue
        arguments = [place[a] for a in node.args]
        released = [held.pop(a) for a in set(node.args) if last_use[a] == i and a in held]
        if node.op != "select":  # every other ufunc may write onto its own argument
            free.extend(released)
        if node in target:
            place[node] = target[node]
        else:
            if not free:
                free.append(count)
                count += 1
            held[node] = free.pop()
            place[node] = f"b{held[node]}"
        if node.op == "select":
            free.extend(released)
        operations += 1
        lines.append(f"    np_{node.op}({', '.join(arguments)}, {place[node]})")
    for k, e in enumerate(outputs):
        if place[e] != f"o{k}":
            lines.append(f"    np_copy(o{k}, {place[e]})")
    header = [
        "def run(inputs, outputs, buffers, constants):",
        f"    {', '.join(inputs)}, = inputs",
        f"    {', '.join(f'o{k}' for k in range(len(outputs)))}, = outputs",
    ]
    if count:
        header.append(f"    {', '.join(f'b{k}' for k in range(count))}, = buffers")
    if constants:
        header.append(f"    {', '.join(constants.values())}, = constants")
    values = [np.asarray(e.payload, dtype=np.float64) for e in constants]
    return "\n".join([*header, *lines, "    return None"]), values, count, operations
