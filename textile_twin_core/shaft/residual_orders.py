"""Orders of the turn in the leading filter's residuals: unmodelled ripple, and errors of the sensor.

White residuals, and sensor errors that repeat each turn, have the same power in all orders; the power of motion falls.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import layout
from textile_twin_core.shaft.constants import (
    ABOVE_SENSOR,
    FALL,
    FALLING,
    FEWEST_ORDERS,
    FLAT,
    FROM_WHITE,
    HIGH_SIGNIFICANT,
    KEEP_ORDER,
    LOG_MEAN,
    LOG_SIGMA,
    NORMAL_MEDIAN,
    OMITTED,
    ORDERS,
    RESOLVED_SHARE,
    RIPPLE_SIZE,
    ROBUST,
    SCALE_SAMPLES,
    SECOND_ORDER_EVERY,
    SEEN_CYCLES,
    SIMPLER_EVIDENCE,
    TAIL_ORDERS,
)
from textile_twin_core.shaft.filter_bank import set_shaft_second
from textile_twin_core.shaft.model_bank import samples_a_turn
from textile_twin_core.shaft.ripple import set_basis_at
from textile_twin_core.shaft.status import Bank, FilterRow, FilterStatus, Models, Orders, Records, Sampling
from textile_twin_core.shaft.turns import TURN

PIECE = 4_096  # rows whose coefficients are summed at once: as many as a cache holds


@compiled_in_place
def average_orders(bank: Bank, orders: Orders, sampling: Sampling, angle: float, noise: float) -> None:
    """Average the Fourier coefficients of the leading filter's innovations, scaled to the readings' noise.

    Large single innovations are clipped as in the filter: otherwise a restart would leave the flat spectrum of a
    sensor.
    """
    filters, models, basis = bank.filters, bank.models, bank.wave.basis
    m = models.best[models.leading]
    expected = noise + filters.prior_variance[m]
    unfollowed, most = noise / expected, math.sqrt(ROBUST * filters.scale[m] * expected)
    count = _averaged_orders(models, layout.HIGH)
    set_basis_at(bank.wave, angle, count // 2)
    part = 2.0 * math.sqrt(unfollowed) * min(max(filters.innovation[m], -most), most) / SCALE_SAMPLES
    for i in range(2 * count):
        orders.sums[i] = KEEP_ORDER * orders.sums[i] + part * basis[i]
    orders.reading_variance += (filters.scale[m] * noise - orders.reading_variance) / SCALE_SAMPLES
    orders.average_weight += (1.0 - orders.average_weight) / SCALE_SAMPLES
    if models.leading != orders.averaged_model:
        orders.averaged_model, orders.averaged_since = float(models.leading), sampling.used
    if sampling.used % SECOND_ORDER_EVERY == 0.0:
        orders.sums[2 * count :] = 0.0  # no longer averaged
        _set_sensor_power(bank, orders, sampling)
        _detect_high_orders(bank, orders, sampling)
        for f in range(layout.MODELS):
            if models.active[f] > 0.0:
                _part_observed_orders(bank, orders, sampling, f, unfollowed)


@compiled_in_place
def set_sensor_power(status: FilterStatus, power: float) -> None:
    """Divide the orders between sensor and motion by the sensor's power known at the end of a record."""
    bank, orders, sampling = status.bank, status.orders, status.sampling
    orders.sensor_power = power
    for f in range(1, layout.MODELS if orders.average_weight > 0.0 else 1):
        _part_observed_orders(bank, orders, sampling, f, 1.0)
        set_shaft_second(bank.models, f)


@compiled_in_place
def set_systematic(models: Models, row: FilterRow, speed: float, least: float) -> None:
    """Set a row's variances by orders of uncertain origin, at a speed [rad/s] that is no standstill above `least`."""
    power = 1.0 if abs(speed) > least else 0.0
    for place in range(3):
        row.systematic[place] = power * models.uncertain_power[models.leading, place]
        power *= speed**2


@compiled_in_place
def add_systematic(row: FilterRow, part: float) -> None:
    """Add the part `part` of these variances to a row's covariance."""
    for place in range(3):
        row.covariance[4 * place] += part * row.systematic[place]


