"""Cams and followers against envelopes at 40 digits, equivalent linkages, and closed forms of contact force."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import mpmath as mp
import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.dynamics import Body
from textile_twin_core.dynamics.loads import Spring
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import interpret
from textile_twin_core.files.machine_file import save_machine_file
from textile_twin_core.mechanism import CamFollower, Crank, Linkage, RRPDyad, RRRDyad
from textile_twin_core.mechanism.cam_follower import SecondRoller
from textile_twin_core.mechanism.law_strokes import Stroke
from textile_twin_core.mechanism.law_table import LiftTable

AXIS, PIVOT = (0.01, -0.02), (0.15, 0.03)
POINTS = {"O": AXIS, "C": PIVOT}
THETA = np.linspace(0.0, 2.0 * math.pi, 721)
SLIDES = {"guide_direction": (0.6, 0.8), "tip": "T"}
LIFT = (Stroke(0.3, 1.7, 0.02, "cycloidal"), Stroke(2.8, 2.4, 0.0, "cycloidal"))
SWING = (Stroke(0.3, 1.7, 0.2, "cycloidal"), Stroke(2.8, 2.4, 0.0, "cycloidal"))


NAMES: dict[str, Any] = {"cam": "cam", "follower": "f", "at": "O", "mark": "M", "end": "B"}


def cam(strokes: tuple[Stroke, ...], **declared: Any) -> CamFollower:
    return CamFollower(**(NAMES | {"base_radius_m": 0.06, "length_m": 0.12, "strokes": strokes} | declared))


KINDS = {
    "roller slides": cam(LIFT, **SLIDES, roller_radius_m=0.012, offset_m=0.015),
    "edge slides": cam(LIFT, **SLIDES, offset_m=-0.01),
    "flat slides": cam(LIFT, **SLIDES, face="flat"),
    "roller left": cam(SWING, pivot="C", roller_radius_m=0.012, phase_rad=0.4),
    "roller right": cam(SWING, pivot="C", roller_radius_m=0.012, side="right"),
    "flat left": cam(SWING, pivot="C", face="flat", offset_m=0.004),
    "flat right": cam(tuple(replace(s, to=s.to / 4.0) for s in SWING), pivot="C", face="flat", side="right"),
}
CONJUGATE = {
    "conjugate left": cam(SWING, pivot="C", roller_radius_m=0.012, second=SecondRoller((0.06, 0.11), 0.01)),
    "conjugate slides": cam(LIFT, **SLIDES, roller_radius_m=0.012, second=SecondRoller((-0.15, 0.01), 0.02)),
}


def machine(group: CamFollower, **declared: Any) -> ttc.Machine:
    bodies = (Body("f", 1.3, 2e-3, (0.4, 0.1)), Body("cam", 2.0, 5e-3, (0.2, -0.1)))
    return ttc.Machine("cam", POINTS, (group,), **({"bodies": bodies} | declared))


def cycloidal(strokes: tuple[Stroke, ...], angle: Any) -> Any:
    """Compute the lift at a cam angle in [0, 2 pi) by the law's definition."""
    before = mp.mpf(0)
    for stroke in strokes:
        u = (angle - stroke.start_rad) / stroke.turn_rad
        if u < 0:
            return before
        if u < 1:
            return before + (stroke.to - before) * (u - mp.sin(2 * mp.pi * u) / (2 * mp.pi))
        before = mp.mpf(stroke.to)
    return before


