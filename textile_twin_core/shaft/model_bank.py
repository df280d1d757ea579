"""Model bank: probabilities of the ripple models, which of them are active, and the mixture of their states."""

from __future__ import annotations

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import filter_bank, layout
from textile_twin_core.shaft.constants import (
    BEGIN,
    COMPARABLE,
    EDGES_PER_WAVE,
    FASTEST_IDLE,
    FIRST_IDLE,
    FIRST_SCALE_WEIGHT,
    HIGH_ORDERS,
    IMPROBABLE,
    KEEP,
    LONGEST_IDLE,
    LONGEST_TRIAL,
    MINOR,
    MODEL_SWITCH,
    SAMPLES_PER_WAVE,
    SECOND_ORDER_EVERY,
    SEEN_CYCLES,
    SIMPLER,
    SIMPLER_IDLE,
    TRIAL_CYCLES,
    UNBIASED,
)
from textile_twin_core.shaft.measurement_noise import standstill_speed
from textile_twin_core.shaft.ripple import add_products, add_ripple_covariance, add_spread, dot, shaft_state
from textile_twin_core.shaft.status import Bank, FilterRow, Mixture, Models, Noise, Orders, Sampling
from textile_twin_core.shaft.turns import TURN


@compiled_in_place
def samples_a_turn(move: float) -> float:
    """Return the number of readings per turn at a mean move [rad]."""
    return float(TURN / max(move, 1e-9))


@compiled_in_place
def resolved_waves(bank: Bank, sampling: Sampling, f: int, margin: float) -> int:
    """Return the number of the model's orders that the readings per turn resolve."""
    needed = margin * (EDGES_PER_WAVE if sampling.edges > 0.0 else SAMPLES_PER_WAVE) * bank.wave.lowest
    return min(int(samples_a_turn(sampling.move) / needed), layout.MOST_WAVES[f])


@compiled_in_place
def is_observed(bank: Bank, f: int) -> bool:
    """Return whether the shaft has turned enough for the model's ripple to be observable."""
    return bank.models.travelled[f] * bank.wave.lowest >= SEEN_CYCLES * TURN


@compiled_in_place
def _turns_remembered(models: Models, move: float) -> float:
    """Return the memory of the leading filter, in turns."""
    return float(layout.MEMORIES[models.best[models.leading]] / samples_a_turn(move))


@compiled_in_place
def begin_or_suspend(
    bank: Bank, orders: Orders, sampling: Sampling, track: Mixture, noise: Noise, f: int, turned: float
) -> None:
    """Start, resize or suspend a model with ripple, `turned` [rad] after the last sample."""
    models, lowest = bank.models, bank.wave.lowest
    if models.mode_probability[f] <= IMPROBABLE or f != models.leading:
        idle = models.idle[f] > 0.0
        pace = min(max(1.0 / _turns_remembered(models, sampling.move), 1.0), FASTEST_IDLE) if idle else 1.0
        models.idle[f] -= turned * pace
    else:
        models.idle[f], models.next_idle[f] = 0.0, FIRST_IDLE
    resolved = resolved_waves(bank, sampling, f, BEGIN) >= layout.LEAST_WAVES[f]
    wanted = f < layout.HIGH or orders.high_orders > HIGH_ORDERS
    working = models.active[f] > 0.0
    if not working and resolved and models.idle[f] <= 0.0 and wanted:
        _begin(bank, sampling, f)
        models.active[f], models.idle[f], models.travelled[f], models.mode_probability[f] = 1.0, 0.0, 0.0, 0.0
        models.start_speed[f] = max(abs(track.speed), standstill_speed(noise, track.speed, sampling.interval))
        models.start_angle[f] = track.angle
    elif working and resolved_waves(bank, sampling, f, KEEP) < layout.LEAST_WAVES[f]:
        _withdraw(models, f)
        models.active[f] = 0.0
    elif working and models.idle[f] * lowest < -TRIAL_CYCLES * TURN:
        _end_trial(bank, orders, sampling, f)
    if working and models.active[f] > 0.0:
        _fit_waves(bank, sampling, f, turned)


@compiled_in_place
def _withdraw(models: Models, f: int) -> None:
    """Give a model's probability to the plain model: the gate needs probabilities that sum to 1."""
    models.mode_probability[0] += models.mode_probability[f]
    models.mode_probability[f] = 0.0


@compiled_in_place
def _begin(bank: Bank, sampling: Sampling, f: int) -> None:
    """Start a model from the leading one, including its ripple, or else from the plain filter."""
    known, m, leading = layout.PLAIN, UNBIASED, bank.models.leading
    if leading > 0 and is_observed(bank, leading) and _turns_remembered(bank.models, sampling.move) >= 1.0:
        known, m = leading, bank.models.best[leading]
    filter_bank.begin_model(bank, f, known, m, resolved_waves(bank, sampling, f, BEGIN))


@compiled_in_place
def _end_trial(bank: Bank, orders: Orders, sampling: Sampling, f: int) -> None:
    """End a trial: suspend the model, let it lead if it is simpler and as good, or extend it if it has more orders."""
    models, lowest = bank.models, bank.wave.lowest
    comparable = models.mode_probability[f] > COMPARABLE
    if f < models.leading:
        enough = models.leading < layout.HIGH or orders.high_orders <= HIGH_ORDERS
        if comparable and enough and _turns_remembered(models, sampling.move) >= 1.0:
            models.mode_probability[f] = 1.0
            return
    elif comparable and models.idle[f] * lowest > -LONGEST_TRIAL * TURN:
        return
    models.active[f] = models.mode_probability[f] = models.idle[f] = 0.0
    if f < models.leading or not comparable:
        models.idle[f] = models.next_idle[f] * (SIMPLER_IDLE if f < models.leading else 1.0) * TURN / lowest
        models.next_idle[f] = min(2.0 * models.next_idle[f], LONGEST_IDLE)


