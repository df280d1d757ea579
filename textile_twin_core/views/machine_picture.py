"""A machine drawn before there is any recording: its linkage and its curves over the turn."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.twin import compile_machine
from textile_twin_core.views import paper
from textile_twin_core.views.plot_linkage import draw_linkage
from textile_twin_core.views.scene import build_scene

_SAMPLES = 1440
_LINES = ("#0072b2", "#e07b00", "#2a9d63", "#c2377a", "#6b4fa0", "#22272e")
_TORQUES = {
    "balancing_torque_Nm": "balancing",
    "torque_inertial_Nm": "inertia",
    "torque_gravity_Nm": "weight",
    "torque_load_Nm": "loads",
}
_MOST_CURVES = 4


def plot_machine(
    path: str | os.PathLike[str], machine: AnyMachine, *, rpm: float | None = None, at_deg: float | None = None
) -> Path:
    """Write a picture of a machine, 1600 x 1000 pixels: linkage, torque and its parts, motion of its measures.

    Args:
        path: The .png file to write.
        machine: A linkage, or a machine with a law of motion, which is shown by its curves alone.
        rpm: Speed of the shaft; the machine's nominal speed by default.
        at_deg: Shaft angle of the drawn linkage; by default the angle at which its links cover each other least.

    Returns:
        The path written.

    Raises:
        RecordingError: The file cannot be written there.
    """
    figure = _linkage_page(machine, rpm, at_deg) if isinstance(machine, Machine) else _law_page(machine, rpm)
    return paper.save_png(figure, path)


def _linkage_page(machine: Machine, rpm: float | None, at_deg: float | None) -> Figure:
    speed = machine.nominal_speed_rad_s if rpm is None else rpm * np.pi / 30.0
    curves: list[tuple[str, str, dict[str, str]]] = []
    if not machine.missing_for_torque:
        curves.append(("Shaft torque", "N m", _TORQUES))
        curves.append(("Equivalent inertia", "kg m²", {"equivalent_inertia_kgm2": "at the main shaft"}))
    for measure in machine.measures[:_MOST_CURVES]:
        for what, title, unit in (("position_m", "position", "mm"), ("acceleration_m_s2", "acceleration", "m/s²")):
            if f"{measure.name}_{what}" in machine.outputs and len(curves) < _MOST_CURVES:
                name = measure.name.replace("_", " ")
                curves.append((f"{name.capitalize()}: {title}", unit, {f"{measure.name}_{what}": name}))
    if not curves:
        names = {f"theta_{link.name}_rad": link.name for link in machine.links}
        curves.append(("Angles of the links", "deg", {k: v for k, v in names.items() if k in machine.outputs}))
    whole = machine.linkage.solved.turns_fully
    theta = np.linspace(0.0, 2.0 * np.pi, _SAMPLES + 1) if whole else machine.shaft_angles(_SAMPLES)
    low, high = np.rad2deg(machine.range_rad)
    said = "one turn" if whole else f"from {low:.4g}° to {high:.4g}°,"
    figure = _page(machine.name, machine.description, f"{said} at {speed * 30.0 / np.pi:.4g} rpm")
    rows = (len(curves) + 1) // 2
    grid = figure.add_gridspec(
        rows, 3, width_ratios=[0.9, 1.4, 1.4], left=0.025, right=0.978, top=0.885, bottom=0.07, wspace=0.17, hspace=0.27
    )
    at_rad = None if at_deg is None else np.deg2rad(at_deg)
    draw_linkage(figure.add_subplot(grid[:, 0]), build_scene(machine), machine, at_rad)
    wanted = [name for _, _, names in curves for name in names]
    found = compile_machine(machine, wanted).evaluate(theta, np.full_like(theta, speed), np.zeros_like(theta))
    for k, (title, unit, names) in enumerate(curves):
        wide = k == len(curves) - 1 and len(curves) % 2 == 1
        cell = grid[k // 2, 1:] if wide else grid[k // 2, 1 + k % 2]
        factor = {"mm": 1e3, "deg": 180.0 / np.pi}.get(unit, 1.0)
        _curves(figure.add_subplot(cell), title, unit, theta, {v: found[n] * factor for n, v in names.items()})
    for axes in figure.axes[1:]:
        for event in machine.events():
            axes.axvline(np.rad2deg(event.angle_rad), color=paper.GRID, linewidth=1.2, zorder=0)
    return figure


def _law_page(machine: AnyMachine, rpm: float | None) -> Figure:
    """Draw the motion outputs of a machine with a law of motion over one turn."""
    speed = machine.nominal_speed_rad_s if rpm is None else rpm * np.pi / 30.0
    time = np.linspace(0.0, 2.0 * np.pi / speed, _SAMPLES + 1)
    theta = speed * time
    outputs = list(machine.outputs)
    motions = ("position_m", "velocity_m_s", "acceleration_m_s2")
    wanted = {what: [name for name in outputs if name.endswith(what)] for what in motions}
    twin = compile_machine(machine, [name for names in wanted.values() for name in names])
    columns = (theta, np.full_like(theta, speed), np.zeros_like(theta))
    found = twin.evaluate(*columns, time=time)
    figure = _page(machine.name, machine.description, f"one turn at {speed * 30.0 / np.pi:.4g} rpm")
    grid = figure.add_gridspec(3, 1, left=0.06, right=0.978, top=0.885, bottom=0.07, hspace=0.35)
    for row, (what, names) in enumerate(wanted.items()):
        unit, factor = {"position_m": ("mm", 1e3), "velocity_m_s": ("m/s", 1.0)}.get(what, ("m/s²", 1.0))
        curves = {name.removesuffix(f"_{what}").replace("_", " "): found[name] * factor for name in names}
        _curves(figure.add_subplot(grid[row, 0]), what.split("_")[0].capitalize(), unit, theta, curves)
    return figure


def _page(name: str, description: str, motion: str) -> Figure:
    figure = paper.new_figure(16.0, 10.0)
    figure.text(0.025, 0.955, name, fontsize=19, weight="bold", color=paper.INK)
    said = f"{description}     " if description else ""
    figure.text(0.025, 0.922, f"{said}{motion}", fontsize=12.5, color=paper.MUTED)
    return figure


def _curves(axes: Axes, title: str, unit: str, theta: FloatArray, curves: dict[str, FloatArray]) -> None:
    for (name, values), colour in zip(curves.items(), _LINES, strict=False):
        axes.plot(np.rad2deg(theta), np.broadcast_to(values, theta.shape), color=colour, linewidth=1.6, label=name)
    if len(curves) > 1:
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, frameon=False, fontsize=9.5, borderaxespad=0.1,
            columnspacing=0.8, handlelength=0.9, handletextpad=0.4,
        )  # fmt: skip
    paper.dress(axes, f"{title}, {unit}")
    low, high = np.rad2deg(theta[[0, -1]])
    axes.set_xlim(low, high)
    if high - low > 359.0:
        axes.set_xticks(np.arange(0.0, 361.0, 45.0))
    axes.xaxis.set_major_formatter("{x:.4g}°")