class Envelope:
    """The cam as the envelope of the follower's positions on it, in complex numbers, derivatives by differences."""

    def __init__(self, group: CamFollower) -> None:
        self.group, self.axis, self.pivot = group, mp.mpc(*AXIS), mp.mpc(*PIVOT)
        self.reach = mp.mpf(group.base_radius_m) + group.roller_radius_m
        self.sense = -1 if group.side == "left" else 1

    def roller(self, angle: Any) -> Any:
        """The roller's centre, from the axis."""
        g, lift = self.group, cycloidal(self.group.strokes, angle)
        if g.guide_direction is not None:
            along = mp.mpc(*g.guide_direction)
            return along * (mp.mpc(0, 1) * g.offset_m + mp.sqrt(self.reach**2 - mp.mpf(g.offset_m) ** 2) + lift)
        line = self.pivot - self.axis
        x = (abs(line) ** 2 + self.reach**2 - mp.mpf(g.length_m) ** 2) / (2 * abs(line))
        at_rest = (x - self.sense * mp.mpc(0, 1) * mp.sqrt(self.reach**2 - x**2)) * line / abs(line)
        return line + (at_rest - line) * mp.expj(self.sense * lift)

    def face(self, angle: Any) -> tuple[Any, Any]:
        """Angle of the flat face's normal and its distance from the axis."""
        g, lift = self.group, cycloidal(self.group.strokes, angle)
        if g.guide_direction is not None:
            return mp.arg(mp.mpc(*g.guide_direction)), mp.mpf(g.base_radius_m) + lift
        line = self.pivot - self.axis
        rest = mp.acos((mp.mpf(g.base_radius_m) + g.offset_m) / abs(line))
        normal = mp.arg(line) - self.sense * (rest - lift)
        return normal, abs(line) * mp.cos(rest - lift) - g.offset_m

    def at(self, angle: Any) -> tuple[Any, Any, Any]:
        """Outline on the cam, radius of curvature and pressure angle at a cam angle."""
        if self.group.face == "flat":
            turned = lambda a: self.face(a)[0] - a  # noqa: E731
            rate = lambda a: mp.diff(lambda b: self.face(b)[1], a) / mp.diff(turned, a)  # noqa: E731
            distance = self.face(angle)[1]
            outline = (distance + mp.mpc(0, 1) * rate(angle)) * mp.expj(turned(angle))
            radius, normal = distance + mp.diff(rate, angle) / mp.diff(turned, angle), mp.expj(self.face(angle)[0])
            touch = outline * mp.expj(angle)
        else:
            path = lambda a: self.roller(a) * mp.expj(-a)  # noqa: E731
            first, second = mp.diff(path, angle), mp.diff(path, angle, 2)
            across = mp.mpc(0, 1) * first / abs(first)
            outline = path(angle) - self.group.roller_radius_m * across
            radius = -(abs(first) ** 3) / (mp.conj(first) * second).imag - self.group.roller_radius_m
            normal, touch = across * mp.expj(angle), self.roller(angle)
        way = mp.mpc(*self.group.guide_direction or (0, 0))
        if self.group.guide_direction is None:
            way = self.sense * mp.mpc(0, 1) * (touch - (self.pivot - self.axis))
        return outline, radius, mp.arg(normal / way)


@pytest.mark.parametrize("kind", KINDS)
def test_against_the_envelope(kind: str) -> None:
    group = KINDS[kind]
    solved = Linkage(POINTS, (group,)).solved
    found = [solved.quantities[n] for n in ("outline_cam_x_m", "outline_cam_y_m", "curvature_radius_cam_m")]
    found.append(solved.quantities["pressure_angle_f_rad"])
    with mp.workdps(40):
        for theta in (0.1, 0.7, 1.3, 1.9, 2.4, 3.1, 4.0, 4.9, 5.9):
            outline, radius, pressure = Envelope(group).at(mp.mpf(theta) + group.phase_rad)
            told = interpret(found, {"theta": theta}, math)
            assert abs(complex(*told[:2]) - complex(outline)) < 1e-15
            assert told[2] == pytest.approx(float(radius), rel=1e-12)
            assert told[3] == pytest.approx(float(pressure), abs=1e-13)


@pytest.mark.parametrize("kind", [*KINDS, *CONJUGATE])
def test_both_routes_to_the_torque(kind: str) -> None:
    m = machine((KINDS | CONJUGATE)[kind])
    names = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm"]
    both = ttc.compile(m, outputs=names, method="exact").evaluate(THETA, 30.0, 70.0)
    assert np.abs(both[names[0]]).max() > 0.5
    np.testing.assert_allclose(*both.values(), rtol=0.0, atol=1e-13 * np.abs(both[names[0]]).max())