@compiled_in_place
def _averaged_orders(models: Models, f: int) -> int:
    """Return the number of averaged orders: those of the largest model; twice as many while model HIGH is active."""
    return ORDERS if f == layout.HIGH and models.active[f] > 0.0 else layout.MOST_WAVES[-1]


@compiled_in_place
def _top(bank: Bank, sampling: Sampling, share: float, most: int) -> int:
    """Return the orders up to `share` of the samples per turn; half of the samples are resolved."""
    return min(most, int(share * samples_a_turn(sampling.move) / bank.wave.lowest))


@compiled_in_place
def _power(bank: Bank, orders: Orders, f: int, k: int) -> float:
    """Return the squared amplitude of an order, in the ripple of model `f` or in the innovations."""
    if k < bank.models.waves[f]:
        ripple = bank.filters.ripple[:, bank.models.best[f]]
        return ripple[2 * k] ** 2 + ripple[2 * k + 1] ** 2
    return (orders.sums[2 * k] ** 2 + orders.sums[2 * k + 1] ** 2) / orders.average_weight**2


@compiled_in_place
def _white_power(orders: Orders) -> float:
    """Return the mean power of an order in white residuals."""
    variance = orders.reading_variance / orders.average_weight
    return 2.0 * variance / SCALE_SAMPLES * (2.0 / orders.average_weight - 1.0)


@compiled_in_place
def _is_sensors(lowest: float, k: int) -> bool:
    """Return whether an order is whole: in cycles of several turns only whole orders can be the sensor's."""
    return (k + 1) % int(1.0 / lowest + 0.5) == 0


@compiled_in_place
def _own_power(bank: Bank, orders: Orders, k: int) -> float:
    """Return the power of the sensor's errors in an order."""
    return orders.sensor_power if _is_sensors(bank.wave.lowest, k) else 0.0


