"""Dimensional synthesis of a crank-rocker for a swing and a crank rotation, and selection of the best designs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError
from textile_twin_core.synthesis.crank_rocker_family import CrankRockerFamily, LinkRatios

LARGEST_DEVIATION_RAD = float(np.radians(40.0))
"""Largest deviation of a good design's transmission angle from 90 deg [rad]."""

WANTED_RATIO = 0.3
"""Crank over coupler of a good beat-up: sufficient acceleration at the fell with tolerable bearing loads."""

_WHOLE_DEGREE_SLACK = 1e-9
_SAME_ANGLE_RAD = 1e-9


@dataclass(frozen=True)
class LinkLengths:
    """Lengths of a crank-rocker [m]."""

    crank_m: float
    coupler_m: float
    rocker_m: float
    ground_m: float


@dataclass(frozen=True)
class CrankRockerDesign:
    """One crank-rocker: lengths over the ground link, angles in radians, worst transmission angle."""

    beta_rad: float
    crank: float
    coupler: float
    rocker: float
    crank_over_coupler: float
    mu_min_rad: float

    @property
    def deviation_rad(self) -> float:
        """Deviation of the transmission angle from 90 deg [rad]."""
        return np.pi / 2 - self.mu_min_rad

    @property
    def grashof(self) -> str:
        """`crank-rocker`, or `change point` where the four links can lie in one line (mu_min is 0)."""
        return "crank-rocker" if self.mu_min_rad > 1e-7 else "change point"

    def scaled(self, ground_m: float) -> LinkLengths:
        """Return the lengths in metres for a ground link of `ground_m`. Raises SceneError unless that is a length."""
        if not 0.0 < ground_m < np.inf:
            raise SceneError(f"ground link {ground_m:g} m: give a positive length")
        ratios = (self.crank, self.coupler, self.rocker, 1.0)
        return LinkLengths(*(ratio * ground_m for ratio in ratios))

    def to_json(self, ground_m: float | None = None) -> dict[str, Any]:
        """Return the design by the symbols of the paper.

        These are a crank, b coupler, c rocker over the ground link, and r/l crank over coupler. With `ground_m`, the
        lengths in metres are included.
        """
        lengths = {} if ground_m is None else asdict(self.scaled(ground_m))
        return {
            "beta_deg": _rounded_degrees(self.beta_rad),
            "beta_rad": self.beta_rad,
            "a": self.crank,
            "b": self.coupler,
            "c": self.rocker,
            "r_over_l": self.crank_over_coupler,
            "mu_min_deg": float(np.degrees(self.mu_min_rad)),
            "mu_min_rad": self.mu_min_rad,
            "deviation_deg": float(np.degrees(self.deviation_rad)),
            "grashof": self.grashof,
            **lengths,
        }


@dataclass(frozen=True)
class CrankRockerSynthesis:
    """Designs for a swing and a crank rotation.

    Attributes:
        designs: designs of every whole degree of beta; where phi = 180 deg + psi the one of best transmission (Eq.
            10-14).
        best: member of `designs` with a transmission angle within 40 deg of 90 and crank over coupler nearest 0.3, or
            None.
        best_continuous: the same criterion over the whole family.
        best_transmission: largest mu_min of all; None at phi = 180 deg, where mu_min grows as the crank vanishes.
    """

    family: CrankRockerFamily
    designs: tuple[CrankRockerDesign, ...]
    best: CrankRockerDesign | None
    best_continuous: CrankRockerDesign | None
    best_transmission: CrankRockerDesign | None

    @property
    def case(self) -> str:
        """Case of the paper's four."""
        imbalance = self.family.imbalance_rad
        if self.family.single_beta:
            return "phi = 180 + psi"
        if imbalance == 0.0:
            return "phi = 180"
        return "phi > 180" if imbalance > 0.0 else "phi < 180"

    def to_json(self, ground_m: float | None = None) -> dict[str, Any]:
        """Return task, bounds on beta, `designs`, `best`, `best_continuous` and `best_transmission` as one object.

        With `ground_m`, each design includes its lengths in metres.
        """
        family = self.family
        low, high = family.beta_bounds_rad
        return {
            "kind": "crank-rocker",
            "swing_rad": family.swing_rad,
            "rotation_rad": np.pi + family.imbalance_rad,
            "swing_deg": _rounded_degrees(family.swing_rad),
            "rotation_deg": _rounded_degrees(np.pi + family.imbalance_rad),
            "case": self.case,
            "beta_bounds_rad": [low, high],
            "beta_bounds_deg": [_rounded_degrees(low), _rounded_degrees(high)],
            "designs": [design.to_json(ground_m) for design in self.designs],
            "best": _json_or_none(self.best, ground_m),
            "best_continuous": _json_or_none(self.best_continuous, ground_m),
            "best_transmission": _json_or_none(self.best_transmission, ground_m),
        }


