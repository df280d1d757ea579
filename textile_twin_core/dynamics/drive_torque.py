"""Drive torques as tables over time and over the shaft angle."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from textile_twin_core.dynamics.loads.periodic_table import PeriodicTable
from textile_twin_core.errors import MotionError
from textile_twin_core.expression import const, cos, sin
from textile_twin_core.expression.scalar import compile_scalar
from textile_twin_core.mechanism import THETA, Rotation
from textile_twin_core.mechanism.vector import Vector

DriveTorque = Callable[[float, float, float], float]
"""Torque [N m] of the drive at (time [s], shaft angle [rad], shaft speed [rad/s])."""


@dataclass(frozen=True)
class TorqueOverTime:
    """A drive torque that is piecewise linear over time, and constant before and after its table.

    Args:
        time_s: (n,) increasing times [s].
        torque_Nm: (n,) torques [N m].

    Raises:
        MotionError: for a table that is too short or whose times do not increase.

    Examples:
        >>> ramp = TorqueOverTime((0.0, 1.0), (0.0, 20.0))
        >>> ramp(0.5, theta=0.0, omega=0.0)
        10.0
    """

    time_s: tuple[float, ...]
    torque_Nm: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.time_s) != len(self.torque_Nm) or len(self.time_s) < 2:
            raise MotionError(
                f"drive torque over time: it needs two or more times and as many torques, "
                f"not {len(self.time_s)} and {len(self.torque_Nm)}"
            )
        if not all(math.isfinite(v) for v in (*self.time_s, *self.torque_Nm)):
            raise MotionError("drive torque over time: times and torques must be finite numbers")
        for k, (a, b) in enumerate(pairwise(self.time_s)):
            if not b > a:
                raise MotionError(f"drive torque over time: times must rise, but point {k + 1} at {b} s follows {a} s")

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which the torque has a corner [s]."""
        return self.time_s

    def __call__(self, time: float, theta: float, omega: float) -> float:
        """Return the torque at a time [N m]."""
        k = bisect_right(self.time_s, time)
        if k == 0 or k == len(self.time_s):
            return self.torque_Nm[0 if k == 0 else -1]
        t0, t1 = self.time_s[k - 1], self.time_s[k]
        share = (time - t0) / (t1 - t0)
        return (1.0 - share) * self.torque_Nm[k - 1] + share * self.torque_Nm[k]


@dataclass(frozen=True)
class TorqueOverAngle:
    """A drive torque as a smooth periodic function through a table over the shaft angle (see PeriodicTable).

    Args:
        angle_rad: (n,) increasing angles over at most one turn [rad].
        torque_Nm: (n,) torques [N m].
        harmonics: length of the Fourier series; None takes the fewest that meet every value.

    Raises:
        MachineError: for a table of fewer than three angles, angles that do not increase, or values that no series
            meets.

    Examples:
        >>> import math
        >>> pull = TorqueOverAngle((0.0, math.pi / 2, math.pi, 3 * math.pi / 2), (12.0, 10.0, 8.0, 10.0))
        >>> round(pull(time=0.0, theta=math.pi / 2, omega=0.0), 9)
        10.0
    """

    angle_rad: tuple[float, ...]
    torque_Nm: tuple[float, ...]
    harmonics: int | None = None

    def __post_init__(self) -> None:
        _ = self._function

    @cached_property
    def _function(self) -> Callable[[float], float]:
        table = PeriodicTable("drive torque over the angle", self.angle_rad, self.torque_Nm, self.harmonics)
        half = Vector(cos(0.5 * THETA), sin(0.5 * THETA))
        series = table.at(Rotation(half, THETA, const(1.0), const(0.0)).direction)
        function = compile_scalar([series], ["theta"])
        return lambda theta: function(theta)[0]

    def __call__(self, time: float, theta: float, omega: float) -> float:
        """Return the torque at a shaft angle [N m]."""
        return self._function(theta)
