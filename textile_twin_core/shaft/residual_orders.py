"""Orders of the turn in what the leading filter leaves: ripple that it does not model, and errors of the sensor.

White residuals, and a sensor's errors that come again each turn, have the same power in all orders; motion's falls.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import SCALE_SAMPLES, set_shaft_second
from textile_twin_core.shaft.clock import set_basis_at
from textile_twin_core.shaft.families import SECOND_ORDER_EVERY, samples_a_turn
from textile_twin_core.shaft.kalman import ROBUST
from textile_twin_core.shaft.measurement_noise import standstill_speed
from textile_twin_core.shaft.status import Record, Records

ORDERS = lanes.WIDEST  # that are listened for at most: as many as the basis has room for
KEEP = 1.0 - 1.0 / SCALE_SAMPLES  # of what is known of an order, at each reading
HEARD = 0.9  # of the samples per turn: orders up to it differ from their aliases, as readings fall elsewhere each turn
SIGNIFICANT = 7.0  # times the mean power of white residuals in an order, exceeded by chance in 1 case of 1000
ABOVE_SENSOR = 20.0  # times the sensor's, by some 12 orders: exceeded by chance in 1 case of 140 000 (F of 2 and 24)
TAIL = 3  # highest modelled orders by which those beyond are foretold, and those before by which their fall is known
TAIL_SAMPLES = 10_000.0  # over which is averaged how much of it is heard
CHANCE = 4.0  # times the mean power of white residuals, that an order may have beyond its own: 1 case of 50
ENDED = 0.2  # part heard, below which the ripple ends with the modelled orders
FEWEST_ORDERS = 5  # by which the sensor's power is known
HIGH_SIGNIFICANT = 14.0  # of orders above the usual ones: in one case of a million
LOG_MEAN, LOG_SIGMA = 0.5772, 1.2825  # of exponentially distributed powers: how far the logarithm's mean is below
# that of their mean, and its standard deviation
FLAT, FALLING = 2.5, 3.5  # deviations by which the lower half's power exceeds the upper's: the sensor's; a motion's
FROM_WHITE = 3.0  # times the power of white residuals, from which the excess begins to count as the sensor's
FALL = (np.arange(ORDERS) / np.arange(1.0, ORDERS + 1.0)) ** 6
"""Of the power of the angle's orders, from one to the next: torque that jumps, but has no peaks, falls as 1 / k."""


