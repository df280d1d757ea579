"""The elliptic gear pair against rolling in 50 digits, the complex step, and the paper's own equations."""

from __future__ import annotations

import cmath
import math

import mpmath as mp
import numpy as np
import pytest

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, interpret
from textile_twin_core.expression.loop import Loop
from textile_twin_core.mechanism import Crank, Linkage, RRRDyad, check_assembly
from textile_twin_core.mechanism.elliptic_gear_pair import EllipticGearPair

HALF_AXIS, AXIS_RATIO = 0.071233, 0.85


def gears(
    axis_ratio: float = AXIS_RATIO, phase_rad: float = 0.0, line_rad: float = 0.0
) -> tuple[EllipticGearPair, Linkage]:
    pair = EllipticGearPair("gear_1", "gear_2", "O", "A", ("F", "G"), axis_ratio, phase_rad)
    reach = 2 * HALF_AXIS
    points = {"O": (0.0, 0.0), "A": (reach * math.cos(line_rad), reach * math.sin(line_rad))}
    return pair, Linkage(points, (pair,))


def values(expressions: list[Expr], theta: np.ndarray) -> list[np.ndarray]:
    out = [np.empty_like(theta) for _ in expressions]
    Loop(expressions, ["theta"])([theta], out)
    return out


def rolled(axis_ratio: float, turn: mp.mpf) -> mp.mpf:
    """Turn of the driven gear by integrating the ratio r1/r2 of Eq. 1 and 3 over the driver's turn."""
    with mp.workdps(50):
        a = mp.mpf(HALF_AXIS)
        b = a * mp.mpf(axis_ratio)
        c = mp.sqrt(a**2 - b**2)

        def ratio(f: mp.mpf) -> mp.mpf:
            r1 = b**2 / (a + c * mp.cos(f))
            return r1 / (2 * a - r1)

        pieces = [turn * k / 8 for k in range(9)]
        return mp.quad(ratio, pieces)


def test_ratio_of_the_published_pair() -> None:
    _, linkage = gears()
    theta = np.linspace(0, 2 * np.pi, 20001)
    (speed,) = values([-linkage.solved.links["gear_2"].first], theta)
    assert [round(speed.min(), 4), round(speed.max(), 4)] == [0.3099, 3.2264]


@pytest.mark.parametrize("axis_ratio", [0.4, 0.85, 0.999, 1.0])
@pytest.mark.parametrize("turn", [-0.3, 1e-6, 1.0, 3.0, math.pi, 3.3, 6.0])
def test_driven_gear_turns_as_ellipses_roll(axis_ratio: float, turn: float) -> None:
    pair, linkage = gears(axis_ratio)
    exact = rolled(axis_ratio, mp.mpf(turn))
    link = linkage.solved.links["gear_2"]
    assert link.angle is not None
    (angle,) = values([link.angle], np.array([turn]))
    assert float(math.pi - angle[0]) == pytest.approx(float(exact), abs=2e-15)
    assert pair.driven_turn(turn) == pytest.approx(float(exact), abs=2e-15)
    x, y = values([link.direction.x, link.direction.y], np.array([turn]))
    assert x[0] == pytest.approx(float(-mp.cos(exact)), abs=1e-15)
    assert y[0] == pytest.approx(float(mp.sin(exact)), abs=1e-15)


def test_paper_writes_the_same_with_an_arc_cosine() -> None:
    pair, _ = gears()
    a, b = HALF_AXIS, HALF_AXIS * AXIS_RATIO
    c = math.sqrt(a * a - b * b)
    for f1 in np.linspace(0.1, 3.0, 15):  # Eq. 4, its angle counted from the far focus
        cosine = ((a + c * math.cos(f1)) * b**2 / (2 * a * a + 2 * a * c * math.cos(f1) - b**2) - a) / c
        assert pair.driven_turn(float(f1)) == pytest.approx(math.pi - math.acos(cosine), abs=1e-13)


@pytest.mark.parametrize("phase_rad", [0.0, math.radians(184.0), -2.0])
@pytest.mark.parametrize("axis_ratio", [0.5, 0.85, 0.99])
def test_derivatives_by_complex_step(axis_ratio: float, phase_rad: float) -> None:
    _, linkage = gears(axis_ratio, phase_rad, line_rad=0.7)
    motion, step = linkage.solved, 1e-30
    gear, point = motion.links["gear_2"], motion.points["P"]
    both = [gear.direction.x, gear.direction.y, gear.first, point.position.x, point.first.x]
    exact = [gear.direction.x, gear.direction.y, gear.first, gear.second, point.first.x, point.second.x]
    for theta in np.linspace(0.0, 2 * np.pi, 37):
        sloped = [v.imag / step for v in interpret(both, {"theta": complex(theta, step)}, cmath)]
        ux, uy, first, second, slide, bend = (float(v.real) for v in interpret(exact, {"theta": complex(theta)}, cmath))
        size = 3.3 / axis_ratio**4
        assert first == pytest.approx(ux * sloped[1] - uy * sloped[0], abs=1e-15 * size)
        assert second == pytest.approx(sloped[2], abs=1e-15 * size**2)
        assert slide == pytest.approx(sloped[3], abs=1e-15)
        assert bend == pytest.approx(sloped[4], abs=1e-14)


