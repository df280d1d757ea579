"""Steady turn: the scene at equally spaced angles and constant speed, for libraries that do not support
arbitrary angles.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from textile_twin_core.bench.scenes import Motion, Workload


class SteadyTurn(Workload):
    """Turn through the angles 2 pi k / samples for k = 1 .. samples, at nominal speed without acceleration."""

    @cached_property
    def motion(self) -> Motion:
        """Angle [rad], speed [rad/s], acceleration [rad/s^2]."""
        theta = 2.0 * np.pi / self.samples * np.arange(1.0, self.samples + 1.0)
        return theta, np.full(self.samples, self.machine.nominal_speed_rad_s), np.zeros(self.samples)

    @classmethod
    def of(cls, scene: Workload, samples: int) -> SteadyTurn:
        """Create a turn of `samples` samples with the machine and outputs of a scene."""
        return cls(scene.machine, scene.name, scene.outputs, samples)
