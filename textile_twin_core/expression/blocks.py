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
from textile_twin_core.expression.aligned import aligned_rows
from textile_twin_core.expression.blas import SERIAL, add_multiple
from textile_twin_core.expression.block_code import write_block_code
from textile_twin_core.expression.graph import Expr
from textile_twin_core.expression.sincos import sincos

CHUNK = 16384
"""Samples per chunk at most: enough to hide the cost of a numpy call."""
_CACHED_BYTES = 1_600_000
"""What the buffers may take together, to stay mostly in a processor core's cache."""
_FEWEST_SAMPLES = 512

_UFUNCS: Mapping[str, Any] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.true_divide,
    "neg": np.negative,
    "square": np.square,
    "sqrt": np.sqrt,
    "abs": np.absolute,
    "atan2": np.arctan2,
    "at_least": np.greater_equal,
}


_TINY = np.asarray(1e-307)


def _sign(x: Any, out: FloatArray) -> None:
    """As np.sign, but without a branch for each sample: x / (|x| + tiny), 1, 0 or -1 but for |x| below 1e-290.

    Infinite x give NaN, as the rest of a motion with an infinite speed does.
    """
    if np.minimum.reduce(x) > 0.0:  # a shaft's speed mostly is
        out.fill(1.0)
        return
    np.absolute(x, out)
    np.add(out, _TINY, out)
    np.true_divide(x, out, out)


def _times_sign(y: FloatArray, x: Any, work: FloatArray) -> None:
    """y sign(x) in the place of y."""
    if not np.minimum.reduce(x) > 0.0:
        _sign(x, work)
        np.multiply(y, work, y)


def _times_at_least(y: FloatArray, a: Any, b: Any, work: FloatArray) -> None:
    """y where a >= b, else 0, in the place of y."""
    reached = work.view(np.bool_)[: y.size]
    np.greater_equal(a, b, reached)
    np.multiply(y, reached, y)


def _select(condition: Any, yes: Any, no: Any, out: FloatArray) -> None:
    np.copyto(out, no)
    np.copyto(out, yes, where=np.asarray(condition, dtype=bool))


class BlockProgram:
    """Outputs as functions of input arrays, evaluated chunk by chunk.

    `operations` is the number of array operations for each sample. `arranged` looks for an order that needs few
    buffers, which pays where the program is run often. `beside` arrays of the caller's share the cache.
    """

    def __init__(
        self,
        outputs: Sequence[Expr],
        inputs: Sequence[str],
        chunk: int | None = None,
        arranged: bool = False,
        beside: int = 0,
    ) -> None:
        self.inputs = tuple(inputs)
        code = write_block_code(outputs, self.inputs, arranged, join_multiples=not beside)
        self.buffer_count, self.operations = code.buffers, code.operations
        self.chunk = chunk or _chunk(code.buffers + beside, CHUNK if beside else SERIAL)
        self._constants = [np.asarray(value) for value in code.constants]
        namespace: dict[str, Any] = {f"np_{op}": ufunc for op, ufunc in _UFUNCS.items()}
        namespace |= {"np_select": _select, "np_sign": _sign, "np_copy": np.copyto, "np_sincos": sincos}
        namespace |= {"add_multiple": add_multiple, "times_sign": _times_sign, "times_at_least": _times_at_least}
        exec(compile(code.source, "<twin blocks>", "exec"), namespace)
        self._run: Callable[..., None] = namespace["run"]
        self._local = threading.local()

    def __call__(self, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray]) -> None:
        """Evaluate one-dimensional inputs of equal length (broadcast views allowed) into contiguous outputs of float64.

        Raises ValueError for other outputs, which BLAS would not fill. NaN goes through; numpy's warnings about it are
        the caller's to keep or silence.
        """
        if not all(a.flags.c_contiguous and a.dtype == np.float64 for a in outputs):
            raise ValueError("outputs of a block program must be contiguous arrays of float64")
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
            held = self._local.buffers = aligned_rows(self.buffer_count, self.chunk)
        return held


def _chunk(buffers: int, most: int) -> int:
    """As many samples as let the buffers stay in the cache, a multiple of the fewest."""
    fitting = _CACHED_BYTES // (8 * max(buffers, 1))
    return min(max(fitting // _FEWEST_SAMPLES, 1) * _FEWEST_SAMPLES, most)
