"""Static scene of a recording: solids of the machine, colours of series and phases, grids of the plots over the
angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

import numpy as np
import rerun as rr

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.views import palette
from textile_twin_core.views.angle_canvas import TWO_PI, AngleCanvas, round_ticks, split_turns
from textile_twin_core.views.phases import PhaseRow
from textile_twin_core.views.scene import BackingPlane, MachineScene
from textile_twin_core.views.solids import Solid

_MIN_MAX = rr.components.AggregationPolicy.MinMax  # averaging would hide peaks of the torque

_CLOSE = 0.1
"""Largest distance of a path from a fixed point, over the machine's size, at which it would cross the point's label."""


def draw_machine(stream: rr.RecordingStream, scene: MachineScene, names: bool = True) -> None:
    """Draw the solids and the names of points, in the frame `world` (z up): `base` rolled by +90 degrees."""
    log = stream.log
    half = float(np.sqrt(0.5))
    log("world/base", rr.Transform3D(quaternion=rr.Quaternion(xyzw=[half, 0.0, 0.0, half])), static=True)
    log("world/base/fixed", mesh(scene.fixed), static=True)
    for part in scene.moving:
        log(f"world/base/links/{part.name}", mesh(part.solid), static=True)
    front = _depth_m(scene) + 0.02 * scene.size_m
    if names:
        _draw_names(stream, scene, front)
    log(
        "world/base/paths",
        rr.LineStrips3D(
            [np.column_stack([path, np.full(len(path), front)]) for path in scene.paths.values()],
            radii=[-0.8],
            colors=[palette.FRAME],
        ),
        static=True,
    )
    if scene.backing is not None:
        log("world/base/backing", _backing_weave(scene, scene.backing), static=True)


def _draw_names(stream: rr.RecordingStream, scene: MachineScene, front: float) -> None:
    """Draw the names of points, in front of all links."""
    log = stream.log
    for part in scene.moving:
        label = rr.Points3D(
            [[part.length_m, 0.0, front - part.layer_m]],
            radii=[0.0],
            labels=[part.end],
            colors=[palette.TEXT],
        )
        log(f"world/base/links/{part.name}/end", label, static=True)
    log(
        "world/base/pins",
        rr.Points3D(
            [[x, y - _label_drop_m(scene, x, y), front] for x, y in scene.fixed_points.values()],
            radii=[0.0],
            labels=list(scene.fixed_points),
            colors=[palette.TEXT],
        ),
        static=True,
    )


def _label_drop_m(scene: MachineScene, x: float, y: float) -> float:
    """Return the distance of a fixed point's label below it [m]; the label clears the points that turn close to it."""
    reaches = [float(np.max(np.hypot(path[:, 0] - x, path[:, 1] - y))) for path in scene.paths.values()]
    closely = max((reach for reach in reaches if reach < _CLOSE * scene.size_m), default=0.0)
    return closely + 0.05 * scene.size_m


def style_series(stream: rr.RecordingStream) -> None:
    """Set colours and names of the series over time."""
    log = stream.log
    log(
        "torque/measured",
        rr.SeriesLines(colors=[palette.MEASURED], names=["measured"], widths=[1.6], aggregation_policy=_MIN_MAX),
        static=True,
    )
    log(
        "torque/predicted",
        rr.Measurements.from_fields(
            colors=[palette.PREDICTED],
            names=["predicted ± sigma"],
            widths=[1.8],
            aggregation_policy=_MIN_MAX,
        ),
        static=True,
    )
    log(
        "residual/residual",
        rr.SeriesLines(colors=[palette.RESIDUAL], names=["residual"], widths=[1.4], aggregation_policy=_MIN_MAX),
        static=True,
    )
    log(
        "residual/over_limit",
        rr.SeriesPoints(colors=[palette.OVER_LIMIT], names=["over the limit"], markers=["circle"], marker_sizes=[3.0]),
        static=True,
    )
    for side in ("upper", "lower"):
        log(
            f"residual/limit_{side}",
            rr.SeriesLines(colors=[palette.LIMIT], names=[f"{side} limit"], widths=[1.0]),
            static=True,
        )


def style_measures(stream: rr.RecordingStream, names: Sequence[str]) -> None:
    """Set colours and names of the measures, over time and over the shaft angle, and of the shaft speed."""
    for name, colour in zip(names, cycle(palette.MEASURES)):
        style = rr.SeriesLines(colors=[colour], names=[name], widths=[1.8], aggregation_policy=_MIN_MAX)
        stream.log(f"travel/{name}", style, static=True)
        line = rr.LineStrips2D.from_fields(colors=[colour], radii=[-1.4], draw_order=1.0)
        stream.log(f"travel_angle/{name}", line, static=True)
        now = rr.Points2D.from_fields(colors=[palette.NOW], radii=[-5.0], draw_order=50.0)
        stream.log(f"travel_angle/now_{name}", now, static=True)
    speed = rr.SeriesLines(colors=[palette.STEEL], names=["shaft"], widths=[1.6], aggregation_policy=_MIN_MAX)
    stream.log("speed/shaft", speed, static=True)


def draw_curve(
    stream: rr.RecordingStream, entity: str, canvas: AngleCanvas, theta_rad: FloatArray, value: FloatArray
) -> None:
    """Draw a static curve over one turn (k,); `style_measures` sets its colour."""
    strips = split_turns(theta_rad, np.column_stack([theta_rad * (canvas.width / TWO_PI), canvas.y(value)]))
    stream.log(entity, rr.LineStrips2D.from_fields(strips=strips), static=True)


