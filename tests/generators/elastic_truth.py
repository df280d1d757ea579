"""An elastic shaft with tufting linkages by independent equations: dense, in each station's own angle, by DOP853.

No code is shared with the engine. The linkage is that of `tufting_truth` (complex loop equations in many digits) at a
few angles, as a Fourier series; each station has its own absolute angle behind its gears.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import numpy.typing as npt
import scipy

from tests.generators.tufting_truth import truth
from textile_twin_core.arrays import BoolArray, FloatArray

_ANGLES = 96
PLANE_M = 0.55784


@cache
def series() -> npt.NDArray[np.complex128]:
    """Compute the (3, harmonics) complex Fourier coefficients of inertia, potential energy and needle position."""
    names = ("equivalent_inertia_kgm2", "potential_energy_J", "needle_position_m")
    turn = [truth(2.0 * math.pi * k / _ANGLES, 0.0, 0.0, 20, reactions=False) for k in range(_ANGLES)]
    values = np.array([[float(at[name]) for at in turn] for name in names])
    spectrum: npt.NDArray[np.complex128] = np.fft.rfft(values, axis=1)[:, : _ANGLES // 2] / _ANGLES
    spectrum[:, 1:] *= 2.0
    return spectrum


def linkage(theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute J, J', V', needle position y and y' at crank angles."""
    orders = np.arange(_ANGLES // 2)
    wave = np.exp(1j * np.outer(orders, theta))
    inertia, potential, needle = series()
    along = 1j * orders
    return (
        (inertia @ wave).real,
        ((along * inertia) @ wave).real,
        ((along * potential) @ wave).real,
        (needle @ wave).real,
        ((along * needle) @ wave).real,
    )


@dataclass
class Chain:
    """Stations with discs and linkages (`carries`), pieces with gears and backlash, loads and base motion."""

    discs: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    carries: BoolArray
    phase: FloatArray
    gears: FloatArray = field(default_factory=lambda: np.zeros(0))
    play: FloatArray = field(default_factory=lambda: np.zeros(0))
    viscous: float = 0.0
    force: Callable[[FloatArray], FloatArray] | None = None
    """Force on the needle along +y over the crank angle [N]."""
    backing_N: float = 0.0
    law: Callable[[FloatArray, BoolArray], FloatArray] | None = None
    """Continuous force against the needle by its position and whether it goes down [N]."""
    base: Callable[[float], tuple[float, float, float]] | None = None
    """Angle, speed and acceleration of the first station; None: free, under `torque`."""
    torque: Callable[[float, float, float], float] = field(default=lambda t, theta, omega: 0.0)

    def __post_init__(self) -> None:
        pieces = self.stiffness.size
        self.gears = self.gears if self.gears.size else np.ones(pieces)
        self.play = self.play if self.play.size else np.zeros(pieces)
        self.inside = np.zeros(self.discs.size, dtype=bool)

    def piece_torques(self, theta: FloatArray, omega: FloatArray) -> FloatArray:
        """Compute the torque of each piece on its far station."""
        twist = theta[:-1] / self.gears - theta[1:]
        rate = omega[:-1] / self.gears - omega[1:]
        reach = np.sign(twist) * np.maximum(np.abs(twist) - 0.5 * self.play, 0.0)
        touches = (reach != 0.0) | (self.play == 0.0)
        torque: FloatArray = self.stiffness * reach + np.where(touches, self.damping * rate, 0.0)
        return torque

    def accelerations(self, t: float, theta: FloatArray, omega: FloatArray) -> FloatArray:
        """Compute the acceleration of every station."""
        J, slope, weight, needle, travel = linkage(theta + self.phase)
        resisting = 0.5 * slope * omega**2 + weight + self.viscous * omega
        if self.force is not None:
            resisting += self.force(theta + self.phase) * travel
        if self.law is not None:
            resisting += self.law(needle, travel * omega > 0.0) * np.abs(travel) * np.sign(omega)
        resisting += self.backing_N * np.abs(travel) * np.sign(omega) * self.inside
        pieces = self.piece_torques(theta, omega)
        net = np.where(self.carries, -resisting, 0.0)
        net[1:] += pieces
        net[:-1] -= pieces / self.gears
        net[0] += self.torque(t, theta[0], omega[0])
        found: FloatArray = net / (self.discs + np.where(self.carries, J, 0.0))
        return found

    def run(self, start: FloatArray, times: FloatArray, tolerance: float = 1e-11) -> tuple[FloatArray, FloatArray]:
        """Integrate (samples, stations) angles and speeds from `start`, (angles, speeds)."""
        n = self.discs.size

        def slopes(t: float, y: FloatArray) -> FloatArray:
            theta, omega = y[:n].copy(), y[n:].copy()
            if self.base is not None:
                theta[0], omega[0], alpha = self.base(t)
            found = self.accelerations(t, theta, omega)
            if self.base is not None:
                found[0] = alpha
            return np.concatenate([omega, found])

        rows = np.empty((times.size, 2 * n))
        state, now = start.copy(), float(times[0])
        scale = np.concatenate([np.full(n, 1e-3), np.full(n, 1.0)]) * tolerance
        carrying = np.flatnonzero(self.carries).tolist()
        if self.backing_N:
            self.inside = linkage(state[:n] + self.phase)[3] >= PLANE_M
        while now < times[-1]:
            later = np.flatnonzero(times > now if now > times[0] else times >= now)
            found = scipy.integrate.solve_ivp(
                slopes,
                (now, float(times[-1])),
                state,
                "DOP853",
                t_eval=times[later],
                rtol=tolerance,
                atol=scale,
                events=[self._crossing(k) for k in carrying] if self.backing_N else None,
            )
            reached = len(found.t)
            rows[later[:reached]] = np.array(found.y).T if reached else np.empty((0, 2 * n))
            now = float(times[-1])
            if found.status == 1:
                which, moments = next((k, m) for k, m in enumerate(found.t_events) if m.size)
                now, state = float(moments[0]), found.y_events[which][0]
                self.inside[carrying[which]] ^= True
        if self.base is not None:
            rows[:, 0], rows[:, n] = np.array([self.base(t)[:2] for t in times]).T
        return rows[:, :n], rows[:, n:]

    def _crossing(self, station: int) -> Callable[[float, FloatArray], float]:
        """Return the needle's depth in the backing, whose zero ends a run at entry or exit."""

        def depth(t: float, y: FloatArray) -> float:
            theta = np.array([y[station] + self.phase[station]])
            return float(linkage(theta)[3][0]) - PLANE_M

        depth.terminal = True  # type: ignore[attr-defined]
        depth.direction = -1.0 if self.inside[station] else 1.0  # type: ignore[attr-defined]
        return depth
