"""The angle of a link as a continuous (unwrapped) function of the shaft angle."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.expression import Expr, atan2, interpret
from textile_twin_core.expression.loop import Loop
from textile_twin_core.mechanism.group import MAIN_SHAFT
from textile_twin_core.mechanism.linkage import THETA
from textile_twin_core.mechanism.motion import LinkMotion, Motion
from textile_twin_core.mechanism.vector import Vector

_SAMPLES = 721


def full_turns(angle: Expr, motion: Motion) -> int:
    """Count the turns that an angle makes per revolution of the main shaft; 0 if the motion covers no full turn."""
    if not motion.turns_fully:
        return 0
    begin, end = (interpret([angle], {"theta": theta}, math)[0] for theta in motion.range_rad)
    return round(float(end - begin) / (motion.range_rad[1] - motion.range_rad[0]))


def link_angle(link: LinkMotion, motion: Motion, near_rad: float = 0.0) -> Expr:
    """Express the angle of a link from +x, counter-clockwise, as a function of theta [rad].

    The angle of a swinging link is continuous; the middle of its range lies within half a turn of `near_rad`. The angle
    of a link that turns with the shaft grows from turn to turn.
    """
    if link.angle is not None:
        return link.angle
    shaft_direction = motion.rotations[MAIN_SHAFT].direction
    phase: float = math.atan2(*interpret([shaft_direction.y, shaft_direction.x], {"theta": 0.0}, math))
    theta = np.linspace(*motion.range_rad, _SAMPLES)
    x, y = np.empty_like(theta), np.empty_like(theta)
    Loop([link.direction.x, link.direction.y], ["theta"])([theta], [x, y])
    sampled = np.unwrap(np.arctan2(y, x))
    turns: int = round((sampled[-1] - sampled[0]) / (theta[-1] - theta[0])) if motion.turns_fully else 0
    periodic = sampled - turns * (theta + phase)
    middle = float(periodic.min() + periodic.max()) / 2.0
    middle += 2.0 * math.pi * round((near_rad - middle) / (2.0 * math.pi))
    direction = link.direction
    for _ in range(abs(turns)):
        s = shaft_direction if turns > 0 else Vector(shaft_direction.x, -shaft_direction.y)
        direction = Vector(s.dot(direction), s.cross(direction))
    reference = Vector.of(math.cos(middle), math.sin(middle))
    swing = atan2(reference.cross(direction), reference.dot(direction))
    wound: Expr = turns * THETA
    return swing + (middle + turns * phase) + wound
