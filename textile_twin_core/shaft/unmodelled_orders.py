"""Orders of ripple that the leading family does not model: found in its residuals, added to the state's covariance.

A filter takes orders that it does not model for measurement noise, and underestimates the speed's variance. White
residuals have the same power in every order; a significant excess is ripple.
"""

from __future__ import annotations

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import set_basis_at
from textile_twin_core.shaft.families import samples_a_turn
from textile_twin_core.shaft.measurement_noise import standstill_speed
from textile_twin_core.shaft.status import Record

ORDERS = lanes.WIDEST  # that are estimated: as many as the basis has room for
ORDER_SAMPLES = 500.0  # readings over which an order is averaged
SIGNIFICANT = 7.0  # times the mean power of white residuals in an order, exceeded by chance in 1 case of 1000
FEWEST_ORDERS, ABOVE_FLOOR = 8, 3.0
"""The highest third of that many orders or more gives the floor common to all (pitch errors); ripple is so many times
above it."""


@compiled_in_place
def listen_for_orders(status: Record, noise: float) -> None:
    """Average the Fourier coefficients and the variance of the leading filter's residuals (after its update)."""
    m = status.best[status.leading]
    left = noise / (noise + status.prior_variance[m])
    set_basis_at(status, status.angle, ORDERS // 2)
    residual = 2.0 * left * status.innovation[m] / ORDER_SAMPLES
    for i in range(2 * ORDERS):
        status.order_sums[i] += residual * status.basis[i] - status.order_sums[i] / ORDER_SAMPLES
    status.residual_variance += (status.scale[m] * left * noise - status.residual_variance) / ORDER_SAMPLES


@compiled_in_place
def add_unmodelled(status: Record, row: Record) -> None:
    """Set a row's variances of angle, speed, acceleration by unmodelled orders, and add them to its covariance.

    Orders up to half the samples per turn: beyond, they are aliases of lower ones.
    """
    for place in range(3):
        row.unmodelled[place] = 0.0
    if abs(status.speed) <= standstill_speed(status):
        return
    first, top = lanes.WAVES[status.leading], min(ORDERS, int(0.5 * samples_a_turn(status) / status.lowest))
    high, floor = (top - first) // 3 if top - first >= FEWEST_ORDERS else 0, 0.0
    for k in range(top - high, top):
        floor += _power(status, k) / high
    least = max(2.0 * SIGNIFICANT * status.residual_variance / ORDER_SAMPLES, ABOVE_FLOOR * floor)
    for k in range(first, top):
        power, rate = _power(status, k), status.lowest * (k + 1) * status.speed
        if power > least:
            row.unmodelled[0] += 0.5 * power
            row.unmodelled[1] += 0.5 * power * rate**2
            row.unmodelled[2] += 0.5 * power * rate**4
    add_unmodelled_again(row)


@compiled_in_place
def _power(status: Record, k: int) -> float:
    """Squared amplitude of an order in the residuals."""
    return status.order_sums[2 * k] ** 2 + status.order_sums[2 * k + 1] ** 2  # type: ignore[no-any-return]


@compiled_in_place
def add_unmodelled_again(row: Record) -> None:
    """Add the variances of unmodelled orders to a row's covariance."""
    for place in range(3):
        row.covariance[4 * place] += row.unmodelled[place]
