"""Slotted levers, yokes, crossing guides and geared cranks in their hard cases, against 60 digits."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import mpmath as mp
import pytest

from tests.generators.planar_truth import four_bar
from tests.mechanism.planar_cases import NUDGE, by_every_back_end
from textile_twin_core.errors import MachineError
from textile_twin_core.mechanism import (
    Crank,
    GearPair,
    Guide,
    Linkage,
    PRPDyad,
    RPPDyad,
    RPRDyad,
    RRRDyad,
    check_assembly,
)

DIGITS = 60
NEAR = [sign * 10.0**-k for k in (0, 1, 3, 5, 7, 9, 11) for sign in (1.0, -1.0)]


@dataclass(frozen=True)
class LeverCase:
    """Crank [m], pivot [m], offset of the slot [m], crank angle [rad]; `cylinder` has the lever on the crank."""

    crank: float
    pivot: tuple[float, float]
    offset: float
    theta: float
    cylinder: bool = False

    def ours(self) -> list[tuple[float, ...]]:
        pins = ("C", "A") if self.cylinder else ("A", "C")
        dyad = RPRDyad("block", "lever", *pins, "B", "T", (0.1, 1.0), self.offset)
        linkage = Linkage({"O": (0.0, 0.0), "C": self.pivot}, (Crank("crank", "O", "A", self.crank), dyad))
        lever, block = linkage.solved.links["lever"], linkage.solved.links["block"]
        assert block.sliding is not None
        u = lever.direction
        return by_every_back_end([u.x, u.y, lever.first, lever.second, block.sliding.first], self.theta)

    def truth(self, nudge: Any = 0) -> tuple[Any, ...]:
        with mp.workdps(DIGITS):
            theta, e, pivot = mp.mpf(self.theta) + nudge, mp.mpf(self.offset), mp.mpc(*self.pivot)
            turn = mp.expj(theta)
            d = self.crank * turn - pivot
            d1, d2 = 1j * self.crank * turn, -self.crank * turn
            if self.cylinder:
                d, d1, d2 = -d, -d1, -d2
            squared = mp.re(d) ** 2 + mp.im(d) ** 2
            s = mp.sqrt(squared - e * e)
            u = d / mp.mpc(s, e)
            v, w = d1 / u, d2 / u
            p = mp.im(v) / s
            rate = mp.re(v) + e * p
            return mp.re(u), mp.im(u), p, (mp.im(w) - 2 * p * rate + e * p * p) / s, rate


PROPORTIONS = {
    "crank and slotted lever": (0.09, 0.25, 0.0),
    "whitworth": (0.11, 0.04, 0.0),
    "1e-3 from the pivot": (0.1, 0.1001, 0.0),
    "1e-6 from the pivot": (0.1, 0.1 + 1e-7, 0.0),
    "1e-9 from the pivot, beyond": (0.1, 0.1 - 1e-10, 0.0),
    "tiny crank": (1e-6, 0.25, 0.0),
    "far pivot": (0.1, 1e5, 0.0),
    "offset slot": (0.09, 0.25, 0.05),
    "offset slot, the other side": (0.11, 0.3, -0.02),
    "1e-9 from a change point": (0.1, 0.25, 0.15 - 1e-10),
    "1e-4 from a change point": (0.3, 0.1, -(0.2 - 1e-5)),
}


@pytest.mark.parametrize("cylinder", [False, True], ids=["lever", "cylinder"])
@pytest.mark.parametrize("angle", [0.0, 2.3])
@pytest.mark.parametrize("name", PROPORTIONS)
def test_slotted_levers(name: str, angle: float, cylinder: bool) -> None:
    """Errors stay below 2e-15, apart from the effect of rounding the crank angle by 1.1e-16 rad."""
    crank, ground, offset = PROPORTIONS[name]
    pivot = (ground, 0.0) if angle == 0.0 else (ground * math.cos(angle), ground * math.sin(angle))
    for end, distance in itertools.product((0.0, math.pi), NEAR):
        case = LeverCase(crank, pivot, offset, angle + end + distance, cylinder)
        truth, nudged = case.truth(), case.truth(NUDGE)
        speed = abs(truth[2])
        scales = (1, 1, speed, abs(truth[3]) + speed * speed, crank)
        for values in case.ours():
            for k, (value, exact, moved, scale) in enumerate(zip(values, truth, nudged, scales, strict=True)):
                error, by_rounding = abs(value - exact) / scale, abs(moved - exact) / scale
                assert error < 2e-15 + 12.0 * by_rounding, (case, k, float(error), float(by_rounding))


@pytest.mark.parametrize("slot_rad", [math.pi / 2.0, 0.3, 2.9])
def test_yokes_near_their_dead_centres(slot_rad: float) -> None:
    """Place and derivatives of yoke and block keep every digit that the crank's circle has."""
    direction, place = (0.6, 0.8), (0.02, -0.01)
    dyad = RPPDyad("block", "yoke", "A", "Q", ("S", "T"), (0.05, 0.1), place, direction, slot_rad)
    motion = Linkage({"O": (0.0, 0.0)}, (Crank("crank", "O", "A", 0.1), dyad)).solved
    positions = dyad.positions(motion)
    dead = math.atan2(0.8, 0.6) + slot_rad + math.pi / 2.0
    for theta in (dead + distance for distance in NEAR):
        with mp.workdps(DIGITS):
            axis, turn = mp.mpc(*direction) / mp.sqrt(mp.mpf(0.6) ** 2 + mp.mpf(0.8) ** 2), mp.expj(mp.mpf(theta))
            pin = [mp.mpf(0.1) * turn - mp.mpc(*place), 0.1 * 1j * turn, -0.1 * turn]
            seen = [z / axis for z in pin]
            angle = mp.mpf(slot_rad) if slot_rad != math.pi / 2.0 else mp.pi / 2
            across = [mp.im(z) / mp.sin(angle) for z in seen]
            along = [mp.re(z) - mp.cos(angle) * t for z, t in zip(seen, across, strict=True)]
        for values in by_every_back_end([*positions.along, *positions.across], theta):
            for value, exact in zip(values, [*along, *across], strict=True):
                assert abs(value - exact) < 4e-16 * (0.1 / math.sin(slot_rad) + abs(value)), theta


