"""Optimisation of a four-bar whose coupler curve approximates given points."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import differential_evolution, least_squares

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError
from textile_twin_core.synthesis.four_bar import (
    ComplexArray,
    FourBarDesign,
    are_crank_rockers,
    coupler_points,
    lack_of_turning,
    worst_transmission,
)

_ANGLES = np.linspace(0.0, 2.0 * math.pi, 120, endpoint=False)
_FEWEST, _MOST = 6, 500
_BAD = 1e6
_RUNS = 3
# pivots, lengths and coupler point in units of the curve's size; the sign of the last is the branch
_BOUNDS = [(-3.0, 3.0)] * 4 + [(0.1, 2.0), (0.3, 5.0), (0.3, 5.0), (-3.0, 3.0), (-3.0, 3.0), (-1.0, 1.0)]


@dataclass(frozen=True)
class CurveDesign:
    """The best four-bar: RMS and largest distance of the points from its curve [m], and number of designs tried."""

    four_bar: FourBarDesign
    rms_m: float
    largest_m: float
    designs: int
    stopped: bool


def fit_curve(
    points_m: Sequence[tuple[float, float]],
    seed: int = 0,
    smallest_mu_rad: float = 0.0,
    generations: int = 600,
    progress: Callable[[float], bool | None] | None = None,
) -> CurveDesign:
    """Find the crank-rocker whose coupler curve passes nearest to six or more points [m], at any crank angles.

    Differential evolution searches pivots, lengths, coupler point and branch, all designs of a generation at once, in
    three runs. Least squares over the design and the crank angle of each point then refine the best.

    Args:
        points_m: (n, 2) points [m].
        seed: seed of the search; the same seed gives the same design.
        smallest_mu_rad: smallest allowed transmission angle [rad].
        generations: generations per run.
        progress: called with the completed share; the search stops if it returns True.

    Raises:
        SceneError: for points that are too few, not finite or identical, and if no such crank-rocker is found.

    References:
        Storn and Price 1997: differential evolution.

    Returns:
        The design and its largest distance from the points.

    Examples:
        >>> import numpy as np
        >>> from textile_twin_core.synthesis.curve_fit import fit_curve
        >>> turn = np.arange(8) * np.pi / 4.0
        >>> points = np.stack([0.1 * np.cos(turn), 0.03 * np.sin(turn)], axis=1)  # [m]
        >>> fit_curve(points, generations=200)  # doctest: +SKIP
    """
    points = np.array([complex(*p) for p in points_m])
    if not _FEWEST <= points.size <= _MOST:
        raise SceneError(f"a curve is given by {_FEWEST} to {_MOST} points, not {points.size}")
    if not np.isfinite(points).all():
        raise SceneError("points must be finite coordinates in metres")
    centre, size = complex(points.mean()), float(np.abs(points - points.mean()).max())
    if size == 0.0:
        raise SceneError("the points are one and the same: give points that lie apart")
    task = (points - centre) / size
    tried = 0
    stopped = False

    def cost(columns: FloatArray) -> FloatArray:
        nonlocal tried
        tried += columns.shape[1]
        designs, side = columns[:9].T, np.sign(columns[9])
        return _mean_square(designs, side, task, smallest_mu_rad)

    step = 0

    def report(*_: object, **__: object) -> bool:
        nonlocal step, stopped
        step += 1
        stopped = bool(progress and progress(min(1.0, step / (_RUNS * generations))))
        return stopped

    best: tuple[float, FloatArray, float] | None = None
    for random in np.random.default_rng(seed).spawn(_RUNS):
        found = differential_evolution(
            cost, _BOUNDS, maxiter=generations, popsize=12, tol=1e-6, rng=random, polish=False, vectorized=True,
            updating="deferred", callback=report,
        )  # fmt: skip
        side = float(np.sign(found.x[9]))
        row = _polished(found.x[:9], side, task, smallest_mu_rad)
        value = float(_mean_square(row[None], np.array([side]), task, smallest_mu_rad)[0])
        if best is None or value < best[0]:
            best = value, row, side
        if stopped:
            break
    assert best is not None
    _check(best[1], smallest_mu_rad)
    return _design(best[1], best[2], points, centre, size, tried, stopped)


def _check(row: FloatArray, smallest_mu_rad: float) -> None:
    """Raise SceneError unless the search has reached a crank-rocker within the limit."""
    turns = bool(are_crank_rockers(row[None])[0])
    if not turns or worst_transmission(row[None])[0] < smallest_mu_rad:
        wanted = f" with a transmission angle of at least {math.degrees(smallest_mu_rad):g} deg" if turns else ""
        raise SceneError(f"no crank-rocker{wanted} was found for this curve; lower that limit, or search for longer")


def _mean_square(designs: FloatArray, side: FloatArray, task: ComplexArray, smallest_mu_rad: float) -> FloatArray:
    """Compute the (n,) mean square distance of the points from the curves, with penalties.

    The penalties are on a crank that turns only in part and on a small transmission angle.
    """
    curves = coupler_points(designs, side, _ANGLES)
    away = np.abs(curves[:, None, :] - task[None, :, None]) ** 2
    with np.errstate(invalid="ignore"):
        value = away.min(axis=2).mean(axis=1)
        short = smallest_mu_rad - worst_transmission(designs)
    # Any design within the limit, even one off by the curve's size, ranks before designs beyond the limit.
    beyond = np.where(short > 0.0, 1.0 + 10.0 * short, 0.0)
    unfit = ~are_crank_rockers(designs) | ~np.isfinite(value)
    # Designs that do not turn fully get a gradient towards those that do.
    return np.where(unfit, _BAD * (1.0 + lack_of_turning(designs)), np.nan_to_num(value, nan=_BAD) + beyond)


def _polished(row: FloatArray, side: float, task: ComplexArray, smallest_mu_rad: float) -> FloatArray:
    """Refine design and crank angles by least squares, from the nearest angles on a fine grid."""
    sides = np.array([side])
    fine = np.linspace(0.0, 2.0 * math.pi, 1440, endpoint=False)
    curve = coupler_points(row[None], sides, fine)[0]
    angles = fine[np.abs(curve[:, None] - task[None, :]).argmin(axis=0)]

    def misses(unknowns: FloatArray) -> FloatArray:
        away = coupler_points(unknowns[None, :9], sides, unknowns[None, 9:])[0] - task
        return np.asarray(np.nan_to_num(np.concatenate([away.real, away.imag]), nan=1e3))

    low, high = (np.array([b[k] for b in _BOUNDS[:9]] + [end] * task.size) for k, end in ((0, -np.inf), (1, np.inf)))
    start = np.append(np.clip(row, low[:9] + 1e-9, high[:9] - 1e-9), angles)
    found = least_squares(misses, start, bounds=(low, high), x_scale="jac", max_nfev=300)
    better = found.x[None, :9]
    fits = are_crank_rockers(better)[0] and worst_transmission(better)[0] >= smallest_mu_rad
    return np.asarray(found.x[:9] if fits else row)


def _design(
    row: FloatArray, side: float, points: ComplexArray, centre: complex, size: float, tried: int, stopped: bool
) -> CurveDesign:
    four_bar = FourBarDesign.of_row(row, side, centre, size)
    fine = four_bar.points(np.linspace(0.0, 2.0 * math.pi, 7201))
    away = np.abs(fine[None, :] - points[:, None]).min(axis=1)
    return CurveDesign(four_bar, float(np.sqrt((away**2).mean())), float(away.max()), tried, stopped)
