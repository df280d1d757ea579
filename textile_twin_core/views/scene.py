"""Machine as moving solids, built from its declaration: bars, pins, guides, needle and backing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.loads import Backing, ForceCurve
from textile_twin_core.mechanism import GearPair, Travel
from textile_twin_core.mechanism.gear_pair import PitchCircle
from textile_twin_core.mechanism.joint import BASE
from textile_twin_core.twin import compile_machine
from textile_twin_core.views import palette
from textile_twin_core.views.solids import Solid, circle, extrude, join, rectangle, stadium

if TYPE_CHECKING:
    from textile_twin_core.machine.declaration import Link
    from textile_twin_core.machine.machine import Machine

_TURN = np.linspace(0.0, 2.0 * np.pi, 361)


@dataclass(frozen=True, slots=True, eq=False)
class MovingPart:
    """Solid in the frame of a link: origin at the start of the link, x along it, z towards the reader."""

    name: str
    start: str
    end: str
    length_m: float
    solid: Solid
    colour: palette.Colour
    layer_m: float
    outlines: tuple[FloatArray, ...] = ()
    """Outlines (n, 2) [m] of a cam and its conjugate cam, or pitch circles of gears, in the frame of the link."""
    is_cam: bool = False


@dataclass(frozen=True, slots=True)
class BackingPlane:
    """Surface of the backing: the line through `point_m` perpendicular to `direction`, in which the needle enters."""

    point_m: tuple[float, float]
    direction: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class MachineScene:
    """Geometry of a machine to draw, in its frame `base`: x right, y up, z towards the reader, metres.

    Attributes:
        moving: One part per link.
        fixed: Pins on the ground, and guides.
        backing: Surface that the needles pass through; None for a machine without one.
        paths: Path (k, 2) of each moving point over one turn, or over its declared part.
        fixed_points: Points of the ground.
        lower, upper: Corners of the box around every point over the turn.
    """

    moving: tuple[MovingPart, ...]
    fixed: Solid
    backing: BackingPlane | None
    paths: Mapping[str, FloatArray]
    fixed_points: Mapping[str, tuple[float, float]]
    lower: tuple[float, float]
    upper: tuple[float, float]

    @property
    def size_m(self) -> float:
        """Largest extent of the linkage over its turn."""
        return max(self.upper[0] - self.lower[0], self.upper[1] - self.lower[1])


class PointPositions:
    """Positions (n, 2) [m] of every point of a machine at shaft angles (n,) [rad]."""

    def __init__(self, machine: Machine) -> None:
        self._points = machine.point_names
        names = [f"point_{point}_{axis}_m" for point in self._points for axis in "xy"]
        self._twin = compile_machine(machine, outputs=names, method="exact")

    def __call__(self, theta_rad: FloatArray) -> dict[str, FloatArray]:
        """Return the positions by point."""
        zero = np.zeros_like(theta_rad)
        found = self._twin.evaluate(theta_rad, zero, zero)
        return {
            point: np.column_stack(
                [np.broadcast_to(found[f"point_{point}_{axis}_m"], theta_rad.shape) for axis in "xy"]
            )
            for point in self._points
        }


def poses(part: MovingPart, points: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return the pose of a part from the positions of its points: translations (n, 3) [m], angles about z (n,)
    [rad].
    """
    start, end = points[part.start], points[part.end]
    along = end - start
    place = np.column_stack([start, np.full(start.shape[0], part.layer_m)])
    return place, np.arctan2(along[:, 1], along[:, 0])