def crank_rocker(swing_rad: float, rotation_rad: float) -> CrankRockerSynthesis:
    """Synthesise all crank-rockers whose rocker swings by an angle while the crank turns by another.

    With the crank pivot on the left, the rocker pivot on the right and the joint of coupler and rocker above them, a
    crank that turns counter-clockwise takes the rotation from the stretched to the folded dead centre.

    Args:
        swing_rad: swing of the rocker [rad].
        rotation_rad: rotation of the crank for it [rad].

    Returns:
        The designs, and the best of them.

    Raises:
        SceneError: if no beta is admissible.

    References:
        Topalbekiroglu and Celik 2010, Eq. 1-18, after Khare and Dave 1978; continued beyond phi = 180 deg + psi.

    Examples:
        >>> import math
        >>> from textile_twin_core.synthesis.crank_rocker import crank_rocker
        >>> best = crank_rocker(math.radians(30.0), math.pi).best
        >>> round(math.degrees(best.mu_min_rad), 1)  # [deg]
        67.2
    """
    if not np.isfinite(swing_rad) or not np.isfinite(rotation_rad):
        raise SceneError("swing and rotation must be finite numbers")
    family = CrankRockerFamily(float(swing_rad), float(rotation_rad) - np.pi)
    peak = _best_transmission_ratio(family)
    designs = _whole_degrees(family, peak)
    good = [design for design in designs if design.deviation_rad < LARGEST_DEVIATION_RAD]
    best = min(good, key=lambda design: abs(design.crank_over_coupler - WANTED_RATIO), default=None)
    return CrankRockerSynthesis(
        family=family,
        designs=designs,
        best=best,
        best_continuous=_best_continuous(family, peak),
        best_transmission=_records(family.at_ratio(peak))[0] if family.imbalance_rad else None,
    )


def best_rotation(swing_rad: float) -> float:
    """Find the crank rotation [rad] of the best transmission angle for this swing and r/l = 0.3.

    With this ratio the criteria of Topalbekiroglu and Celik 2010 determine all but the rotation. Away from 180 deg one
    of the two extreme transmission angles grows and the other falls, so 180 deg is best wherever it is admissible.

    Raises:
        SceneError: for a swing that no crank-rocker has.
    """
    centric = CrankRockerFamily(swing_rad, 0.0)

    def mu_min(imbalance_rad: float) -> float:
        family = CrankRockerFamily(swing_rad, imbalance_rad)
        if family.smallest_ratio >= WANTED_RATIO:
            return 0.0
        return float(family.at_ratio(WANTED_RATIO).mu_min_rad[0])

    low, high = swing_rad / 2 - np.pi / 2, np.pi / 2 + swing_rad / 2
    grid = np.linspace(low, high, 361)[1:-1]
    top = float(grid[int(np.argmax([mu_min(x) for x in grid.tolist()]))])
    step = float(grid[1] - grid[0])
    found = minimize_scalar(
        lambda x: -mu_min(x), bounds=(max(low, top - step), min(high, top + step)), method="bounded"
    )
    best = max((0.0, top, float(found.x)), key=mu_min)
    return np.pi + (best if mu_min(best) > mu_min(0.0) + _SAME_ANGLE_RAD else centric.imbalance_rad)


def _records(links: LinkRatios) -> tuple[CrankRockerDesign, ...]:
    columns = (
        links.beta_rad,
        links.crank,
        links.coupler,
        links.rocker,
        links.crank_over_coupler,
        links.mu_min_rad,
    )
    return tuple(CrankRockerDesign(*row) for row in zip(*(column.tolist() for column in columns), strict=True))


def _whole_degrees(family: CrankRockerFamily, peak: float) -> tuple[CrankRockerDesign, ...]:
    if family.single_beta:
        return _records(family.at_ratio(peak))
    low, high = np.degrees(family.beta_bounds_rad)
    first, last = np.ceil(low - _WHOLE_DEGREE_SLACK), np.floor(high + _WHOLE_DEGREE_SLACK)
    beta: FloatArray = np.radians(np.arange(first, last + 1.0))
    ratio = family.ratio_at(beta)
    # Whole degrees at a change point are treated as exact, despite their rounding in radians.
    ratio[np.abs(beta - (np.pi / 2 - family.swing_rad / 2)) < np.radians(_WHOLE_DEGREE_SLACK)] = 1.0
    # At phi = 180 deg, beta = 0 would give a crank of zero length.
    return _records(family.at_ratio(ratio[ratio > 0.0]))


def _json_or_none(design: CrankRockerDesign | None, ground_m: float | None) -> dict[str, Any] | None:
    return design.to_json(ground_m) if design else None


def _mu_min(family: CrankRockerFamily) -> Callable[[float], float]:
    return lambda ratio: float(family.at_ratio(ratio).mu_min_rad[0])


def _best_transmission_ratio(family: CrankRockerFamily) -> float:
    """Find the ratio of the largest mu_min, which rises from one change point and falls to the other."""
    mu_min, smallest = _mu_min(family), family.smallest_ratio
    if family.single_beta:
        # Eq. 11 and 12: b^2 = a (1 + a).
        crank = np.sin(family.swing_rad / 2)
        return float(np.sqrt(crank / (1 + crank)))
    if 1.0 - smallest < 1e-12:
        return 1.0
    grid = np.linspace(smallest, 1.0, 65)[1:-1]
    top = int(np.argmax(family.at_ratio(grid).mu_min_rad))
    around = (grid[top - 1] if top else smallest, grid[top + 1] if top + 1 < len(grid) else 1.0)
    low = max(around[0], np.finfo(float).tiny)
    found = minimize_scalar(lambda r: -mu_min(r), bounds=(low, around[1]), method="bounded", options={"xatol": 1e-13})
    return float(found.x)


def _best_continuous(family: CrankRockerFamily, peak: float) -> CrankRockerDesign | None:
    mu_min, smallest_mu = _mu_min(family), np.pi / 2 - LARGEST_DEVIATION_RAD
    if mu_min(peak) < smallest_mu:
        return None
    ratio = max(WANTED_RATIO, family.smallest_ratio)
    if mu_min(ratio) < smallest_mu:
        # The nearest ratio with a good transmission angle lies between the wanted ratio and the peak.
        ratio = brentq(lambda r: mu_min(r) - smallest_mu, ratio, peak, xtol=1e-15)
    return _records(family.at_ratio(ratio))[0]


def _rounded_degrees(angle_rad: float) -> float:
    """Convert to degrees without the rounding of radians: 48, not 48.00000000000001."""
    return round(float(np.degrees(angle_rad)), 12)