@pytest.mark.parametrize("kind", KINDS)
def test_both_routes_with_a_spring_and_a_dyad_on_the_end_of_the_follower(kind: str) -> None:
    """A sliding follower starts at that point, a swinging one ends there."""
    group, points = KINDS[kind], POINTS | {"G": (0.35, 0.2)}
    rod = RRRDyad("rod", "lever", "B", "G", "E", (0.35, 0.3))
    bodies = (Body("f", 1.3, 2e-3, (0.4, 0.1)), Body("rod", 0.8, 1e-3), Body("lever", 0.5, 1e-3))
    mounted = ttc.Machine("cam", points, (group, rod), bodies, (Spring("B", "G", 400.0, 0.1),))
    names = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm"]
    one, two = ttc.compile(mounted, names, method="exact").evaluate(THETA, 30.0, 200.0).values()
    assert np.abs(one - two).max() < 1e-12 * np.abs(one).max()
    assert '<joint name="rod"' in mounted.urdf()


@pytest.mark.parametrize("kind", CONJUGATE)
def test_conjugate_cams_move_the_follower_in_both_directions(kind: str) -> None:
    """Exactly one of them presses, and the torque is that of one cam that could pull."""
    m, alone = machine(CONJUGATE[kind]), machine(replace(CONJUGATE[kind], second=None))
    names = ["contact_force_f_N", "contact_force_f_second_N", "balancing_torque_Nm"]
    found = ttc.compile(m, outputs=names, method="exact").evaluate(THETA, 40.0)
    single = ttc.compile(alone, outputs=[names[0], names[2]], method="exact").evaluate(THETA, 40.0)
    first, second = found[names[0]], found[names[1]]
    assert first.min() == 0.0 == second.min()
    assert first.max() > 1.0
    assert second.max() > 1.0
    assert not ((first > 0.0) & (second > 0.0)).any()
    np.testing.assert_array_equal(first, np.maximum(single[names[0]], 0.0))
    np.testing.assert_allclose(found[names[2]], single[names[2]], atol=1e-13 * np.abs(single[names[2]]).max())
    assert not [event for event in m.events() if "lift" in event.name]
    assert [event.name for event in replace(alone, nominal_speed_rad_s=40.0).events() if "lift" in event.name]


@pytest.mark.parametrize(("face", "curved"), [("flat", 0.055), ("roller", 0.055)])
def test_an_eccentric_disc(face: Any, curved: float) -> None:
    """A disc about a point 15 mm off its axis moves a flat face harmonically: its outline and curvature are known."""
    strokes = (Stroke(0.0, math.pi, 0.03, "simple_harmonic"), Stroke(math.pi, math.pi, 0.0, "simple_harmonic"))
    if face == "flat":
        group = replace(cam(strokes, **SLIDES, face="flat"), base_radius_m=0.04)
        tolerance = 1e-12
    else:  # the same disc under a roller moves it as a slider-crank does: rod 55 + 10 mm, crank 15 mm
        angles = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)
        lift = -0.015 * np.cos(angles) + np.sqrt(0.065**2 - (0.015 * np.sin(angles)) ** 2) - 0.05
        table = LiftTable(tuple(angles.tolist()), tuple(lift.tolist()))
        group = replace(cam((), **SLIDES, table=table, roller_radius_m=0.01), base_radius_m=0.04)
        tolerance = 1e-7
    names = ["outline_cam_x_m", "outline_cam_y_m", "curvature_radius_cam_m"]
    x, y, radius = ttc.compile(machine(group), outputs=names, method="exact").evaluate(THETA).values()
    np.testing.assert_allclose(radius, curved, rtol=tolerance)
    heavy = complex(x.mean(), y.mean())
    centre = 0.015 * np.exp(1j * np.angle(heavy))  # the side that lifts
    np.testing.assert_allclose(np.abs(x + 1j * y - centre), curved, rtol=tolerance)