@compiled_in_place
def _set_sensor_power(bank: Bank, orders: Orders, sampling: Sampling) -> None:
    """Set the power of the sensor's errors in each order from the upper orders, unless too few are resolved.

    The mean logarithm is insensitive to single peaks, as of gears. The power counts as far as it does not fall with the
    order.
    """
    f, top = bank.models.leading, _top(bank, sampling, 0.5, layout.MOST_WAVES[-1])
    first = max(min(bank.models.waves[f], layout.USUAL_WAVES) // 2, top // 4)
    middle, count, upper, lower, total = (first + top) // 2, 0, 0, 0.0, 0.0
    settled = sampling.used - orders.averaged_since > SCALE_SAMPLES
    most = layout.MOST_WAVES[-1] if bank.models.active[layout.HIGH] > 0.0 else layout.USUAL_WAVES
    for k in range(first, top):
        # Orders that another model had until recently are not in the averages.
        if _is_sensors(bank.wave.lowest, k) and (settled or k < bank.models.waves[f] or k >= most):
            power = math.log(max(_power(bank, orders, f, k), 1e-300))
            count, total = count + 1, total + power
            upper, lower = upper + (k >= middle), lower + (power if k < middle else 0.0)
    if count < FEWEST_ORDERS or upper == 0 or upper == count:
        return
    sigma = LOG_SIGMA * math.sqrt(1.0 / upper + 1.0 / (count - upper))
    fall = (lower / (count - upper) - (total - lower) / upper) / sigma
    power, white = math.exp(total / count + LOG_MEAN), _white_power(orders)
    power = min(max(power - white, 0.0), 1.5 * max(power - FROM_WHITE * white, 0.0))
    orders.sensor_power = power * min(max((FALLING - fall) / (FALLING - FLAT), 0.0), 1.0)


@compiled_in_place
def part_orders(bank: Bank, orders: Orders, f: int) -> tuple[float, float, float]:
    """Set the sensor's part of each order of a model's ripple (Wiener), and the variances by its uncertain orders.

    Returns the powers that the last three orders predict for the next one.
    """
    models, motion, last = bank.models, 0.0, (0.0, 0.0, 0.0)
    models.uncertain_power[f, :] = 0.0
    for k in range(models.waves[f]):
        own, power = _own_power(bank, orders, k), _power(bank, orders, f, k)
        motion *= FALL[k]
        if power > own * ABOVE_SENSOR:
            motion = max(power - own, motion)
        part = own / (motion + own) if own > 0.0 else 0.0
        models.sensor_ripple[f, 2 * k] = part * bank.filters.ripple[2 * k, models.best[f]]
        models.sensor_ripple[f, 2 * k + 1] = part * bank.filters.ripple[2 * k + 1, models.best[f]]
        _add_uncertain_order(bank, f, k, part * motion)
        last = _shifted(last, motion if own > 0.0 else power, k)
    return last


@compiled_in_place
def _shifted(last: tuple[float, float, float], found: float, k: int) -> tuple[float, float, float]:
    """Append the power of order `k` to those of the three orders before, each as it predicts the next order's."""
    return FALL[k + 1] * last[1], FALL[k + 1] * last[2], FALL[k + 1] * found


@compiled_in_place
def add_omitted_orders(
    bank: Bank, orders: Orders, f: int, top: int, last: tuple[float, float, float],
    white: float, bandwidth: float, unfollowed: float,
) -> None:  # fmt: skip
    """Add the orders from those of model `f` on to its uncertain variances, as far as the readings do not exclude them.

    `orders.found` are squared amplitudes in residuals up to the order `top`, `white` their mean without motion. The
    power of motion falls at least as that of a torque with steps, and ends at some order: the evidence of each end
    gives the probability that an order exists (Bayes). A significant order exists by itself, as of gears. `last`: see
    `part_orders`. Orders below `bandwidth` are followed without a model; the part `unfollowed` of the others is not.
    """
    models, lowest, waves, level, before = bank.models, bank.wave.lowest, bank.models.waves[f], math.inf, 1.0
    evidence, largest = 0.0, SIMPLER_EVIDENCE
    for k in range(waves, top):
        omitted, noise = 1.0 / (1.0 + (bandwidth / (lowest * (k + 1.0))) ** 6), white + _own_power(bank, orders, k)
        orders.expected[k], level = 0.0, level * FALL[k] if k > 0 else level
        if omitted >= OMITTED:
            if k > 0 and before >= OMITTED:
                level = min(level, (last[0] + last[1] + last[2]) / min(k, TAIL_ORDERS))
            prior = min(level, 2.0 * (RIPPLE_SIZE / (lowest * (k + 1.0))) ** 2) * omitted**2
            share = prior / (prior + noise)
            if orders.found[k] > HIGH_SIGNIFICANT * noise:
                _add_uncertain_order(bank, f, k, unfollowed * (orders.found[k] - noise))
            else:
                orders.expected[k] = share * noise + share**2 * orders.found[k]
            evidence += math.log1p(-share) + share * orders.found[k] / noise
        last = _shifted(last, orders.found[k], k)
        orders.evidence[k], before, largest = evidence, omitted, max(largest, evidence)
    total = math.exp(SIMPLER_EVIDENCE - largest)
    exists = 0.0
    for k in range(waves, top):
        orders.evidence[k] = math.exp(orders.evidence[k] - largest)
        exists += orders.evidence[k]
    total += exists
    for k in range(waves, top):
        _add_uncertain_order(bank, f, k, unfollowed * exists / total * orders.expected[k])
        if k == top - 1 and level < math.inf:  # sums of order^-6, order^-4 and order^-2 beyond
            end, power = k + 1.5, 0.5 * unfollowed * exists / total * level * (k + 1.0) ** 6
            models.uncertain_power[f, 0] += power / (5.0 * end**5)
            models.uncertain_power[f, 1] += power * lowest**2 / (3.0 * end**3)
            models.uncertain_power[f, 2] += power * lowest**4 / end
        exists -= orders.evidence[k]


@compiled_in_place
def _add_uncertain_order(bank: Bank, f: int, k: int, power: float) -> None:
    """Add an order of the given power to the uncertain variances."""
    squared = (bank.wave.lowest * (k + 1)) ** 2
    bank.models.uncertain_power[f, 0] += 0.5 * power
    bank.models.uncertain_power[f, 1] += 0.5 * power * squared
    bank.models.uncertain_power[f, 2] += 0.5 * power * squared**2


@compiled_in_place
def _part_observed_orders(bank: Bank, orders: Orders, sampling: Sampling, f: int, unfollowed: float) -> None:
    """Set a model's uncertain orders, of the leading one with those in the averaged innovations."""
    last = part_orders(bank, orders, f)
    if f == bank.models.leading:
        top = _top(bank, sampling, resolved_share(sampling.edges), _averaged_orders(bank.models, f))
        for k in range(bank.models.waves[f], top):
            orders.found[k] = _power(bank, orders, f, k)
        add_omitted_orders(bank, orders, f, top, last, _white_power(orders), 0.0, unfollowed)


@compiled_in_place
def resolved_share(edges: float) -> float:
    """Return the part of the readings per turn up to which orders differ from their aliases."""
    return 0.5 if edges > 0.0 else RESOLVED_SHARE


@compiled_in_place
def _detect_high_orders(bank: Bank, orders: Orders, sampling: Sampling) -> None:
    """Average whether motion has orders from the highest usual one on, in the ripple or in its residuals."""
    f, present, white = bank.models.leading, 0.0, _white_power(orders)
    settled = sampling.used - orders.averaged_since > SCALE_SAMPLES
    if not settled and bank.models.waves[f] < layout.USUAL_WAVES:
        return
    for k in range(layout.USUAL_WAVES - 1, _top(bank, sampling, 0.5, layout.MOST_WAVES[-1])):
        significant = _power(bank, orders, f, k) > max(
            ABOVE_SENSOR * _own_power(bank, orders, k), HIGH_SIGNIFICANT * white
        )
        if significant and (settled or k < bank.models.waves[f]):
            present = 1.0
    orders.high_orders += (present - orders.high_orders) * SECOND_ORDER_EVERY / SCALE_SAMPLES


def add_omitted(rows: Records, status: Records, model: int) -> None:
    """Add the variances by uncertain orders to the covariances of smoothed rows (n,) of a model."""
    now = status[0]
    bank, orders, lowest = now["bank"], now["orders"], float(now["bank"]["wave"]["lowest"])
    moving = np.abs(rows["speed"]) * rows["step"] > 3.0 * np.sqrt(rows["unit"])
    used = rows[moving & (rows["noise"] > 0.0) & (rows["residual"] != 0.0)]
    travel, power = float(np.sum(np.abs(np.diff(used["angle"])))), np.zeros(3)
    if len(used) and np.ptp(used["angle"]) * lowest >= SEEN_CYCLES * TURN:
        share = resolved_share(now["sampling"]["edges"]) * len(used) * TURN / (travel * lowest)
        top = min(int(share), ORDERS if model == layout.HIGH else layout.MOST_WAVES[-1])
        orders["found"][:top], white, bandwidth = _spectrum(used, lowest, top)
        last, omitted = part_orders(bank, orders, model), orders["found"][int(bank["models"]["waves"][model]) : top]
        if omitted.size >= FEWEST_ORDERS:  # no more than the median of exponentially distributed powers of that mean
            orders["sensor_power"] = min(orders["sensor_power"], np.median(omitted) / np.log(2.0))
        add_omitted_orders(bank, orders, model, top, last, white, bandwidth, 1.0)
        power = bank["models"]["uncertain_power"][model]
    for place in range(3):
        found = np.where(moving, power[place] * rows["speed"] ** (2 * place), 0.0)
        rows["covariance"][:, 4 * place] += found
        rows["systematic"][:, place] = found


def _spectrum(rows: Records, lowest: float, top: int) -> tuple[FloatArray, float, float]:
    """Return the squared amplitudes (top,) of the orders in the residuals, their mean if white, and the followed order.

    The smoother follows motion up to that order without a model.
    """
    residual = rows["residual"]
    most = np.sqrt(ROBUST * np.median(residual**2) / NORMAL_MEDIAN)
    residual, sums = np.clip(residual, -most, most), np.zeros(top, np.complex128)
    for first in range(0, len(rows), PIECE):
        piece = slice(first, first + PIECE)
        turn = np.exp(-1j * lowest * rows["angle"][piece])
        wave = residual[piece].astype(np.complex128)
        for k in range(top):
            wave *= turn
            sums[k] += np.sum(wave)
    independent = float(np.sum(1.0 / np.maximum(rows["correlated"], 1.0)))
    cut = np.median(rows["intensity"] / (rows["noise"] * rows["step"] * rows["speed"] ** 6))
    return np.abs(2.0 * sums / len(rows)) ** 2, float(4.0 * np.mean(residual**2) / independent), float(cut ** (1 / 6))
