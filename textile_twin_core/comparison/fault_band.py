"""Band of a machine's usual turns, and the departure of later turns from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.fault_signatures import KINDS, TurnFeatures

SERIES = (*KINDS, "noise", "profile", "dropout", "stuck")
"""Features watched in each turn."""
ONE_SIDED = np.array([name not in KINDS or name == "blunt_needles" for name in SERIES])
"""Series that count only when they grow; the others count with either sign."""
_LOAD, _PIERCE = SERIES.index("load_force"), SERIES.index("blunt_needles")
_PROFILE, _DROPOUT = SERIES.index("profile"), SERIES.index("dropout")
_FARTHEST = 200.0
_ROUNDING = 1e-6
"""Share of the torque below which its scatter is rounding, as in a simulator."""
_FAR = 8.0
"""Scatters from the median at which the values of learnt turns are clipped."""
SAME_SPEED, _FEWEST = 0.05, 0.05
"""Relative difference within which two speeds are equal; share of the turns at a speed that makes it known."""
_OF_MEDIAN = 0.5 * math.pi
"""Variance of a median over that of a mean."""


@dataclass(frozen=True)
class Band:
    """Statistics of a set of turns.

    Attributes:
        turns: their number. mean, sigma: (series,) of one turn.
        profile_Nm, profile_sigma_Nm: (BINS,) residual by shaft angle that no signature explains.
        residual_Nm: (BINS,) whole residual by shaft angle.
        usual_count: samples in a turn. speeds_rad_s: (turns,) of each. least_noise_Nm: noise below it is rounding.
    """

    turns: int
    mean: FloatArray
    sigma: FloatArray
    profile_Nm: FloatArray
    profile_sigma_Nm: FloatArray
    residual_Nm: FloatArray
    usual_count: float
    speeds_rad_s: FloatArray
    least_noise_Nm: float

    def rows(self, turns: TurnFeatures) -> FloatArray:
        """The watched series of turns, (t, series)."""
        away = np.nan_to_num(turns.profile_Nm - self.profile_Nm) / self.profile_sigma_Nm
        # The sampling rate is constant in time, so a slower turn holds more samples.
        full = turns.count * np.abs(turns.speed_rad_s) / max(self.usual_count, 1.0)
        sizes = turns.sizes.copy()
        # Cloth that differs moves the pierce by between nothing and its own share: the smaller growth is the needles'.
        sizes[:, _PIERCE] += np.minimum(sizes[:, _LOAD] - self.mean[_LOAD], 0.0)
        return np.column_stack(
            [
                sizes,
                np.log(np.maximum(turns.noise_Nm, self.least_noise_Nm)),
                np.log(np.maximum(np.mean(away**2, axis=1), 1e-3)),
                -full,
                turns.stuck,
            ]
        )

    def knows_speed(self, speed_rad_s: float) -> bool:
        """Return true if enough of the turns were made at this speed."""
        near = np.abs(self.speeds_rad_s - speed_rad_s) < SAME_SPEED * abs(speed_rad_s)
        return bool(np.mean(near) >= _FEWEST)


def band_of(learnt: Sequence[TurnFeatures], torque_Nm: float, memory_turns: float, first: Band | None = None) -> Band:
    """Learn the band of a set of turns.

    Args:
        learnt: the turns. torque_Nm: size of the machine's torque. memory_turns: length of the moving mean.
        first: a band of more turns. The new band is no narrower, and wider as its mean over fewer turns is less
            certain.
    """
    turns = TurnFeatures.joined(learnt)
    profiles = np.nan_to_num(turns.profile_Nm)  # bins without samples, beside a discontinuity of the load
    profile = np.median(profiles, axis=0)
    spread = 1.4826 * np.median(np.abs(profiles - profile), axis=0)
    spread = np.maximum(spread, max(0.3 * float(np.median(spread)), _ROUNDING * torque_Nm))
    if first is not None:
        spread = np.maximum(spread, first.profile_sigma_Nm)
    mean = np.zeros(len(SERIES))
    mean[: len(KINDS)] = np.median(turns.sizes, axis=0)
    bare = Band(
        turns=len(learnt),
        mean=mean,
        sigma=np.ones(len(SERIES)),
        profile_Nm=profile,
        profile_sigma_Nm=spread,
        residual_Nm=np.median(np.nan_to_num(turns.by_angle_Nm[:, 0]), axis=0),
        usual_count=float(np.median(turns.count)),
        speeds_rad_s=turns.speed_rad_s,
        least_noise_Nm=_ROUNDING * torque_Nm,
    )
    rows = bare.rows(turns)
    mean = np.median(rows, axis=0)
    sigma = _scatter(rows, mean, torque_Nm, memory_turns)
    if first is not None:
        # Beside a fault a series may alternate between two values: its full scatter counts, about the mean.
        mean, sigma = np.mean(rows, axis=0), np.maximum(sigma, np.std(rows, axis=0))
        # The few learnt turns lie closer to their own mean profile than later turns.
        mean[_PROFILE] = max(mean[_PROFILE], first.mean[_PROFILE])
        moving = moving_spread(memory_turns) ** 2
        wider = (moving + 1.0 / len(learnt)) / (moving + _OF_MEDIAN / first.turns)
        sigma = np.maximum(sigma, first.sigma) * math.sqrt(max(wider, 1.0))
    return replace(bare, mean=mean, sigma=sigma)


def moving_spread(memory_turns: float) -> float:
    """Standard deviation of an exponentially weighted mean, over that of one turn."""
    share = 1.0 / memory_turns
    return math.sqrt(share / (2.0 - share))


def _scatter(rows: FloatArray, mean: FloatArray, torque_Nm: float, memory_turns: float) -> FloatArray:
    """Scatter of a turn, enlarged where neighbouring turns are correlated, since their mean then scatters more."""
    alone = 1.4826 * np.median(np.abs(rows - mean), axis=0)
    floor = np.array([1e-4, 1e-4 * torque_Nm, 1e-4, 1e-5, 1e-4, 0.03, 0.05, 0.02 * abs(mean[_DROPOUT]) + 1e-6, 0.03])
    # Without clipping a single outlier would widen the band for good.
    far = _FAR * np.maximum(alone, floor)
    rows = np.clip(rows, mean - far, mean + far)
    block = min(max(2, round(memory_turns)), rows.shape[0])
    means = rows[: rows.shape[0] // block * block].reshape(-1, block, rows.shape[1]).mean(axis=1)
    together = np.std(means, axis=0) * math.sqrt(block)
    return np.asarray(np.maximum(np.maximum(alone, together), floor))


class Departure:
    """Exponentially weighted moving mean of the departures of turns from a band (Roberts 1959)."""

    def __init__(self, band: Band, memory_turns: float) -> None:
        self.band, self._memory_turns = band, memory_turns
        self._moving = np.zeros(len(SERIES))

    @property
    def sigmas(self) -> FloatArray:
        """Departure (series,) in its standard deviations."""
        return np.asarray(self._moving / moving_spread(self._memory_turns))

    @property
    def away(self) -> FloatArray:
        """Departure in its standard deviations, without the sign where both signs count."""
        return np.where(ONE_SIDED, self.sigmas, np.abs(self.sigmas))

    @property
    def size(self) -> FloatArray:
        """Departure (series,) in the units of the series, without the sign where both signs count."""
        size = self._moving * self.band.sigma
        return np.where(ONE_SIDED, size, np.abs(size))

    def take(self, turn: TurnFeatures) -> None:
        """Add one turn."""
        departure = (self.band.rows(turn)[0] - self.band.mean) / self.band.sigma
        # One large departure moves the mean at once; a lasting small one moves it in time.
        self._moving += (np.clip(departure, -_FARTHEST, _FARTHEST) - self._moving) / self._memory_turns