@pytest.mark.slow
def test_a_cam_that_moves_as_linkages_do_needs_their_torque() -> None:
    """A roller on an eccentric disc is the coupler of a slider-crank, or of a crank-rocker."""
    angles = tuple(np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False).tolist())
    theta = np.array(angles)
    loads = (Spring("T", "C", 400.0, 0.3),)
    points = {"O": (0.0, 0.0), "C": (0.02, -0.3)}
    rod = RRPDyad("rod", "f", "A", "B", "T", (0.09, 0.12), (0.0, 0.02), (1.0, 0.0))
    slider = ttc.Machine("s", points, (Crank("cam", "O", "A", 0.02), rod), (Body("f", 1.5),), loads)
    at_b = ttc.compile(slider, outputs=["point_B_x_m"]).evaluate(theta)["point_B_x_m"]
    rest = 0.065
    table = LiftTable(angles, tuple((at_b - math.sqrt(rest**2 - 0.02**2)).tolist()))
    group = CamFollower("cam", "f", "O", "M", "B", 0.05, 0.12, table=table, guide_direction=(1.0, 0.0), tip="T",
                        offset_m=0.02, roller_radius_m=rest - 0.05)  # fmt: skip
    like = ttc.Machine("c", points, (group,), (Body("f", 1.5),), loads)
    _same_torque(slider, like)

    points = {"O": (0.0, 0.0), "C": (0.15, 0.0)}
    dyad = RRRDyad("rod", "f", "A", "C", "B", (0.1, 0.11))
    rocker = ttc.Machine("r", points, (Crank("cam", "O", "A", 0.02), dyad), (Body("f", 1.5, 3e-3),))
    swing = ttc.compile(rocker, outputs=["theta_f_rad"]).evaluate(theta)["theta_f_rad"]
    rest_angle = math.acos((0.11**2 + 0.15**2 - 0.07**2) / (2.0 * 0.11 * 0.15))
    table = LiftTable(angles, tuple((math.pi - rest_angle - swing).tolist()))
    group = CamFollower("cam", "f", "O", "M", "B", 0.06, 0.11, table=table, pivot="C", roller_radius_m=0.01)
    _same_torque(rocker, ttc.Machine("c", points, (group,), (Body("f", 1.5, 3e-3),)))


def _same_torque(linkage: ttc.Machine, like: ttc.Machine) -> None:
    """Compare torques to the error in acceleration of a spline of 720 knots."""
    torques = [ttc.compile(m).evaluate(THETA + 0.002, 25.0, 90.0)["balancing_torque_Nm"] for m in (linkage, like)]
    np.testing.assert_allclose(torques[1], torques[0], atol=1e-8 * np.abs(torques[0]).max())


def sprung(preload_N: float) -> ttc.Machine:
    """A flat face on an eccentric disc, m = 2 kg, 500 N/m, at 60 rad/s: N = F + k e (1 - cos) + m e w^2 cos."""
    strokes = (Stroke(0.0, math.pi, 0.02, "simple_harmonic"), Stroke(math.pi, math.pi, 0.0, "simple_harmonic"))
    group = CamFollower("cam", "f", "O", "M", "B", 0.04, 0.1, strokes, guide_direction=(0.0, 1.0), tip="T", face="flat")
    spring = Spring("T", "G", 500.0, 1.14, preload_N)
    return ttc.Machine(
        "sprung", {"O": (0.0, 0.0), "G": (0.0, -1.0)}, (group,), (Body("f", 2.0),), (spring,),
        gravity_m_s2=(0.0, 0.0), nominal_speed_rad_s=60.0,
    )  # fmt: skip