@pytest.mark.parametrize("turns", [-3, 0, 1, 7, 1000])
def test_angle_winds_up_with_the_shaft(turns: int) -> None:
    _, linkage = gears(phase_rad=math.radians(184.0))
    angle = linkage.solved.links["gear_2"].angle
    assert angle is not None
    base = np.linspace(0.0, 2 * np.pi, 41)
    here, there = (values([angle], base + shift)[0] for shift in (0.0, 2 * np.pi * turns))
    assert there + 2 * np.pi * turns == pytest.approx(here, abs=4e-13 * max(1, abs(turns)))


def test_ellipses_touch_on_the_centre_line() -> None:
    """Both gears put one and the same point there: distances to the two foci of either sum up to 2a."""
    _, linkage = gears(phase_rad=1.0, line_rad=-2.0)
    motion = linkage.solved
    names = ("O", "F", "A", "G", "P")
    flat = [c for n in names for c in (motion.points[n].position.x, motion.points[n].position.y)]
    rows = values(flat, np.linspace(0, 2 * np.pi, 101))
    place = {n: rows[2 * i] + 1j * rows[2 * i + 1] for i, n in enumerate(names)}
    for axis, focus in (("O", "F"), ("A", "G")):
        around = np.abs(place["P"] - place[axis]) + np.abs(place["P"] - place[focus])
        assert around == pytest.approx(np.full(101, 2 * HALF_AXIS), abs=1e-16 * 4)


def test_contact_tangent_is_that_of_the_ellipse() -> None:
    """An ellipse's tangent halves the outer angle between the lines to its foci."""
    pair, linkage = gears(phase_rad=0.4, line_rad=0.9)
    motion = linkage.solved
    mesh = pair.contact(motion)
    theta = np.linspace(0, 2 * np.pi, 50)
    steep, px, py, fx, fy = values(
        [
            mesh.steepness,
            motion.points["P"].position.x,
            motion.points["P"].position.y,
            motion.points["F"].position.x,
            motion.points["F"].position.y,
        ],
        theta,
    )
    touch, focus = px + 1j * py, fx + 1j * fy
    normal = touch / np.abs(touch) + (touch - focus) / np.abs(touch - focus)
    tangent = 1j * np.exp(0.9j) * (1 + 1j * steep)
    assert (normal * tangent.conj()).real == pytest.approx(np.zeros(50), abs=1e-14)


def test_crank_and_dyad_hang_on_the_driven_gear() -> None:
    pair, _ = gears(phase_rad=math.pi)
    foot = (2 * HALF_AXIS - 0.14, 0.14)
    crank = Crank("l1", "A", "B", 0.04, phase_rad=1.0, driven_by="gear_2")
    linkage = Linkage(
        {"O": (0.0, 0.0), "A": (2 * HALF_AXIS, 0.0), "D": foot},
        (pair, crank, RRRDyad("l2", "l3", "B", "D", "C", (0.1, 0.18), "left")),
    )
    (closeness,) = check_assembly(linkage)
    assert closeness.margin > 0.1
    motion = linkage.solved
    theta = np.linspace(0, 2 * np.pi, 7)
    bx, by, gear = values([motion.points["B"].position.x, motion.points["B"].position.y, pair_angle(linkage)], theta)
    place = 2 * HALF_AXIS + 0.04 * np.exp(1j * (gear + 1.0))
    assert bx + 1j * by == pytest.approx(place, abs=1e-15)


def pair_angle(linkage: Linkage) -> Expr:
    angle = linkage.solved.links["gear_2"].angle
    assert angle is not None
    return angle


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"axis_ratio": 0.0}, "teeth would jam"),
        ({"axis_ratio": 0.3}, "teeth would jam"),
        ({"axis_ratio": 1.1}, "not above 1"),
        ({"axis_ratio": float("nan")}, "axis_ratio"),
        ({"axis_ratio": 0.9, "pressure_angle_rad": 1.0}, "pressure_angle_rad"),
        ({"axis_ratio": 0.9, "phase_rad": float("inf")}, "phase_rad"),
    ],
)
def test_impossible_gears_are_refused(wrong: dict[str, float], says: str) -> None:
    with pytest.raises(MachineError, match=says):
        EllipticGearPair("gear_1", "gear_2", "O", "A", ("F", "G"), **wrong)


def test_gears_want_two_fixed_axes() -> None:
    pair, _ = gears()
    with pytest.raises(MachineError, match="one point"):
        _ = Linkage({"O": (0.0, 0.0), "A": (0.0, 0.0)}, (pair,)).solved
    moving = (Crank("l0", "O", "A", 0.1), pair)
    with pytest.raises(MachineError, match="fixed to the ground"):
        _ = Linkage({"O": (0.0, 0.0)}, moving).solved
