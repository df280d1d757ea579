"""Measures and loads for many designs at once: displacements, and drive torque of a load."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np

from textile_twin_core.dynamics.loads import (
    Backing,
    ForceCurve,
    JointDamping,
    JointFriction,
    PointDamping,
    ShaftFriction,
    SliderFriction,
    Spring,
    TorsionSpring,
)
from textile_twin_core.errors import SceneError
from textile_twin_core.mechanism import Arc, Measure, Travel
from textile_twin_core.synthesis.batch_motion import Chain


@dataclass(frozen=True)
class Turn:
    """Inputs of a load: a solved chain, the machine's measures, and the shaft's constant speed [rad/s].

    `carries_shaft_loads` is set for one linkage of a shaft.
    """

    chain: Chain
    measures: tuple[Measure, ...]
    speed_rad_s: float
    carries_shaft_loads: bool

    @property
    def sense(self) -> float:
        """Sign of the speed."""
        return math.copysign(1.0, self.speed_rad_s)

    def rate(self, link: str, against: str | None) -> Any:
        """Compute the derivative of a link's angle, relative to another link or the ground, by the shaft angle."""
        other = 0.0 if against is None else self.chain.links[against].first
        return self.chain.links[link].first - other


@singledispatch
def displacement(measure: object, chain: Chain) -> tuple[Any, Any, Any]:
    """Compute a measure's displacement [m] and its derivatives by the shaft angle."""
    raise SceneError(f"no batch form is known for a measure of type {type(measure).__name__}")


@displacement.register
def _(measure: Travel, chain: Chain) -> tuple[Any, Any, Any]:
    axis = complex(*measure.direction)
    axis /= abs(axis)
    point, origin = chain.points[measure.point], chain.points[measure.origin]
    travel = point.position - origin.position
    return (travel / axis).real, (point.first / axis).real, (point.second / axis).real


@displacement.register
def _(measure: Arc, chain: Chain) -> tuple[Any, Any, Any]:
    link, scale = chain.links[measure.link], measure.sense * chain.number(f"{measure.name}.radius_m")
    swung = scale * np.angle(link.direction / link.direction[:, :1])
    return swung - np.min(swung, axis=-1, keepdims=True), scale * link.first, scale * link.second


def is_known(load: object) -> bool:
    """Return whether a load has a batch form."""
    return load_torque.dispatch(type(load)) is not load_torque.dispatch(object)


@singledispatch
def load_torque(load: object, name: str, turn: Turn) -> Any:
    """Compute the drive torque that a load requires [N m]; `name` is that of its slots."""
    raise SceneError(f"no batch form is known for a load of type {type(load).__name__}")


@load_torque.register
def _(load: Backing, name: str, turn: Turn) -> Any:
    chain = turn.chain
    (measure,) = [m for m in turn.measures if m.name == load.on]
    position, slope, _ = displacement(measure, chain)
    speed = slope * turn.speed_rad_s
    force, free, entry, leave = (
        chain.number(f"{name}.{k}") for k in ("force_N", "free_force_N", "entry_plane_m", "exit_plane_m")
    )
    inside = position >= np.where(speed >= 0.0, entry, leave)
    # A needle that never reaches the entry plane meets no backing when it leaves.
    inside &= (leave >= entry) | (position.max(axis=-1, keepdims=True) >= entry)
    return np.sign(speed) * slope * np.where(inside, force, free)


@load_torque.register
def _(load: ForceCurve, name: str, turn: Turn) -> Any:
    chain = turn.chain
    places = {f"{m.name}_position_m": m for m in turn.measures}
    if load.measure not in places:
        raise SceneError(f"force curve '{load.name}': designs in numbers take curves over a measure's position alone")
    position, slope, _ = displacement(places[load.measure], chain)
    speed = slope * turn.speed_rad_s
    force = np.where(speed >= 0.0, load.values(position), load.values(position, growing=False))
    if load.speed_power:
        force = force * (abs(turn.speed_rad_s) / (load.at_speed_rad_s or 1.0)) ** load.speed_power
    return np.sign(speed) * slope * force


@load_torque.register
def _(load: ShaftFriction, name: str, turn: Turn) -> Any:
    if not turn.carries_shaft_loads:
        return 0.0
    viscous, coulomb = (turn.chain.number(f"{name}.{k}") for k in ("viscous_Nms", "coulomb_Nm"))
    return viscous * turn.speed_rad_s + coulomb * turn.sense


@load_torque.register
def _(load: JointFriction, name: str, turn: Turn) -> Any:
    return turn.chain.number(f"{name}.torque_Nm") * np.abs(turn.rate(load.link, load.against)) * turn.sense


@load_torque.register
def _(load: JointDamping, name: str, turn: Turn) -> Any:
    return turn.chain.number(f"{name}.viscous_Nms") * turn.rate(load.link, load.against) ** 2 * turn.speed_rad_s


@load_torque.register
def _(load: SliderFriction, name: str, turn: Turn) -> Any:
    return turn.chain.number(f"{name}.force_N") * np.abs(turn.chain.links[load.slider].slides) * turn.sense


@load_torque.register
def _(load: PointDamping, name: str, turn: Turn) -> Any:
    moved = np.abs(turn.chain.points[load.point].first)
    return turn.chain.number(f"{name}.viscous_Ns_m") * moved**2 * turn.speed_rad_s


@load_torque.register
def _(load: Spring, name: str, turn: Turn) -> Any:
    chain = turn.chain
    a, b = chain.points[load.from_point], chain.points[load.to_point]
    span = b.position - a.position
    length = np.abs(span)
    pull = chain.number(f"{name}.stiffness_N_m") * (length - chain.number(f"{name}.free_length_m"))
    slope = (np.conj(span) * (b.first - a.first)).real / length
    return (pull + chain.number(f"{name}.preload_N")) * slope


@load_torque.register
def _(load: TorsionSpring, name: str, turn: Turn) -> Any:
    chain = turn.chain
    other = 1.0 if load.against is None else chain.links[load.against].direction
    beyond = np.angle(chain.links[load.link].direction / other * np.exp(-1j * chain.number(f"{name}.free_angle_rad")))
    torque = chain.number(f"{name}.preload_Nm") - chain.number(f"{name}.stiffness_Nm_rad") * beyond
    return -torque * turn.rate(load.link, load.against)
