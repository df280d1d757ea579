"""Beat-up mechanism of a handmade carpet loom: a crank-rocker whose rocker carries the beater.

Crank DC on the main shaft D, coupler CB, rocker AB about A, and the beater arm AE rigid with the rocker (Topalbekiroglu
and Celik 2010); the design of beta = 48 deg at a crank rotation of 180 deg, scaled by 0.3 m.
"""

from __future__ import annotations

from typing import Unpack

from textile_twin_core.dynamics import Body
from textile_twin_core.expression import real
from textile_twin_core.machine.machine import Machine
from textile_twin_core.machines.sensor_parameters import SensorNumbers, numbers_of, sensors_of
from textile_twin_core.mechanism import Arc, Crank, RigidArm, RRRDyad
from textile_twin_core.mechanism.python_numbers import with_python_numbers


@with_python_numbers
def handloom_beatup(
    *,
    crank_m: float = 0.0597,
    coupler_m: float = 0.2007,
    rocker_m: float = 0.23082,
    ground_m: float = 0.3,
    arm_m: float = 0.3001,
    arm_angle_rad: float = 0.0,
    ground_angle_rad: float = 0.0,
    crank_kg: float = 0.129,
    coupler_kg: float = 0.434,
    rocker_kg: float = 0.0,
    arm_kg: float = 0.649,
    beater_kg: float = 2.5,
    crank_kgm2: float = 4.073e-5,
    coupler_kgm2: float = 0.0015,
    rocker_kgm2: float = 0.0,
    arm_kgm2: float = 0.0049,
    beater_kgm2: float = 0.0,
    gravity_m_s2: float = 9.81,
    **sensors: Unpack[SensorNumbers],
) -> Machine:
    """Build the beat-up mechanism, with masses and inertias as printed, for cast iron of 30 x 10 mm.

    The rocker AB is part of the bar AE (`arm_angle_rad` 0) and has no mass of its own. The printed crank inertia is
    that of a bar 15 mm wide; 30 mm gives 4.80e-5 kg m^2. The text does not give the orientation in the room:
    `ground_angle_rad` is the direction from the shaft D to the pivot A, and affects gravity only. The beater's position
    counts along its arc from the rear dead centre. Beat-up is at the front dead centre, with crank and coupler
    stretched.

    Args:
        crank_m, coupler_m, rocker_m, ground_m, arm_m: lengths of the links [m].
        arm_angle_rad, ground_angle_rad: angles of the arm and of the ground link [rad].
        crank_kg, coupler_kg, rocker_kg, arm_kg, beater_kg: masses [kg].
        crank_kgm2, coupler_kgm2, rocker_kgm2, arm_kgm2, beater_kgm2: inertias about the centroids [kg m^2].
        gravity_m_s2: acceleration of gravity [m/s^2].
        **sensors: numbers of the sensors, by parameter.

    Returns:
        The machine.

    Raises:
        MachineError: for lengths that do not close, and impossible numbers.

    Examples:
        >>> import textile_twin_core as ttc
        >>> ttc.machines.handloom_beatup().shown_outputs[-1]
        'beater_acceleration_m_s2'

    References:
        Topalbekiroglu and Celik 2010.
    """
    parameters = numbers_of(locals())
    pivot = (ground_m * real.cos(ground_angle_rad), ground_m * real.sin(ground_angle_rad))
    return Machine(
        name="handloom_beatup",
        nominal_speed_rad_s=15.5,
        description="beat-up mechanism of a handmade carpet loom (Topalbekiroglu and Celik 2010)",
        points={"D": (0.0, 0.0), "A": pivot},
        groups=(
            Crank("l1", at="D", end="C", length_m=crank_m),
            RRRDyad(
                "l2",
                "l3",
                from_point="C",
                ground="A",
                end="B",
                lengths_m=(coupler_m, rocker_m),
                branch="left",
            ),
            RigidArm("l4", on="l3", end="E", length_m=arm_m, angle_rad=arm_angle_rad),
        ),
        bodies=(
            Body("l1", crank_kg, crank_kgm2),
            Body("l2", coupler_kg, coupler_kgm2),
            Body("l3", rocker_kg, rocker_kgm2),
            Body("l4", arm_kg, arm_kgm2),
            Body("l4", beater_kg, beater_kgm2, centroid=(1.0, 0.0)),
        ),
        measures=(Arc("beater", link="l4", radius_m=arm_m, sense=-1),),
        gravity_m_s2=(0.0, -gravity_m_s2),
        sensors=sensors_of(sensors),
        joint_names={"l1": "main_shaft", "l2": "coupler", "l3": "rocker"},
        angle_near_rad={"l2": ground_angle_rad + 1.0, "l3": ground_angle_rad + 1.6, "l4": ground_angle_rad + 1.6},
        parameters=parameters,
    )
