"""Linear stretches between events: the matrix exponential with its forcing, as a power series exact to rounding."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.drive import DrivePiece
from textile_twin_core.contact.mode import Mode
from textile_twin_core.contact.polynomials import rescale

ORDER = 24
_REACH = 2.5
"""(reach)^(order+1) / (order+1)! = 6e-16: over that much of phase the series ends below rounding."""
_ROUNDING = 1e-15


class LinearFlow:
    """Solution operator of one mode without pads.

    The series of exp(A t) and of its convolution with the drive's own series, order 24, is a fixed matrix on
    (coordinates, speeds, 1, drive coefficients); it is made once per mode and used for every step, whose length is
    bounded so that what the series leaves out lies below rounding. Nothing depends on a tolerance.
    """

    def __init__(self, mode: Mode) -> None:
        self.mode = mode
        size = mode.size
        damping = float(np.abs(mode.damping).sum(axis=1).max()) if size else 0.0
        stiffness = float(np.abs(mode.stiffness).sum(axis=1).max()) if size else 0.0
        fastest = 0.5 * (damping + math.sqrt(damping * damping + 4.0 * stiffness))
        self.span_s = _REACH / max(fastest, 1e-3)
        self._operator = self._build(self.span_s)

    def _build(self, h: float) -> FloatArray:
        mode, size = self.mode, self.mode.size
        inputs = 2 * size + 1 + ORDER + 1
        q = np.zeros((ORDER + 1, size, inputs))
        q[0, :, :size] = np.eye(size)
        q[1, :, size : 2 * size] = np.eye(size)
        drive = 2 * size + 1
        for k in range(ORDER - 1):
            right = -(h * h) * (mode.stiffness @ q[k]) - h * (k + 1) * (mode.damping @ q[k + 1])
            right[:, drive + k] += h * h * mode.by_position
            right[:, drive + k + 1] += h * (k + 1) * mode.by_velocity
            if k == 0:
                right[:, 2 * size] += h * h * mode.constant
            q[k + 2] = right / ((k + 1) * (k + 2))
        return q.transpose(1, 0, 2).reshape(size * (ORDER + 1), inputs)

    def step(
        self, coordinates: FloatArray, speeds: FloatArray, piece: DrivePiece, time_s: float, longest_s: float
    ) -> tuple[float, FloatArray]:
        """Length [s] and movers' power series (movers, 25) of the step that starts here, at most `longest_s` long."""
        h = piece.reach_s(time_s, min(self.span_s, longest_s), ORDER, _ROUNDING)
        if self.mode.size == 0:
            drive = piece.taylor(time_s, h, ORDER)
            return h, self.mode.movers(np.zeros((0, ORDER + 1)), drive)
        drive = piece.taylor(time_s, self.span_s, ORDER)
        start = np.concatenate((coordinates, speeds * self.span_s, (1.0,), drive))
        series = (self._operator @ start).reshape(self.mode.size, ORDER + 1)
        return h, rescale(self.mode.movers(series, drive), h / self.span_s)
