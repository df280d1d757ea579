"""Orders of ripple beyond those of the leading family: more ripple, or errors of the sensor.

A filter takes orders that it does not model for measurement noise, and underestimates the speed's variance. White
residuals have the same power in every order; a significant excess is ripple. An excess that the orders have in common
is the sensor's: pitch errors of teeth, or of an encoder's disc, come again every turn as ripple does, but have the same
power in all orders. The family's orders have their part of it, which is no motion.
"""

from __future__ import annotations

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import set_basis_at
from textile_twin_core.shaft.families import SECOND_ORDER_EVERY, samples_a_turn
from textile_twin_core.shaft.measurement_noise import standstill_speed
from textile_twin_core.shaft.status import Record

ORDERS = lanes.WIDEST  # that are estimated: as many as the basis has room for
ORDER_SAMPLES = 500.0  # readings over which an order is averaged
SIGNIFICANT = 7.0  # times the mean power of white residuals in an order, exceeded by chance in 1 case of 1000
FEWEST_ORDERS = 5  # of the residuals, by which the sensor's are known
ABOVE_WHITE = 3.0  # times white residuals: the mean power of so many orders, from which it is the sensor's
ABOVE_SENSOR = 10.0  # times the mean of 12 orders, exceeded by chance in 1 case of 1400 (F of 2 and 24 freedoms)
FALL = (np.arange(lanes.WIDEST // 2) / np.arange(1.0, lanes.WIDEST // 2 + 1.0)) ** 6
"""Of the power of the angle's orders, from one to the next: torque that jumps, but has no peaks, falls as 1 / k."""


@compiled_in_place
def listen_for_orders(status: Record, noise: float) -> None:
    """Average the Fourier coefficients and the variance of the leading filter's residuals (after its update)."""
    m = status.best[status.leading]
    left = noise / (noise + status.prior_variance[m])
    set_basis_at(status, status.angle, ORDERS // 2)
    residual, keep = 2.0 * left * status.innovation[m] / ORDER_SAMPLES, 1.0 - 1.0 / ORDER_SAMPLES
    for i in range(2 * ORDERS):
        status.order_sums[i] = keep * status.order_sums[i] + residual * status.basis[i]
    status.residual_variance += (status.scale[m] * left * noise - status.residual_variance) / ORDER_SAMPLES
    if status.samples % SECOND_ORDER_EVERY == 0.0:
        status.sensor_power = _sensor_power(status)
        _set_sensor_ripple(status, status.sensor_power / left)


@compiled_in_place
def set_systematic(status: Record, row: Record) -> None:
    """Set a row's variances of angle, speed, acceleration by unmodelled orders, and by those that may be the sensor's.

    Orders up to half the samples per turn: beyond, they are aliases of lower ones.
    """
    for place in range(3):
        row.systematic[place] = 0.0
    if abs(status.speed) <= standstill_speed(status):
        return
    f, least = status.leading, max(SIGNIFICANT * _white_power(status), ABOVE_SENSOR * status.sensor_power)
    for k in range(max(lanes.WAVES[f], _top(status))):
        own = k < lanes.WAVES[f]
        power, rate = _power(status, k), status.lowest * (k + 1) * status.speed
        variance = status.sensor_variance[f, k] if own else 0.5 * power if power > least else 0.0
        if variance > 0.0:
            row.systematic[0] += variance
            row.systematic[1] += variance * rate**2
            row.systematic[2] += variance * rate**4


@compiled_in_place
def add_systematic(row: Record) -> None:
    """Add these variances to a row's covariance."""
    for place in range(3):
        row.covariance[4 * place] += row.systematic[place]


@compiled_in_place
def _top(status: Record) -> int:
    """Orders that the samples resolve."""
    return min(ORDERS, int(0.5 * samples_a_turn(status) / status.lowest))


@compiled_in_place
def _power(status: Record, k: int) -> float:
    """Squared amplitude of an order in the residuals."""
    return status.order_sums[2 * k] ** 2 + status.order_sums[2 * k + 1] ** 2  # type: ignore[no-any-return]


@compiled_in_place
def _white_power(status: Record) -> float:
    """Mean power of an order in white residuals."""
    return 2.0 * status.residual_variance / ORDER_SAMPLES  # type: ignore[no-any-return]


@compiled_in_place
def _sensor_power(status: Record) -> float:
    """Power that the sensor's errors have in each order of the residuals, by the higher ones; 0 where it has none.

    Of cycles of several turns only whole orders come again with the sensor.
    """
    first, top, every = lanes.WAVES[status.leading], _top(status), int(1.0 / status.lowest + 0.5)
    count, total = 0, 0.0
    for k in range(max(first, top // 2), top):
        if (k + 1) % every == 0:
            count, total = count + 1, total + _power(status, k)
    mean, white = total / max(count, 1), _white_power(status)
    return mean - white if count >= FEWEST_ORDERS and mean > ABOVE_WHITE * white else 0.0


@compiled_in_place
def _set_sensor_ripple(status: Record, sensor: float) -> None:
    """Set which part of each order of the ripple is the sensor's, as Wiener's filter tells it from their powers.

    An order's power of motion is what it has beyond the sensor's where that is significant, else what lower orders
    make probable.
    """
    every = int(1.0 / status.lowest + 0.5)
    status.sensor_ripple[:], status.sensor_variance[:] = 0.0, 0.0
    for f in range(1, lanes.FAMILIES if sensor > 0.0 else 1):
        ripple, motion = status.ripple[:, status.best[f]], 0.0
        for k in range(lanes.WAVES[f] if status.active[f] > 0.0 else 0):
            power, own = ripple[2 * k] ** 2 + ripple[2 * k + 1] ** 2, (k + 1) % every == 0
            motion *= FALL[k]
            if power > ABOVE_SENSOR * sensor or not own:
                motion = max(power - sensor, motion)
            part = sensor / (motion + sensor) if own else 0.0
            status.sensor_ripple[f, 2 * k] = part * ripple[2 * k]
            status.sensor_ripple[f, 2 * k + 1] = part * ripple[2 * k + 1]
            status.sensor_variance[f, k] = 0.5 * part * motion
