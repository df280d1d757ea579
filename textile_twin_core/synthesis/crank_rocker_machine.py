"""A crank-rocker's lengths as a machine: bars of one section, and an arm on the rocker that carries a tool."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

from textile_twin_core.dynamics import Body
from textile_twin_core.machine.machine import Machine
from textile_twin_core.mechanism import Arc, Crank, Group, RigidArm, RRRDyad
from textile_twin_core.synthesis.bars import CAST_IRON, BarSection
from textile_twin_core.synthesis.crank_rocker import LinkLengths
from textile_twin_core.synthesis.hand_positions import RockerThroughPoints


@dataclass(frozen=True)
class Tool:
    """A tool at the end of an arm on the rocker: the arm's length [m] and the tool's mass [kg]."""

    arm_m: float
    mass_kg: float = 0.0


def crank_rocker_machine(
    lengths: LinkLengths,
    section: BarSection = CAST_IRON,
    tool: Tool | None = None,
    hand: RockerThroughPoints | None = None,
    name: str = "crank_rocker",
) -> Machine:
    """Build the machine: crank l1 about O, coupler l2, rocker l3 about C, and for a tool the arm l4 in line with l3.

    The arm is one bar with the rocker, as the paper's AE with AB. With `hand`, the rocker's pivot is that of the hand
    and the ground link is turned so that the tool's arc coincides with the hand's. A hand that moves clockwise beats up
    with crank and coupler stretched, one that moves counter-clockwise with them folded.
    """
    a, b, c, g = lengths.crank_m, lengths.coupler_m, lengths.rocker_m, lengths.ground_m
    turn, pivot, sense = 0.0, complex(g, 0.0), -1
    if hand is not None:
        clockwise = hand.last_rad < hand.first_rad
        turn = (hand.last_rad if clockwise else hand.first_rad) - _stretched_rocker(a, b, c, g)
        pivot, sense = complex(*hand.pivot_m), -1 if clockwise else 1
    crank_pivot = pivot - g * cmath.exp(1j * turn)
    groups: list[Group] = [
        Crank("l1", at="O", end="A", length_m=a),
        RRRDyad("l2", "l3", from_point="A", ground="C", end="B", lengths_m=(b, c), branch="left"),
    ]
    bodies = [section.bar("l1", a), section.bar("l2", b)]
    swinging, radius = "l3", c
    if tool is None:
        bodies.append(section.bar("l3", c))
    else:
        swinging, radius = "l4", tool.arm_m
        groups.append(RigidArm("l4", on="l3", end="E", length_m=tool.arm_m))
        bodies.append(section.bar("l4", tool.arm_m) if tool.arm_m >= c else section.bar("l3", c))
        bodies.append(Body("l4", tool.mass_kg, centroid=(1.0, 0.0)))
    return Machine(
        name=name,
        description="crank-rocker, synthesised",
        points={"O": (crank_pivot.real, crank_pivot.imag), "C": (pivot.real, pivot.imag)},
        groups=tuple(groups),
        bodies=tuple(bodies),
        measures=(Arc("rocker" if tool is None else "beater", link=swinging, radius_m=radius, sense=sense),),
        joint_names={"l1": "main_shaft", "l2": "coupler", "l3": "rocker"},
        angle_near_rad={link: turn + math.pi / 2 for link in (["l3"] if tool is None else ["l3", "l4"])},
    )


def _stretched_rocker(crank: float, coupler: float, rocker: float, ground: float) -> float:
    """Compute the rocker's angle from the ground link with crank and coupler stretched [rad]."""
    reach = crank + coupler
    return math.pi - math.acos((rocker**2 + ground**2 - reach**2) / (2.0 * rocker * ground))
