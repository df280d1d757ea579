"""Input samples: conversion to arrays, and rejection, with its cause, of those that cannot be used."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled_in_place
from textile_twin_core.errors import MotionError
from textile_twin_core.shaft.status import Record

Stamps = npt.NDArray[Any]  # int64 nanoseconds or float64 seconds


@by_reference
class Block(NamedTuple):
    """A block of n input samples."""

    last: Stamps  # (1,) the newest stamp accepted
    stamps: Stamps  # (n,)
    angles: FloatArray  # (n,) [rad]
    velocities: FloatArray  # (n,) [rad/s], NaN for none, or empty
    heard: FloatArray  # (n,) set: unwrapped readings that tell of the encoder's resolution, else NaN


@compiled_in_place
def admit(status: Record, last: Stamps, stamp: float, angle: float) -> bool:
    """Whether to accept a sample: angle and stamp finite, the stamp newer than `last` (1,); counts the cause if not."""
    status.received += 1.0
    if not (math.isfinite(angle) and math.isfinite(stamp)):
        status.not_finite += 1.0
        return False
    if status.accepted > 0.0 and stamp <= last[0]:
        status.duplicate_stamp += stamp == last[0]
        status.older_stamp += stamp < last[0]
        return False
    status.accepted += 1.0
    return True


def as_samples(
    stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None
) -> tuple[Stamps, FloatArray, FloatArray]:
    """Samples as arrays: stamps int64 [ns] or float64 [s], angles [rad], velocities [rad/s] (empty for none).

    Raises:
        MotionError: arrays of different lengths, or stamps that are no numbers.
    """
    stamp, angle = np.asarray(stamps), np.ascontiguousarray(angles, dtype=np.float64)
    kind = stamp.dtype.kind
    if kind not in "iuf":
        raise MotionError(f"stamps are of type {stamp.dtype}: give integer nanoseconds or float seconds")
    stamp = np.ascontiguousarray(stamp, dtype=np.float64 if kind == "f" else np.int64)
    if stamp.ndim != 1 or angle.shape != stamp.shape:
        raise MotionError(
            f"{stamp.size} stamps (shape {stamp.shape}) but {angle.size} angles (shape {angle.shape}): "
            "give one stamp per angle"
        )
    velocity = np.zeros(0) if velocities is None else np.ascontiguousarray(velocities, dtype=np.float64)
    if velocity.size and velocity.shape != stamp.shape:
        raise MotionError(f"{stamp.size} stamps but {velocity.size} velocities: give one per angle, or none")
    return stamp, angle, velocity
