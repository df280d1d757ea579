"""Laws of motion against their definitions, integrated with many digits, and as the drive of a shaft."""

from __future__ import annotations

import math
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from textile_twin_core.contact.law_pieces import law_pieces
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import cos, sin, variable
from textile_twin_core.expression.scalar import compile_scalar
from textile_twin_core.mechanism.law_strokes import NAMES, Stroke, law_of_strokes
from textile_twin_core.mechanism.law_table import from_function, from_table
from textile_twin_core.mechanism.motion_law import MotionLaw
from textile_twin_core.mechanism.vector import Vector

RISE, STROKE = 0.6446, 0.0326


#: Largest acceleration over stroke / turn^2, as handbooks print it (Norton 2009, table 3-2).
PEAKS = {
    "modified_sine": 5.528,
    "cycloidal": 6.283,
    "modified_trapezoid": 4.888,
    "polynomial_345": 5.774,
    "polynomial_4567": 7.513,
    "simple_harmonic": 4.935,
}


def rise_dwell_fall(name: Any, stroke: float, rise: float, fall_start: float, fall: float) -> MotionLaw:
    return law_of_strokes((Stroke(0.0, rise, stroke, name), Stroke(fall_start, fall, 0.0, name)))


def law(name: str) -> MotionLaw:
    return rise_dwell_fall(name, STROKE, RISE, math.pi, 0.5)


def test_every_law_has_its_peak() -> None:
    assert PEAKS.keys() == set(NAMES)
    for name, peak in PEAKS.items():
        found = max(law(name).evaluate(t, 2) for t in np.linspace(0.0, RISE, 8001).tolist())
        assert found * RISE**2 / STROKE == pytest.approx(peak, abs=6e-4), name


def test_expressions_are_the_law() -> None:
    """Position and both derivatives, in each section, at its start and over the end of the turn."""
    strokes = (
        Stroke(0.3, 1.1, 0.02, "modified_trapezoid"),
        Stroke(2.0, 0.7, -0.01),
        Stroke(4.0, 2.1, 0.0, "cycloidal"),
    )
    for the_law in (law_of_strokes(strokes), from_function(lambda a: 0.01 * math.exp(math.sin(a)))):
        theta = variable("theta")
        function = compile_scalar(the_law.over(Vector(cos(theta), sin(theta))), ["theta"])
        angles = [*np.linspace(-7.0, 13.0, 401).tolist(), 0.0, 2.0 * math.pi - 1e-9]
        for angle in angles:
            for derivative, value in enumerate(function(angle)):
                scale = 10.0**derivative * 0.02
                assert value == pytest.approx(the_law.evaluate(angle, derivative), abs=1e-13 * scale)


def modified_sine_acceleration(s: mp.mpf) -> mp.mpf:
    """Acceleration of the standard modified sine, peak 1: quarter sines of period 1/2 outside, of 3/2 between."""
    if s <= mp.mpf(1) / 8:
        return mp.sin(4 * mp.pi * s)
    if s <= mp.mpf(7) / 8:
        return mp.cos(4 * mp.pi / 3 * (s - mp.mpf(1) / 8))
    return -mp.sin(4 * mp.pi * (1 - s))


def test_modified_sine_is_its_acceleration_integrated_twice() -> None:
    with mp.workdps(30):
        breaks = [0, mp.mpf(1) / 8, mp.mpf(7) / 8, 1]

        def twice(s: mp.mpf) -> mp.mpf:
            edges = [b for b in breaks if b < s] + [s]
            return mp.quad(lambda r: (s - r) * modified_sine_acceleration(r), edges)

        whole = twice(mp.mpf(1))
        for s in (0.05, 0.125, 0.3, 0.5, 0.8, 0.95):
            exact = float(twice(mp.mpf(s)) / whole) * STROKE
            assert law("modified_sine").evaluate(s * RISE) == pytest.approx(exact, abs=1e-17)
        peak = float(1 / whole)
    found = max(law("modified_sine").evaluate(t, 2) for t in np.linspace(0.0, RISE, 4001).tolist())
    assert peak == pytest.approx(5.528, abs=5e-4)
    assert found * RISE**2 / STROKE == pytest.approx(peak, rel=1e-6)


