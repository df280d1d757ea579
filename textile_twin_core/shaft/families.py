"""Mode probabilities of the families, which of them are active, and the state that all of them tell."""

from __future__ import annotations

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import bank, lanes
from textile_twin_core.shaft.clock import add_products, add_ripple_covariance, add_spread, dot, shaft_state
from textile_twin_core.shaft.measurement_noise import begin_jitter, least_scale, standstill_speed
from textile_twin_core.shaft.status import Record
from textile_twin_core.shaft.turns import TURN

SWITCH_PROBABILITY = 1e-5  # from one family to another at each sample, and of one that enters after another with ripple
SIMPLER = 10.0  # times as probable, where several enter, is each than the next with more orders: few readings fit any
SEEN_CYCLES = 1.25  # cycles of motion after which a family enters the comparison
IMPROBABLE = 0.05  # mode probability up to which a family may rest or restart
IDLE_CYCLES = 8.0  # that an improbable family, or one of more orders than the leading one, is active until it rests ..
LONGEST_TRIAL = 32.0  # .. and the latter while it is nearly as good; then it begins anew from the leading one
FIRST_REST, LONGEST_REST = 16.0, 256.0  # cycles of a rest, which doubles each time
SIMPLER_REST = 0.25  # part of that for fewer orders than lead: needless orders disturb the acceleration
FASTEST_REST = 32.0  # at most so many times faster does a rest pass where memory is short: the ripple may have changed
RESTART_SPEED = 2.0  # at so many times its first speed a family forgets: it mistook the run-up for ripple
COMPARABLE = 1e-3  # probability at which a family of fewer orders than the leading one has caught up, and is preferred
SAMPLES_PER_WAVE = 2.3  # that the highest order of a family needs: 2 (Nyquist), and a margin for changing speeds
EDGES_PER_WAVE = 3.0  # as edges of teeth tell of the same angles in each turn, of all but the missing ones
BEGIN, KEEP = 1.05, 0.95  # times that many samples for orders to begin with, and to go on
HIGH_ORDERS = 0.75  # part of the time: 700 readings in a row at first, by when the sensor's errors are known
UNBIASED = int(np.argmin(np.abs(lanes.MEMORIES[: lanes.END[lanes.PLAIN]] - 1.0)))
"""Lane of the plain filter with a memory of one sample: ripple biases longer ones, shorter ones are noisy."""
MINOR = 0.05  # filters of less than this part of the greatest probability do not enter the mixture
SECOND_ORDER_EVERY = 8.0  # samples between updates of g2, which changes slowly


@compiled_in_place
def samples_a_turn(status: Record) -> float:
    """Readings per turn of late."""
    return float(TURN / max(status.move, 1e-9))


@compiled_in_place
def resolved_waves(status: Record, f: int, margin: float) -> int:
    """How many of the family's orders there are enough readings per turn for."""
    needed = margin * (EDGES_PER_WAVE if status.edges > 0.0 else SAMPLES_PER_WAVE) * status.lowest
    return min(int(samples_a_turn(status) / needed), lanes.MOST_WAVES[f])


@compiled_in_place
def is_observed(status: Record, f: int) -> bool:
    """Whether the shaft has turned enough for the family's ripple to be observable."""
    return status.travelled[f] * status.lowest >= SEEN_CYCLES * TURN


@compiled_in_place
def _turns_remembered(status: Record) -> float:
    """Memory of the leading filter, in turns."""
    return float(lanes.MEMORIES[status.best[status.leading]] / samples_a_turn(status))


@compiled_in_place
def begin_or_rest(status: Record, f: int, turned: float) -> None:
    """Begin, resize or rest a family with ripple, `turned` [rad] after the last sample.

    A probable family does not restart at a higher speed: it keeps its ripple as a first guess.
    """
    speed, improbable = abs(status.speed), status.mode_probability[f] <= IMPROBABLE
    if improbable or f != status.leading:
        pace = min(max(1.0 / _turns_remembered(status), 1.0), FASTEST_REST) if status.rest[f] > 0.0 else 1.0
        status.rest[f] -= turned * pace
    else:
        status.rest[f], status.pause[f] = 0.0, FIRST_REST
    faster = speed > RESTART_SPEED * status.began[f]
    working = status.active[f] > 0.0 and not (improbable and faster)
    resolved = resolved_waves(status, f, BEGIN) >= lanes.LEAST_WAVES[f]
    if not working and resolved and status.rest[f] <= 0.0 and (f < lanes.HIGH or status.high_orders > HIGH_ORDERS):
        _begin(status, f)
        status.active[f], status.rest[f], status.travelled[f], status.mode_probability[f] = 1.0, 0.0, 0.0, 0.0
        status.began[f], status.began_at[f] = max(speed, standstill_speed(status)), status.angle
    elif status.active[f] > 0.0 and resolved_waves(status, f, KEEP) < lanes.LEAST_WAVES[f]:
        _strike_out(status, f)
        status.active[f] = 0.0
    elif status.active[f] > 0.0 and status.rest[f] * status.lowest < -IDLE_CYCLES * TURN:
        _end_trial(status, f)
    if working and status.active[f] > 0.0:
        _fit_waves(status, f, turned, is_observed(status, f) and not faster)
        if faster:
            bank.doubt_ripple(status, f, 0)
            _strike_out(status, f)
            status.began[f], status.began_at[f], status.travelled[f] = speed, status.angle, 0.0


@compiled_in_place
def _strike_out(status: Record, f: int) -> None:
    """Give a family's probability to the plain one: the gate takes the probabilities for whole."""
    status.mode_probability[0] += status.mode_probability[f]
    status.mode_probability[f] = 0.0


