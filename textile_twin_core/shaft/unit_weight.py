"""Variance of unit weight (Baarda 1968): a factor on smoothed covariances, estimated from the residuals."""

from __future__ import annotations

import math

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft.constants import BOUND, CLIP, CLIPPED, LEAST_REDUNDANCY, SCALE_SAMPLES
from textile_twin_core.shaft.residual_orders import add_systematic
from textile_twin_core.shaft.status import FilterRow, Records


@compiled_in_place
def _weigh_residual(weight: FloatArray, row: FilterRow) -> float:
    """Update `weight` (2,), the factor and its redundancy, with a smoothed row's residual; return the factor."""
    if row.noise > 0.0 and row.residual != 0.0 and abs(row.speed) * row.step > 3.0 * math.sqrt(row.noise):
        redundancy = max(1.0 - (row.covariance[0] - row.systematic[0]) / row.noise, LEAST_REDUNDANCY)
        found = min(row.residual * row.residual / (row.noise * redundancy), CLIP * weight[0]) / CLIPPED
        weight[1] = min(weight[1] + redundancy, SCALE_SAMPLES)
        weight[0] += redundancy / weight[1] * (found - weight[0])
        weight[0] = min(max(weight[0], 1.0 / BOUND), BOUND)
    return float(weight[0])


@compiled_in_place
def scale_covariances(weight: FloatArray, rows: Records) -> None:
    """Multiply the covariances of smoothed rows by the current factor, except the part that no residual shows.

    `weight` (2,) starts as FIRST_WEIGHT.
    """
    for k in range(rows.size):
        factor = _weigh_residual(weight, rows[k])
        for i in range(9):
            rows[k].covariance[i] *= factor
        add_systematic(rows[k], 1.0 - factor)


def adopt_weight(record: Records, weight: FloatArray) -> None:
    """Scale the estimated jitter of the stamps by the factor from the residuals of a whole record."""
    if record["noise"]["jitter_configured"][0] == 0.0:
        record["noise"]["jitter"] *= weight[0]
