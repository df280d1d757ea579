"""Figures 6 and 7 of Topalbekiroglu and Celik 2010: motion and force of the beater, loads on the joints C and B."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine.machine import Machine
from textile_twin_core.machines import handloom_beatup
from textile_twin_core.papers.beatup import CRANK_RAD_S
from textile_twin_core.papers.rows import at_angles
from textile_twin_core.views.figures import style

_TURNS = 2
_DEGREES = np.linspace(0.0, 360.0 * _TURNS, 7201)
_ANGLE = "angle of the crank [deg]"


def figure_6() -> Figure:
    """Draw position, velocity and acceleration of the beater (a-c) and the force on it (d), over two turns."""
    made, panels = style.figure(
        2,
        2,
        (10.5, 6.2),
        "Beat-up of a handmade carpet loom at 15.5 rad/s: the beater  (Topalbekiroglu and Celik 2010, Fig. 6)",
        "Along the arc of the beater, from its rear point; dotted: beat-up, crank and coupler in one line.",
    )
    machine = handloom_beatup()
    mass = machine.parameters["beater_kg"]
    position, velocity, acceleration = _over_two_turns(
        "beater_position_m", "beater_velocity_m_s", "beater_acceleration_m_s2"
    )
    for axes, letter, what, unit, values, colour in (
        (panels[0], "a", "position", "mm", position * 1e3, style.BLUE),
        (panels[1], "b", "velocity towards the fabric", "m/s", velocity, style.GREEN),
        (panels[2], "c", "acceleration, away from the fabric", "m/s²", -acceleration, style.ORANGE),
        (panels[3], "d", "inertia force of the beater, towards the fabric", "N", -mass * acceleration, style.INK),
    ):
        axes.plot(_DEGREES, values, color=colour)
        style.panel(axes, letter, what, unit)
    for axes, level, text in ((panels[2], 25.0, "printed: 25 m/s²"), (panels[3], 60.0, "printed: over 60 N")):
        axes.axhline(level, color=style.PRINTED, lw=0.9, ls=(0, (4, 3)))
        axes.annotate(text, (235.0, level), (0, 3), textcoords="offset points", ha="center", fontsize=8.0)
    _mark_beat_up(panels)
    for axes in panels[2:]:
        style.shaft_axis(axes, _ANGLE, _TURNS)
    return made


def figure_7() -> Figure:
    """Draw the loads on the pins C and B over two turns, from inertia alone and with the weights of the links."""
    made, panels = style.figure(
        2,
        1,
        (10.5, 6.2),
        "Beat-up of a handmade carpet loom at 15.5 rad/s: loads on the joints  (Topalbekiroglu and Celik 2010, Fig. 7)",
        "The paper does not say how the mechanism stands.  Inertia alone gives the largest loads about beat-up,"
        " as it says.  Dotted: beat-up.",
        sharey=True,
    )
    for axes, pin in zip(panels, "CB", strict=True):
        names = (f"reaction_{pin}_x_N", f"reaction_{pin}_y_N")
        for machine, label, colour in (
            (handloom_beatup(), "with weights, D to A level", style.SKY),
            (handloom_beatup(gravity_m_s2=0.0), "inertia alone", style.INK),
        ):
            axes.plot(_DEGREES, np.hypot(*_over_two_turns(*names, machine=machine)), color=colour, label=label)
        style.panel(axes, "", f"load on joint {pin}", "N")
        style.legend(axes, 2)
    _mark_beat_up(panels)
    style.shaft_axis(panels[1], _ANGLE, _TURNS)
    return made


def _over_two_turns(*names: str, machine: Machine | None = None) -> list[FloatArray]:
    return list(at_angles(machine or handloom_beatup(), names, CRANK_RAD_S, np.radians(_DEGREES)).values())


def _mark_beat_up(panels: list[Axes]) -> None:
    (front,) = (event.angle_rad for event in handloom_beatup().events() if event.name == "beater_largest")
    for axes in panels:
        for turn in range(_TURNS):
            axes.axvline(math.degrees(front) + 360.0 * turn, color=style.PRINTED, lw=1.0, ls=":")
