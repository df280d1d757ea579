"""The linear forces on the bodies of a model as matrices: springs, dampers, constant forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.model import ContactModel


@dataclass(frozen=True)
class LinearForces:
    """Force on the movers (bodies, then driven element): constant - stiffness x - damping v, movers in rows."""

    masses: FloatArray
    """(bodies,) in kg"""
    stiffness: FloatArray
    """(movers, movers) in N/m"""
    damping: FloatArray
    """(movers, movers) in N s/m"""
    constant: FloatArray
    """(movers,) in N"""

    @classmethod
    def of(cls, model: ContactModel) -> LinearForces:
        """Assemble from the model's springs, dampers and constant forces; what acts on the frame is left out."""
        count = len(model.bodies) + 1
        stiffness = np.zeros((count + 1, count + 1))
        damping = np.zeros((count + 1, count + 1))
        constant = np.zeros(count + 1)
        for row, body in enumerate(model.bodies):
            constant[row] += body.force_N
        for spring in model.springs:
            pull = np.zeros(count + 1)
            pull[model.index[spring.upper]] = 1.0
            pull[model.index[spring.lower]] = -1.0
            stiffness += spring.stiffness_N_m * np.outer(pull, pull)
            damping += spring.damping_Ns_m * np.outer(pull, pull)
            constant += spring.stiffness_N_m * spring.free_length_m * pull
        masses = np.array([body.mass_kg for body in model.bodies])
        return cls(masses, stiffness[:-1, :-1], damping[:-1, :-1], constant[:-1])

    def on_movers(self, positions: FloatArray, velocities: FloatArray) -> FloatArray:
        """Force [N] on every mover; positions and velocities (movers,) or as power series (movers, order+1)."""
        force = -(self.stiffness @ positions) - self.damping @ velocities
        if force.ndim == 1:
            return np.asarray(force + self.constant)
        force[:, 0] += self.constant
        return np.asarray(force)
