"""Draws docs/reference/groups/*.png, a group each with its keys as names, and docs/gallery/*.png, an example each."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox
from PIL import Image

import textile_twin_core as ttc
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.views import paper
from textile_twin_core.views.machine_picture import plot_machine
from textile_twin_core.views.plot_linkage import draw_linkage
from textile_twin_core.views.scene import build_scene

ROOT = Path(__file__).resolve().parents[1]
GROUPS = ROOT / "docs" / "reference" / "groups"
GALLERY = ROOT / "docs" / "gallery"
_AXIS_RATIO = 0.85
_DPI = 200
CRANK = "{type: crank, name: crank, at: O, end: A, length_m: 0.06}"

DECLARATIONS: Mapping[str, tuple[str, float]] = {
    "crank": ("points: {at: [0, 0]}\ngroups: [{type: crank, name: crank, at: at, end: end, length_m: 0.06}]", 40.0),
    "rigid_arm": (
        "points: {at: [0, 0]}\ngroups:\n  - {type: crank, name: 'on', at: at, end: A, length_m: 0.06}\n"
        "  - {type: rigid_arm, name: arm, on: 'on', end: end, length_m: 0.05, angle_rad: 1.3}",
        45.0,
    ),
    "rrr_dyad": (
        f"points: {{O: [0, 0], ground: [0.3, 0]}}\ngroups:\n  - {CRANK.replace('end: A', 'end: from')}\n"
        "  - {type: rrr_dyad, coupler: coupler, rocker: rocker, from: from, ground: ground, end: end,"
        " lengths_m: [0.2, 0.23], branch: left}",
        60.0,
    ),
    "rrp_dyad": (
        f"points: {{O: [0, 0]}}\ngroups:\n  - {CRANK.replace('end: A', 'end: from')}\n"
        "  - {type: rrp_dyad, rod: rod, slider: slider, from: from, end: end, tip: tip, lengths_m: [0.2, 0.08],"
        " guide_point_m: [0, 0.02], guide_direction: [1, 0]}",
        60.0,
    ),
    "rpr_dyad": (
        f"points: {{O: [0, 0], pivot: [-0.15, 0]}}\ngroups:\n  - {CRANK.replace('end: A', 'end: from')}\n"
        "  - {type: rpr_dyad, slider: slider, lever: lever, from: from, pivot: pivot, end: end, tip: tip,"
        " lengths_m: [0.05, 0.28]}",
        70.0,
    ),
    "rpp_dyad": (
        f"points: {{O: [0, 0]}}\ngroups:\n  - {CRANK.replace('end: A', 'end: from')}\n"
        "  - {type: rpp_dyad, block: block, slider: slider, from: from, end: end, tips: [tip_1, tip_2],"
        " lengths_m: [0.05, 0.09], guide_point_m: [0, -0.04], guide_direction: [1, 0]}",
        50.0,
    ),
    "prp_dyad": (
        f"points: {{O: [0, 0]}}\ngroups:\n  - {CRANK}\n"
        "  - {type: prp_dyad, sliders: [slider_1, slider_2], end: end, tips: [tip_1, tip_2], lengths_m: [0.06, 0.1],"
        " guides: [{on: crank}, {point_m: [0.16, 0], direction: [-0.2, 1]}]}\nrange_rad: [-0.6, 0.6]",
        30.0,
    ),
    "gear_pair": (
        "points: {at: [0, 0], driven_at: [0.12, 0]}\ngroups:\n"
        "  - {type: crank, name: driver, at: at, end: A, length_m: 0.04}\n"
        "  - {type: gear_pair, driver: driver, driven: driven, at: at, driven_at: driven_at, end: end, length_m: 0.03,"
        " teeth: [40, 20]}",
        150.0,
    ),
    "elliptic_gear_pair": (
        "points: {at: [0, 0], driven_at: [0.142, 0]}\ngroups:\n"
        "  - {type: elliptic_gear_pair, driver: driver, driven: driven, at: at, driven_at: driven_at,"
        f" ends: [end_1, end_2], axis_ratio: {_AXIS_RATIO}}}",
        50.0,
    ),
    "cam_follower": (
        "points: {at: [0, 0], pivot: [0.15, 0.03]}\ngroups:\n"
        "  - {type: cam_follower, cam: cam, follower: follower, at: at, mark: mark, end: end, pivot: pivot,"
        " length_m: 0.12, base_radius_m: 0.06, roller_radius_m: 0.012,"
        " strokes: [{start_rad: 0.3, turn_rad: 1.2, to: 0.2}, {start_rad: 1.5, turn_rad: 1.5, to: 0, law: cycloidal}]}",
        60.0,
    ),
}
"""For each type of group a machine whose names are its keys, and the shaft angle of the drawing [deg]."""


def made(declaration: str) -> Machine:
    """Build the machine of a declaration."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "group.yaml"
        file.write_text(declaration)
        machine = ttc.load_machine(file)
    assert isinstance(machine, Machine)
    return machine


