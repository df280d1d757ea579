"""Figures 6 to 9 of Pejchar and Beran 2011: the elements of the needle transfer, original and optimised design."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactRun
from textile_twin_core.machine import ContactMachine
from textile_twin_core.machines.needle_transfer import DESIGNS, PAD, needle_transfer
from textile_twin_core.papers.needle_transfer import (
    COLLETS_MEET_MS,
    LARGEST_DECELERATION_MS,
    NEEDLE_TRANSFER,
    PAD_REACHED_MS,
)
from textile_twin_core.views.figures import style

_END_S = 0.0265
_TIMES_S = np.linspace(0.0, _END_S, 10601)
_COLOURS = {"element_1": style.FAINT, "element_2": style.BLUE, "element_3": style.ORANGE}
_NOTE = "Law of motion of element 1: modified sine, 32.6 mm in 24.62 ms (a picture in print).  {}"


@dataclass(frozen=True)
class _Run:
    design: str
    machine: ContactMachine
    motion: ContactRun

    def of(self, what: str, element: str) -> FloatArray:
        """Return positions, velocities or accelerations of one element (times,)."""
        rows: FloatArray = getattr(self.motion, what)[self.motion.model.index[element]]
        return rows


def figure_6() -> Figure:
    """Draw the accelerations of the elements; impacts have no finite acceleration."""
    made, panels = _figure(6, "accelerations", "Rings: printed time of the largest acceleration of element 2.")
    for axes, run in zip(panels, _runs(), strict=True):
        _draw(axes, run, "accelerations")
        second = run.of("accelerations", "element_2")
        printed_ms = LARGEST_DECELERATION_MS[run.design]
        style.marked(axes, printed_ms, float(second.min()), f"{printed_ms:.2f} ms", (-8, 0), "right")
        _finish(axes, run, "m/s²")
    return made


def figure_7() -> Figure:
    """Draw the velocities of the elements."""
    made, panels = _figure(7, "velocities", "Dashed: printed time at which element 2 reaches the pad.")
    for axes, run in zip(panels, _runs(), strict=True):
        _draw(axes, run, "velocities")
        _printed(axes, PAD_REACHED_MS[run.design])
        _finish(axes, run, "m/s")
    return made


def figure_8() -> Figure:
    """Draw the positions of the elements and the face of the rubber pad."""
    made, panels = _figure(8, "positions", "Dashed: printed time at which element 2 reaches the pad.")
    for axes, run in zip(panels, _runs(), strict=True):
        _draw(axes, run, "positions", 1e3)
        face = next(pad.position_m for pad in run.machine.model.pads if pad.name == PAD) * 1e3
        axes.axhline(face, color=style.PRINTED, lw=0.9, ls=":")
        axes.annotate("face of the rubber pad", (0.3, face), (0, 3), textcoords="offset points", fontsize=8.0)
        _printed(axes, PAD_REACHED_MS[run.design])
        _finish(axes, run, "mm")
    return made


def figure_9() -> Figure:
    """Draw the positions of the points F and G, which meet when element 2 opens the collets."""
    made, panels = _figure(9, "points F and G", "Dashed: printed time at which elements 2 and 3 meet.")
    for axes, run in zip(panels, _runs(), strict=True):
        on_2 = run.of("positions", "element_2") + run.machine.parameters["value_d_m"]
        on_3 = run.of("positions", "element_3") + run.machine.parameters["value_a_m"]
        axes.plot(_TIMES_S * 1e3, on_2 * 1e3, color=style.BLUE, label="on element 2, $x_2 + D$")
        axes.plot(_TIMES_S * 1e3, on_3 * 1e3, color=style.ORANGE, label="on element 3, $x_3 + A$")
        _printed(axes, COLLETS_MEET_MS)
        _finish(axes, run, "mm")
    return made


def _runs() -> list[_Run]:
    machines = {design: needle_transfer(design=design) for design in DESIGNS}
    return [_Run(design, machine, machine.simulate(_END_S, _TIMES_S)) for design, machine in machines.items()]


def _draw(axes: Axes, run: _Run, what: str, scale: float = 1.0) -> None:
    """Draw a quantity of all elements, the faster ones below."""
    for depth, (element, colour) in enumerate(_COLOURS.items()):
        label = element.replace("_", " ")
        axes.plot(_TIMES_S * 1e3, run.of(what, element) * scale, color=colour, label=label, zorder=4 - depth)


def _figure(number: int, what: str, note: str) -> tuple[Figure, list[Axes]]:
    title = f"Needle transfer of a sewing machine: {what}  ({NEEDLE_TRANSFER}, Fig. {number})"
    return style.figure(2, 1, (9.0, 7.0), title, _NOTE.format(note), sharey=True)


def _finish(axes: Axes, run: _Run, unit: str) -> None:
    style.panel(axes, "", f"{run.design} design", unit)
    style.legend(axes, 3)
    axes.set_xlim(0.0, _END_S * 1e3)
    if run.design == DESIGNS[-1]:
        axes.set_xlabel("time [ms]")


def _printed(axes: Axes, milliseconds: float) -> None:
    axes.axvline(milliseconds, color=style.PRINTED, lw=0.9, ls=(0, (4, 3)))
    axes.annotate(
        f"{milliseconds:g} ms ",
        (milliseconds, 0.02),
        xycoords=("data", "axes fraction"),
        ha="right",
        fontsize=8.0,
        color=style.PRINTED,
    )
