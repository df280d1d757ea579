"""A measured periodic table as a smooth function of the shaft's direction: a Fourier series of its spline."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import scipy

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const
from textile_twin_core.mechanism.vector import Vector

Spectrum: TypeAlias = npt.NDArray[np.complex128]

MOST_HARMONICS = 64
CLOSE_ENOUGH = 1e-3
_LARGEST_OVERSHOOT = 1.1
_APART = 1e-9
_SAMPLES = 4096
_TURN = 2.0 * math.pi


@dataclass(frozen=True)
class PeriodicTable:
    """Values over one turn [rad] as a Fourier series.

    Evenly spaced values whose upper third of harmonics is empty give their own series. All other tables give the series
    of a periodic cubic spline, which does not ring between the points (see `_spline`). `harmonics` None takes the
    fewest harmonics that meet every value to 0.1 % of their range, at most 64.

    A series has no branches, so every evaluator and every derivative keeps full accuracy. A discontinuity cannot be
    represented; a discontinuous action, such as a needle in the backing, is a load of its own.

    Raises:
        MachineError: for fewer than three angles, angles that do not increase or span more than a turn, and values that
            64 harmonics do not meet.
    """

    what: str
    angle_rad: tuple[float, ...]
    values: tuple[float, ...]
    harmonics: int | None = None

    def __post_init__(self) -> None:
        if len(self.angle_rad) != len(self.values) or len(self.values) < 3:
            raise MachineError(
                f"{self.what}: it needs at least three angles and as many values, "
                f"not {len(self.angle_rad)} and {len(self.values)}"
            )
        if not all(math.isfinite(v) for v in (*self.angle_rad, *self.values)):
            raise MachineError(f"{self.what}: angles and values must be finite numbers")
        if not all(b - a > _APART for a, b in pairwise([*self.angle_rad, self.angle_rad[0] + _TURN])):
            raise MachineError(f"{self.what}: angles must rise and lie within one turn, the first not repeated")
        if self.harmonics is not None and not 0 <= self.harmonics <= _SAMPLES // 4:
            raise MachineError(f"{self.what}: harmonics must lie from 0 to {_SAMPLES // 4}, not {self.harmonics}")
        _ = self.coefficients

    @cached_property
    def coefficients(self) -> tuple[complex, ...]:
        """Coefficients c_0 .. c_H of Re sum c_k exp(i k theta)."""
        limit = CLOSE_ENOUGH * float(np.ptp(self.values))
        miss = math.inf
        for spectrum in self._spectra():
            if self.harmonics is not None and self.harmonics < len(spectrum):
                return tuple(complex(c) for c in spectrum[: self.harmonics + 1])
            for count in range(min(MOST_HARMONICS + 1, len(spectrum))):
                miss = self._miss(spectrum[: count + 1])
                if self.harmonics is None and miss <= limit:
                    return tuple(complex(c) for c in spectrum[: count + 1])
        raise MachineError(
            f"{self.what}: {MOST_HARMONICS} harmonics miss a value by {miss:.3g}, over 0.1 % of the range; "
            "smooth the table, or give 'harmonics' to accept such a miss"
        )

    def _spectra(self) -> Iterator[Spectrum]:
        """Yield coefficients c_k of sum c_k exp(i k theta): those of evenly spaced values, then those of the spline."""
        n = len(self.values)
        angles = np.array([*self.angle_rad, self.angle_rad[0] + _TURN])
        if np.allclose(np.diff(angles), _TURN / n, rtol=0.0, atol=1e-6 * _TURN / n):
            own = np.fft.rfft(self.values)[: n // 3 + 1] * (2.0 / n)
            own[0] *= 0.5
            yield own * np.exp(-1j * np.arange(own.size) * angles[0])

        smooth = np.fft.rfft(self._spline(angles)(np.arange(_SAMPLES) * (_TURN / _SAMPLES))) * (2.0 / _SAMPLES)
        smooth[0] *= 0.5
        yield smooth[: _SAMPLES // 4 + 1]

    def _spline(self, angles: FloatArray) -> scipy.interpolate.PPoly:
        """Fit the periodic spline through the values at `angles`, the first repeated.

        A steep edge beside a plateau makes a smooth spline overshoot. If it exceeds the range of the values by more
        than a tenth, its slopes are limited to three times those to either neighbour, which keeps it monotonic where
        the values are.

        References:
            Hyman, Accurate monotonicity preserving cubic interpolation, SIAM J. Sci. Stat. Comput. 4, 1983.
        """
        values = np.array([*self.values, self.values[0]])
        smooth = scipy.interpolate.CubicSpline(angles, values, bc_type="periodic")
        over_turn = smooth(np.linspace(angles[0], angles[-1], _SAMPLES))
        if np.ptp(over_turn) <= _LARGEST_OVERSHOOT * np.ptp(values):
            return smooth
        slopes, after = smooth(angles, 1), np.diff(values) / np.diff(angles)
        before, after = np.append(after[-1], after), np.append(after, after[0])
        sense = np.where(before * after > 0.0, np.sign(before), np.sign(slopes))
        steepest = 3.0 * np.minimum(np.abs(before), np.abs(after))
        limited = sense * np.clip(sense * slopes, 0.0, steepest)
        return scipy.interpolate.CubicHermiteSpline(angles, values, limited)

    def _miss(self, spectrum: Spectrum) -> float:
        angles = np.asarray(self.angle_rad)
        waves = np.exp(1j * np.outer(angles, np.arange(len(spectrum))))
        return float(np.abs((waves @ spectrum).real - np.asarray(self.values)).max())

    def at(self, direction: Vector) -> Expr:
        """Express the function at a direction (cos, sin), by Horner's rule for the unit complex number."""
        *lower, top = self.coefficients
        real, imaginary = const(top.real), const(top.imag)
        for c in reversed(lower):
            real, imaginary = (
                c.real + (direction.x * real - direction.y * imaginary),
                c.imag + (direction.x * imaginary + direction.y * real),
            )
        return real
