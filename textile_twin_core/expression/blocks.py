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
from textile_twin_core.expression.block_code import write_block_code
from textile_twin_core.expression.graph import Expr
from textile_twin_core.expression.sincos import sincos

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

    `operations` is the number of array operations for each sample. `arranged` looks for an order that needs few
    buffers, which pays where the program is run often.
    """

    def __init__(
        self, outputs: Sequence[Expr], inputs: Sequence[str], chunk: int = CHUNK, arranged: bool = False
    ) -> None:
        self.inputs = tuple(inputs)
        self.chunk = chunk
        code = write_block_code(outputs, self.inputs, arranged)
        self.buffer_count, self.operations = code.buffers, code.operations
        self._constants = [np.asarray(value) for value in code.constants]
        namespace: dict[str, Any] = {f"np_{op}": ufunc for op, ufunc in _UFUNCS.items()}
        namespace["np_select"], namespace["np_copy"], namespace["np_sincos"] = _select, np.copyto, sincos
        exec(compile(code.source, "<twin blocks>", "exec"), namespace)
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