@compiled_in_place
def _fit_waves(bank: Bank, sampling: Sampling, f: int, turned: float) -> None:
    """Adjust the number of orders to the readings per turn.

    New orders start late: an order that is not known yet would absorb part of a stop.
    """
    models = bank.models
    waves, more = models.waves[f], resolved_waves(bank, sampling, f, BEGIN)
    models.resolved_angle[f] = models.resolved_angle[f] + turned if more > waves else 0.0
    if not is_observed(bank, f):
        waves = max(min(waves, resolved_waves(bank, sampling, f, KEEP)), more)
    elif models.resolved_angle[f] * bank.wave.lowest >= SEEN_CYCLES * TURN:
        waves = more
    if waves != models.waves[f]:
        filter_bank.resize(bank, f, waves)


@compiled_in_place
def reset_models(bank: Bank) -> None:
    """Reset everything but the plain states, noise scales included: the readings so far were misinterpreted."""
    models = bank.models
    for m in range(layout.END[layout.PLAIN]):
        bank.filters.scale_samples[m] = FIRST_SCALE_WEIGHT
    models.active[1:] = models.mode_probability[1:] = models.idle[1:] = 0.0
    models.mode_probability[0] = 1.0
    models.leading = 0
    models.uncertain_power[:] = 0.0


@compiled_in_place
def update_mode_probabilities(
    bank: Bank, sampling: Sampling, speed: float, variance: float, least: float, turning: bool
) -> None:
    """Update all active models with a measurement of this variance, and their probabilities while the shaft turns.

    `least`: lower bound of the filters' noise scale.
    """
    filters, models = bank.filters, bank.models
    total, count, entry = 0.0, 0, MODEL_SWITCH if models.ripple_tried > 0.0 else 1.0
    mode_probability = models.mode_probability
    for f in range(layout.MODELS):
        if models.active[f] > 0.0:
            filter_bank.update_filters(bank, f, variance, least, speed, sampling.move)
            observed = f > 0 and is_observed(bank, f)
            if observed and sampling.used % SECOND_ORDER_EVERY == 0.0:
                filter_bank.update_second_order(bank, f)
            if observed and turning and mode_probability[f] == 0.0:
                mode_probability[f] = entry * SIMPLER ** (1 - f)
                models.ripple_tried = 1.0
            mode_probability[f] *= models.density[f if turning else layout.PLAIN]
            first, stop = layout.FIRST[f], layout.STOP[f]
            models.log_memory[f] = dot(filters.probability[first:stop], filters.logarithm[first:stop], stop - first)
            total += mode_probability[f]
            count += 1
    for f in range(layout.MODELS):
        if mode_probability[f] > 0.0:
            mode_probability[f] = mode_probability[f] / total * (1.0 - MODEL_SWITCH) + MODEL_SWITCH / count


@compiled_in_place
def memory_of(bank: Bank, f: int) -> float:
    """Return the mean log memory of a model that is probable, or active with fewer orders than the leading model.

    Any other model has the leading model's memory, so that smoothing compares all models on equal terms.
    """
    models = bank.models
    simpler = f < models.leading and models.active[f] > 0.0 and is_observed(bank, f)
    own = f == 0 or models.mode_probability[f] > IMPROBABLE or simpler
    return float(models.log_memory[f if own else models.leading])


@compiled_in_place
def combine(bank: Bank, track: Mixture, row: FilterRow) -> None:
    """Set mean and covariance (9,) of the mixture of all filters, in the track and in a row."""
    filters, models, slopes, top = bank.filters, bank.models, bank.wave.slopes, 0.0
    for f in range(layout.MODELS):
        share = models.mode_probability[f] * filters.probability[models.best[f]]
        if share > top:
            top, models.leading = share, f
    f, covariance = models.leading, row.covariance
    m = models.best[f]
    # Moments about the best filter's state: their differences do not cancel.
    # The search for its angle starts at a reading that it follows: far away the ripple leads elsewhere.
    near = row.reading if row.noise > 0.0 else track.angle
    about, speed, acceleration = shaft_state(bank, f, m, filters.clock[:, m], near)
    total = by_angle = by_speed = by_acceleration = 0.0
    covariance[:] = 0.0
    for f in range(layout.MODELS):
        if models.mode_probability[f] < MINOR * top:
            continue
        for m in range(layout.FIRST[f], layout.END[f]):
            weight = models.mode_probability[f] * filters.probability[m]
            if weight < MINOR * top:
                continue
            theta, omega, alpha = shaft_state(bank, f, m, filters.clock[:, m], about)
            d0, d1, d2 = theta - about, omega - speed, alpha - acceleration
            total += weight
            by_angle += weight * d0
            by_speed += weight * d1
            by_acceleration += weight * d2
            add_spread(filters.clock[:, m], slopes, weight * filters.scale[m], covariance)
            add_products((d0, d1, d2), weight, covariance)
            add_ripple_covariance(bank, models.waves[f], m, weight * filters.scale[m], covariance)
    mean = by_angle / total, by_speed / total, by_acceleration / total
    for place in range(9):
        covariance[place] /= total
    add_products(mean, -1.0, covariance)
    track.angle = about + mean[0]
    track.speed = row.speed = speed + mean[1]
    track.acceleration = row.acceleration = acceleration + mean[2]
