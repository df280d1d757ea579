"""Four-bars whose coupler point passes exactly through up to five given points, in order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError
from textile_twin_core.synthesis.four_bar import (
    ComplexArray,
    FourBarDesign,
    are_crank_rockers,
    coupler_points,
    worst_transmission,
)

MOST_POINTS = 5
_STARTS = 384
_ROUNDS = 8
_STEPS = 40
_STEP = 1e-7
_LARGEST_MISS = 1e-11
"""Largest miss of a point by a solution, in units of the task's size."""
_LONGEST = 8.0
"""Largest length of a link, in units of the task's size."""
Found = tuple[float, FloatArray, float, FloatArray]
"""Worst transmission angle, design, side, crank angles."""
_APART_RAD = math.radians(3.0)


@dataclass(frozen=True)
class PointsDesign:
    """A four-bar through the points, with its crank angles (n,) at the points [rad] and the largest miss [m]."""

    four_bar: FourBarDesign
    angles_rad: tuple[float, ...]
    miss_m: float


def through_points(
    points_m: Sequence[tuple[float, float]], seed: int = 0, count: int = 5, smallest_mu_rad: float = 0.0
) -> tuple[PointsDesign, ...]:
    """Find crank-rockers whose coupler point passes two to five points in order, best transmission angle first.

    Pivots, lengths, coupler point and the crank angle at each point are 9 + n unknowns of 2 n equations. From each
    start the nearest solution is found by Newton's method with the shortest step (Gauss-Newton for an underdetermined
    system). Solutions are accepted if the crank turns fully and meets the points in order. The same seed gives the same
    designs.

    Args:
        points_m: (n, 2) points [m].
        seed: seed of the starts.
        count: number of designs.
        smallest_mu_rad: smallest allowed transmission angle [rad].

    Returns:
        The designs.

    Raises:
        SceneError: for points that are too few, too many, not finite or identical, and if no crank-rocker is found.

    References:
        Deuflhard 2011: Gauss-Newton for underdetermined systems.

    Examples:
        >>> from textile_twin_core.synthesis.through_points import through_points
        >>> len(through_points([(0.0, 0.1), (0.05, 0.12)], count=1))
        1
    """
    points = _checked(points_m)
    centre, size = complex(points.mean()), float(np.abs(points - points.mean()).max())
    if size == 0.0:
        raise SceneError("the points are one and the same: give points that lie apart")
    task = (points - centre) / size
    found: list[Found] = []
    random = np.random.default_rng(seed)
    for _ in range(_ROUNDS):
        found += _accepted(*_solve(*_starts(random, task), task), task, smallest_mu_rad)
        if len(found) >= count:
            break
    if not found:
        raise SceneError("no crank-rocker through these points was found; try another seed, fewer points or mu limit 0")
    found.sort(key=lambda entry: -entry[0])
    return tuple(_design(entry, centre, size, points) for entry in found[:count])


def _checked(points_m: Sequence[tuple[float, float]]) -> ComplexArray:
    if not 2 <= len(points_m) <= MOST_POINTS:
        raise SceneError(
            f"a coupler point is led through 2 to {MOST_POINTS} points, not {len(points_m)}; for more fit a curve"
        )
    points = np.array([complex(*p) for p in points_m])
    if not np.isfinite(points).all():
        raise SceneError("points must be finite coordinates in metres")
    return points


def _starts(random: np.random.Generator, task: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Draw rough linkages of the task's size, and crank angles spread over a turn in either sense."""
    pivots = random.normal(scale=1.5, size=(_STARTS, 4))
    crank = random.uniform(0.2, 1.2, _STARTS)
    ground = np.hypot(pivots[:, 2] - pivots[:, 0], pivots[:, 3] - pivots[:, 1])
    coupler = random.uniform(0.8, 3.0, _STARTS)
    rocker = np.clip(np.hypot(ground, coupler) * random.uniform(0.7, 1.3, _STARTS), crank + 0.1, None)
    point = random.normal(scale=1.0, size=(_STARTS, 2))
    gaps = random.dirichlet(np.ones(task.size), _STARTS) * 2.0 * math.pi
    sense = random.choice([-1.0, 1.0], _STARTS)
    angles = random.uniform(0.0, 2.0 * math.pi, (_STARTS, 1)) + sense[:, None] * np.cumsum(gaps, axis=1)
    side = random.choice([-1.0, 1.0], _STARTS)
    return np.column_stack([pivots, crank, coupler, rocker, point, angles]), side


def _misses(unknowns: FloatArray, side: FloatArray, task: ComplexArray) -> FloatArray:
    """Compute the (n, 2 k) deviation of the coupler point from each point."""
    away = coupler_points(unknowns[:, :9], side, unknowns[:, 9:]) - task
    return np.concatenate([away.real, away.imag], axis=1)


def _solve(unknowns: FloatArray, side: FloatArray, task: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Apply Newton's method with the shortest step; discard linkages that open."""
    for _ in range(_STEPS):
        miss = _misses(unknowns, side, task)
        slopes = np.empty((*miss.shape, unknowns.shape[1]))
        for k in range(unknowns.shape[1]):
            moved = unknowns.copy()
            moved[:, k] += _STEP
            slopes[:, :, k] = (_misses(moved, side, task) - miss) / _STEP
        usable = np.isfinite(miss).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2))
        unknowns, side, miss, slopes = unknowns[usable], side[usable], miss[usable], slopes[usable]
        if not unknowns.size:
            break
        step = -(np.linalg.pinv(slopes, rcond=1e-10) @ miss[:, :, None])[:, :, 0]
        longest = np.abs(step).max(axis=1, keepdims=True)
        unknowns = unknowns + step * np.minimum(1.0, 0.4 / np.maximum(longest, 1e-300))
    return unknowns, side


def _accepted(unknowns: FloatArray, side: FloatArray, task: ComplexArray, smallest_mu_rad: float) -> list[Found]:
    designs, angles = unknowns[:, :9], unknowns[:, 9:]
    with np.errstate(invalid="ignore"):
        miss = np.abs(_misses(unknowns, side, task)).max(axis=1)
        mu = worst_transmission(designs)
        good = (miss < _LARGEST_MISS) & are_crank_rockers(designs) & (mu >= smallest_mu_rad)
        good &= (np.abs(designs[:, :7]) < _LONGEST).all(axis=1) & (designs[:, 4] > 0.02)
    out: list[Found] = []
    for i in np.flatnonzero(good).tolist():
        if _in_order(angles[i]) and all(np.abs(designs[i] - other[1]).max() > 1e-3 for other in out):
            out.append((float(mu[i]), designs[i], float(side[i]), angles[i]))
    return out


def _in_order(angles: FloatArray) -> bool:
    """Return whether a crank turning in one sense meets the angles one after another, apart from each other."""
    for sense in (1.0, -1.0):
        gaps = np.mod(sense * np.diff(np.append(angles, angles[0])), 2.0 * math.pi)
        if (gaps > _APART_RAD).all() and gaps.sum() < 2.5 * math.pi:
            return True
    return False


def _design(entry: Found, centre: complex, size: float, points: ComplexArray) -> PointsDesign:
    _, row, side, angles = entry
    four_bar = FourBarDesign.of_row(row, side, centre, size)
    miss = float(np.abs(four_bar.points(angles) - points).max())
    return PointsDesign(four_bar, tuple(np.mod(angles, 2.0 * math.pi).tolist()), miss)
