"""Planar multibody systems in redundant coordinates: each body has x, y and angle, joints are constraints.

The equations of motion of one driven turn follow from the constraint Jacobian alone: positions by Newton's method,
velocities and accelerations by linear solves, the torque on the driven body by projection onto the admissible
direction. No loop is solved in closed form (Nikravesh, "Planar Multibody Dynamics").
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Vector = tuple[float, float]


@dataclass(frozen=True)
class Body:
    """A rigid body: mass, inertia about its centroid, first guess of centroid and angle (x, y, angle)."""

    mass_kg: float
    inertia_kgm2: float
    guess: tuple[float, float, float]


@dataclass(frozen=True)
class Pin:
    """A body-fixed point [m] coincides with a point of another body, or of the ground if `second` is None."""

    first: int
    at_first: Vector
    second: int | None
    at_second: Vector


@dataclass(frozen=True)
class Weld:
    """Two bodies keep the angle `offset_rad` between them: angle(second) = angle(first) + offset."""

    first: int
    second: int
    offset_rad: float


@dataclass(frozen=True)
class Guide:
    """A body slides along y at a fixed x [m] and does not turn (`angle_rad`)."""

    body: int
    x_m: float
    angle_rad: float


@dataclass(frozen=True)
class Turn:
    """Coordinates over the driven angle and their derivatives by it, each (samples, 3 * bodies) [m, rad]."""

    theta_rad: Floats
    q: Floats
    q1: Floats
    q2: Floats


@dataclass
class Multibody:
    """Bodies, joints and the one body whose angle is driven."""

    bodies: list[Body]
    joints: list[Pin | Weld | Guide]
    driven: int
    gravity_m_s2: float = 9.81
    _rows: int = field(init=False)

    def __post_init__(self) -> None:
        self._rows = 1 + sum({Pin: 2, Weld: 1, Guide: 2}[type(joint)] for joint in self.joints)
        if self._rows != 3 * len(self.bodies):
            raise ValueError(
                f"{self._rows} constraints for {3 * len(self.bodies)} coordinates: not one degree of freedom"
            )

    def turn(self, theta: Floats) -> Turn:
        """Assemble the system at every angle in `theta` [rad] and differentiate it twice by that angle."""
        q = np.tile(np.array([c for body in self.bodies for c in body.guess]), (theta.size, 1))
        q[:, 3 * self.driven + 2] = theta
        for _ in range(30):
            residual, jacobian, _ = self._constraints(q, np.zeros_like(q), theta)
            step = np.linalg.solve(jacobian, residual[..., None])[..., 0]
            q -= step
            if np.abs(step).max() < 1e-13:
                break
        else:
            raise ValueError("the loops cannot be assembled from the given guesses")
        drive = np.zeros_like(q)
        drive[:, -1] = 1.0
        _, jacobian, _ = self._constraints(q, drive, theta)
        q1 = np.linalg.solve(jacobian, drive[..., None])[..., 0]
        _, _, curvature = self._constraints(q, q1, theta)
        q2 = np.zeros_like(q)
        q2 -= np.linalg.solve(jacobian, curvature[..., None])[..., 0]
        return Turn(theta, q, q1, q2)

    def inertia(self, turn: Turn) -> tuple[Floats, Floats]:
        """Compute the equivalent inertia at the driven body [kg m^2] and half its derivative by the angle."""
        mass = np.array([m for body in self.bodies for m in (body.mass_kg, body.mass_kg, body.inertia_kgm2)])
        return (turn.q1**2) @ mass, (turn.q1 * turn.q2) @ mass

    def gravity_torque(self, turn: Turn) -> Floats:
        """Compute the torque on the driven body that holds the system against gravity along -y [N m]."""
        weight = np.array([w for body in self.bodies for w in (0.0, body.mass_kg * self.gravity_m_s2, 0.0)])
        torque: Floats = turn.q1 @ weight
        return torque

    def _constraints(self, q: Floats, rate: Floats, theta: Floats) -> tuple[Floats, Floats, Floats]:
        """Compute the residuals, their Jacobian by q, and the second derivative of the residuals along `rate`."""
        residual = np.zeros((q.shape[0], self._rows))
        jacobian = np.zeros((q.shape[0], self._rows, q.shape[1]))
        curvature = np.zeros((q.shape[0], self._rows))
        row = 0
        for joint in self.joints:
            if isinstance(joint, Pin):
                ends = [(joint.first, joint.at_first, 1.0)]
                if joint.second is None:
                    residual[:, row : row + 2] -= joint.at_second
                else:
                    ends.append((joint.second, joint.at_second, -1.0))
                for body, (along, across), sign in ends:
                    x, y, angle = 3 * body, 3 * body + 1, 3 * body + 2
                    cos, sin = np.cos(q[:, angle]), np.sin(q[:, angle])
                    arm_x, arm_y = along * cos - across * sin, along * sin + across * cos
                    residual[:, row] += sign * (q[:, x] + arm_x)
                    residual[:, row + 1] += sign * (q[:, y] + arm_y)
                    jacobian[:, row, x] = jacobian[:, row + 1, y] = sign
                    jacobian[:, row, angle] = -sign * arm_y
                    jacobian[:, row + 1, angle] = sign * arm_x
                    curvature[:, row] -= sign * arm_x * rate[:, angle] ** 2
                    curvature[:, row + 1] -= sign * arm_y * rate[:, angle] ** 2
                row += 2
            elif isinstance(joint, Weld):
                first, second = 3 * joint.first + 2, 3 * joint.second + 2
                residual[:, row] = q[:, second] - q[:, first] - joint.offset_rad
                jacobian[:, row, second], jacobian[:, row, first] = 1.0, -1.0
                row += 1
            else:
                x, angle = 3 * joint.body, 3 * joint.body + 2
                residual[:, row], residual[:, row + 1] = q[:, x] - joint.x_m, q[:, angle] - joint.angle_rad
                jacobian[:, row, x] = jacobian[:, row + 1, angle] = 1.0
                row += 2
        residual[:, row] = q[:, 3 * self.driven + 2] - theta
        jacobian[:, row, 3 * self.driven + 2] = 1.0
        return residual, jacobian, curvature
