"""The crank-rocker synthesis against the printed equations and linkages assembled by circle intersection."""

from __future__ import annotations

import json

import mpmath as mp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from textile_twin_core.errors import SceneError, TwinError
from textile_twin_core.papers.crank_rocker import TABLE_1, table_1_designs
from textile_twin_core.synthesis import CrankRockerFamily, best_rotation, crank_rocker

SWING = np.radians(30.0)
STEPS = 720
"""Size of the grid over a turn of the crank for the first search of dead centres."""


def printed_equations(swing: mp.mpf, rotation: mp.mpf, beta: mp.mpf) -> tuple[mp.mpf, mp.mpf, mp.mpf]:
    """Eq. 1-3 of Topalbekiroglu and Celik 2010 as printed, in 60 digits."""
    with mp.workdps(60):
        alpha1, alpha2, beta1 = swing / 2, (rotation - swing) / 2, rotation / 2 + beta
        a = -mp.sin(alpha1) * mp.cos(beta1) / mp.sin(alpha2)
        b = mp.sin(alpha1) * mp.sin(beta1) / mp.cos(alpha2)
        return a, b, mp.sqrt((a + b) ** 2 + 1 - 2 * (a + b) * mp.cos(beta))


def assemble(a: float, b: float, c: float, crank_angle: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
    """Compute rocker and transmission angle by intersecting circles about the crank pin and the pivot (1, 0)."""
    pin = a * mp.expj(crank_angle)
    across = 1 - pin
    distance = abs(across)
    along = (distance**2 + mp.mpf(b) ** 2 - mp.mpf(c) ** 2) / (2 * distance)
    joint = pin + across / distance * mp.mpc(along, mp.sqrt(mp.mpf(b) ** 2 - along**2))
    return mp.arg(joint - 1), abs(mp.arg((pin - joint) / (1 - joint)))


def dead_centre(a: float, b: float, c: float, start: float) -> tuple[mp.mpf, mp.mpf]:
    """Find the crank angle of a dead centre within a grid step of `start`, and the rocker's angle there."""
    with mp.workdps(40):

        def rocker(angle: mp.mpf) -> mp.mpf:
            return assemble(a, b, c, angle)[0]

        around = (start - 2 * mp.pi / STEPS, start + 2 * mp.pi / STEPS)
        crank_angle = mp.findroot(lambda angle: mp.diff(rocker, angle), around, solver="anderson", tol=1e-30)
        return crank_angle, rocker(crank_angle)


def measured(a: float, b: float, c: float) -> tuple[float, float, float]:
    """Measure swing, counter-clockwise rotation from stretched to folded, and mu_min from the motion."""
    grid = np.linspace(0.0, 2 * np.pi, STEPS + 1)
    pin = a * np.exp(1j * grid)
    distance = np.abs(1 - pin)
    along = (distance**2 + b**2 - c**2) / (2 * distance)
    joint = pin + (1 - pin) / distance * (along + 1j * np.sqrt(b**2 - along**2))
    rocker = np.angle(joint - 1)
    assert np.abs(np.diff(rocker)).max() < 3.0, "the rocker stays on one side: no wrap on the way"
    mu = np.abs(np.angle((pin - joint) / (1 - joint)))
    stretched_at, stretched = dead_centre(a, b, c, grid[np.argmin(rocker)])
    folded_at, folded = dead_centre(a, b, c, grid[np.argmax(rocker)])
    with mp.workdps(40):
        worst = assemble(a, b, c, mp.pi * int(np.argmin(np.minimum(mu, np.pi - mu))) * 2 / STEPS)[1]
        turned = (folded_at - stretched_at) % (2 * mp.pi)
        return float(folded - stretched), float(turned), float(min(worst, mp.pi - worst))


@given(
    swing=st.floats(2.0, 170.0),
    place=st.floats(0.02, 0.98),
    within=st.floats(0.05, 0.95),
)
@example(swing=46.0, place=0.9799999999999999, within=0.05078125)
@settings(max_examples=25)
def test_assembled_linkage_swings_and_turns_as_asked(swing: float, place: float, within: float) -> None:
    """The whole admissible range is covered, also beyond phi = 180 + psi."""
    rotation = 90 + swing / 2 + 180 * place
    family = CrankRockerFamily(np.radians(swing), np.radians(rotation) - np.pi)
    links = family.at_ratio(family.smallest_ratio + within * (1 - family.smallest_ratio))
    a, b, c = (float(side[0]) for side in (links.crank, links.coupler, links.rocker))
    if max(b, c) > 50:
        return  # the coupler grows without bound towards phi = 180 + psi, which other tests cover
    swung, turned, mu_min = measured(a, b, c)
    assert np.degrees(swung) == pytest.approx(swing, abs=1e-9)
    assert np.degrees(turned) == pytest.approx(rotation, abs=1e-8)
    assert links.mu_min_rad[0] == pytest.approx(mu_min, abs=2e-15 / (mu_min * a))


@pytest.mark.parametrize("rotation", [106, 120, 160, 179, 180, 181, 200, 209, 211, 240, 284])
def test_every_whole_degree_is_a_crank_rocker_of_the_task(rotation: int) -> None:
    result = crank_rocker(SWING, np.radians(rotation))
    low, high = np.degrees(result.family.beta_bounds_rad)
    beta = [round(float(np.degrees(design.beta_rad)), 9) for design in result.designs]
    assert beta == [k for k in range(181) if low - 1e-9 <= k <= high + 1e-9 and not (k == 0 and rotation == 180)]
    for design in result.designs:
        sides = sorted([design.crank, design.coupler, design.rocker, 1.0])
        slack = sides[1] + sides[2] - sides[0] - sides[3]
        assert design.crank == pytest.approx(sides[0], rel=1e-14)
        if design.grashof == "change point":
            assert slack == pytest.approx(0.0, abs=1e-12)
        else:
            assert slack > 1e-9 and design.mu_min_rad > 1e-5


def test_no_crank_rocker_outside_the_bounds() -> None:
    """The equations one degree outside give no crank-rocker, or one of another swing or rotation."""
    for rotation in (110, 140, 170, 180, 195, 215, 250):
        low, high = np.degrees(CrankRockerFamily(SWING, np.radians(rotation) - np.pi).beta_bounds_rad)
        for beta in (low - 1, high + 1):
            a, b, c = (float(x) for x in printed_equations(mp.radians(30), mp.radians(rotation), mp.radians(beta)))
            sides = sorted([a, b, c, 1.0])
            grashof = min(a, b, c) > 0 and sides[0] + sides[3] < sides[1] + sides[2] and a == sides[0]
            if grashof:
                swung, turned, _ = measured(a, b, c)
                assert not (np.isclose(np.degrees(swung), 30) and np.isclose(np.degrees(turned), rotation))


@pytest.mark.parametrize("from_singular", [0.0, 1e-3, -1e-3, 1e-7, -1e-7, 1e-11, -1e-11])
def test_family_holds_through_its_singular_rotation(from_singular: float) -> None:
    """Close to phi = 180 + psi the printed form loses all digits in doubles; ours keeps them."""
    imbalance = SWING - from_singular
    family = CrankRockerFamily(SWING, imbalance)
    ratio = np.array([0.1, 0.3, 0.7, 0.999])
    links = family.at_ratio(ratio)
    for k, r in enumerate(ratio.tolist()):
        with mp.workdps(60):
            skew = (mp.mpf(SWING) - mp.mpf(family.imbalance_rad)) / 2
            if skew:
                beta = mp.atan2(mp.mpf(r) * mp.cos(skew), mp.sin(skew)) - mp.mpf(family.imbalance_rad) / 2
                rotation = mp.pi + mp.mpf(family.imbalance_rad)
                a, b, c = printed_equations(mp.mpf(SWING), rotation, beta)
            else:  # Eq. 11, free coupler, right angle of Eq. 12-13 in general: c^2 = 1 + b^2 - a^2
                a = mp.sin(mp.mpf(SWING) / 2)
                b = a / mp.mpf(r)
                c = mp.sqrt(1 + b**2 - a**2)
            cosines = [abs((b**2 + c**2 - (1 + sign * a) ** 2) / (2 * b * c)) for sign in (-1, 1)]
            mu = mp.acos(max(cosines))
        for ours, exact in (
            (links.crank[k], a),
            (links.coupler[k], b),
            (links.rocker[k], c),
            (links.mu_min_rad[k], mu),
        ):
            assert abs(mp.mpf(float(ours)) - exact) <= 1e-15 * max(1, abs(exact)) * 4


def test_limit_of_the_general_case_is_the_special_one() -> None:
    special = crank_rocker(SWING, SWING + np.pi)
    assert special.case == "phi = 180 + psi"
    (design,) = special.designs
    a = -np.cos(np.radians(105))  # Eq. 11-14
    assert design.crank == pytest.approx(a, abs=2e-16)
    assert design.coupler == pytest.approx(np.sqrt(a * (1 + a)), abs=4e-16)
    assert design.rocker == pytest.approx(np.sqrt(1 + a), abs=4e-16)
    assert design.mu_min_rad == pytest.approx(np.arccos(2 * np.sqrt(a) / (1 + a)), abs=1e-15)
    for off in (1e-6, -1e-6):
        near = CrankRockerFamily(SWING, SWING + off).at_ratio(design.crank_over_coupler)
        assert near.coupler[0] == pytest.approx(design.coupler, abs=3 * abs(off))
        assert near.mu_min_rad[0] == pytest.approx(design.mu_min_rad, abs=3 * abs(off))
    # The special design is the one of the largest mu_min among the members with a free coupler.
    others = special.family.at_ratio(np.linspace(0.01, 1.0, 1000)).mu_min_rad
    assert others.max() <= design.mu_min_rad


def test_centric_case_has_its_own_equations() -> None:
    for design in crank_rocker(SWING, np.pi).designs:
        beta = design.beta_rad  # Eq. 16-18
        assert design.crank == pytest.approx(np.tan(SWING / 2) * np.sin(beta), abs=1e-15)
        assert design.coupler == pytest.approx(np.cos(beta), abs=1e-15)
        assert design.rocker == pytest.approx(np.sin(beta) / np.cos(SWING / 2), abs=1e-15)
        cos_mu = min(1.0, np.sin(SWING / 2) / np.cos(beta))
        assert np.cos(design.mu_min_rad) == pytest.approx(cos_mu, abs=4e-15)


def test_printed_expansion_of_the_rocker_agrees() -> None:
    for design in crank_rocker(SWING, np.radians(160.0)).designs:  # Eq. 4-5
        k2 = 2 * np.sin(SWING / 2) / np.sin(np.radians(130.0))
        alpha3 = np.radians(145.0)
        k1 = 1 + k2 * np.cos(alpha3) + k2**2 / 2
        beta = design.beta_rad
        squared = k1 + k2 * np.cos(alpha3 + 2 * beta) + k2**2 / 2 * np.cos(2 * alpha3 + 2 * beta)
        assert design.rocker**2 == pytest.approx(squared, abs=1e-15)


@pytest.mark.parametrize("swing", [1e-12, 1e-6, 1e-3])
def test_small_swings_keep_their_digits(swing: float) -> None:
    for imbalance in (-0.4, 0.0, 0.7 * swing, 0.4):
        family = CrankRockerFamily(swing, imbalance)
        beta = 0.7 if imbalance <= swing else 2.0
        links = family.at_ratio(family.ratio_at(beta))
        with mp.workdps(60):
            # The same double decides beta in both.
            r, skew = mp.mpf(float(links.crank_over_coupler[0])), (mp.mpf(swing) - mp.mpf(imbalance)) / 2
            exact_beta = mp.atan2(r * mp.cos(skew), mp.sin(skew)) - mp.mpf(imbalance) / 2
            a, b, _ = printed_equations(mp.mpf(swing), mp.pi + mp.mpf(imbalance), exact_beta)
        assert links.crank[0] == pytest.approx(float(a), rel=2e-15)
        assert links.coupler[0] == pytest.approx(float(b), rel=2e-15)
        assert links.beta_rad[0] == pytest.approx(beta, rel=1e-14)


def test_best_designs_of_the_carpet_loom() -> None:
    result = crank_rocker(SWING, np.pi)
    assert result.best is not None and result.best_continuous is not None
    assert np.degrees(result.best.beta_rad) == pytest.approx(48.0, abs=1e-12)
    assert result.best_continuous.crank_over_coupler == pytest.approx(0.3, abs=1e-15)
    # r/l = tan(15 deg) tan(beta) at phi = 180 (Eq. 16).
    assert np.tan(result.best_continuous.beta_rad) == pytest.approx(0.3 / np.tan(np.radians(15)), rel=1e-14)
    lengths = result.best.scaled(0.3)
    assert [round(x, 4) for x in (lengths.crank_m, lengths.coupler_m, lengths.rocker_m)] == [
        0.0597,
        0.2007,
        0.2308,
    ]


def test_criteria_lead_to_half_a_turn_and_the_best_row_of_the_table() -> None:
    """psi = 30 deg: of all rotations 180 deg transmits best at r/l = 0.3, of all rows of Table 1 beta = 48 is best."""
    assert best_rotation(SWING) == np.pi
    for swing in (10.0, 30.0, 45.0):
        chosen = best_rotation(np.radians(swing)) - np.pi
        mu = float(CrankRockerFamily(np.radians(swing), chosen).at_ratio(0.3).mu_min_rad[0])
        for imbalance in np.linspace(-0.9, 0.9, 181):
            family = CrankRockerFamily(np.radians(swing), float(imbalance))
            if family.smallest_ratio < 0.3:
                assert family.at_ratio(0.3).mu_min_rad[0] <= mu + 1e-12
    good = [
        (row, design)
        for row, design in zip(TABLE_1, table_1_designs(), strict=True)
        if design.deviation_rad < np.radians(40.0)
    ]
    best = min(good, key=lambda pair: abs(pair[1].crank_over_coupler - 0.3))
    assert best[0][:2] == (180, 48)
    beyond = crank_rocker(SWING, np.pi).best_continuous
    assert beyond is not None and np.degrees(beyond.beta_rad) == pytest.approx(48.2299, abs=5e-5)
    assert np.degrees(beyond.mu_min_rad) == pytest.approx(67.14, abs=5e-3)


def test_nearest_ratio_stands_on_the_limit_of_the_transmission_angle() -> None:
    """Take the nearest sufficient ratio if r/l = 0.3 has too small a transmission angle."""
    result = crank_rocker(np.radians(20.0), np.radians(195.0))
    assert result.best is not None and result.best_continuous is not None
    continuous = result.best_continuous
    grid = result.family.at_ratio(np.linspace(result.family.smallest_ratio + 1e-9, 1.0, 200001))
    good = grid.mu_min_rad >= np.radians(50.0)
    nearest = np.abs(grid.crank_over_coupler[good] - 0.3).min()
    assert abs(continuous.crank_over_coupler - 0.3) == pytest.approx(nearest, abs=1e-5)
    assert continuous.deviation_rad <= np.radians(40.0) + 1e-12
    assert abs(continuous.crank_over_coupler - 0.3) <= abs(result.best.crank_over_coupler - 0.3)


@given(swing=st.floats(1.0, 175.0), place=st.floats(0.001, 0.999))
@settings(max_examples=60)
def test_best_transmission_is_the_largest_of_a_dense_grid(swing: float, place: float) -> None:
    rotation = 90 + swing / 2 + 180 * place
    result = crank_rocker(np.radians(swing), np.radians(rotation))
    if result.best_transmission is None:
        return
    low = max(result.family.smallest_ratio, 1e-6)
    grid = result.family.at_ratio(np.linspace(low, 1.0, 20001)).mu_min_rad
    assert result.best_transmission.mu_min_rad >= grid.max() - 1e-12


def test_no_design_within_the_transmission_limit() -> None:
    result = crank_rocker(SWING, np.radians(120.0))
    assert result.best is None and result.best_continuous is None
    written = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert written["best"] is None and len(written["designs"]) == 16
    assert written["beta_bounds_deg"] == [60.0, 75.0]
    assert written["designs"][-1]["grashof"] == "change point" and written["designs"][-1]["mu_min_deg"] == 0.0


@pytest.mark.parametrize(
    ("swing", "rotation", "says"),
    [
        (0.0, 180.0, "swing 0 deg"),
        (-5.0, 180.0, "swing -5 deg"),
        (180.0, 180.0, "swing 180 deg"),
        (30.0, 104.0, "from 105 to 285 deg"),
        (30.0, 286.0, "from 105 to 285 deg"),
        (30.0, 720.0, "no admissible beta"),
        (float("nan"), 180.0, "finite"),
        (30.0, float("inf"), "finite"),
    ],
)
def test_impossible_tasks_are_refused_in_one_line(swing: float, rotation: float, says: str) -> None:
    with pytest.raises(SceneError, match=says) as caught:
        crank_rocker(np.radians(swing), np.radians(rotation))
    assert isinstance(caught.value, TwinError) and "\n" not in str(caught.value)


def test_scaling_wants_a_length() -> None:
    (design, *_) = crank_rocker(SWING, np.pi).designs
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(SceneError, match="positive length"):
            design.scaled(wrong)