def build_scene(machine: Machine) -> MachineScene:
    """Build the scene of a machine from its links, joints, measures and loads."""
    paths = PointPositions(machine)(_TURN if machine.linkage.solved.turns_fully else machine.shaft_angles(_TURN.size))
    known = np.all([np.isfinite(path).all(axis=1) for path in paths.values()], axis=0)  # excludes dead points
    paths = {name: path[known] for name, path in paths.items()}
    corners = np.concatenate(list(paths.values()))
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = float(np.max(high - low))
    width = 0.04 * size
    longest = float(np.max([np.ptp(path) for path in paths.values()])) or 1.0
    meshes = [group.mesh for group in machine.groups if isinstance(group, GearPair)]
    fixed_points = {
        name: (float(path[0, 0]), float(path[0, 1]))
        for name, path in paths.items()
        if float(np.max(np.ptp(path, axis=0))) < 1e-9 * longest and name not in meshes
    }
    backing = _backing(machine, paths)
    sliding = {joint.child_link: joint for joint in machine.joints if joint.kind == "prismatic"}
    moving, grounds = [], []
    for number, link in enumerate(machine.links):
        outlines = _outlines(machine, link.name)
        is_cam = bool(outlines)
        length = float(np.hypot(*(paths[link.end][0] - paths[link.start][0])))
        colour = palette.LINKS[number % len(palette.LINKS)]
        if link.name in sliding:
            solid = _needle_bar(length, width, colour) if backing else _slider(length, width, colour)
            axis, parent = sliding[link.name].axis, sliding[link.name].parent_link
            if parent == BASE:
                grounds.append(_guide(paths[link.start], (float(axis[0]), float(axis[1])), width))
        else:
            gears = [circle(gear.radius) for gear in _gears(machine, link) if not gear.is_ring]
            solid = _cam(outlines, width, colour) if outlines else _bar(length, width, colour)
            solid = join([solid, _cam(tuple(gears), width, colour)]) if gears else solid
            outlines += tuple(circle(gear.radius, sides=90) for gear in _gears(machine, link))
        layer = 0.55 * width * number
        moving.append(MovingPart(link.name, link.start, link.end, length, solid, colour, layer, outlines, is_cam))
    depth = 0.55 * width * len(moving)
    grounds += [_bearing(point, width, depth) for point in fixed_points.values()]
    return MachineScene(
        moving=tuple(moving),
        fixed=join(grounds),
        backing=backing,
        paths={name: path for name, path in paths.items() if name not in fixed_points},
        fixed_points=fixed_points,
        lower=(float(low[0]), float(low[1])),
        upper=(float(high[0]), float(high[1])),
    )


def _gears(machine: Machine, link: Link) -> list[PitchCircle]:
    """Return the round gears about the start of a link that are fixed to it."""
    pairs = (group.pitch_circles(machine.linkage.solved) for group in machine.groups if isinstance(group, GearPair))
    return [gear for pair in pairs for gear in pair if gear.link == link.name and gear.centre == link.start]


def _outlines(machine: Machine, link: str) -> tuple[FloatArray, ...]:
    """Return the outlines (n, 2) [m] of the cams on a link, counter-clockwise; empty without full rotation."""
    found = []
    for ending in ("", "_second"):
        names = [f"outline_{link}{ending}_{axis}_m" for axis in "xy"]
        if machine.linkage.solved.turns_fully and set(names) <= set(machine.outputs):
            over = compile_machine(machine, outputs=names, method="exact").evaluate(_TURN[:-1], 0.0, 0.0)
            outline = np.column_stack([over[name] for name in names])
            x, y = outline.T
            found.append(outline if x @ np.roll(y, -1) > y @ np.roll(x, -1) else outline[::-1])
    return tuple(found)


def _backing(machine: Machine, paths: Mapping[str, FloatArray]) -> BackingPlane | None:
    measures = {measure.name: measure for measure in machine.measures}
    for load in machine.loads:
        travel, plane = None, 0.0
        if isinstance(load, Backing):
            travel, plane = measures.get(load.on), load.entry_plane_m
        elif isinstance(load, ForceCurve):
            travel, plane = measures.get(load.measure.removesuffix("_position_m")), load.knots[0]
        if isinstance(travel, Travel):
            direction = np.asarray(travel.direction) / np.hypot(*travel.direction)
            tip, origin = paths[travel.point][0], paths[travel.origin][0]
            x, y = tip + (plane - float((tip - origin) @ direction)) * direction
            return BackingPlane((float(x), float(y)), (float(direction[0]), float(direction[1])))
    return None


def _bar(length: float, width: float, colour: palette.Colour) -> Solid:
    """Build a bar with round ends and pins; a link hardly longer than it is wide becomes an eccentric disc."""
    thick = 0.42 * width
    pin = extrude(circle(0.22 * width), -0.5 * width, 0.75 * width, palette.DARK_STEEL)
    if length < 1.6 * width:
        disc = extrude(circle(length + 0.55 * width), -0.5 * thick, 0.5 * thick, colour)
        hub = extrude(circle(0.5 * width), -0.5 * thick, 0.9 * thick, palette.STEEL)
        return join([disc, hub, pin, pin.moved((length, 0.0, 0.0))])
    bar = extrude(stadium(length, 0.5 * width), -0.5 * thick, 0.5 * thick, colour)
    rib = extrude(
        rectangle(0.55 * width, length - 0.55 * width, -0.16 * width, 0.16 * width), 0.0, 0.75 * thick, colour
    )
    boss = extrude(circle(0.38 * width), -0.7 * thick, 0.8 * thick, palette.STEEL)
    return join([bar, rib, boss, boss.moved((length, 0.0, 0.0)), pin, pin.moved((length, 0.0, 0.0))])


