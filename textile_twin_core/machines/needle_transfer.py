"""Needle transfer of a sewing machine for an imitated hand stitch (Pejchar and Beran 2011), as a contact model.

Element 1, the jacket of the needle bar, is driven by the shaft. Element 2, which opens the collets, and element 3, the
collets, are mounted on springs and dampers between one-sided stops. Before the dead centre element 2 strikes a rubber
pad on the frame while the jacket continues.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import cast

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import FRAME, Pad, SlidingBody, SpringDamper, Stop
from textile_twin_core.errors import MachineError
from textile_twin_core.machine.contact_machine import ContactMachine, DrivenElement
from textile_twin_core.mechanism.law_strokes import LawName, Stroke, law_of_strokes
from textile_twin_core.mechanism.law_table import from_function, from_table
from textile_twin_core.mechanism.motion_law import TURN, MotionLaw
from textile_twin_core.mechanism.python_numbers import with_python_numbers

DESIGNS = ("original", "optimised")
ELEMENTS = ("element_1", "element_2", "element_3")
PIN, CONE, PAD, COLLETS = "pin", "cone", "rubber_pad", "collet_contact"

_START_2_M: Mapping[str, float] = {"original": 0.0719, "optimised": 0.0669}
_MILLI = 1e3


@with_python_numbers
def needle_transfer(
    *,
    design: str = "original",
    motion_law: str | MotionLaw | Callable[[float], float] | tuple[FloatArray, FloatArray] = "modified_sine",
    stroke_m: float = 0.0326,
    forward_duration_s: float = 0.024623,
    return_duration_s: float | None = None,
    return_start_rad: float = math.pi,
    cycles_per_minute: float = 250.0,
    pad_position_m: float = 0.0949,
    pad_linear_N_mm: float = 445.17,
    pad_quadratic_N_mm2: float = -2e-10,
    pad_cubic_N_mm3: float = 1573.9,
    pad_damping_Ns_m: float = 28.5,
    pad_pulls: bool = True,
    element_1_kg: float = 0.1196,
    element_2_kg: float = 0.0426,
    element_3_kg: float = 0.0051,
    spring_1_N_m: float = 900.0,
    spring_1_Ns_m: float = 13.16,
    spring_1_free_m: float = 0.089,
    spring_2_N_m: float = 690.0,
    spring_2_Ns_m: float = 3.32,
    spring_2_free_m: float = 0.0292,
    value_a_m: float = 0.0268,
    value_d_m: float = 0.0547,
    value_e_m: float = 0.0081,
    element_2_start_m: float | None = None,
    element_3_start_m: float = 0.0929,
    pin_restitution: float = 0.0,
    cone_restitution: float = 0.0,
    collet_restitution: float = 0.6,
) -> ContactMachine:
    """Build the mechanism with the paper's Tables 1 to 3, in its "original" or "optimised" `design`.

    In the optimised design element 2 starts 5 mm further back. Details that the paper does not determine are
    parameters:

    - The law of motion of element 1 is given as a picture (Fig. 4). `motion_law` is "modified_sine", "cycloidal", a
      `MotionLaw`, a function of the shaft angle [rad] that returns x_1 [m], or a table of both over a turn. With the
      named laws the jacket moves forward by `stroke_m` from theta = 0, dwells, returns by the same law from
      `return_start_rad`, and dwells. The stroke 32.6 mm and 250 cycles/min are printed. The duration of the forward
      motion is not: 24.623 ms (24.62 in round figures) is fitted so that pad, largest deceleration and contact of 2 and
      3 occur at the printed times. The return mirrors the forward motion, half a cycle later.
    - The pad begins at 0.0949 m in Eq. 5, 9 and 13, and at 0.0989 m in Eq. 17 and 18. With 0.0949 m the printed stroke
      fits, one contact time serves both designs as printed, and only the original leaves its pin. With 0.0989 m a
      cycloidal 34.84 mm in 23.38 ms comes as near to the times.
    - Eq. 1 gives newtons for a compression in millimetres; in metres the pad would be softer than the springs.
    - In Eq. 13 and 18 spring and damper of the pad act wherever element 2 is past its face. The pad therefore pulls for
      0.1 ms when the element leaves, which the printed contact time needs (`pad_pulls`). Without that pull element 2
      returns faster and meets element 3 at 19.07 ms instead of 19.24 ms.
    - Boundary conditions 15, 16, 19 and 20 are one-sided stops: pin, x_2 - x_1 at most its start; cone, x_3 - x_1 at
      most its start (relative to x_2, as in Eq. 16, F and G could never meet); collets F-G, x_3 - x_2 at most D - A.
      Pin and cone transmit the jacket's motion, as in 15 and 16 (restitution 0). F-G bounces with 0.6.

    Args:
        design: "original" or "optimised".
        motion_law: law of motion of element 1, as above.
        stroke_m: its stroke [m].
        forward_duration_s, return_duration_s: durations of its motions [s].
        return_start_rad: shaft angle at which it returns [rad].
        cycles_per_minute: speed for which durations are given.
        pad_position_m: face of the pad [m].
        pad_linear_N_mm, pad_quadratic_N_mm2, pad_cubic_N_mm3: stiffness of the pad [N/mm, N/mm^2, N/mm^3].
        pad_damping_Ns_m: its damping [N s/m].
        pad_pulls: whether the pad may pull.
        element_1_kg, element_2_kg, element_3_kg: masses [kg].
        spring_1_N_m, spring_2_N_m: stiffness of the springs [N/m].
        spring_1_Ns_m, spring_2_Ns_m: their damping [N s/m].
        spring_1_free_m, spring_2_free_m: their free lengths [m].
        value_a_m, value_d_m, value_e_m: distances A, D and E of the paper [m].
        element_2_start_m, element_3_start_m: positions at the shaft angle 0 [m].
        pin_restitution, cone_restitution, collet_restitution: of the stops; 0 sticks, 1 loses nothing.

    Returns:
        The machine.

    Raises:
        MachineError: for an unknown design or law, a motion that does not fit into a turn, or masses too light for
            their springs and dampers to be integrated.
        ContactError: for bad masses, stiffnesses or restitutions, or a start beyond a stop.

    Examples:
        >>> import textile_twin_core as ttc
        >>> ttc.machines.needle_transfer(design="optimised").elements
        ('element_1', 'element_2', 'element_3')

    References:
        Pejchar and Beran 2011.
    """
    if design not in DESIGNS:
        raise MachineError(f"needle_transfer: design is {design!r}; there are {' and '.join(DESIGNS)}")
    if not cycles_per_minute > 0.0:
        raise MachineError(f"needle_transfer: cycles_per_minute is {cycles_per_minute!r}; give a positive number")
    given = {name: value for name, value in locals().items() if isinstance(value, (int, float))}
    speed = TURN * cycles_per_minute / 60.0
    back = forward_duration_s if return_duration_s is None else return_duration_s
    start_2 = _START_2_M[design] if element_2_start_m is None else element_2_start_m
    given |= {"return_duration_s": back, "element_2_start_m": start_2}
    return ContactMachine(
        name="needle_transfer",
        driven=DrivenElement(
            "element_1",
            law=_law(motion_law, stroke_m, forward_duration_s * speed, return_start_rad, back * speed),
            mass_kg=element_1_kg,
        ),
        bodies=(SlidingBody("element_2", element_2_kg), SlidingBody("element_3", element_3_kg)),
        springs=(
            SpringDamper("spring_1", "element_1", "element_2", spring_1_N_m, spring_1_Ns_m, spring_1_free_m),
            SpringDamper(
                "spring_2", "element_2", "element_3", spring_2_N_m, spring_2_Ns_m, spring_2_free_m + value_e_m
            ),
        ),
        stops=(
            Stop(PIN, "element_1", "element_2", start_2, pin_restitution),
            Stop(CONE, "element_1", "element_3", element_3_start_m, cone_restitution),
            Stop(COLLETS, "element_2", "element_3", value_d_m - value_a_m, collet_restitution),
        ),
        pads=(
            Pad(
                PAD,
                FRAME,
                "element_2",
                pad_position_m,
                (pad_linear_N_mm * _MILLI, pad_quadratic_N_mm2 * _MILLI**2, pad_cubic_N_mm3 * _MILLI**3),
                pad_damping_Ns_m,
                pad_pulls,
            ),
        ),
        start_m={"element_2": start_2, "element_3": element_3_start_m},
        axis=(0.0, -1.0),
        nominal_speed_rad_s=speed,
        parameters={name: float(value) for name, value in given.items()},
        choices={"design": design},
        description="needle transfer of a sewing machine (Pejchar and Beran 2011)",
    )


def _law(
    motion_law: str | MotionLaw | Callable[[float], float] | tuple[FloatArray, FloatArray],
    stroke_m: float,
    forward_rad: float,
    return_start_rad: float,
    return_rad: float,
) -> MotionLaw:
    if isinstance(motion_law, MotionLaw):
        return motion_law
    if isinstance(motion_law, str):
        there = Stroke(0.0, forward_rad, stroke_m, cast(LawName, motion_law))
        return law_of_strokes((there, Stroke(return_start_rad, return_rad, 0.0, there.law)), motion_law)
    if callable(motion_law):
        return from_function(motion_law)
    return from_table(*motion_law)