def test_cycloidal() -> None:
    for s in (0.0, 0.1, 0.25, 0.5, 0.9):
        exact = STROKE * (s - math.sin(2 * math.pi * s) / (2 * math.pi))
        assert law("cycloidal").evaluate(s * RISE) == pytest.approx(exact, abs=1e-17)


@pytest.mark.parametrize("name", [name for name in NAMES if name != "simple_harmonic"])
def test_sections_join_without_a_step_in_velocity_or_acceleration(name: str) -> None:
    the_law = law(name)
    large = 100.0 if name.startswith("polynomial") else 1.0  # coefficients up to 84 that cancel
    for start in the_law.starts_rad:
        for derivative, allowed in ((0, 1e-16 * large), (1, 1e-15 * large), (2, 4e-14 * large)):
            before = the_law.sections[the_law.starts_rad.index(start) - 1]
            previous = the_law.starts_rad[the_law.starts_rad.index(start) - 1]
            width = start - previous if start > previous else 2 * math.pi - previous
            assert before.value(width, derivative) == pytest.approx(the_law.evaluate(start, derivative), abs=allowed)


@pytest.mark.parametrize("theta", [(0.3, -25.0, 3.0), (6.0, 40.0, -60.0, 1.0), (-1e6, 31.0), (3.7, 26.0, 0.0, 1e-6)])
def test_pieces_follow_the_shaft_forwards_backwards_and_through_reversal(theta: tuple[float, ...]) -> None:
    the_law = law("modified_sine")
    at = 0.0
    for piece in law_pieces(the_law, 0.0, 1.0, theta):
        assert piece.start_s == at
        at = piece.end_s
        for time in np.linspace(piece.start_s, piece.end_s, 5).tolist():
            angle = sum(c * time**k for k, c in enumerate(theta))
            rounding = 1e-15 * (1.0 + abs(theta[0]))
            assert piece.state(time)[0] == pytest.approx(the_law.evaluate(angle), abs=rounding)
    assert at == 1.0


def test_a_users_function_and_table() -> None:
    fitted = from_function(lambda angle: 0.01 * math.exp(math.sin(angle)))
    angles = np.linspace(0.0, 7.0, 50)
    assert max(abs(fitted.evaluate(a) - 0.01 * math.exp(math.sin(a))) for a in angles.tolist()) < 1e-13
    knots = np.linspace(1.0, 1.0 + 2 * math.pi, 201)
    table = from_table(knots, 0.02 * np.cos(knots))
    assert max(abs(table.evaluate(a) - 0.02 * math.cos(a)) for a in angles.tolist()) < 1e-12


def test_wrong_laws_are_refused() -> None:
    with pytest.raises(MachineError, match="modified_sine, cycloidal"):
        rise_dwell_fall("modified-sine", 0.03, 0.5, 3.0, 0.5)
    with pytest.raises(MachineError, match="within one turn"):
        rise_dwell_fall("cycloidal", 0.03, 3.2, 3.0, 0.5)
    with pytest.raises(MachineError, match="does not increase at row 3"):
        from_table(np.array([0.0, 1.0, 2.0, 2.0, 3.0, 4.0]), np.zeros(6))
    with pytest.raises(MachineError, match="at least 6"):
        from_table(np.arange(3.0), np.zeros(3))
    with pytest.raises(MachineError, match=r"from 0 to 0\.01, but the smooth curve through it from -0\.05\d+ to 0\.03"):
        from_table(np.array([0.0, 1.0, 2.0, 2.1, 3.5, 4.5, 4.6]), np.array([0.0, 0.0, 0.0, 0.01, 0.01, 0.01, 0.0]))


def test_few_points_of_a_smooth_curve_are_a_law_and_stay_as_they_are() -> None:
    """Six points beside the crests of a sine curve; a table over the whole turn may be read-only."""
    knots = np.linspace(0.0, 2.0 * math.pi, 7)
    lift = 0.02 * np.sin(knots)
    lift.flags.writeable = False
    law = from_table(knots, lift)
    assert max(abs(law.evaluate(a) - 0.02 * math.sin(a)) for a in np.linspace(0.0, 6.0, 50).tolist()) < 2e-4
