"""Beat-up of a power loom by a crank-rocker on elliptic gears (Zhao, Ren and Chen 2011).

Gear 1 on the spindle O drives gear 2 about A. Crank AB is fixed on gear 2, with coupler BC, rocker CD about D, and sley
DE rigid with CD.
"""

from __future__ import annotations

import math
from typing import Unpack

from textile_twin_core.dynamics import Body
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import real
from textile_twin_core.machine.machine import Machine
from textile_twin_core.machine.sensors import Scene
from textile_twin_core.machines.sensor_parameters import SensorNumbers, numbers_of, sensors_of
from textile_twin_core.mechanism import Arc, Crank, EllipticGearPair, RigidArm, RRRDyad
from textile_twin_core.mechanism.python_numbers import with_python_numbers


@with_python_numbers
def elliptic_gear_beatup(
    *,
    half_axis_m: float = 0.071233,
    axis_ratio: float = 0.85,
    crank_m: float = 0.040,
    coupler_m: float = 0.100,
    rocker_m: float = 0.180,
    ground_m: float = 0.199,
    sley_m: float = 0.1895,
    past_largest_ratio_rad: float = math.radians(4.0),
    ground_angle_rad: float = math.radians(135.0),
    centre_line_rad: float = 0.0,
    sley_angle_rad: float = 0.0,
    pressure_angle_rad: float = math.radians(20.0),
    gear_1_kg: float | None = None,
    gear_2_kg: float | None = None,
    crank_kg: float | None = None,
    coupler_kg: float | None = None,
    rocker_kg: float | None = None,
    sley_kg: float | None = None,
    gear_1_kgm2: float | None = None,
    gear_2_kgm2: float | None = None,
    crank_kgm2: float | None = None,
    coupler_kgm2: float | None = None,
    rocker_kgm2: float | None = None,
    sley_kgm2: float | None = None,
    gravity_m_s2: float = 9.81,
    **sensors: Unpack[SensorNumbers],
) -> Machine:
    """Build the mechanism with the paper's lengths; torque, energy and reactions need every mass and inertia.

    At theta = 0 the sley is at the front, with crank and coupler stretched. Gear 1 is `past_largest_ratio_rad` past its
    largest ratio, and the crank turns towards AD. The paper prints 4 and 135 deg without symbols (driving ellipse to
    centre line, AD to the x axis). Here gear 1 is 4 deg past the largest ratio, not before, since only that gives the
    printed dwell. The direction of the centre line OA is not in the text: `centre_line_rad`.

    Args:
        half_axis_m, axis_ratio: major half axis of the gears [m], and minor over major.
        crank_m, coupler_m, rocker_m, ground_m, sley_m: lengths of the links [m].
        past_largest_ratio_rad, ground_angle_rad, centre_line_rad, sley_angle_rad, pressure_angle_rad: angles [rad].
        gear_1_kg, gear_2_kg, crank_kg, coupler_kg, rocker_kg, sley_kg: masses [kg].
        gear_1_kgm2, gear_2_kgm2, crank_kgm2, coupler_kgm2, rocker_kgm2, sley_kgm2: inertias [kg m^2].
        gravity_m_s2: acceleration of gravity [m/s^2].
        **sensors: numbers of the sensors, by parameter.

    Returns:
        The machine.

    Raises:
        MachineError: for lengths that do not close, and impossible numbers.

    Examples:
        >>> import textile_twin_core as ttc
        >>> ttc.machines.elliptic_gear_beatup().missing_for_torque[0]
        'gear_1_kg'

    References:
        Zhao, Ren and Chen 2011.
    """
    given = dict(locals())
    missing = tuple(name for name, value in given.items() if value is None)
    parameters = numbers_of(given)
    reach = 2.0 * half_axis_m
    axis = (reach * real.cos(centre_line_rad), reach * real.sin(centre_line_rad))
    foot = (axis[0] + ground_m * real.cos(ground_angle_rad), axis[1] + ground_m * real.sin(ground_angle_rad))
    gears = EllipticGearPair(
        "gear_1",
        "gear_2",
        at="O",
        driven_at="A",
        ends=("F", "G"),
        axis_ratio=axis_ratio,
        phase_rad=math.pi + past_largest_ratio_rad,
        pressure_angle_rad=pressure_angle_rad,
    )
    gear_2_in_front = centre_line_rad + math.pi - gears.driven_turn(gears.phase_rad)
    front = ground_angle_rad + stretched_angle(crank_m, coupler_m, rocker_m, ground_m)
    return Machine(
        name="elliptic_gear_beatup",
        nominal_speed_rad_s=300.0 * 2.0 * math.pi / 60.0,
        description="elliptic-gear crank-rocker beat-up of a power loom (Zhao, Ren and Chen 2011)",
        points={"O": (0.0, 0.0), "A": axis, "D": foot},
        groups=(
            gears,
            Crank("l1", at="A", end="B", length_m=crank_m, phase_rad=front - gear_2_in_front, driven_by="gear_2"),
            RRRDyad(
                "l2",
                "l3",
                from_point="B",
                ground="D",
                end="C",
                lengths_m=(coupler_m, rocker_m),
                branch="left",
            ),
            RigidArm("sley", on="l3", end="E", length_m=sley_m, angle_rad=sley_angle_rad),
        ),
        bodies=tuple(
            Body(link, given[f"{name}_kg"] or 0.0, given[f"{name}_kgm2"] or 0.0) for link, name in _BODY_NAMES.items()
        ),
        measures=(Arc("sley", link="sley", radius_m=sley_m, sense=-1),),
        gravity_m_s2=(0.0, -gravity_m_s2),
        sensors=sensors_of(sensors),
        joint_names={
            "gear_1": "main_shaft",
            "gear_2": "driven_gear",
            "l1": "crank",
            "l2": "coupler",
            "l3": "rocker",
        },
        scene=Scene(outputs=_SLEY) if missing else Scene(),
        missing_for_torque=missing,
        parameters=parameters,
    )


_SLEY = ("sley_position_m", "sley_velocity_m_s", "sley_acceleration_m_s2")

_BODY_NAMES = {
    "gear_1": "gear_1",
    "gear_2": "gear_2",
    "l1": "crank",
    "l2": "coupler",
    "l3": "rocker",
    "sley": "sley",
}


def stretched_angle(crank: float, coupler: float, rocker: float, ground: float) -> float:
    """Compute the angle at the crank's axis from the ground link to crank and coupler in one line [rad].

    Raises:
        MachineError: for lengths [m] that form no triangle.
    """
    reach = crank + coupler
    cosine = (reach**2 + ground**2 - rocker**2) / (2.0 * reach * ground)
    if not abs(cosine) <= 1.0:
        raise MachineError(
            f"machine 'elliptic_gear_beatup': stretched crank and coupler of {reach:g} m, rocker of {rocker:g} m "
            f"and ground of {ground:g} m form no triangle; change their lengths"
        )
    return real.acos(cosine)
