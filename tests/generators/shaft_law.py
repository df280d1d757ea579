"""Two machines reduced to their shaft, from bodies in redundant coordinates, as truth of test recordings.

No code is shared with the engine: the bodies and joints are those of `multibody`, tabulated over one turn and
interpolated by scipy's periodic cubic spline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from tests.generators.multibody import Body, Floats, Guide, Multibody, Pin, Weld
from tests.generators.tufting_rig import tufting_multibody

NODES = 4096


@dataclass(frozen=True)
class Friction:
    """Friction against the shaft's rotation: `viscous_Nms` times its speed, plus `coulomb_Nm` while it turns."""

    viscous_Nms: float = 0.0
    coulomb_Nm: float = 0.0


@dataclass(frozen=True)
class Backing:
    """Friction on the needle below a plane (distance under C) while moving down and up, and above it."""

    force_N: float = 1000.0
    free_force_N: float = 0.0
    entry_plane_m: float = 0.55784
    exit_plane_m: float = 0.55784


class ShaftLaw:
    """Equivalent inertia, half its slope, gravity torque and one point's travel over the shaft angle."""

    def __init__(self, system: Multibody, travel: int, travel_sense: float, travel_origin: float) -> None:
        theta = 2.0 * math.pi * np.arange(NODES + 1) / NODES
        turn = system.turn(theta)
        inertia, half_slope = system.inertia(turn)
        position = travel_sense * turn.q[:, travel] + travel_origin
        columns = np.stack(
            [inertia, half_slope, system.gravity_torque(turn), position, travel_sense * turn.q1[:, travel]]
        )
        columns[:, -1] = columns[:, 0]
        self._spline = CubicSpline(theta, columns, axis=1, bc_type="periodic")

    def at(self, theta: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Return inertia [kg m^2], half slope, gravity torque [N m], travel [m] and its slope at angles (n,)."""
        inertia, half_slope, gravity, travel, slope = self._spline(np.mod(theta, 2.0 * math.pi))
        return inertia, half_slope, gravity, travel, slope

    def torque(
        self,
        theta: Floats,
        omega: Floats,
        alpha: Floats,
        friction: Friction,
        backing: Backing | None = None,
        added_inertia_kgm2: float = 0.0,
    ) -> Floats:
        """Compute the balancing torque [N m] of shaft motion (n,) by Lagrange's equation, with loads."""
        inertia, half_slope, gravity, travel, slope = self.at(theta)
        torque = (inertia + added_inertia_kgm2) * alpha + half_slope * omega**2 + gravity
        torque = torque + friction.viscous_Nms * omega + friction.coulomb_Nm * np.sign(omega)
        if backing is not None:
            down = slope * omega > 0.0
            inside = travel >= np.where(down, backing.entry_plane_m, backing.exit_plane_m)
            force = np.where(inside, backing.force_N, backing.free_force_N)
            torque = torque + force * slope * np.sign(slope * omega)
        return np.asarray(torque)


@cache
def tufting_law() -> ShaftLaw:
    """Reduce the tufting machine of Xu et al. 2016; its travel is the needle's distance below C."""
    # y of the needle bar's centroid: the tip lies 0.22 m below it, C at 0.155 m
    return ShaftLaw(tufting_multibody(), travel=16, travel_sense=-1.0, travel_origin=0.155 + 0.220)


@cache
def loom_law() -> ShaftLaw:
    """Reduce a crank-rocker with a heavy sley; its travel is the height of the rocker's centroid."""
    crank, coupler, rocker, ground = 0.06, 0.20, 0.23, 0.30
    pin = complex(crank, 0.0)
    across = complex(ground, 0.0) - pin
    along = (abs(across) ** 2 + coupler**2 - rocker**2) / (2.0 * abs(across))
    joint = pin + across / abs(across) * complex(along, math.sqrt(coupler**2 - along**2))
    middle, centre = (pin + joint) / 2.0, (ground + joint) / 2.0
    turn = (joint - pin, joint - ground)
    angles = [math.atan2(v.imag, v.real) for v in turn]
    bodies = [
        Body(0.15, 5.0e-5, (crank / 2.0, 0.0, 0.0)),
        Body(0.45, 1.6e-3, (middle.real, middle.imag, angles[0])),
        Body(8.00, 9.0e-2, (centre.real, centre.imag, angles[1])),
    ]
    joints: list[Pin | Weld | Guide] = [
        Pin(0, (-crank / 2.0, 0.0), None, (0.0, 0.0)),
        Pin(0, (crank / 2.0, 0.0), 1, (-coupler / 2.0, 0.0)),
        Pin(1, (coupler / 2.0, 0.0), 2, (rocker / 2.0, 0.0)),
        Pin(2, (-rocker / 2.0, 0.0), None, (ground, 0.0)),
    ]
    return ShaftLaw(Multibody(bodies, joints, driven=0), travel=7, travel_sense=1.0, travel_origin=0.0)


LOOM_FILE = """\
name: friction_loom
points: {O: [0, 0], C: [0.3, 0]}
groups:
  - {type: crank, name: crank, at: O, end: A, length_m: 0.06}
  - {type: rrr_dyad, coupler: l2, rocker: l3, from: A, ground: C, end: B, lengths_m: [0.2, 0.23], branch: left}
bodies:
  crank: {mass_kg: 0.15, inertia_kgm2: 5.0e-5}
  l2: {mass_kg: 0.45, inertia_kgm2: 1.6e-3}
  l3: {mass_kg: 8.0, inertia_kgm2: 9.0e-2}
measures: [{type: arc, name: sley, link: l3, radius_m: 0.23}]
loads: [{type: shaft_friction, viscous_Nms: 0.04, coulomb_Nm: 1.0}]
"""
"""User's declaration of the same loom; its friction is LOOM_FRICTION."""

LOOM_FRICTION = Friction(viscous_Nms=0.04, coulomb_Nm=1.0)