def test_contact_force_and_where_the_follower_lifts_off() -> None:
    force = ttc.compile(sprung(20.0), outputs=["contact_force_f_N"]).evaluate(THETA, 60.0)["contact_force_f_N"]
    inertia = 2.0 * 0.01 * 60.0**2
    np.testing.assert_allclose(force, 20.0 + 5.0 * (1.0 - np.cos(THETA)) + inertia * np.cos(THETA), atol=1e-11)
    (event,) = [event for event in sprung(20.0).events() if event.name == "f_lifts_off"]
    assert event.angle_rad == pytest.approx(math.acos(-25.0 / (inertia - 5.0)), abs=1e-12)
    assert not [event for event in sprung(2.0 * inertia).events() if event.name == "f_lifts_off"]


def test_a_cam_that_would_be_undercut_is_refused_with_the_angle() -> None:
    """Radial roller, by the textbook's radius of its centre's path (Norton 2009, ch. 7)."""
    strokes = (Stroke(0.5, 0.9, 0.03, "cycloidal"), Stroke(3.0, 2.0, 0.0, "cycloidal"))

    def margin(angle: Any) -> Any:
        lift = lambda a: cycloidal(strokes, a)  # noqa: E731
        r, v, a = mp.mpf("0.055") + lift(angle), mp.diff(lift, angle), mp.diff(lift, angle, 2)
        return (r * r + v * v) ** mp.mpf("1.5") - mp.mpf("0.025") * (r * r + 2 * v * v - r * a)

    with mp.workdps(30):
        angles = [mp.mpf(k) / 100 for k in range(50, 141)]
        after = next(k for k, angle in enumerate(angles) if margin(angle) < 0)
        begins = math.degrees(mp.findroot(margin, (angles[after - 1], angles[after]), solver="ridder"))
    group = replace(cam(strokes, **SLIDES, roller_radius_m=0.025), base_radius_m=0.03)
    with pytest.raises(MachineError) as refused:
        machine(group)
    words = str(refused.value)
    assert "cam 'cam' that is undercut: it begins at a shaft angle of" in words
    assert float(words.split("angle of ")[1].split(" deg")[0]) == pytest.approx(begins, abs=6e-5)
    machine(replace(group, base_radius_m=0.08))
    with pytest.raises(MachineError):
        machine(cam(strokes, **SLIDES, face="flat"))


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ({}, "give a pivot, for a follower that swings, or guide_direction and tip"),
        ({"pivot": "C", "tip": "T"}, "give a pivot"),
        ({"pivot": "C", "face": "flat", "roller_radius_m": 0.01}, "left out of a flat face"),
        ({**SLIDES, "offset_m": 0.07}, "offset_m must be smaller"),
        ({"pivot": "C", "length_m": 0.01}, "cannot lie on the base circle"),
        ({**SLIDES, "table": LiftTable((0.0, 1.0), (0.0, 1.0))}, "either strokes or a table"),
        ({**SLIDES, "strokes": (Stroke(0.0, 1.0, 0.01),)}, "must lead back to 0"),
        ({**SLIDES, "strokes": (Stroke(0.0, 2.0, 0.01), Stroke(1.0, 2.0, 0.0))}, "must follow one another"),
        ({"pivot": "O"}, "are one point"),
    ],
)
def test_wrong_declarations(declared: dict[str, Any], said: str) -> None:
    with pytest.raises(MachineError, match=said):
        machine(cam(**({"strokes": LIFT} | declared)))


@pytest.mark.parametrize("kind", [*KINDS, *CONJUGATE])
def test_robot_and_machine_file(kind: str, tmp_path: Path) -> None:
    """Every link of the description hangs on the world, and a file declares the same machine."""
    m = machine((KINDS | CONJUGATE)[kind])
    robot = Xml.fromstring(m.urdf())
    parents = {j.find("child").get("link"): j.find("parent").get("link") for j in robot.findall("joint")}  # type: ignore[union-attr]
    assert {link.get("name") for link in robot.findall("link")} - parents.keys() == {"world"}
    save_machine_file(m, tmp_path / "cam.yaml")
    assert ttc.load_machine(tmp_path / "cam.yaml") == m
