"""Shaft motion of a user as flat columns of one length, and the arrays that receive the outputs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from ctypes import addressof, c_char
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MotionError

_SHORT = 16_384
_DOUBLE = np.dtype(np.float64)
_beginning = (c_char * 0).from_buffer


def flat_columns(motion: Mapping[str, npt.ArrayLike]) -> tuple[tuple[int, ...], list[FloatArray]]:
    """Return the common shape of numbers and arrays, and each of them broadcast to it as one float64 dimension.

    Raises:
        MotionError: A value is not a real number, or the shapes do not fit.
    """
    arrays = [_floats(name, value) for name, value in motion.items()]
    shape, *others = {a.shape for a in arrays}
    if not others and len(shape) == 1:
        return shape, arrays
    different = {a.shape for a in arrays if a.ndim}
    try:
        shape = different.pop() if len(different) == 1 else np.broadcast_shapes(*different)
    except ValueError:
        shapes = ", ".join(f"{name} {a.shape}" for name, a in zip(motion, arrays, strict=True))
        raise MotionError(f"the motion's arrays do not fit each other: {shapes}; give equal shapes") from None
    return shape, [_spread(a, shape) for a in arrays]


def _spread(values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Broadcast an array to a shape, as one dimension; short columns of a number are filled, not broadcast."""
    size = math.prod(shape)
    if values.ndim == 1 and values.shape == shape:
        return values  # broadcasting costs as much as a short block
    if values.ndim:
        return np.broadcast_to(values, shape).reshape(-1)
    if size > _SHORT:
        return np.broadcast_to(values, size)
    column = np.empty(size)
    column.fill(float(values))
    return column


def arrays_for(
    outputs: Iterable[str],
    shape: tuple[int, ...],
    out: Mapping[str, FloatArray] | None,
    columns: Iterable[FloatArray],
) -> dict[str, FloatArray]:
    """Return one array of a shape per output: new ones, or those of `out`.

    Raises:
        MotionError: An array of `out` is missing or has another form, or shares memory with another one or with the
            motion's `columns`, which are still read while outputs are written.
    """
    if out is None:
        return {name: np.empty(shape) for name in outputs}
    chosen: dict[str, FloatArray] = {}
    for name in outputs:
        a = out.get(name)
        if not (isinstance(a, np.ndarray) and a.shape == shape and a.dtype == _DOUBLE and a.flags.carray):
            raise MotionError(f"out['{name}'] must be a writeable, contiguous float64 array of shape {shape}")
        chosen[name] = a
    _check_apart(chosen, columns, math.prod(shape) * _DOUBLE.itemsize)
    return chosen


def _check_apart(outputs: Mapping[str, Any], columns: Iterable[Any], nbytes: int) -> None:
    """Raise MotionError if outputs of `nbytes` bytes share memory with each other or with the motion.

    Start addresses come from ctypes, which takes a tenth of numpy's time.
    """
    places = [(addressof(_beginning(a)), name) for name, a in outputs.items()]
    for column in columns:
        if column.flags.carray:
            places.append((addressof(_beginning(column)), ""))
        else:
            places += [(addressof(_beginning(a)), "") for a in outputs.values() if np.shares_memory(a, column)]
    for (begin, one), (following, other) in pairwise(sorted(places)):  # equal sizes: overlapping arrays are neighbours
        if following < begin + nbytes and one != other:
            if one and other:
                raise MotionError(f"out['{one}'] and out['{other}'] share memory; give each output an array of its own")
            raise MotionError(f"out['{one or other}'] shares memory with the motion; give it an array of its own")


def _floats(name: str, value: npt.ArrayLike) -> FloatArray:
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise MotionError(f"{name} must be a real number or an array of them, not {value!r:.60}") from None
