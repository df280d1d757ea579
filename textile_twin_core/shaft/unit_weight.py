"""Variance of unit weight (Baarda 1968): how much larger or smaller smoothed covariances are, by their residuals."""

from __future__ import annotations

import math

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft.bank import SCALE_SAMPLES
from textile_twin_core.shaft.residual_orders import add_systematic
from textile_twin_core.shaft.status import Record, Records

FIRST_WEIGHT = (1.0, 25.0)  # the factor at first, and the redundant measurements that it counts for
CLIP = 4.0  # residuals beyond two deviations count as two, as outliers are no noise
CLIPPED = 0.9205  # mean of min(z^2, CLIP) of a normal z
LEAST_REDUNDANCY = 0.05
BOUND = 4.0  # of the factor and its inverse: exact readings are no promise for those to come


@compiled_in_place
def _weigh_residual(weight: FloatArray, row: Record) -> float:
    """Take a smoothed row's residual into `weight` (2,), the factor and the redundancy it rests on; the factor."""
    if row.noise > 0.0 and row.residual != 0.0 and abs(row.speed) * row.step > 3.0 * math.sqrt(row.noise):
        redundancy = max(1.0 - (row.covariance[0] - row.systematic[0]) / row.noise, LEAST_REDUNDANCY)
        found = min(row.residual * row.residual / (row.noise * redundancy), CLIP * weight[0]) / CLIPPED
        weight[1] = min(weight[1] + redundancy, SCALE_SAMPLES)
        weight[0] += redundancy / weight[1] * (found - weight[0])
        weight[0] = min(max(weight[0], 1.0 / BOUND), BOUND)
    return float(weight[0])


@compiled_in_place
def scale_covariances(weight: FloatArray, rows: Records) -> None:
    """Multiply the covariances of smoothed rows, but for what no residual shows, by the factor that is known by then.

    `weight` (2,) begins as FIRST_WEIGHT.
    """
    for k in range(rows.size):
        factor = _weigh_residual(weight, rows[k])
        for i in range(9):
            rows[k].covariance[i] *= factor
        add_systematic(rows[k], 1.0 - factor)


def adopt_weight(record: Records, weight: FloatArray) -> None:
    """Make the learnt jitter of the stamps what the residuals of a whole record say."""
    if record["jitter_told"][0] == 0.0:
        record["jitter"] *= weight[0]