@compiled_in_place
def _begin(status: Record, f: int) -> None:
    """Begin a family from the leading one, whose ripple it takes over, or else from the plain filter."""
    known, m = lanes.PLAIN, UNBIASED
    if status.leading > 0 and is_observed(status, status.leading) and _turns_remembered(status) >= 1.0:
        known, m = status.leading, status.best[status.leading]
    bank.begin_family(status, f, known, m, resolved_waves(status, f, BEGIN))


@compiled_in_place
def _end_trial(status: Record, f: int) -> None:
    """Let a family that does not lead rest; lead, if it is simpler and as good; or go on, if it has more orders."""
    comparable = status.mode_probability[f] > COMPARABLE
    if f < status.leading:
        enough = status.leading < lanes.HIGH or status.high_orders <= HIGH_ORDERS
        if comparable and enough and _turns_remembered(status) >= 1.0:
            status.mode_probability[f] = 1.0
            return
    elif comparable and status.rest[f] * status.lowest > -LONGEST_TRIAL * TURN:
        return
    status.active[f] = status.mode_probability[f] = status.rest[f] = 0.0
    if f < status.leading or not comparable:
        status.rest[f] = status.pause[f] * (SIMPLER_REST if f < status.leading else 1.0) * TURN / status.lowest
        status.pause[f] = min(2.0 * status.pause[f], LONGEST_REST)


@compiled_in_place
def _fit_waves(status: Record, f: int, turned: float, known: bool) -> None:
    """Model as many orders as there are readings for; new ones late, as one that is not known takes part of a stop."""
    waves, more = status.waves[f], resolved_waves(status, f, BEGIN)
    status.ample[f] = status.ample[f] + turned if more > waves else 0.0
    if not known:
        waves = max(min(waves, resolved_waves(status, f, KEEP)), more)
    elif status.ample[f] * status.lowest >= SEEN_CYCLES * TURN:
        waves = more
    if waves != status.waves[f]:
        bank.resize(status, f, waves)


@compiled_in_place
def forget_lessons(status: Record) -> None:
    """Begin anew all but the plain states, and the noise scales: the readings until now were not what they seemed."""
    for m in range(lanes.END[lanes.PLAIN]):
        status.scale_samples[m] = bank.FIRST_SCALE_WEIGHT
    status.active[1:] = status.mode_probability[1:] = status.rest[1:] = 0.0
    status.mode_probability[0] = 1.0
    status.leading = 0
    status.order_sums[:] = status.doubt[:] = 0.0
    status.move *= 1.0 + 0.5 * (status.longest_hold + status.leapt_after)
    status.listened = status.reading_variance = status.sensor_power = status.high_orders = 0.0
    status.tail_heard = status.tail_expected = status.fastest = 0.0
    begin_jitter(status)


@compiled_in_place
def update_mode_probabilities(status: Record, noise: float, turning: bool) -> None:
    """Measurement update of all active families, and of their mode probabilities while the shaft turns."""
    least = least_scale(status, noise)
    total, count, entry = 0.0, 0, SWITCH_PROBABILITY if status.ripple_tried > 0.0 else 1.0
    mode_probability = status.mode_probability
    for f in range(lanes.FAMILIES):
        if status.active[f] > 0.0:
            bank.update_filters(status, f, noise, least)
            observed = f > 0 and is_observed(status, f)
            if observed and status.used % SECOND_ORDER_EVERY == 0.0:
                bank.update_second_order(status, f)
            if observed and turning and mode_probability[f] == 0.0:
                mode_probability[f] = entry * SIMPLER ** (1 - f)
                status.ripple_tried = 1.0
            mode_probability[f] *= status.density[f if turning else lanes.PLAIN]
            first, stop = lanes.FIRST[f], lanes.STOP[f]
            status.log_memory[f] = dot(status.probability[first:stop], status.logarithm[first:stop], stop - first)
            total += mode_probability[f]
            count += 1
    for f in range(lanes.FAMILIES):
        if mode_probability[f] > 0.0:
            mode_probability[f] = mode_probability[f] / total * (1.0 - SWITCH_PROBABILITY) + SWITCH_PROBABILITY / count


@compiled_in_place
def memory_of(status: Record, f: int) -> float:
    """Mean log memory of a family that is probable, or active with fewer orders than the leading one.

    For any other family that of the leading one, so that smoothing compares all on equal terms.
    """
    simpler = f < status.leading and status.active[f] > 0.0 and is_observed(status, f)
    own = f == 0 or status.mode_probability[f] > IMPROBABLE or simpler
    return status.log_memory[f if own else status.leading]


@compiled_in_place
def combine(status: Record, row: Record) -> None:
    """Set mean and covariance (9,) of the mixture of all filters, as the state of the status and of a row."""
    top = 0.0
    for f in range(lanes.FAMILIES):
        share = status.mode_probability[f] * status.probability[status.best[f]]
        if share > top:
            top, status.leading = share, f
    f, m, covariance = status.leading, status.best[status.leading], row.covariance
    # Moments about the best filter's state: their differences do not cancel.
    about, speed, acceleration = shaft_state(status, f, m, status.clock[:, m], status.angle)
    total = by_angle = by_speed = by_acceleration = 0.0
    covariance[:] = 0.0
    for f in range(lanes.FAMILIES):
        if status.mode_probability[f] < MINOR * top:
            continue
        for m in range(lanes.FIRST[f], lanes.END[f]):
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
