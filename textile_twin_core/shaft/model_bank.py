"""Model bank: probabilities of the ripple models, which of them are active, and the mixture of their states."""

from __future__ import annotations

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import filter_bank, layout
from textile_twin_core.shaft.clock import add_products, add_ripple_covariance, add_spread, dot, shaft_state
from textile_twin_core.shaft.measurement_noise import begin_jitter, least_scale, standstill_speed
from textile_twin_core.shaft.status import Record
from textile_twin_core.shaft.turns import TURN

# from one model to another at each sample, and of a model that enters after another one with ripple
SWITCH_PROBABILITY = 1e-5
# where several models enter at once, each is this many times as probable as the next: few readings fit any
SIMPLER = 10.0
SEEN_CYCLES = 1.25  # cycles of motion after which a model enters the comparison
IMPROBABLE = 0.05  # model probability up to which a model may be suspended or restarted
# cycles of an improbable model, or of one with more orders than the leading one, until suspension ..
TRIAL_CYCLES = 8.0
LONGEST_TRIAL = 32.0  # .. and of the latter while it is nearly as good; then it restarts from the leading model
FIRST_IDLE, LONGEST_IDLE = 16.0, 256.0  # cycles of a suspension, which doubles each time
SIMPLER_IDLE = 0.25  # part of that for models of fewer orders: needless orders disturb the acceleration
FASTEST_IDLE = 32.0  # factor by which suspensions shorten at most where memory is short: the ripple may have changed
RESTART_SPEED = 2.0  # ratio to its first speed at which a model is reset: it took the run-up for ripple
COMPARABLE = 1e-3  # probability at which a model of fewer orders than the leading one is as good, and preferred
SAMPLES_PER_WAVE = 2.3  # needed by a model's highest order: 2 (Nyquist), and a margin for changing speeds
EDGES_PER_WAVE = 3.0  # the same for edges of teeth, which sample nearly the same angles in each turn
BEGIN, KEEP = 1.05, 0.95  # times that many samples to start an order with, and to keep it
# part of the time with high orders: 700 readings in a row at first, when the sensor's errors are known
HIGH_ORDERS = 0.75
UNBIASED = int(np.argmin(np.abs(layout.MEMORIES[: layout.END[layout.PLAIN]] - 1.0)))
"""Index of the plain filter with a memory of one sample: ripple biases longer memories, shorter ones are noisy."""
MINOR = 0.05  # part of the greatest probability below which a filter does not enter the mixture
SECOND_ORDER_EVERY = 8.0  # samples between updates of g2, which changes slowly


@compiled_in_place
def samples_a_turn(status: Record) -> float:
    """Return the recent number of readings per turn."""
    return float(TURN / max(status.move, 1e-9))


@compiled_in_place
def resolved_waves(status: Record, f: int, margin: float) -> int:
    """Return the number of the model's orders that the readings per turn resolve."""
    needed = margin * (EDGES_PER_WAVE if status.edges > 0.0 else SAMPLES_PER_WAVE) * status.lowest
    return min(int(samples_a_turn(status) / needed), layout.MOST_WAVES[f])


@compiled_in_place
def is_observed(status: Record, f: int) -> bool:
    """Return whether the shaft has turned enough for the model's ripple to be observable."""
    return status.travelled[f] * status.lowest >= SEEN_CYCLES * TURN


@compiled_in_place
def _turns_remembered(status: Record) -> float:
    """Return the memory of the leading filter, in turns."""
    return float(layout.MEMORIES[status.best[status.leading]] / samples_a_turn(status))


