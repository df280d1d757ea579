"""All crank-rockers of a given rocker swing and crank rotation, in a form without a singular case."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError

ROUNDING_RAD = 4e-15
"""Rounding of a rotation [rad]: a value closer than this to pi or to pi + swing is taken as exactly that."""


@dataclass(frozen=True)
class LinkRatios:
    """Crank-rockers as arrays of one shape (n,): lengths over the ground link, angles in radians.

    `beta_rad` is the angle at the crank pivot from the ground link to the stretched line of crank and coupler.
    `mu_min_rad` is the smallest of the extreme transmission angles, with the crank pointing at the rocker pivot and
    away from it, and of their supplements.
    """

    beta_rad: FloatArray
    crank: FloatArray
    coupler: FloatArray
    rocker: FloatArray
    crank_over_coupler: FloatArray
    mu_min_rad: FloatArray


@dataclass(frozen=True)
class CrankRockerFamily:
    """The one-parameter family of crank-rockers with swing psi and crank rotation phi = pi + imbalance.

    The equations of Khare and Dave (Topalbekiroglu and Celik 2010, Eq. 1-3) take the angle beta as the parameter and
    divide by cos(phi/2 - psi/2), which vanishes at phi = 180 deg + psi. With the ratio r of crank to coupler as the
    parameter, d = (psi - imbalance)/2 and h^2 = r^2 cos^2 d + sin^2 d they become

        coupler = sin(psi/2)/h,  crank = r coupler,  beta + imbalance/2 = atan2(r cos d, sin d),

    valid in every case. The ratio r runs from |tan d tan(imbalance/2)| to 1, both of them change points.
    """

    swing_rad: float
    imbalance_rad: float

    def __post_init__(self) -> None:
        swing, imbalance = self.swing_rad, self.imbalance_rad
        if not 0.0 < swing < np.pi:
            raise SceneError(
                f"swing {np.degrees(swing):g} deg: a crank-rocker swings more than 0 and less than 180 deg"
            )
        if abs(imbalance) <= ROUNDING_RAD:
            object.__setattr__(self, "imbalance_rad", 0.0)
        elif abs(imbalance - swing) <= ROUNDING_RAD:
            object.__setattr__(self, "imbalance_rad", swing)
        low, high = np.pi / 2 + swing / 2, 3 * np.pi / 2 + swing / 2
        if not low - ROUNDING_RAD <= np.pi + imbalance <= high + ROUNDING_RAD:
            raise SceneError(
                f"rotation {np.degrees(np.pi + imbalance):g} deg: no admissible beta; for a swing of"
                f" {np.degrees(swing):g} deg give one from {np.degrees(low):g} to {np.degrees(high):g} deg"
            )

    @property
    def skew_rad(self) -> float:
        """The angle d = (psi - imbalance)/2; zero where phi = 180 deg + psi."""
        return (self.swing_rad - self.imbalance_rad) / 2

    @property
    def single_beta(self) -> bool:
        """True if phi = 180 deg + psi: every member has the same beta, the coupler is free (Eq. 10-11)."""
        return self.imbalance_rad == self.swing_rad

    @property
    def smallest_ratio(self) -> float:
        """Crank over coupler at the far change point; 0 (no crank, or an endless coupler) is not a member."""
        return min(1.0, float(abs(np.tan(self.skew_rad) * np.tan(self.imbalance_rad / 2))))

    @property
    def beta_bounds_rad(self) -> tuple[float, float]:
        """Smallest and largest beta, closed: Eq. 6 and 8, continued beyond phi = 180 deg + psi."""
        change = np.pi / 2 - self.swing_rad / 2
        if self.single_beta:
            return change, change
        if self.imbalance_rad > self.swing_rad:
            return change, max(change, np.pi - self.imbalance_rad)
        return min(change, max(0.0, -self.imbalance_rad)), change

    def ratio_at(self, beta_rad: FloatArray | float) -> FloatArray:
        """Compute crank over coupler at beta (n,), clipped to the family's range; meaningless where `single_beta`."""
        ratio = np.tan(np.asarray(beta_rad, dtype=np.float64) + self.imbalance_rad / 2) * np.tan(self.skew_rad)
        return np.asarray(np.clip(ratio, self.smallest_ratio, 1.0), dtype=np.float64)

    def at_ratio(self, crank_over_coupler: FloatArray | float) -> LinkRatios:
        """Return the members with these ratios of crank to coupler (n,), in [`smallest_ratio`, 1] and above 0."""
        ratio = np.atleast_1d(np.asarray(crank_over_coupler, dtype=np.float64))
        cos_d, sin_d = np.cos(self.skew_rad), np.sin(self.skew_rad)
        middle = np.arctan2(ratio * cos_d, sin_d)
        # One of these two angles is zero at each change point: return zero, not its rounding.
        beta = np.maximum(middle - self.imbalance_rad / 2, 0.0)
        folded = np.maximum(middle + self.imbalance_rad / 2, 0.0)
        coupler = np.sin(self.swing_rad / 2) / np.hypot(ratio * cos_d, sin_d)
        crank = ratio * coupler
        rocker = np.hypot(crank + coupler - np.cos(beta), np.sin(beta))

        # Heron's factors with the crank on the ground line, in the dead-centre angles, without cancellation.
        height = 2 * coupler * np.sqrt((1 - ratio) * (1 + ratio))
        sin_towards = height * np.sin(beta / 2) * np.cos(folded / 2)
        sin_away = height * np.cos(beta / 2) * np.sin(folded / 2)
        middle_cos = coupler**2 + crank * coupler - (crank + coupler) * np.cos(beta)
        towards = np.arctan2(sin_towards, middle_cos + crank)
        away = np.arctan2(sin_away, middle_cos - crank)
        smallest = np.minimum(np.minimum(towards, np.pi - towards), np.minimum(away, np.pi - away))
        return LinkRatios(beta, crank, coupler, rocker, ratio, smallest)