def draw_group(kind: str, path: Path) -> None:
    """Draw a group with its keys, and the direction in which the shaft's angle counts."""
    declaration, theta_deg = DECLARATIONS[kind]
    machine = made(declaration)
    figure = paper.new_figure(5.6, 3.8)
    axes = figure.add_axes((0.03, 0.06, 0.94, 0.82))
    scene = build_scene(machine)
    draw_linkage(axes, scene, machine, np.radians(theta_deg))
    axes.set_title(kind, loc="left", fontsize=13, color=paper.INK, pad=8)
    if kind == "elliptic_gear_pair":  # whose driver is declared against its smallest speed
        _ellipses(axes, machine, theta_deg)
    else:
        _angle(axes, next(iter(machine.points.values())), 0.08 * scene.size_m, theta_deg)
    used = figure.get_tightbbox()
    figure.savefig(path, dpi=_DPI, bbox_inches=Bbox([[0.0, used.y0 - 0.1], [figure.get_figwidth(), used.y1 + 0.1]]))


def _ellipses(axes: Axes, machine: Machine, theta_deg: float) -> None:
    """Draw the pitch curves of elliptic gears about their foci: the axis and the end of each link."""
    names = [f"point_{point}_{x}_m" for point in ("end_1", "end_2") for x in "xy"]
    place = ttc.compile(machine, names).evaluate(np.radians(theta_deg), 0.0)
    first, second = (np.array(machine.points[axis]) for axis in ("at", "driven_at"))
    long = float(np.linalg.norm(second - first))
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for axis, end in ((first, "end_1"), (second, "end_2")):
        other = np.array([float(place[f"point_{end}_{x}_m"]) for x in "xy"])
        along = (other - axis) / np.linalg.norm(other - axis)
        across = _AXIS_RATIO * np.array([-along[1], along[0]])
        curve = (axis + other) / 2.0 + long / 2.0 * (np.outer(np.cos(turn), along) + np.outer(np.sin(turn), across))
        axes.plot(*curve.T, color=paper.MUTED, linewidth=1.6, zorder=2)


def _angle(axes: Axes, at: tuple[float, float], radius: float, theta_deg: float) -> None:
    """Draw the shaft's angle, from +x counter-clockwise."""
    x, y = at
    end = np.radians(theta_deg)
    white = [withStroke(linewidth=3.0, foreground="white")]
    axes.plot([x, x + 1.7 * radius], [y, y], color=paper.MUTED, linewidth=0.9, linestyle=":", zorder=2)
    axes.add_patch(
        Arc(at, 2 * radius, 2 * radius, theta1=0.0, theta2=theta_deg, color=paper.MEASURED, linewidth=1.6, zorder=7)
    )
    tip = x + radius * np.cos(end), y + radius * np.sin(end)
    before = x + radius * np.cos(end - 0.25), y + radius * np.sin(end - 0.25)
    axes.annotate("", tip, before, arrowprops={"arrowstyle": "-|>", "color": paper.MEASURED}, zorder=7)
    style: dict[str, Any] = {
        "color": paper.MEASURED,
        "fontsize": 10,
        "ha": "left",
        "va": "center",
        "path_effects": white,
    }
    axes.text(x + 1.8 * radius, y, "theta", zorder=8, **style)


def examples() -> dict[str, AnyMachine]:
    """Return the machines of the gallery by the name of their picture."""
    machines: dict[str, AnyMachine] = {name: ttc.machines.create(name) for name in ttc.machines.NAMES}
    return machines | {file.stem: ttc.load_machine(file) for file in sorted((ROOT / "examples").glob("*.yaml"))}


def main() -> None:
    """Draw and write all."""
    GROUPS.mkdir(exist_ok=True)
    GALLERY.mkdir(exist_ok=True)
    for kind in DECLARATIONS:
        draw_group(kind, GROUPS / f"{kind}.png")
        shrink(GROUPS / f"{kind}.png")
    for name, machine in examples().items():
        shrink(plot_machine(GALLERY / f"{name}.png", machine))


def shrink(path: Path) -> None:
    """Reduce a picture to the width of a page and few colours."""
    with Image.open(path) as picture:
        small = picture.convert("RGB")
    small.thumbnail((1200, 750))
    # A median cut would give small areas, as of lines, the colours of their neighbours.
    small.quantize(128, Image.Quantize.FASTOCTREE).save(path, optimize=True)


if __name__ == "__main__":
    main()
