"""The tufting paper's equations: corrected they agree with the machine, as printed they give the rows' statements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.machines.xu_equations import L4, W1, Mended, centroid_accelerations, forces, motion
from textile_twin_core.machines import tufting
from textile_twin_core.papers.rows import at_angles
from textile_twin_core.papers.tufting import tufting_rows
from textile_twin_core.twin import compile_machine

ANGLES = np.radians(np.arange(0.5, 360.0, 1.0))
AS_MENDED = Mended()
KINDS = (("theta", "t", "rad"), ("omega", "w", "rad_s"), ("alpha", "a", "rad_s2"))


def row(name: str):  # type: ignore[no-untyped-def]
    return next(row for row in tufting_rows() if row.quantity.startswith(name))


def printed_range(name: str) -> list[float]:
    return [float(word) for word in str(row(name).printed).split("..")]


def test_mended_equations_give_the_motion() -> None:
    names = {f"{ours}_{k}_{unit}": f"{theirs}{k}" for ours, theirs, unit in KINDS for k in (2, 3, 4, 5)}
    names |= {"needle_position_m": "needle", "needle_velocity_m_s": "needle_speed"}
    ours = at_angles(tufting(), tuple(names), W1, ANGLES)
    paper = [motion(angle) for angle in ANGLES]
    for name, symbol in names.items():
        theirs = np.array([values[symbol] for values in paper])
        assert np.abs(ours[name] - theirs).max() < 1e-12 * max(1.0, np.abs(theirs).max()), name


def test_mended_equations_give_torques_and_joint_forces() -> None:
    machine = tufting()
    inside = at_angles(machine, ("needle_position_m",), W1, ANGLES)["needle_position_m"] >= 0.55784
    paper = [forces(angle, 1000.0 * deep) for angle, deep in zip(ANGLES, inside, strict=True)]
    ours = at_angles(machine, tuple(paper[0]), W1, ANGLES)
    for name in paper[0]:
        theirs = np.array([values[name] for values in paper])
        assert np.abs(ours[name] - theirs).max() < 1e-11 * np.abs(theirs).max(), name


@pytest.mark.parametrize(("name", "symbol", "mend"), [("Eq. 9", "t2", "eq_9"), ("Eq. 14", "t5", "eq_14")])
def test_wrong_branches(name: str, symbol: str, mend: str) -> None:
    asked = replace(AS_MENDED, **{mend: False})
    angle = np.degrees([motion(t1, asked)[symbol] for t1 in ANGLES])
    assert [angle.min(), angle.max()] == pytest.approx(printed_range(name), abs=0.051)


def test_eq_23_with_its_wrong_length() -> None:
    wrong = [abs(centroid_accelerations(t1, replace(AS_MENDED, eq_23=False))[2]) for t1 in ANGLES]
    right = [abs(centroid_accelerations(t1)[2]) for t1 in ANGLES]
    assert max(wrong) == pytest.approx(float(row("Eq. 23").printed), abs=6e-3)
    assert max(right) == pytest.approx(row("Eq. 23").computed, rel=1e-4)


def test_eq_33_with_its_missing_square() -> None:
    speed = max(abs(motion(t1)["w4"]) for t1 in ANGLES)
    assert speed * L4 / 2 == pytest.approx(float(row("Eq. 33").printed), abs=6e-4)
    assert speed**2 * L4 / 2 == pytest.approx(row("Eq. 33").computed, rel=1e-4)
    wrong, right = (centroid_accelerations(1.0, replace(AS_MENDED, eq_33=mended))[4] for mended in (False, True))
    assert abs(wrong - right) > 0.1 * abs(right)


def test_eq_35_with_its_wrong_sign() -> None:
    torque = [forces(t1, 0.0, replace(AS_MENDED, eq_35=False))["driven_shaft_torque_Nm"] for t1 in ANGLES]
    assert [min(torque), max(torque)] == pytest.approx(printed_range("Eq. 35"), abs=6e-3)


def test_equations_at_constant_speed_only() -> None:
    """The machine's a2 is not that of Eq. 12 with a shaft acceleration."""
    machine = tufting()
    name = "alpha_2_rad_s2"
    free, pushed = (compile_machine(machine, [name]).evaluate(0.3, W1, alpha)[name] for alpha in (0.0, 50.0))
    assert free == pytest.approx(motion(0.3)["a2"], rel=1e-12)
    assert abs(pushed - free) > 0.1