def style_angle_curves(stream: rr.RecordingStream) -> None:
    """Set colours of the curves over the shaft angle. The prediction is thin and on top, so that it covers nothing."""
    for name, colour, radius, order in (
        ("measured", palette.dim(palette.MEASURED, 0.6), -0.6, 0.0),
        ("last", palette.MEASURED, -2.0, 1.0),
        ("predicted", palette.PREDICTED, -1.1, 2.0),
    ):
        style = rr.LineStrips2D.from_fields(colors=[colour], radii=[radius], draw_order=order)
        stream.log(f"angle/{name}", style, static=True)
    now = rr.Points2D.from_fields(colors=[palette.NOW], radii=[-5.0], draw_order=50.0)
    stream.log("angle/now", now, static=True)


def style_phases(stream: rr.RecordingStream, phase_rows: Sequence[PhaseRow]) -> None:
    """Set the colours of the phases."""
    for row in phase_rows:
        stream.log(
            f"phase/{row.name}",
            rr.StateConfiguration(values=list(row.colours), colors=list(row.colours.values())),
            static=True,
        )


def draw_canvas(
    stream: rr.RecordingStream, origin: str, canvas: AngleCanvas, events: Sequence[tuple[str, float]], inside: BoolArray
) -> None:
    """Draw grid, scale and event lines of a plot over the shaft angle.

    Args:
        origin: Entity of the plot.
        canvas: Scale of the plot.
        events: Name and angle [rad] of each event to mark.
        inside: (k,) over one turn, true where the needle is in the backing; these angles are tinted.
    """
    log = stream.log
    width, height = canvas.width, canvas.height
    ticks = round_ticks(canvas.low, canvas.high, 6)
    levels = canvas.y(np.array(ticks))
    angles = np.arange(0.0, 361.0, 45.0)
    across = angles * (width / 360.0)
    log(
        f"{origin}/grid",
        rr.LineStrips2D(
            [[(0.0, y), (width, y)] for y in levels] + [[(x, 0.0), (x, height)] for x in across],
            radii=[-0.5],
            colors=[palette.FRAME if tick == 0.0 else palette.GRID for tick in ticks] + [palette.GRID] * len(across),
            draw_order=-20.0,
        ),
        static=True,
    )
    if inside.any():
        # A 2D view has no filled shapes and its lines have round ends, so the tint is a comb of fine lines.
        comb = np.arange(0.0, width, 2.0)
        comb = comb[inside[(comb * (inside.size / width)).astype(np.int64)]]
        log(
            f"{origin}/in_backing",
            rr.LineStrips2D(
                [[(x, 1.0), (x, height - 1.0)] for x in comb],
                radii=[1.0],
                colors=[palette.dim(palette.IN_BACKING, 0.16)],
                draw_order=-30.0,
            ),
            static=True,
        )
    shown = across[::2]
    log(
        f"{origin}/scale",
        rr.Points2D(
            [(x, 1.055 * height) for x in shown] + [(-0.045 * width, y) for y in levels],
            radii=[0.0],
            labels=[f"{angle:.0f}°" for angle in angles[::2]] + [f"{tick + 0.0:g}" for tick in ticks],
            colors=[palette.TEXT],
        ),
        static=True,
    )
    if events:
        places = canvas.x(np.array([angle for _, angle in events]))
        log(
            f"{origin}/events",
            rr.LineStrips2D(
                [[(x, 0.0), (x, height)] for x in places],
                radii=[-0.9],
                colors=[palette.IN_BACKING],
                draw_order=-10.0,
            ),
            static=True,
        )
        log(
            f"{origin}/event_names",
            rr.Points2D(
                [(x, -0.055 * height) for x in places],
                radii=[0.0],
                labels=[f"{name} {np.rad2deg(angle):.1f}°" for name, angle in events],
                colors=[palette.TEXT],
            ),
            static=True,
        )


def _depth_m(scene: MachineScene) -> float:
    return max(part.layer_m for part in scene.moving)


def _backing_weave(scene: MachineScene, plane: BackingPlane) -> rr.LineStrips3D:
    """Return the backing as warp and weft, so that the needles stay visible above and below it."""
    size = scene.size_m
    (dx, dy), (x, y), depth = plane.direction, plane.point_m, _depth_m(scene)
    across = np.array([-dy, dx, 0.0])
    centre = np.array([x, y, depth])
    inward = np.array([0.0, 0.0, 1.0])
    wide, deep = 0.16 * size, 0.14 * size
    warp = [
        [centre + u * across - deep * inward, centre + u * across + deep * inward] for u in np.linspace(-wide, wide, 33)
    ]
    weft = [
        [centre - wide * across + v * inward, centre + wide * across + v * inward] for v in np.linspace(-deep, deep, 29)
    ]
    return rr.LineStrips3D([*warp, *weft], radii=[0.0011 * size], colors=[palette.IN_BACKING])


def mesh(solid: Solid) -> rr.Mesh3D:
    """Convert a solid to the viewer's mesh."""
    return rr.Mesh3D(
        vertex_positions=solid.vertices,
        vertex_normals=solid.normals,
        vertex_colors=solid.colours,
        triangle_indices=solid.triangles,
    )
