"""Orders of ripple that the leading family lacks: they show in what it leaves of innovations; the state is off by them.

A filter without them takes them for noise of the readings, which foretells best where they are too fast to follow, and
is sure of a speed that ripples. What white innovations leave has as much of each order as the next; what is beyond is
ripple.
"""

from __future__ import annotations

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import set_basis_at
from textile_twin_core.shaft.families import samples_a_turn
from textile_twin_core.shaft.measurement_noise import standstill_speed
from textile_twin_core.shaft.status import Record

ORDERS = lanes.WIDEST
"""That are listened for: as many as the basis has room for."""
ORDER_SAMPLES = 500.0
"""Readings over which an order is averaged."""
BEYOND = 7.0
"""So many times what white noise has of an order on average is ripple: these have it in one case of 1000."""
MANY, ABOVE = 8, 3.0
"""Orders whose highest third tells what all have, as an encoder's pitch errors do; ripple is so many times more."""


@compiled
def listen_for_orders(status: Record, noise: float) -> None:
    """Take note of what the leading family's best filter left of its newest innovation: the rest it followed."""
    m = status.best[status.leading]
    left = noise / (noise + status.prior_variance[m])
    set_basis_at(status, status.angle, ORDERS // 2)
    off = 2.0 * left * status.innovation[m] / ORDER_SAMPLES
    for i in range(2 * ORDERS):
        status.order_sums[i] += off * status.basis[i] - status.order_sums[i] / ORDER_SAMPLES
    status.residual_variance += (status.scale[m] * left * noise - status.residual_variance) / ORDER_SAMPLES


@compiled
def add_unmodelled(status: Record, row: Record) -> None:
    """Set variances of a row's angle, speed, acceleration by orders that are heard and lacked; add them to its state's.

    Up to half the samples of a turn: beyond, an order cannot be told from a lower one.
    """
    for place in range(3):
        row.unmodelled[place] = 0.0
    if abs(status.speed) <= standstill_speed(status):
        return
    first, top = lanes.WAVES[status.leading], min(ORDERS, int(0.5 * samples_a_turn(status) / status.lowest))
    high, level = (top - first) // 3 if top - first >= MANY else 0, 0.0
    for k in range(top - high, top):
        level += _power(status, k) / high
    least = max(2.0 * BEYOND * status.residual_variance / ORDER_SAMPLES, ABOVE * level)
    for k in range(first, top):
        power, rate = _power(status, k), status.lowest * (k + 1) * status.speed
        if power > least:
            row.unmodelled[0] += 0.5 * power
            row.unmodelled[1] += 0.5 * power * rate**2
            row.unmodelled[2] += 0.5 * power * rate**4
    add_unmodelled_again(row)


@compiled
def _power(status: Record, k: int) -> float:
    """Square of the amplitude that is heard of an order."""
    return status.order_sums[2 * k] ** 2 + status.order_sums[2 * k + 1] ** 2  # type: ignore[no-any-return]


@compiled
def add_unmodelled_again(row: Record) -> None:
    """Add what a row's state lacks to its covariance, which was told anew."""
    for place in range(3):
        row.covariance[4 * place] += row.unmodelled[place]
