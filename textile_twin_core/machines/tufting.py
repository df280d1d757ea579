"""Tufting machine: the needle linkage of a carpet tufting machine DHGN801D-400 (Xu et al. 2016).

Crank l1, coupler l2, rocker l3 on the driven shaft C; arm l4 rigid with l3; connecting rod l5; needle bar l6.
"""

from __future__ import annotations

import math
from typing import Unpack

from textile_twin_core.dynamics import Backing, Body
from textile_twin_core.machine.machine import Machine
from textile_twin_core.machines.sensor_parameters import SensorNumbers, numbers_of, sensors_of
from textile_twin_core.mechanism import Crank, RigidArm, RRPDyad, RRRDyad, Travel
from textile_twin_core.mechanism.python_numbers import with_python_numbers


@with_python_numbers
def tufting(
    *,
    l1_m: float = 0.015,
    l2_m: float = 0.138,
    l3_m: float = 0.115,
    l4_m: float = 0.125,
    l5_m: float = 0.120,
    l6_m: float = 0.440,
    x1_m: float = 0.070,
    x2_m: float = 0.100,
    H1_m: float = 0.155,
    beta1_rad: float = math.radians(168.0),
    m1_kg: float = 3.07,
    m2_kg: float = 3.79,
    m3_kg: float = 2.96,
    m4_kg: float = 1.74,
    m5_kg: float = 0.36,
    m6_kg: float = 1.47,
    J1_kgm2: float = 4.34e-3,
    J2_kgm2: float = 26.99e-3,
    J3_kgm2: float = 10.77e-3,
    J4_kgm2: float = 6.69e-3,
    J5_kgm2: float = 0.91e-3,
    J6_kgm2: float = 19.15e-3,
    backing_force_N: float = 1000.0,
    free_force_N: float = 0.0,
    entry_plane_m: float = 0.55784,
    exit_plane_m: float = 0.55784,
    gravity_m_s2: float = 9.81,
    **sensors: Unpack[SensorNumbers],
) -> Machine:
    """Build the tufting machine, with lengths, masses and inertias of Xu et al. 2016, Table 1.

    The paper gives 1000 N of friction and the angles at which the needle enters (about 22 deg) and leaves (about 194
    deg). Both angles correspond to one plane of the backing 557.84 mm below the driven shaft: `entry_plane_m` and
    `exit_plane_m`. Eq. 9 and 14 are on the branches pi - asin and 2 pi - acos.

    Args:
        l1_m, l2_m, l3_m, l4_m, l5_m, l6_m: lengths of the links [m].
        x1_m, x2_m, H1_m: places of the driven shaft and of the guide [m].
        beta1_rad: angle between rocker and arm [rad].
        m1_kg, m2_kg, m3_kg, m4_kg, m5_kg, m6_kg: masses [kg].
        J1_kgm2, J2_kgm2, J3_kgm2, J4_kgm2, J5_kgm2, J6_kgm2: inertias about the centroids [kg m^2].
        backing_force_N, free_force_N: force on the needle in the backing and above it [N].
        entry_plane_m, exit_plane_m: planes of the backing below the driven shaft [m].
        gravity_m_s2: acceleration of gravity [m/s^2].
        **sensors: numbers of the sensors, by parameter.

    Returns:
        The machine.

    Raises:
        MachineError: for lengths that do not close, and impossible numbers.

    Examples:
        >>> import textile_twin_core as ttc
        >>> [round(event.angle_rad, 2) for event in ttc.machines.tufting().events()][:1]
        [0.38]

    References:
        Xu et al. 2016.
    """
    parameters = numbers_of(locals())
    centre = (x1_m, H1_m)
    return Machine(
        name="tufting",
        description="needle linkage of a carpet tufting machine (Xu et al. 2016)",
        points={"O": (0.0, 0.0), "C": centre},
        groups=(
            Crank("l1", at="O", end="A", length_m=l1_m),
            RRRDyad("l2", "l3", from_point="A", ground="C", end="B", lengths_m=(l2_m, l3_m), branch="left"),
            RigidArm("l4", on="l3", end="D", length_m=l4_m, angle_rad=beta1_rad - 2.0 * math.pi),
            RRPDyad(
                "l5",
                "l6",
                from_point="D",
                end="E",
                tip="F",
                lengths_m=(l5_m, l6_m),
                guide_point_m=(x1_m + x2_m, H1_m),
                guide_direction=(0.0, -1.0),
            ),
        ),
        bodies=(
            Body("l1", m1_kg, J1_kgm2),
            Body("l2", m2_kg, J2_kgm2),
            Body("l3", m3_kg, J3_kgm2),
            Body("l4", m4_kg, J4_kgm2),
            Body("l5", m5_kg, J5_kgm2),
            Body("l6", m6_kg, J6_kgm2),
        ),
        measures=(Travel("needle", point="F", origin="C", direction=(0.0, -1.0)),),
        loads=(Backing("needle", backing_force_N, entry_plane_m, exit_plane_m, free_force_N),),
        gravity_m_s2=(0.0, -gravity_m_s2),
        sensors=sensors_of(sensors),
        joint_names={"l1": "main_shaft", "l2": "coupler", "l3": "rocker", "l5": "rod", "l6": "needle_bar"},
        angle_near_rad={
            "l2": math.pi / 2,
            "l3": math.pi,
            "l4": 0.0,
            "l5": 3 * math.pi / 2,
            "l6": 3 * math.pi / 2,
        },
        nominal_speed_rad_s=160.0 * 2.0 * math.pi / 60.0,
        transmitted={"driven_shaft_torque_Nm": "l4"},
        parameters=parameters,
    )