@compiled_in_place
def begin_or_suspend(status: Record, f: int, turned: float) -> None:
    """Start, resize or suspend a model with ripple, `turned` [rad] after the last sample.

    A probable model does not restart at a higher speed: its ripple stays as a first guess.
    """
    speed, improbable = abs(status.speed), status.mode_probability[f] <= IMPROBABLE
    if improbable or f != status.leading:
        pace = min(max(1.0 / _turns_remembered(status), 1.0), FASTEST_IDLE) if status.idle[f] > 0.0 else 1.0
        status.idle[f] -= turned * pace
    else:
        status.idle[f], status.next_idle[f] = 0.0, FIRST_IDLE
    faster = speed > RESTART_SPEED * status.start_speed[f]
    working = status.active[f] > 0.0 and not (improbable and faster)
    resolved = resolved_waves(status, f, BEGIN) >= layout.LEAST_WAVES[f]
    if not working and resolved and status.idle[f] <= 0.0 and (f < layout.HIGH or status.high_orders > HIGH_ORDERS):
        _begin(status, f)
        status.active[f], status.idle[f], status.travelled[f], status.mode_probability[f] = 1.0, 0.0, 0.0, 0.0
        status.start_speed[f], status.start_angle[f] = max(speed, standstill_speed(status)), status.angle
    elif status.active[f] > 0.0 and resolved_waves(status, f, KEEP) < layout.LEAST_WAVES[f]:
        _withdraw(status, f)
        status.active[f] = 0.0
    elif status.active[f] > 0.0 and status.idle[f] * status.lowest < -TRIAL_CYCLES * TURN:
        _end_trial(status, f)
    if working and status.active[f] > 0.0:
        _fit_waves(status, f, turned, is_observed(status, f) and not faster)
        if faster:
            filter_bank.reset_ripple_covariance(status, f, 0)
            _withdraw(status, f)
            status.start_speed[f], status.start_angle[f], status.travelled[f] = speed, status.angle, 0.0


@compiled_in_place
def _withdraw(status: Record, f: int) -> None:
    """Give a model's probability to the plain model: the gate needs probabilities that sum to 1."""
    status.mode_probability[0] += status.mode_probability[f]
    status.mode_probability[f] = 0.0


@compiled_in_place
def _begin(status: Record, f: int) -> None:
    """Start a model from the leading one, including its ripple, or else from the plain filter."""
    known, m = layout.PLAIN, UNBIASED
    if status.leading > 0 and is_observed(status, status.leading) and _turns_remembered(status) >= 1.0:
        known, m = status.leading, status.best[status.leading]
    filter_bank.begin_model(status, f, known, m, resolved_waves(status, f, BEGIN))


@compiled_in_place
def _end_trial(status: Record, f: int) -> None:
    """End a trial: suspend the model, let it lead if it is simpler and as good, or extend it if it has more orders."""
    comparable = status.mode_probability[f] > COMPARABLE
    if f < status.leading:
        enough = status.leading < layout.HIGH or status.high_orders <= HIGH_ORDERS
        if comparable and enough and _turns_remembered(status) >= 1.0:
            status.mode_probability[f] = 1.0
            return
    elif comparable and status.idle[f] * status.lowest > -LONGEST_TRIAL * TURN:
        return
    status.active[f] = status.mode_probability[f] = status.idle[f] = 0.0
    if f < status.leading or not comparable:
        status.idle[f] = status.next_idle[f] * (SIMPLER_IDLE if f < status.leading else 1.0) * TURN / status.lowest
        status.next_idle[f] = min(2.0 * status.next_idle[f], LONGEST_IDLE)


@compiled_in_place
def _fit_waves(status: Record, f: int, turned: float, known: bool) -> None:
    """Adjust the number of orders to the readings per turn.

    New orders start late: an order that is not known yet would absorb part of a stop.
    """
    waves, more = status.waves[f], resolved_waves(status, f, BEGIN)
    status.resolved_angle[f] = status.resolved_angle[f] + turned if more > waves else 0.0
    if not known:
        waves = max(min(waves, resolved_waves(status, f, KEEP)), more)
    elif status.resolved_angle[f] * status.lowest >= SEEN_CYCLES * TURN:
        waves = more
    if waves != status.waves[f]:
        filter_bank.resize(status, f, waves)


