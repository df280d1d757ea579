"""Tolerance analysis: effect of small parameter errors on a design's key figures, singly and together."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.errors import SceneError
from textile_twin_core.synthesis.family import Family

SAMPLES, CORNERS = 20000, 4096
_STEPS = {"m": 1e-6, "rad": 1e-6}
_RELATIVE = 1e-5


class ManyDesigns(Protocol):
    """Evaluator of many designs, such as a `Batch`."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the available results."""
        ...

    def evaluate(self, values: Mapping[str, FloatArray], names: Iterable[str]) -> dict[str, FloatArray]:
        """Compute results by name, each (n,), for values (n,) by name; NaN for an impossible design."""
        ...


@dataclass(frozen=True)
class Limit:
    """Lower or upper limit of a key figure (SI)."""

    number: str
    at_least: bool
    value: float

    def broken(self, values: FloatArray) -> BoolArray:
        """Return (n,) whether values violate the limit; NaN does."""
        with np.errstate(invalid="ignore"):
            kept = values >= self.value if self.at_least else values <= self.value
        return np.asarray(~kept)


@dataclass(frozen=True)
class Spread:
    """Distribution of a key figure: nominal value, mean, standard deviation, 0.5 and 99.5 per cent, and worst case."""

    nominal: float
    mean: float
    sigma: float
    low: float
    high: float
    worst_low: float
    worst_high: float


@dataclass(frozen=True)
class Tolerances:
    """Result of a tolerance analysis: distributions by name, and the share of parts that violate any or each limit."""

    spreads: Mapping[str, Spread]
    scrap_rate: float
    scrap_by_limit: tuple[float, ...]
    samples: int


def sensitivities(
    family: Family, values: Mapping[str, float], batch: ManyDesigns, names: Sequence[str], parameters: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Compute the derivative of each key figure by each parameter (SI), from differences in one batch.

    They are central, and one-sided next to an impossible design, such as a mass below zero.
    """
    units = {p.name: p.unit for p in family.parameters}
    base = _nominal(family, values)
    steps = {p: _STEPS.get(units[p]) or _RELATIVE * (abs(base[p]) or 1.0) for p in parameters}
    columns = {name: np.full(2 * len(parameters) + 1, base[name]) for name in parameters}
    for k, p in enumerate(parameters):
        columns[p][2 * k] += steps[p]
        columns[p][2 * k + 1] -= steps[p]
    found = batch.evaluate(columns, names)
    return {
        name: {p: _slope(v[2 * k + 1], v[-1], v[2 * k], steps[p]) for k, p in enumerate(parameters)}
        for name, v in found.items()
    }


def _slope(below: float, here: float, above: float, step: float) -> float:
    """Compute a derivative from values a step apart; one of the outer ones may be NaN."""
    sides = np.isfinite(below), np.isfinite(above)
    low, high = (below if sides[0] else here), (above if sides[1] else here)
    return float((high - low) / (max(sum(sides), 1) * step)) if any(sides) else float("nan")


def monte_carlo(
    family: Family,
    values: Mapping[str, float],
    batch: ManyDesigns,
    names: Sequence[str],
    tolerances: Mapping[str, float],
    limits: Sequence[Limit] = (),
    samples: int = SAMPLES,
    corners: int = CORNERS,
    seed: int = 0,
) -> Tolerances:
    """Simulate the key figures for parameters within +- their tolerance, and the share of parts that violate a limit.

    Errors are normal with a standard deviation of a third of the tolerance, truncated at the tolerance. The worst case
    is that of all corners of the tolerances, or of `corners` random ones if there are more. Parts that cannot close or
    have a negative mass or length are scrap. The same seed gives the same result.

    Raises:
        SceneError: for a tolerance that is not positive.
    """
    for p, tolerance in tolerances.items():
        if not tolerance > 0.0:
            raise SceneError(f"tolerance of '{p}': must be positive, not {tolerance!r}")
    asked = tuple(dict.fromkeys([*names, *(limit.number for limit in limits)]))
    base, random = _nominal(family, values), np.random.default_rng(seed)
    errors = {p: _cut_normal(random, samples) * tolerance for p, tolerance in tolerances.items()}
    found, ends, nominal = (
        batch.evaluate({p: base[p] + error for p, error in each.items()}, asked)
        for each in (errors, _corners(random, tolerances, corners), {p: np.zeros(1) for p in tolerances})
    )
    broken = [limit.broken(found[limit.number]) for limit in limits]
    closes = np.isfinite(next(iter(found.values())))
    scrap = ~closes if not broken else np.any(broken, axis=0) | ~closes
    return Tolerances(
        {name: _spread(float(nominal[name][0]), found[name], ends[name]) for name in names},
        float(scrap.mean()),
        tuple(float(one.mean()) for one in broken),
        samples,
    )


def _nominal(family: Family, values: Mapping[str, float]) -> dict[str, float]:
    return {p.name: float(values.get(p.name, p.value or 0.0)) for p in family.parameters if p.name in family.searchable}


def _cut_normal(random: np.random.Generator, samples: int) -> FloatArray:
    """Draw normal errors as shares of the tolerance, redrawing those beyond it."""
    drawn = random.standard_normal(samples) / 3.0
    while (beyond := np.abs(drawn) > 1.0).any():
        drawn[beyond] = random.standard_normal(int(beyond.sum())) / 3.0
    return drawn


def _corners(random: np.random.Generator, tolerances: Mapping[str, float], largest_count: int) -> dict[str, FloatArray]:
    if 2 ** len(tolerances) <= largest_count:
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=len(tolerances))))
    else:
        signs = random.choice([-1.0, 1.0], (largest_count, len(tolerances)))
    return {p: signs[:, k] * tolerance for k, (p, tolerance) in enumerate(tolerances.items())}


def _spread(nominal: float, found: FloatArray, corners: FloatArray) -> Spread:
    sound, ends = found[np.isfinite(found)], corners[np.isfinite(corners)]
    if not sound.size:
        return Spread(nominal, *[float("nan")] * 6)
    low, high = np.quantile(sound, [0.005, 0.995])
    extremes = np.concatenate([sound, ends])
    return Spread(
        nominal,
        float(sound.mean()),
        float(sound.std()),
        float(low),
        float(high),
        float(extremes.min()),
        float(extremes.max()),
    )