def _cam(outlines: tuple[FloatArray, ...], width: float, colour: palette.Colour) -> Solid:
    """Build a plate with the outline of a cam on a hub, and behind it the conjugate cam."""
    thick = 0.42 * width
    plates = [
        extrude(outline, -(k + 0.5) * thick, (0.5 - k) * thick, colour, centre=(0.0, 0.0))
        for k, outline in enumerate(outlines)
    ]
    return join([*plates, extrude(circle(0.5 * width), -0.5 * thick, 0.9 * thick, palette.STEEL)])


def _slider(length: float, width: float, colour: palette.Colour) -> Solid:
    """Build a sliding block at the start, with a rod to the end where the link has a length."""
    block = extrude(
        rectangle(-0.8 * width, 0.8 * width, -0.55 * width, 0.55 * width), -0.4 * width, 0.4 * width, colour
    )
    if length < 0.1 * width:
        return block
    return join([block, extrude(rectangle(0.0, length, -0.2 * width, 0.2 * width), -0.2 * width, 0.2 * width, colour)])


def _needle_bar(length: float, width: float, colour: palette.Colour) -> Solid:
    """Build a sliding rod with a cross bar and a row of needles, their tips at the end of the link."""
    needle = min(0.24 * length, 3.2 * width)
    bar_from, bar_to = length - 1.45 * needle, length - needle
    half_row, count = 3.0 * width, 11
    rod = extrude(rectangle(0.0, bar_from, -0.26 * width, 0.26 * width), -0.26 * width, 0.26 * width, colour)
    block = extrude(rectangle(-0.7 * width, 0.9 * width, -0.5 * width, 0.5 * width), -0.4 * width, 0.4 * width, colour)
    cross = extrude(rectangle(bar_from, bar_to, -0.36 * width, 0.36 * width), -half_row, half_row, palette.STEEL)
    pin = extrude(circle(0.22 * width), -0.5 * width, 0.75 * width, palette.DARK_STEEL)
    shaft = extrude(circle(0.075 * width, sides=12), 0.0, 0.75 * needle, palette.NEEDLE)
    tip = extrude(circle(0.075 * width, sides=12), 0.75 * needle, needle, palette.NEEDLE, end_scale=0.08)
    # Needles are extruded along z, then turned along x of the link.
    needles = [
        solid.turned((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)).moved((bar_to, 0.0, z))
        for z in np.linspace(-0.9 * half_row, 0.9 * half_row, count)
        for solid in (shaft, tip)
    ]
    return join([rod, block, cross, pin, *needles])


def _guide(path: FloatArray, axis: tuple[float, float], width: float) -> Solid:
    """Build two rails beside the path of a slider."""
    along = np.asarray(axis)
    travel = path @ along
    across = np.array([-along[1], along[0]])
    reach = 1.2 * width
    origin = path[0] + along * (travel.min() - reach - travel[0])
    length = float(np.ptp(travel)) + 2.0 * reach
    rails = [
        extrude(
            rectangle(0.0, length, side - 0.16 * width, side + 0.16 * width), -0.45 * width, 3.4 * width, palette.GROUND
        )
        for side in (-0.85 * width, 0.85 * width)
    ]
    return join(
        [
            rail.turned((along[0], along[1], 0.0), (across[0], across[1], 0.0), (0.0, 0.0, 1.0)).moved(
                (origin[0], origin[1], 0.0)
            )
            for rail in rails
        ]
    )


def _bearing(point: tuple[float, float], width: float, depth: float) -> Solid:
    """Build a shaft through all layers on a bearing block behind them."""
    shaft = extrude(circle(0.24 * width), -1.1 * width, depth + 0.6 * width, palette.STEEL)
    block = extrude(circle(0.85 * width), -1.1 * width, -0.55 * width, palette.GROUND)
    foot = extrude(
        rectangle(-1.1 * width, 1.1 * width, -1.35 * width, -0.75 * width), -1.1 * width, -0.55 * width, palette.GROUND
    )
    return join([shaft, block, foot]).moved((point[0], point[1], 0.0))
