"""Planar loops to any number of digits: four-bar and slider-crank, positions and exact derivatives.

Vectors are complex numbers. A dyad is closed by the triangle of its lengths over the line of its ends. The derivatives
come from the loop equation, differentiated and solved as a linear equation. With fifty digits the cancellation near
dead centres and change points is harmless.
"""

from __future__ import annotations

from typing import Any

import mpmath as mp

Number = Any
"""A real or complex number of mpmath, or a value it converts: a float is taken at its exact value."""


def dyad_position(start: Number, end: Number, first: Number, second: Number, left: bool) -> Number:
    """Solve the joint of the links `first` from `start` and `second` from `end`, left or right of start -> end."""
    way = end - start
    square = mp.re(way) ** 2 + mp.im(way) ** 2
    along = (first**2 - second**2 + square) / (2 * square)
    across = mp.sqrt(first**2 / square - along**2)
    return start + way * mp.mpc(along, across if left else -across)


def dyad_rates(drift: Number, first: Number, second: Number) -> tuple[Number, Number]:
    """Solve the real p, q with drift + i p first = i q second, for link vectors `first` and `second`."""
    cross = mp.im(mp.conj(first) * second)
    return -mp.re(drift * mp.conj(second)) / cross, -mp.re(drift * mp.conj(first)) / cross


def dyad(
    start: tuple[Number, Number, Number], end: Number, first: Number, second: Number, left: bool
) -> tuple[tuple[Number, Number, Number], tuple[Number, Number, Number]]:
    """Solve the angles of the vectors start -> B and end -> B with two derivatives by the crank angle.

    `start` is the moving end with its two derivatives, `end` is fixed; lengths in m.
    """
    meeting = dyad_position(start[0], end, first, second, left)
    one, two = meeting - start[0], meeting - end
    p1, p2 = dyad_rates(start[1], one, two)
    q1, q2 = dyad_rates(start[2] - p1**2 * one + p2**2 * two, one, two)
    return (mp.arg(one), p1, q1), (mp.arg(two), p2, q2)


def four_bar(
    l1: Number,
    l2: Number,
    l3: Number,
    ground: Number,
    theta: Number,
    *,
    ground_angle: Number = 0,
    left: bool = True,
    digits: int = 50,
) -> dict[str, Number]:
    """Solve crank l1 about the origin, coupler l2 from A to B, rocker l3 from C to B, with C at distance `ground`.

    Returns:
        th2, th3 [rad], p2, p3, q2, q3 (first and second derivative by the crank angle), mu (angle A-B-C) and h
        (distance of B from the line A -> C over |AC|, left positive).
    """
    with mp.workdps(digits):
        l1, l2, l3 = mp.mpf(l1), mp.mpf(l2), mp.mpf(l3)
        end = mp.mpf(ground) * mp.expj(mp.mpf(ground_angle))
        crank = l1 * mp.expj(mp.mpf(theta))
        (th2, p2, q2), (th3, p3, q3) = dyad((crank, 1j * crank, -crank), end, l2, l3, left)
        meeting = crank + l2 * mp.expj(th2)
        mu = abs(mp.arg((crank - meeting) / (end - meeting)))
        h = mp.im((meeting - crank) / (end - crank))
        return {"th2": th2, "th3": th3, "p2": p2, "p3": p3, "q2": q2, "q3": q3, "mu": mu, "h": h}


def slider_crank(crank: Number, rod: Number, offset: Number, theta: Number, *, digits: int = 50) -> dict[str, Number]:
    """Solve a slider on a line parallel to x at height `offset`, ahead of the crank.

    Returns:
        x and its derivatives dx, d2x by the crank angle, rod_angle (from the crank pin to the slider) and
        drop_from_dead_centre (distance to the outer dead centre), in m and rad.
    """
    with mp.workdps(digits):
        crank, rod, offset, theta = mp.mpf(crank), mp.mpf(rod), mp.mpf(offset), mp.mpf(theta)
        pin = crank * mp.expj(theta)
        rise = offset - mp.im(pin)
        reach = mp.sqrt(rod**2 - rise**2)
        turn = -mp.re(pin) / reach
        turn2 = (mp.im(pin) + turn**2 * rise) / reach
        return {
            "x": mp.re(pin) + reach,
            "dx": -mp.im(pin) - turn * rise,
            "d2x": -mp.re(pin) - turn2 * rise - turn**2 * reach,
            "rod_angle": mp.arg(mp.mpc(reach, rise)),
            "drop_from_dead_centre": mp.sqrt((crank + rod) ** 2 - offset**2) - mp.re(pin) - reach,
        }
