"""Cubic splines with a roughness penalty: local basis, banded normal equations, and the inverse within the band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse import csr_array

from textile_twin_core.arrays import FloatArray, IntArray

ORDER = 4
"""Basis functions that are not zero at a time."""


@dataclass(frozen=True)
class LocalBasis:
    """Values of the four basis functions alive at each of n times.

    Attributes:
        first: (n,) number of the first of the four.
        value, slope, bend: (n, 4), with first and second derivatives.
    """

    first: IntArray
    value: FloatArray
    slope: FloatArray
    bend: FloatArray

    @property
    def columns(self) -> IntArray:
        """(n, 4) numbers of the basis functions."""
        return self.first[:, None] + np.arange(ORDER)


class Knots:
    """Breakpoints of a cubic spline: intervals between increasing times, with the outer knots repeated.

    Args:
        breaks: (m + 1,) increasing times [s]; the spline has m + 3 coefficients.
    """

    def __init__(self, breaks: FloatArray) -> None:
        self.breaks = breaks
        self._all = np.concatenate([np.repeat(breaks[0], 3), breaks, np.repeat(breaks[-1], 3)])
        self.intervals = breaks.size - 1
        self.size = self.intervals + 3

    def basis(self, times: FloatArray) -> LocalBasis:
        """The basis at times within the breakpoints (Cox and de Boor's recurrence)."""
        knots = self._all
        first = np.clip(np.searchsorted(self.breaks, times, side="right") - 1, 0, self.intervals - 1)
        levels = [np.ones((times.size, 1))]
        for degree in (1, 2, 3):
            below = levels[-1]
            value = np.zeros((times.size, degree + 1))
            for j in range(degree):
                left = knots[first + 4 - degree + j]  # 4 - degree + j: of the basis functions of degree - 1
                right = knots[first + 4 + j]
                share = below[:, j] / (right - left)
                value[:, j] += (right - times) * share
                value[:, j + 1] += (times - left) * share
            levels.append(value)
        slope = self._differ(levels[2], first, 3)
        bend = self._differ(self._differ(levels[1], first, 2), first, 3)
        return LocalBasis(first, levels[3], slope, bend)

    def _differ(self, below: FloatArray, first: IntArray, degree: int) -> FloatArray:
        """Derivative of basis functions of a degree from values (or derivatives) of those of the degree below."""
        out = np.zeros((below.shape[0], degree + 1))
        for j in range(degree):
            share = degree * below[:, j] / (self._all[first + 4 + j] - self._all[first + 4 - degree + j])
            out[:, j] -= share
            out[:, j + 1] += share
        return out

    def parabola(self, polynomial: FloatArray) -> FloatArray:
        """Coefficients of the spline that is p0 + p1 t + p2 t^2 (its polar form at the knots)."""
        one, two, three = self._all[1:-3], self._all[2:-2], self._all[3:-1]
        mean, product = (one + two + three) / 3.0, (one * two + one * three + two * three) / 3.0
        return np.asarray(polynomial[0] + polynomial[1] * mean + polynomial[2] * product)

    def jerk(self) -> FloatArray:
        """(intervals, 4) third derivative of the four basis functions in each interval."""
        first = np.arange(self.intervals)
        value = np.ones((self.intervals, 1))
        for degree in (1, 2, 3):
            value = self._differ(value, first, degree)
        return value


class PenalisedSpline:
    """Least squares for spline coefficients: sum of (data - B a)^2 weight + sum of jerk^2 h / intensity.

    The penalty is the prior of a motion driven by white jerk (Wahba 1978; local intensities make it adaptive).
    Solutions and covariances come from one banded Cholesky factor.
    """

    def __init__(self, knots: Knots, basis: LocalBasis, weight: FloatArray, intensity: FloatArray) -> None:
        self.basis = basis
        self._knots = knots
        band = np.zeros((ORDER, knots.size))
        jerk = knots.jerk()
        stiff = np.diff(knots.breaks) / intensity
        starts = np.arange(knots.intervals)
        for low in range(ORDER):
            for high in range(low, ORDER):
                products = weight * basis.value[:, low] * basis.value[:, high]
                band[high - low] += np.bincount(basis.first + low, products, knots.size)
                band[high - low] += np.bincount(starts + low, stiff * jerk[:, low] * jerk[:, high], knots.size)
        band[0] *= 1.0 + 1e-13
        rows = np.arange(basis.first.size + 1) * ORDER
        weighted = (basis.value * weight[:, None]).ravel()
        shape = (basis.first.size, knots.size)
        self._transposed = csr_array((weighted, basis.columns.ravel(), rows), shape=shape).T.tocsr()
        self._factor = cholesky_banded(band, lower=True, check_finite=False)

    def project(self, data: FloatArray) -> FloatArray:
        """B' W data for (n,) or (n, p) data."""
        return np.asarray(self._transposed @ data)

    def solve(self, projected: FloatArray) -> FloatArray:
        """Coefficients for projected data."""
        return np.asarray(cho_solve_banded((self._factor, True), projected, check_finite=False))

    def inverse_band(self) -> FloatArray:
        """(size, 4, 4): for each run of four neighbours the block of the inverse (Takahashi 1973); runs start at row i.

        Only the rows up to size - 4 start a full run.
        """
        factor = self._factor
        size = self._knots.size
        blocks = np.zeros((size, ORDER, ORDER))
        last = np.zeros((ORDER, ORDER))
        diagonal = factor[0]
        below = np.zeros((size, 3))
        for k in range(1, ORDER):
            below[: size - k, k - 1] = factor[k, : size - k] / diagonal[: size - k]
        own = 1.0 / diagonal**2
        for i in range(size - 1, -1, -1):
            block = np.empty((ORDER, ORDER))
            block[1:, 1:] = last[:3, :3]
            side = -(last[:3, :3] @ below[i])
            block[1:, 0] = block[0, 1:] = side
            block[0, 0] = own[i] - below[i] @ side
            blocks[i] = last = block
        return blocks
