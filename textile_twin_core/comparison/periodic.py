"""Bound on the explained share of a record by any torque that is periodic in the shaft's angle."""

from __future__ import annotations

import numpy as np

from textile_twin_core.comparison.evidence import Evidence, Settings

_ORDERS = 12


def best_periodic(evidence: Evidence, settings: Settings) -> float:
    """Share of the torque's mean square about its mean that J(theta) alpha + C(theta) omega^2 + G(theta) can explain.

    J, C and G are any functions with orders up to 12 (J: 4) of the shaft angle, by least squares.
    """
    states = evidence.states(settings)
    good = states.good
    theta, torque = states.theta[good], evidence.torque_Nm[good]
    omega = states.omega[good] / max(abs(evidence.working_speed()), 1e-300)
    alpha = states.alpha[good] / max(float(np.std(states.alpha[good])), 1e-300)
    waves = [np.ones_like(theta)]
    for order in range(1, _ORDERS + 1):
        waves += [np.cos(order * theta), np.sin(order * theta)]
    columns = [*waves, *(wave * omega**2 for wave in waves), *(wave * alpha for wave in waves[:9])]
    matrix = np.stack(columns, axis=1)
    found = np.linalg.lstsq(matrix, torque, rcond=1e-8)[0]
    residual = torque - matrix @ found
    freedom = max(torque.size - matrix.shape[1], 1)
    unexplained = float(residual @ residual) / freedom
    return float(1.0 - unexplained / max(float(np.var(torque)), 1e-300))
