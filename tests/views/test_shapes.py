"""Solids, scene, canvas and phases against plain geometry."""

from __future__ import annotations

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray
from textile_twin_core.mechanism import CamFollower, Crank, RRRDyad
from textile_twin_core.mechanism.cam_follower import SecondRoller
from textile_twin_core.mechanism.law_strokes import Stroke
from textile_twin_core.views.angle_canvas import AngleCanvas, canvas_for, round_ticks, split_turns
from textile_twin_core.views.phases import (
    Direction,
    PhaseRow,
    StateChanges,
    inside_backing,
    phase_rows_of,
    state_changes,
)
from textile_twin_core.views.scene import build_scene, poses
from textile_twin_core.views.solids import Solid, circle, extrude, rectangle, stadium


def volume(solid: Solid) -> float:
    """Compute the volume by the divergence theorem: positive only when every triangle faces outwards."""
    a, b, c = (solid.vertices[solid.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def _changes(row: PhaseRow, time_s: FloatArray, theta_rad: FloatArray) -> StateChanges:
    return state_changes(row, time_s, theta_rad, Direction().take(theta_rad))


def test_solids_are_closed_and_look_outwards() -> None:
    colour = (1, 2, 3)
    assert volume(extrude(rectangle(0, 2, 0, 3), -1, 4, colour)) == pytest.approx(30.0)
    bar = extrude(stadium(2.0, 0.5, sides=200), 0.0, 1.0, colour)
    assert volume(bar) == pytest.approx(2.0 + np.pi * 0.25, rel=1e-4)
    cone = extrude(circle(1.0, sides=400), 0.0, 3.0, colour, end_scale=1e-9)
    assert volume(cone) == pytest.approx(np.pi, rel=1e-3)
    boomerang = [(2.0, 0.0), (0.0, 2.0), (-1.0, -1.0), (0.0, -0.5)]  # visible whole from (0, 0)
    assert volume(extrude(boomerang, 0.0, 3.0, colour, centre=(0.0, 0.0))) == pytest.approx(3.0 * 3.75)
    turned = bar.turned((0, 1, 0), (0, 0, 1), (1, 0, 0)).moved((5.0, -7.0, 2.0))
    assert volume(turned) == pytest.approx(volume(bar))


def test_scene_of_the_tufting_machine() -> None:
    scene = build_scene(ttc.machines.tufting())
    assert [part.name for part in scene.moving] == ["l1", "l2", "l3", "l4", "l5", "l6"]
    assert set(scene.fixed_points) == {"O", "C"}
    lengths = {part.name: part.length_m for part in scene.moving}
    assert lengths == pytest.approx({"l1": 0.015, "l2": 0.138, "l3": 0.115, "l4": 0.125, "l5": 0.12, "l6": 0.44})
    assert scene.backing is not None
    # 557.84 mm below C, on the needle's own line.
    assert scene.backing.point_m == pytest.approx((0.170, 0.155 - 0.55784))
    assert scene.backing.direction == pytest.approx((0.0, -1.0))
    assert np.ptp(scene.paths["F"][:, 1]) == pytest.approx(0.0327884, abs=1e-5)


def test_canvas_puts_large_values_up_and_angles_within_a_turn() -> None:
    canvas = AngleCanvas(low=-1.0, high=3.0, width=360.0, height=400.0)
    place = canvas.place(np.deg2rad(np.array([0.0, 90.0, 450.0, -90.0])), np.array([3.0, -1.0, 0.0, 1.0]))
    np.testing.assert_allclose(place, [[0, 0], [90, 400], [90, 300], [270, 200]], atol=1e-9)
    wide = canvas_for([np.array([np.nan, 2.0, -0.5]), np.array([9.0])], 10.0, 10.0)
    assert wide.low < -0.5 < 9.0 < wide.high
    assert round_ticks(-0.6, 17.4, 6) == [0.0, 5.0, 10.0, 15.0]
    assert round_ticks(-0.031, 0.012, 4) == pytest.approx([-0.02, 0.0])


def test_lines_are_split_at_full_turns_and_gaps() -> None:
    theta = np.array([6.0, 6.2, 6.4, 6.6, 6.8, 7.0])
    points = np.column_stack([theta, theta])
    points[4] = np.nan
    assert [strip[:, 0].tolist() for strip in split_turns(theta, points)] == [[6.0, 6.2], [6.4, 6.6]]


def test_phases_follow_the_shaft_forwards_and_backwards() -> None:
    events = ttc.machines.tufting().events()
    phase_rows = {row.name: row for row in phase_rows_of(events)}
    assert set(phase_rows) == {"needle_backing", "needle_stroke"}
    time = np.linspace(0.0, 2.0, 801)
    forward = _changes(phase_rows["needle_backing"], time, 2 * np.pi * time)
    assert forward.states == ("free", "in backing", "free", "in backing", "free")
    entry, leave = 0.38312100023839724 / (2 * np.pi), 3.3846508836082833 / (2 * np.pi)
    np.testing.assert_allclose(forward.time_s, [0.0, entry, leave, 1 + entry, 1 + leave], atol=1e-9)
    backward = _changes(phase_rows["needle_backing"], time, -2 * np.pi * time)
    assert backward.states == ("free", "in backing", "free", "in backing", "free")
    np.testing.assert_allclose(backward.time_s, [0.0, 1 - leave, 1 - entry, 2 - leave, 2 - entry], atol=1e-9)
    # The needle moves forward from its rear to its front point in either direction of rotation.
    turns = [event.angle_rad / (2 * np.pi) for event in events if event.name.endswith(("_largest", "_smallest"))]
    for sign, expected in ((1, ("forward", "back") * 2 + ("forward",)), (-1, ("back", "forward") * 2 + ("back",))):
        stroke = _changes(phase_rows["needle_stroke"], time, sign * 2 * np.pi * time)
        states = [state for state, when in zip(stroke.states, stroke.time_s, strict=True) if when == 0.0 or when > 0.01]
        assert tuple(states)[-4:] == expected[-4:]
        ends = sorted((sign * turn) % 1.0 + k for turn in turns for k in (0, 1))
        np.testing.assert_allclose(stroke.time_s[-4:], ends, atol=1e-9)
    inside = inside_backing(list(phase_rows.values()))
    assert inside.mean() == pytest.approx(leave - entry, abs=2 / 720)


@pytest.mark.parametrize("name", [name for name in ttc.machines.NAMES if name != "needle_transfer"])
def test_every_linkage_has_a_scene(name: str) -> None:
    machine = ttc.machines.create(name)
    scene = build_scene(machine)
    assert [part.name for part in scene.moving] == [link.name for link in machine.links]
    assert scene.fixed_points
    for part in scene.moving:
        assert volume(part.solid) > 0.0
        assert np.isfinite(part.solid.vertices).all()


def test_a_part_of_the_turn_has_a_scene_of_its_own() -> None:
    """Restrict the range to where the linkage closes: A moves about O and B about C within the crank's range."""
    groups = (Crank("l1", "O", "A", 0.12), RRRDyad("l2", "l3", "A", "C", "B", (0.05, 0.11), branch="right"))
    machine = ttc.Machine("part", {"O": (0.0, 0.0), "C": (0.1, 0.0)}, groups, range_rad=(0.6, 1.5))
    scene = build_scene(machine)
    assert set(scene.paths) == {"A", "B"} and set(scene.fixed_points) == {"O", "C"}
    angles = np.arctan2(*scene.paths["A"].T[::-1])
    assert (angles.min(), angles.max()) == (pytest.approx(0.6, abs=0.003), pytest.approx(1.5, abs=0.003))
    np.testing.assert_allclose(np.hypot(*(scene.paths["B"] - (0.1, 0.0)).T), 0.11, rtol=1e-13)
    for part in scene.moving:
        assert volume(part.solid) > 0.0
        assert np.isfinite(part.solid.vertices).all()


def test_rollers_touch_the_cams_that_are_drawn() -> None:
    strokes = (Stroke(0.3, 1.7, 0.2), Stroke(2.8, 2.4, 0.0))
    group = CamFollower(
        "cam", "sley", "O", "M", "B", 0.06, 0.12, strokes, pivot="C", roller_radius_m=0.012,
        second=SecondRoller((0.06, 0.11), 0.01),
    )  # fmt: skip
    scene = build_scene(ttc.Machine("cams", {"O": (0.01, -0.02), "C": (0.15, 0.03)}, (group,)))
    cam, sley = scene.moving
    assert (len(cam.outlines), len(sley.outlines)) == (2, 0)
    assert volume(cam.solid) > 0.0
    places = {name: np.broadcast_to(at, (361, 2)) for name, at in scene.fixed_points.items()} | dict(scene.paths)
    (axis, turned), (pivot, swung) = (poses(part, places) for part in (cam, sley))
    for outline, roller, radius in zip(cam.outlines, [(0.12, 0.0), (0.06, 0.11)], [0.012, 0.01], strict=True):
        for k in range(0, 361, 30):
            centre = pivot[k, :2] + roller @ _turn(swung[k])
            away = np.hypot(*(axis[k, :2] + outline @ _turn(turned[k]) - centre).T)
            assert away.min() == pytest.approx(radius, rel=1e-3)  # corners of the outline lie a degree apart


def _turn(angle: float) -> np.ndarray:
    """Return the matrix that turns a row vector by an angle."""
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
