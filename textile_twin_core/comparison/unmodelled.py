"""Unmodelled torque by shaft angle: the residual as a smooth table with its band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.comparison.uncertainty import bootstrap_moves

_ORDERS = 16  # of the turn
_POINTS = 120  # a turn
_WORTH = 0.01


@dataclass(frozen=True)
class UnmodelledTorque:
    """Torque of the drive that the model lacks, over one cycle; arrays are (points,).

    Attributes:
        cycle_turns: turns of the shaft in a cycle. angle_rad: evenly over the cycle, whose first turn begins at the
            shaft's unwrapped angle 0. torque_Nm: the unmodelled torque. band_Nm: half width of its 95 % band, which
            holds for all angles together.
        share: share of the residual's mean square that it explains.
        significant: true if it exceeds its band anywhere and explains more than a hundredth.
    """

    angle_rad: FloatArray
    torque_Nm: FloatArray
    band_Nm: FloatArray
    share: float
    significant: bool
    cycle_turns: int = 1


def unmodelled_torque(
    theta_rad: FloatArray, residual_Nm: FloatArray, turn: IntArray, cycle_turns: int = 1
) -> UnmodelledTorque:
    """Fit a Fourier series, orders 1 / cycle_turns to 16, to a residual (n,) over the shaft angle, with its band.

    The band is the 95th percentile, over a bootstrap of whole cycles, of the largest departure in units of its scatter.
    """
    cycle = np.asarray(turn // cycle_turns)
    columns = _waves(theta_rad, cycle_turns)
    found = np.linalg.lstsq(columns.T @ columns, columns.T @ residual_Nm, rcond=1e-9)[0]
    unexplained = residual_Nm - columns @ found
    angle = TURN * np.arange(_POINTS * cycle_turns) / _POINTS
    waves = _waves(angle, cycle_turns)
    moves = bootstrap_moves(columns, unexplained, cycle) @ waves.T
    scatter = np.std(moves, axis=0) + 1e-300
    width = float(np.percentile(np.max(np.abs(moves) / scatter, axis=1), 95.0))
    torque, band = waves @ found, width * scatter
    power = float(residual_Nm @ residual_Nm)
    share = 1.0 - float(unexplained @ unexplained) / power if power > 0.0 else 0.0
    significant = share > _WORTH and bool((np.abs(torque) > band).any())
    return UnmodelledTorque(angle, torque, band, share, significant, cycle_turns)


def _waves(theta: FloatArray, cycle_turns: int) -> FloatArray:
    angle = np.outer(theta, np.arange(1, _ORDERS * cycle_turns + 1) / cycle_turns)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
