"""Checks of the arrays to be compared: shapes, stamps, finite values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.errors import AlignmentError


@dataclass(frozen=True, slots=True)
class Predictions:
    """Usable predictions, (n,) each, and the number of those dropped."""

    stamps_ns: IntArray
    torque_Nm: FloatArray
    theta_rad: FloatArray
    sigma_Nm: FloatArray
    settled: BoolArray
    dropped: int


def usable_predictions(
    stamps_ns: IntArray,
    torque_Nm: FloatArray,
    theta_rad: FloatArray,
    sigma_Nm: FloatArray | None,
    settled: BoolArray | None,
) -> Predictions:
    """Check shapes; drop predictions that are not finite or whose stamp does not increase."""
    stamps = _stamps(stamps_ns, "predicted")
    n = stamps.size
    torque = _floats(torque_Nm, n, "predicted torque")
    theta = _floats(theta_rad, n, "shaft angle")
    sigma = np.full(n, np.nan) if sigma_Nm is None else _floats(sigma_Nm, n, "predicted sigma")
    ready = np.ones(n, dtype=np.bool_) if settled is None else np.asarray(settled, dtype=np.bool_)
    if ready.shape != (n,):
        raise AlignmentError(f"settled has shape {ready.shape}, its stamps have ({n},): give one for each stamp")
    good = np.isfinite(torque) & np.isfinite(theta)
    good[good] = _increasing(stamps[good])
    dropped = int(n - np.count_nonzero(good))
    return Predictions(stamps[good], torque[good], theta[good], sigma[good], ready[good], dropped)


def usable_measurements(stamps_ns: IntArray, torque_Nm: FloatArray) -> tuple[IntArray, FloatArray, dict[str, int]]:
    """Drop measured samples that are not finite or whose stamp does not increase, counted by cause."""
    stamps = _stamps(stamps_ns, "measured")
    torque = _floats(torque_Nm, stamps.size, "measured torque")
    finite = np.isfinite(torque)
    good = finite.copy()
    good[good] = _increasing(stamps[good])
    causes = {
        "not_finite": int(np.count_nonzero(~finite)),
        "stamp_not_increasing": int(np.count_nonzero(finite & ~good)),
    }
    return stamps[good], torque[good], causes


def _stamps(stamps_ns: IntArray, which: str) -> IntArray:
    stamps: npt.NDArray[Any] = np.asarray(stamps_ns)
    if stamps.ndim != 1 or not (np.issubdtype(stamps.dtype, np.integer) or stamps.size == 0):
        raise AlignmentError(
            f"the {which} stamps are {stamps.dtype} of shape {stamps.shape}: give a row of whole nanoseconds (int64)"
        )
    return stamps.astype(np.int64)


def _floats(values: FloatArray, n: int, which: str) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (n,):
        raise AlignmentError(f"the {which} has shape {array.shape}, its stamps have ({n},): give one for each stamp")
    return array


def _increasing(stamps_ns: IntArray) -> BoolArray:
    """Return true for the stamps that are later than all before them."""
    good = np.ones(stamps_ns.size, dtype=np.bool_)
    good[1:] = stamps_ns[1:] > np.maximum.accumulate(stamps_ns)[:-1]
    return good
