"""Stretches on an elastic pad: the nonlinear equations by their own Taylor series, step length from its last terms."""

from __future__ import annotations

import math
from operator import mul

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.drive import DrivePiece
from textile_twin_core.contact.mode import Mode
from textile_twin_core.contact.polynomials import rescale


class PadFlow:
    """Taylor integration of one mode with pads that push.

    The force of a pad is a polynomial, so that the solution's coefficients follow from one another by products of
    series, to any order, without a derivative being formed by hand. Order and step after A. Jorba and M. Zou,
    Experimental Mathematics 14 (2005): order from the tolerance (higher than theirs, since the overhead of a step
    outweighs its products here), step from the decay of the last coefficients.
    """

    def __init__(self, mode: Mode, pushing: tuple[int, ...], tolerance: float) -> None:
        self.mode = mode
        self.pushing = pushing
        self.tolerance = tolerance
        self.order = min(max(math.ceil(-0.8 * math.log(tolerance)) + 2, 8), 30)
        self._drive_error = max(1e-16, 1e-3 * min(tolerance, 1e-7))
        model = mode.model
        bodies = len(model.bodies)
        spread = np.vstack((mode.spread, np.zeros((2, mode.size))))
        driven = np.append(mode.driven, (1.0, 0.0))
        offset = np.append(mode.offset, (0.0, 0.0))
        self._pads = []
        for number in pushing:
            pad = model.pads[number]
            upper, lower = model.index[pad.upper], model.index[pad.lower]
            self._pads.append(
                (
                    (spread[upper] - spread[lower]).tolist(),
                    float(driven[upper] - driven[lower]),
                    float(offset[upper] - offset[lower] - pad.position_m),
                    pad.stiffness,
                    pad.damping_Ns_m,
                    [float(-(spread[upper, c] - spread[lower, c]) / mode.cluster_mass[c]) for c in range(mode.size)],
                )
            )
        self._bodies = bodies
        self._guess_s = self._first_guess()

    def _first_guess(self) -> float:
        mode = self.mode
        fastest = 1.0
        if mode.size:
            stiffness = float(np.abs(mode.stiffness).sum(axis=1).max())
            damping = float(np.abs(mode.damping).sum(axis=1).max())
            for _, _, _, polynomial, rubbing, push in self._pads:
                strongest = max(map(abs, push))
                stiffness += polynomial[0] * strongest
                damping += rubbing * strongest
            fastest = max(0.5 * (damping + math.sqrt(damping**2 + 4.0 * stiffness)), 1.0)
        return 1.0 / fastest

    def step(
        self,
        coordinates: FloatArray,
        speeds: FloatArray,
        piece: DrivePiece,
        time_s: float,
        longest_s: float,
        speed_scale: float,
    ) -> tuple[float, FloatArray, FloatArray]:
        """Length [s], movers' power series (movers, order+1) and pad forces (pads, order) of the step from here.

        Its error is at most tolerance times the way that a body makes in the step at `speed_scale` [m/s].
        """
        h = piece.reach_s(time_s, min(self._guess_s, longest_s), self.order, self._drive_error)
        drive = piece.taylor(time_s, h, self.order)
        series, forces = self._series(coordinates.tolist(), speeds.tolist(), drive.tolist(), h)
        coefficients = np.array(series).reshape(self.mode.size, self.order + 1)
        pressure = np.array(forces)
        factor = min(
            4.0,
            self._longest(coefficients, max(speed_scale * h, 1e-300)),
            self._longest(pressure, max(float(np.abs(pressure).max()), 1e-300)),
        )
        self._guess_s = h * factor
        factor = piece.reach_s(time_s, min(h * factor, longest_s), self.order, self._drive_error) / h
        movers = self.mode.movers(coefficients, drive)
        return h * factor, rescale(movers, factor), rescale(pressure, factor)

    def _longest(self, series: FloatArray, scale: float) -> float:
        """Factor on the step at which what follows the series comes down to the tolerance, relative to its scale.

        The radius of convergence is read from the last six coefficients: some of two may vanish by symmetry.
        """
        if series.size == 0:
            return math.inf
        powers = np.arange(series.shape[1])[-6:]
        last = np.abs(series[:, -6:]).max(axis=0)
        if not last.any():
            return math.inf
        present = last > 0.0
        with np.errstate(over="ignore"):  # what is almost zero bounds nothing
            radius = float(((scale / last[present]) ** (1.0 / powers[present])).min())
        return float(0.9 * radius * self.tolerance ** (1.0 / (self.order - 2)))

    def _series(
        self, coordinates: list[float], speeds: list[float], drive: list[float], h: float
    ) -> tuple[list[list[float]], list[list[float]]]:
        mode = self.mode
        size = range(mode.size)
        stiffness, damping = mode.stiffness.tolist(), mode.damping.tolist()
        by_position, by_velocity = mode.by_position.tolist(), mode.by_velocity.tolist()
        constant = mode.constant.tolist()
        q = [[coordinates[c], speeds[c] * h] for c in size]
        squeeze: list[list[list[float]]] = [[[] for _ in pad[3]] for pad in self._pads]
        forces: list[list[float]] = [[] for _ in self._pads]
        for k in range(self.order):
            for pad, powers, force in zip(self._pads, squeeze, forces, strict=True):
                force.append(_pad_term(pad, powers, q, drive, k, h))
            if k == self.order - 1:
                break
            grow = 1.0 / ((k + 1) * (k + 2))
            for c in size:
                right = by_position[c] * drive[k] + (constant[c] if k == 0 else 0.0)
                rate = by_velocity[c] * drive[k + 1]
                for d in size:
                    right -= stiffness[c][d] * q[d][k]
                    rate -= damping[c][d] * q[d][k + 1]
                for pad, force in zip(self._pads, forces, strict=True):
                    right += pad[5][c] * force[k]
                q[c].append((h * h * right + h * (k + 1) * rate) * grow)
        return q, forces


def _pad_term(
    pad: tuple[list[float], float, float, tuple[float, ...], float, list[float]],
    powers: list[list[float]],
    q: list[list[float]],
    drive: list[float],
    k: int,
    h: float,
) -> float:
    """Coefficient k of a pad's force, the powers of its compression being carried along."""
    along, with_drive, offset, stiffness, damping, _ = pad
    compression = with_drive * drive[k] + (offset if k == 0 else 0.0)
    rate = with_drive * drive[k + 1]
    for weight, series in zip(along, q, strict=True):
        compression += weight * series[k]
        rate += weight * series[k + 1]
    first = powers[0]
    first.append(compression)
    total = stiffness[0] * compression + damping * (k + 1) / h * rate
    for exponent in range(1, len(stiffness)):
        lower = powers[exponent - 1]
        term = sum(map(mul, lower, reversed(first)))
        powers[exponent].append(term)
        total += stiffness[exponent] * term
    return total