@compiled_in_place
def listen_for_orders(status: Record, noise: float) -> None:
    """Average the Fourier coefficients of the leading filter's innovations, scaled to the readings' noise.

    Single large ones count as the filter takes them, or what a restart leaves would have the sensor's flat spectrum.
    """
    m = status.best[status.leading]
    expected = noise + status.prior_variance[m]
    left, most = noise / expected, math.sqrt(ROBUST * status.scale[m] * expected)
    orders = _listened_orders(status, lanes.HIGH)
    set_basis_at(status, status.angle, orders // 2)
    part = 2.0 * math.sqrt(left) * min(max(status.innovation[m], -most), most) / SCALE_SAMPLES
    for i in range(2 * orders):
        status.order_sums[i] = KEEP * status.order_sums[i] + part * status.basis[i]
    status.reading_variance += (status.scale[m] * noise - status.reading_variance) / SCALE_SAMPLES
    status.listened += (1.0 - status.listened) / SCALE_SAMPLES
    if status.leading != status.heard:
        status.heard, status.heard_since = float(status.leading), status.used
    if status.used % SECOND_ORDER_EVERY == 0.0:
        status.order_sums[2 * orders :] = 0.0  # not listened for any more
        _set_sensor_power(status)
        _hear_high_orders(status)
        for f in range(lanes.FAMILIES):
            if status.active[f] > 0.0:
                _part_orders(status, f, left)


@compiled_in_place
def set_sensor_power(record: Records, power: float) -> None:
    """Part the orders anew by the sensor's power, as it is known by the end of a record."""
    status = record[0]
    status.sensor_power = power
    for f in range(1, lanes.FAMILIES if status.listened > 0.0 else 1):
        _part_orders(status, f, 1.0)
        set_shaft_second(status, f)


@compiled_in_place
def set_systematic(status: Record, row: Record) -> None:
    """Set a row's variances of angle, speed, acceleration by orders of which it is not known what they are."""
    power = 1.0 if abs(status.speed) > standstill_speed(status) else 0.0
    for place in range(3):
        row.systematic[place] = power * status.doubt[status.leading, place]
        power *= status.speed**2


@compiled_in_place
def add_systematic(row: Record, part: float) -> None:
    """Add such a part of these variances to a row's covariance."""
    for place in range(3):
        row.covariance[4 * place] += part * row.systematic[place]


@compiled_in_place
def _listened_orders(status: Record, f: int) -> int:
    """As many orders as any family models, and twice as many where `f` is that of high orders, and active."""
    return ORDERS if f == lanes.HIGH and status.active[f] > 0.0 else lanes.MOST_WAVES[-1]


@compiled_in_place
def _top(status: Record, share: float, most: int) -> int:
    """Orders of up to such a share of the samples per turn; half of them are resolved."""
    return min(most, int(share * samples_a_turn(status) / status.lowest))


@compiled_in_place
def _power(status: Record, f: int, k: int) -> float:
    """Squared amplitude of an order, in the ripple of family `f` or in the innovations."""
    if k < status.waves[f]:
        ripple = status.ripple[:, status.best[f]]
        return ripple[2 * k] ** 2 + ripple[2 * k + 1] ** 2
    return (status.order_sums[2 * k] ** 2 + status.order_sums[2 * k + 1] ** 2) / status.listened**2


@compiled_in_place
def _white_power(status: Record) -> float:
    """Mean power of an order in white residuals."""
    variance = status.reading_variance / status.listened
    return 2.0 * variance / SCALE_SAMPLES * (2.0 / status.listened - 1.0)


@compiled_in_place
def _is_sensors(status: Record, k: int) -> bool:
    """Whether an order is a whole one: of cycles of several turns the others are no sensor's."""
    return (k + 1) % int(1.0 / status.lowest + 0.5) == 0


@compiled_in_place
def _own_power(status: Record, k: int) -> float:
    """Power of the sensor's errors in an order."""
    return status.sensor_power if _is_sensors(status, k) else 0.0


@compiled_in_place
def _set_sensor_power(status: Record) -> None:
    """Set the power that the sensor's errors have in each order, by the upper orders; unless too few are resolved.

    By their mean logarithm, to which single peaks, as of gears, are little; as far as it does not fall with the order.
    """
    f, top = status.leading, _top(status, 0.5, lanes.MOST_WAVES[-1])
    first = max(min(status.waves[f], lanes.USUAL_WAVES) // 2, top // 4)
    middle, count, upper, lower, total = (first + top) // 2, 0, 0, 0.0, 0.0
    settled = status.used - status.heard_since > SCALE_SAMPLES
    most = lanes.MOST_WAVES[-1] if status.active[lanes.HIGH] > 0.0 else lanes.USUAL_WAVES
    for k in range(first, top):
        # What another family modelled until lately is not in the averages.
        if _is_sensors(status, k) and (settled or k < status.waves[f] or k >= most):
            power = math.log(max(_power(status, f, k), 1e-300))
            count, total = count + 1, total + power
            upper, lower = upper + (k >= middle), lower + (power if k < middle else 0.0)
    if count < FEWEST_ORDERS or upper == 0 or upper == count:
        return
    sigma = LOG_SIGMA * math.sqrt(1.0 / upper + 1.0 / (count - upper))
    fall = (lower / (count - upper) - (total - lower) / upper) / sigma
    power, white = math.exp(total / count + LOG_MEAN), _white_power(status)
    power = min(max(power - white, 0.0), 1.5 * max(power - FROM_WHITE * white, 0.0))
    status.sensor_power = power * min(max((FALLING - fall) / (FALLING - FLAT), 0.0), 1.0)


@compiled_in_place
def _part_orders(status: Record, f: int, left: float) -> None:
    """Set which part of each order of a family's ripple is the sensor's (Wiener), and variances of what is in doubt."""
    motion = 0.0
    status.doubt[f, :] = 0.0
    for k in range(status.waves[f]):
        own, power = _own_power(status, k), _power(status, f, k)
        motion *= FALL[k]
        if power > own * ABOVE_SENSOR:
            motion = max(power - own, motion)
        part = own / (motion + own) if own > 0.0 else 0.0
        status.sensor_ripple[f, 2 * k] = part * status.ripple[2 * k, status.best[f]]
        status.sensor_ripple[f, 2 * k + 1] = part * status.ripple[2 * k + 1, status.best[f]]
        _doubt_order(status, f, k, part * motion)
    _doubt_higher_orders(status, f, motion, left)


@compiled_in_place
def _doubt_higher_orders(status: Record, f: int, motion: float, left: float) -> None:
    """Of an order that the family does not model all that is motion is error, as far as the filter does not follow it.

    That is what is heard where it is significant, else what the highest modelled orders make probable: `motion` where
    these are partly the sensor's, else their tail, by as much of it as was heard of late (`left`: not followed).
    """
    white, fall, share, heard, expected = _white_power(status), 1.0, 1.0, 0.0, 0.0
    if status.sensor_power == 0.0:
        motion, fall = _tail(status, f)
        share = (1.0 + status.tail_heard) / (1.0 + status.tail_expected)
        share = min(share, 1.0) if share > ENDED else 0.0
    for k in range(status.waves[f], _top(status, 0.5 if status.edges > 0.0 else HEARD, _listened_orders(status, f))):
        own, power = _own_power(status, k), _power(status, f, k)
        motion *= FALL[k] * fall
        heard += motion * (min(power, motion + CHANCE * white) - white) / white**2
        expected += (motion / white) ** 2
        least = max(own * ABOVE_SENSOR, SIGNIFICANT * white)
        _doubt_order(status, f, k, left * (power - own if power > least else min(share * motion, power)))
    if f == status.leading and status.sensor_power == 0.0:
        gain, keep = SECOND_ORDER_EVERY / SCALE_SAMPLES, 1.0 - SECOND_ORDER_EVERY / TAIL_SAMPLES
        status.tail_heard = keep * status.tail_heard + gain * heard
        status.tail_expected = keep * status.tail_expected + gain * expected


@compiled_in_place
def _doubt_order(status: Record, f: int, k: int, power: float) -> None:
    """Add an order of that power to the variances of what is in doubt."""
    squared = (status.lowest * (k + 1)) ** 2
    status.doubt[f, 0] += 0.5 * power
    status.doubt[f, 1] += 0.5 * power * squared
    status.doubt[f, 2] += 0.5 * power * squared**2


@compiled_in_place
def _tail(status: Record, f: int) -> tuple[float, float]:
    """What the highest modelled orders tell of those beyond: power of the next, fall from each to the next beyond FALL.

    0 where the highest are not significant, as they end before; they fall faster where those before them do.
    """
    last, m, power, before, variance = status.waves[f], status.best[f], 0.0, 0.0, 0.0
    if last < 2 * TAIL:
        return 0.0, 0.0
    for k in range(last - 2 * TAIL, last):
        weight = ((k + 1.0) / last) ** 6 / TAIL
        if k < last - TAIL:
            before += weight * _power(status, f, k)
            continue
        power += weight * _power(status, f, k)
        for i in range(2 * k, 2 * k + 2):
            for j in range(i + 1):
                variance += weight * status.scale[m] * status.factor[j, i, m] ** 2
    fall = min((power / before) ** (1.0 / TAIL), 1.0) if before > 0.0 else 1.0
    return (power - variance) * fall if power > SIGNIFICANT * variance else 0.0, fall


@compiled_in_place
def _hear_high_orders(status: Record) -> None:
    """Average whether there are orders of motion from the highest usual one on, in the ripple or in what it leaves."""
    f, heard, white = status.leading, 0.0, _white_power(status)
    settled = status.used - status.heard_since > SCALE_SAMPLES
    if not settled and status.waves[f] < lanes.USUAL_WAVES:
        return
    for k in range(lanes.USUAL_WAVES - 1, _top(status, 0.5, lanes.MOST_WAVES[-1])):
        significant = _power(status, f, k) > max(ABOVE_SENSOR * _own_power(status, k), HIGH_SIGNIFICANT * white)
        if significant and (settled or k < status.waves[f]):
            heard = 1.0
    status.high_orders += (heard - status.high_orders) * SECOND_ORDER_EVERY / SCALE_SAMPLES
