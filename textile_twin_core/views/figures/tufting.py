"""Figures 7 to 9 of Xu et al. 2016: motion, forces and balancing torque of the tufting machine's needle linkage."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machines import tufting
from textile_twin_core.papers.rows import at_angles
from textile_twin_core.papers.tufting import FIGURE_9_START_S, PRINTED_EVENTS, SPEED_RAD_S
from textile_twin_core.views.figures import style

_ANGLE = "angle of the main shaft [deg]"
_DEGREES = np.linspace(0.0, 360.0, 7201)
_HALF_DIGIT_S = 0.005
_COLOURS = {1: style.FAINT, 2: style.BLUE, 3: style.ORANGE, 4: style.GREEN, 5: style.PINK, 6: style.BROWN}


def figure_7() -> Figure:
    """Draw angles, speeds and accelerations of rods 2 to 5 (a-c) and of the slider (d-f), over a turn at 160 rpm."""
    made, panels = style.figure(
        2,
        3,
        (12.0, 6.2),
        "Tufting machine at 160 rpm: motion curves of the needle linkage  (Xu et al. 2016, Fig. 7)",
        "Shaded: the needle is in the backing.",
    )
    rods = {
        f"{what}_{k}_{unit}": k
        for what, unit in (("theta", "rad"), ("omega", "rad_s"), ("alpha", "rad_s2"))
        for k in (2, 3, 5)
    }
    slider = ("needle_position_m", "needle_velocity_m_s", "needle_acceleration_m_s2")
    r = _over_a_turn("theta_4_rad", *rods, *slider)
    for k in (2, 3, 4, 5):
        angle = np.degrees(r[f"theta_{k}_rad"])
        panels[0].plot(_DEGREES, angle, color=_COLOURS[k])
        text = f"$\\theta_{k}$   {angle.min():.1f} .. {angle.max():.1f}"
        panels[0].annotate(text, (180.0, angle.max() + 7.0), ha="center", va="bottom", color=_COLOURS[k], fontsize=8.5)
    panels[0].set_ylim(-30.0, 300.0)
    for axes, what, symbol, unit in (
        (panels[1], "omega", "\\omega", "rad_s"),
        (panels[2], "alpha", "\\alpha", "rad_s2"),
    ):
        names = {2: f"${symbol}_2$", 3: f"${symbol}_3 = {symbol}_4$", 5: f"${symbol}_5$"}
        style.curves(axes, _DEGREES, [(names[k], r[f"{what}_{k}_{unit}"], _COLOURS[k]) for k in names])
    style.panel(panels[0], "a", "angles of the rods", "deg")
    style.panel(panels[1], "b", "speeds", "rad/s")
    style.panel(panels[2], "c", "accelerations", "rad/s²")
    for axes, name, letter, what, unit, scale in (
        (panels[3], slider[0], "d", "slider, below the driven shaft", "mm", 1e3),
        (panels[4], slider[1], "e", "its speed, down", "m/s", 1.0),
        (panels[5], slider[2], "f", "its acceleration, down", "m/s²", 1.0),
    ):
        axes.plot(_DEGREES, r[name] * scale, color=_COLOURS[6])
        style.panel(axes, letter, what, unit)
        style.shaft_axis(axes, _ANGLE)
    panels[3].invert_yaxis()
    _shade(panels)
    return made


def figure_8() -> Figure:
    """Draw inertia forces and torques (a-c), forces in the joints (d-i) and the balancing torque (j), over a turn."""
    made, panels = style.figure(
        5,
        2,
        (12.0, 13.0),
        "Tufting machine at 160 rpm: force curves of the needle linkage  (Xu et al. 2016, Fig. 8)",
        "Shaded: the needle is in the backing, 1000 N of friction.  Of the panels the paper's text names j alone;"
        " a to i are what the text lists.",
    )
    letters = iter("abcdefghij")
    axes_of = iter(panels)

    def draw(what: str, unit: str, named: list[tuple[str, str, str]]) -> Axes:
        axes = next(axes_of)
        style.panel(axes, next(letters), what, unit)
        r = _over_a_turn(*(name for _, name, _ in named))
        style.curves(axes, _DEGREES, [(label, r[name], colour) for label, name, colour in named])
        return axes

    for axis in "xy":
        rods = range(1, 7)
        draw(
            f"inertia forces, {axis}",
            "N",
            [(f"$l_{k}$", f"inertia_force_{k}_{axis}_N", _COLOURS[k]) for k in rods],
        )
    draw("inertia torques", "N m", [(f"$l_{k}$", f"inertia_torque_{k}_Nm", _COLOURS[k]) for k in range(2, 6)])
    joints = {"O": "bearing O", "A": "joint A", "B": "joint B", "C": "bearing C", "D": "joint D"}
    for pin, what in joints.items():
        pair = [(axis, f"reaction_{pin}_{axis}_N", colour) for axis, colour in (("x", style.BLUE), ("y", style.ORANGE))]
        draw(f"force in {what}", "N", pair)
    last = [("x, and of the guide", "reaction_E_x_N", style.BLUE), ("y", "reaction_E_y_N", style.ORANGE)]
    draw("force in joint E", "N", last)
    draw("balancing torque", "N m", [("", "balancing_torque_Nm", style.INK)])
    for axes in panels[-2:]:
        style.shaft_axis(axes, _ANGLE)
    _shade(panels)
    return made


def figure_9() -> Figure:
    """Draw the balancing torque and the torque on the driven shaft over the turn of Fig. 9, from 14 s on."""
    made, panels = style.figure(
        2,
        1,
        (9.0, 6.4),
        "Tufting machine at 160 rpm: balancing torque  (Xu et al. 2016, Fig. 9)",
        "Computed: the trace that the paper measured is not published."
        "  Bands: the times that it prints, half a digit to either side.",
    )
    time = FIGURE_9_START_S + np.radians(_DEGREES) / SPEED_RAD_S
    r = _over_a_turn("balancing_torque_Nm", "driven_shaft_torque_Nm")
    for axes, name, what, colour in (
        (panels[0], "balancing_torque_Nm", "balancing torque, on the main shaft", style.INK),
        (panels[1], "driven_shaft_torque_Nm", "torque on the driven shaft", style.GREEN),
    ):
        axes.plot(time, r[name], color=colour)
        style.panel(axes, "", what, "N m")
        for _, _, seconds, _ in PRINTED_EVENTS:
            axes.axvspan(float(seconds) - _HALF_DIGIT_S, float(seconds) + _HALF_DIGIT_S, color=style.BAND, zorder=0)
    for quantity, degrees, seconds, _ in PRINTED_EVENTS:
        words = quantity.replace("the backing", "backing").replace("needle ", "")
        panels[0].annotate(
            f"{words}\n{degrees:g} deg, {seconds} s",
            (float(seconds) + 1.3 * _HALF_DIGIT_S, 0.97),
            xycoords=("data", "axes fraction"),
            va="top",
            fontsize=8.0,
            color=style.PRINTED,
        )
    panels[0].set_ylim(-2.0, 24.0)
    panels[1].set_xlabel("time [s]")
    panels[1].set_xlim(time[0], time[-1])
    return made


def _over_a_turn(*names: str) -> dict[str, FloatArray]:
    return at_angles(tufting(), names, SPEED_RAD_S, np.radians(_DEGREES))


def _shade(panels: list[Axes]) -> None:
    """Shade the angles at which the needle is in the backing."""
    angle = {event.name: math.degrees(event.angle_rad) for event in tufting().events()}
    for axes in panels:
        axes.axvspan(angle["needle_enters_backing"], angle["needle_leaves_backing"], color=style.BAND, zorder=0)