@pytest.mark.parametrize("lean", [1.0, 0.1, 1e-3, 1e-5])
def test_guides_that_come_near_to_parallel(lean: float) -> None:
    """The error grows as rounding over the angle between the guides, by one power more for each derivative."""
    dyad = PRPDyad(("one", "two"), "R", ("S", "T"), (0.05, 0.1), (Guide("crank", (0.0, 0.01)), Guide(None, (0.3, 0.2))))
    low, high = lean, math.pi - lean
    linkage = Linkage({"O": (0.0, 0.0)}, (Crank("crank", "O", "A", 0.1), dyad), (low, high))
    (closeness,) = check_assembly(linkage)
    assert closeness.margin == pytest.approx(math.sin(lean), rel=1e-9)
    assert closeness.transmission_angle_rad == pytest.approx(lean, rel=1e-6)
    positions = dyad.crossing(linkage.solved).positions
    for theta in (low * 1.0000001, 0.5 * (low + high), high * 0.9999999):
        with mp.workdps(DIGITS):
            angle = mp.mpf(theta)

            def place(t: Any) -> tuple[Any, Any]:
                height = mp.mpf(0.2) - mp.mpf(0.01) * mp.cos(t)
                return height / mp.sin(t), height * mp.cos(t) / mp.sin(t) - mp.mpf(0.01) * mp.sin(t) - mp.mpf(0.3)

            exact = [mp.diff(lambda t, k=k: place(t)[k], angle, n) for k in (0, 1) for n in (0, 1, 2)]
        sine = math.sin(theta)
        for values in by_every_back_end([*positions[0], *positions[1]], theta):
            for k, (value, truth) in enumerate(zip(values, exact, strict=True)):
                assert abs(value - truth) < 4e-15 / sine ** (k % 3 + 2), (theta, k)


def test_a_geared_crank_near_its_change_point_keeps_its_digits() -> None:
    """The four-bar on a gear that turns twice, in the half-angle form of its own angle."""
    gears = GearPair("gear", "O", "G", "B", 1.0, (40, 20), "crank", phase_rad=0.4)
    dyad = RRRDyad("coupler", "rocker", "B", "D", "E", (2.0, 2.0), "left")
    points = {"O": (0.0, 0.0), "G": (2.0, 0.0), "D": (5.0, 0.0)}
    links = Linkage(points, (Crank("crank", "O", "A", 0.5, phase_rad=0.25), gears, dyad)).solved.links
    rocker = links["rocker"]
    change = (0.4 - 2.0 * 0.25 - math.pi) / 2.0
    for theta in (change + distance for distance in NEAR):

        def truth(nudge: Any, theta: float = theta) -> dict[str, Any]:
            with mp.workdps(DIGITS):
                angle = mp.mpf(0.4) - 2 * (mp.mpf(theta) + mp.mpf(0.25)) + nudge
                return four_bar(1.0, 2.0, 2.0, 3.0, angle, left=True, digits=DIGITS)

        exact, nudged = truth(0), truth(4 * NUDGE)
        for p, q in by_every_back_end([rocker.first, rocker.second], theta):
            for value, name, factor in ((p, "p3", -2), (q, "q3", 4)):
                scale = abs(factor) * (abs(exact[name]) + abs(exact["p3"]))
                by_rounding = abs(factor) * abs(nudged[name] - exact[name]) / scale
                assert abs(value - factor * exact[name]) / scale < 1e-14 + 12.0 * by_rounding, (theta, name)


@pytest.mark.parametrize("margin", [1e-3, 1e-9, 1e-12])
def test_a_slot_ends_at_the_angle_that_is_stated(margin: float) -> None:
    """A slot that is a little too short names the angle where the slider passes its end; one a little longer holds."""

    def linkage(high: float) -> Linkage:
        dyad = RPRDyad("block", "lever", "A", "C", "B", "T", (0.02, 0.5), slot_m=(0.1, high))
        return Linkage({"O": (0.0, 0.0), "C": (0.0, -0.25)}, (Crank("crank", "O", "A", 0.1), dyad))

    (closeness,) = check_assembly(linkage(0.35 + margin))
    assert closeness.margin > 0.1  # the end of a slot is no dead point
    with pytest.raises(MachineError, match=r"leaves its slot: it begins at a shaft angle of (\S+) deg") as caught:
        check_assembly(linkage(0.35 - margin))
    stated = float(str(caught.value).split("angle of ")[1].split(" deg")[0])
    high = 0.35 - margin
    wanted = math.asin((high**2 - 0.1**2 - 0.25**2) / (2.0 * 0.1 * 0.25))
    assert stated == pytest.approx(math.degrees(wanted), abs=1e-4 if margin > 1e-10 else 0.01)