@compiled_in_place
def reset_adaptation(status: Record) -> None:
    """Reset everything but the plain states, noise scales included: the readings so far were misinterpreted."""
    for m in range(layout.END[layout.PLAIN]):
        status.scale_samples[m] = filter_bank.FIRST_SCALE_WEIGHT
    status.active[1:] = status.mode_probability[1:] = status.idle[1:] = 0.0
    status.mode_probability[0] = 1.0
    status.leading = 0
    status.order_sums[:] = status.uncertain_power[:] = 0.0
    status.move *= 1.0 + 0.5 * (status.longest_repeat + status.large_move_repeats)
    status.average_weight = status.reading_variance = status.sensor_power = status.high_orders = 0.0
    status.tail_observed = status.tail_expected = status.fastest = 0.0
    begin_jitter(status)


@compiled_in_place
def update_mode_probabilities(status: Record, noise: float, turning: bool) -> None:
    """Update all active models with a measurement, and their probabilities while the shaft turns."""
    least = least_scale(status, noise)
    total, count, entry = 0.0, 0, SWITCH_PROBABILITY if status.ripple_tried > 0.0 else 1.0
    mode_probability = status.mode_probability
    for f in range(layout.MODELS):
        if status.active[f] > 0.0:
            filter_bank.update_filters(status, f, noise, least)
            observed = f > 0 and is_observed(status, f)
            if observed and status.used % SECOND_ORDER_EVERY == 0.0:
                filter_bank.update_second_order(status, f)
            if observed and turning and mode_probability[f] == 0.0:
                mode_probability[f] = entry * SIMPLER ** (1 - f)
                status.ripple_tried = 1.0
            mode_probability[f] *= status.density[f if turning else layout.PLAIN]
            first, stop = layout.FIRST[f], layout.STOP[f]
            status.log_memory[f] = dot(status.probability[first:stop], status.logarithm[first:stop], stop - first)
            total += mode_probability[f]
            count += 1
    for f in range(layout.MODELS):
        if mode_probability[f] > 0.0:
            mode_probability[f] = mode_probability[f] / total * (1.0 - SWITCH_PROBABILITY) + SWITCH_PROBABILITY / count


@compiled_in_place
def memory_of(status: Record, f: int) -> float:
    """Return the mean log memory of a model that is probable, or active with fewer orders than the leading model.

    Any other model has the leading model's memory, so that smoothing compares all models on equal terms.
    """
    simpler = f < status.leading and status.active[f] > 0.0 and is_observed(status, f)
    own = f == 0 or status.mode_probability[f] > IMPROBABLE or simpler
    return status.log_memory[f if own else status.leading]


@compiled_in_place
def combine(status: Record, row: Record) -> None:
    """Set mean and covariance (9,) of the mixture of all filters, in the status and in a row."""
    top = 0.0
    for f in range(layout.MODELS):
        share = status.mode_probability[f] * status.probability[status.best[f]]
        if share > top:
            top, status.leading = share, f
    f, m, covariance = status.leading, status.best[status.leading], row.covariance
    # Moments about the best filter's state: their differences do not cancel.
    about, speed, acceleration = shaft_state(status, f, m, status.clock[:, m], status.angle)
    total = by_angle = by_speed = by_acceleration = 0.0
    covariance[:] = 0.0
    for f in range(layout.MODELS):
        if status.mode_probability[f] < MINOR * top:
            continue
        for m in range(layout.FIRST[f], layout.END[f]):
            weight = status.mode_probability[f] * status.probability[m]
            if weight < MINOR * top:
                continue
            theta, omega, alpha = shaft_state(status, f, m, status.clock[:, m], about)
            d0, d1, d2 = theta - about, omega - speed, alpha - acceleration
            total += weight
            by_angle += weight * d0
            by_speed += weight * d1
            by_acceleration += weight * d2
            add_spread(status.clock[:, m], status.slopes, weight * status.scale[m], covariance)
            add_products((d0, d1, d2), weight, covariance)
            add_ripple_covariance(status, status.waves[f], m, weight * status.scale[m], covariance)
    mean = by_angle / total, by_speed / total, by_acceleration / total
    for place in range(9):
        covariance[place] /= total
    add_products(mean, -1.0, covariance)
    status.angle = about + mean[0]
    status.speed = row.speed = speed + mean[1]
    status.acceleration = row.acceleration = acceleration + mean[2]
