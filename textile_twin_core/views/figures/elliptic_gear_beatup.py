"""Figure 4 of Zhao, Ren and Chen 2011: displacement, velocity and acceleration of the sley at 300 rpm."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from textile_twin_core.machines import elliptic_gear_beatup
from textile_twin_core.papers.beatup import DWELL_END_DEG, DWELL_START_DEG, SPINDLE_RAD_S
from textile_twin_core.papers.rows import at_angles
from textile_twin_core.views.figures import style

_DEGREES = np.linspace(0.0, 360.0, 7201)


def figure_4() -> Figure:
    """Draw the three curves over a turn of the spindle, with the printed dwell and the printed maxima."""
    made, panels = style.figure(
        3,
        1,
        (9.0, 8.0),
        "Elliptic-gear beat-up at 300 rpm: the sley  (Zhao, Ren and Chen 2011, Fig. 4)",
        "Along the arc of point E, from its rear point.  Shaded: the printed dwell, 92 to 285 deg."
        "  Rings: the printed largest values.",
    )
    names = ("sley_position_m", "sley_velocity_m_s", "sley_acceleration_m_s2")
    position, velocity, acceleration = at_angles(
        elliptic_gear_beatup(), names, SPINDLE_RAD_S, np.radians(_DEGREES)
    ).values()
    for axes, what, unit, values, colour in (
        (panels[0], "displacement", "mm", position * 1e3, style.BLUE),
        (panels[1], "velocity towards the fabric", "m/s", velocity, style.GREEN),
        (panels[2], "acceleration, away from the fabric", "m/s²", -acceleration, style.ORANGE),
    ):
        axes.plot(_DEGREES, values, color=colour)
        axes.axvspan(DWELL_START_DEG, DWELL_END_DEG, color=style.BAND, zorder=0)
        style.panel(axes, "", what, unit)
    style.marked(panels[0], 0.0, 85.0, "85 mm", (9, 2))
    style.marked(panels[2], 0.0, 615.8434, "615.8434 m/s²", (9, 2))
    style.shaft_axis(panels[2], "angle of the spindle [deg]")
    return made
