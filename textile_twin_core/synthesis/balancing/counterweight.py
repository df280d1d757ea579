"""Counterweights on links with a fixed pivot, against gravity torque or shaking force."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import Body
from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.machine.machine import Machine
from textile_twin_core.mechanism import Crank, LinkMotion
from textile_twin_core.synthesis.balancing.shaking import shaking
from textile_twin_core.synthesis.turn import SAMPLES, over_turn, without_effect

Against = Literal["gravity_torque", "shaking_force"]


@dataclass(frozen=True)
class Counterweight:
    """A point mass on a link: its radius from the link's start [m] and its angle from the link [rad]."""

    link: str
    mass_kg: float
    radius_m: float
    angle_rad: float


@dataclass(frozen=True)
class Counterweighted:
    """A machine with its counterweights, and the balanced quantity over a turn, (n,) or (n, 2), before and after.

    `before` and `after` are the gravity torque [N m] or the components of the shaking force [N] at the shaft angles.
    """

    machine: Machine
    weights: tuple[Counterweight, ...]
    theta_rad: FloatArray
    before: FloatArray
    after: FloatArray

    @property
    def rms(self) -> tuple[float, float]:
        """Return the root mean square of the torque, or of the magnitude of the force, before and after."""
        before, after = (math.sqrt(float((x**2).sum()) / self.theta_rad.size) for x in (self.before, self.after))
        return before, after


def counterweights(
    machine: Machine,
    links: Sequence[str] | None = None,
    against: Against = "gravity_torque",
    radius_m: float | None = None,
    speed_rad_s: float | None = None,
) -> Counterweighted:
    """Find the counterweights on `links` that minimise the mean square of gravity torque or shaking force.

    A weight of mass moment S e^(i d) [kg m] on a link about a fixed point adds linear terms in S cos d and S sin d,
    which gives a linear least-squares problem. Weights on the crank alone (the default) remove the first harmonic
    exactly. Weights on every grounded link of a four-bar remove the whole shaking force. `radius_m` is the radius of
    the masses, by default that of the link's own end.

    Raises:
        MachineError: for a link without a fixed pivot, a machine without masses, or weights without effect.
        SceneError: for an unknown aim.

    References:
        Berkof and Lowen 1969: complete force balance of four-bars.
    """
    if against not in get_args(Against):
        raise SceneError(f"counterweights work against {' or '.join(get_args(Against))}, not '{against}'")
    if machine.missing_for_torque:
        raise MachineError(f"machine '{machine.name}' lacks masses: {', '.join(machine.missing_for_torque)}")
    names = _grounded(machine, links)
    speed = machine.nominal_speed_rad_s if speed_rad_s is None else speed_rad_s
    theta = machine.shaft_angles(SAMPLES)
    before = _felt(machine, against, theta, speed)
    effect = _effect(machine, names, against, theta, speed)
    single = _effect(replace(machine, linkages=machine.linkages[:1]), names, against, theta, speed)
    effect[:, without_effect(effect, single)] = 0.0
    if not effect.any():
        raise MachineError(
            f"machine '{machine.name}': a counterweight on {' and '.join(names)} changes nothing of the"
            f" {against.replace('_', ' ')}, as its linkages balance each other so far or there is no gravity;"
            " name other links"
        )
    solution = np.linalg.lstsq(effect, -before.reshape(-1), rcond=1e-12)[0]
    weights, balanced = [], machine
    for k, name in enumerate(names):
        moment = complex(solution[2 * k], solution[2 * k + 1])
        radius = machine.linkage.solved.links[name].length if radius_m is None else radius_m
        if not (math.isfinite(radius) and radius > 0.0):
            raise SceneError(f"radius {radius!r} m of a counterweight: give a positive length")
        weights.append(Counterweight(name, abs(moment) / radius, radius, cmath.phase(moment)))
        balanced = _with(balanced, name, abs(moment) / radius, radius * cmath.exp(1j * cmath.phase(moment)))
    return Counterweighted(balanced, tuple(weights), theta, before, _felt(balanced, against, theta, speed))


def _effect(machine: Machine, names: Sequence[str], against: Against, theta: FloatArray, speed: float) -> FloatArray:
    """Compute the (m, 2 k) effect of 1 kg m on each of k links, along the link and across it."""
    before = _felt(machine, against, theta, speed)
    changed = [_felt(_with(machine, name, 1.0, turn), against, theta, speed) for name in names for turn in (1.0, 1.0j)]
    return np.stack([(felt - before).reshape(-1) for felt in changed], axis=1)


def _grounded(machine: Machine, links: Sequence[str] | None) -> list[str]:
    motion = machine.linkage.solved
    if links is None:
        links = [g.name for g in machine.groups if isinstance(g, Crank)][:1]
    if not links:
        raise MachineError(f"machine '{machine.name}' has no crank for a counterweight; name a link")
    for name in links:
        link = motion.links.get(name)
        if link is None or not motion.points[link.start].is_fixed or _slides(link):
            raise MachineError(
                f"a counterweight needs a link about a fixed point, and '{name}' has no fixed pivot or slides"
            )
    return list(dict.fromkeys(links))


def _slides(link: LinkMotion) -> bool:
    return link.direction.x.is_constant and link.direction.y.is_constant


def _with(machine: Machine, link: str, mass_kg: float, place: complex) -> Machine:
    """Return the machine with a point mass at a position in the link's frame [m]."""
    length = machine.linkage.solved.links[link].length
    body = Body(link, mass_kg, 0.0, (place.real / length, place.imag / length))
    return replace(machine, bodies=(*machine.bodies, body))


def _felt(machine: Machine, against: Against, theta: FloatArray, speed: float) -> FloatArray:
    if against == "gravity_torque":
        return over_turn([machine.model.output("torque_gravity_Nm")], theta)[0]
    shaken = shaking(machine, speed, theta)
    return np.stack([shaken.x_N, shaken.y_N], axis=1)
