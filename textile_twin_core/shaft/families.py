"""Which families of filters work, and how much each is believed.

Their weights are their likelihoods, with a fixed share; a family with ripple has a say once it saw the shaft turn for
1.25 cycles, and rests while it has no weight: work that is not needed.
"""

from __future__ import annotations

import numpy as np

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import initialise, log_memory, update_filters, update_second_order
from textile_twin_core.shaft.measurement_noise import least_scale, standstill_speed
from textile_twin_core.shaft.status import Record
from textile_twin_core.shaft.turns import TURN

BANK_SHARE = 1e-5
"""Weight that passes between families at each sample: ripple comes and goes with the work done, not with the sample."""
SEEN_CYCLES = 1.25
"""Cycles of motion after which a family has a say."""
RESTLESS_CYCLES, FIRST_REST, LONGEST_REST = 8.0, 16.0, 256.0
"""Cycles that a family of no weight works until it rests; and rests until it tries again, each time twice as long."""
SIMPLER = 0.25
"""Part of that rest for a family of fewer orders than the leading one: orders that are none shake the acceleration."""
MOST_HURRY = 32.0
"""So many times faster does a rest pass at most where the leading memory is shorter than a turn: the ripple may be
another now."""
NO_WEIGHT = 0.05
FASTER = 2.0
"""So many times faster than where a family of no weight began it begins anew: what a run-up told it of the ripple is
mostly the run-up."""
NEWCOMER = 1e-5
"""Weight of a family that comes to have a say where another one with ripple has it already."""
AS_GOOD = 1e-3
"""Weight of a newcomer that foretells as well as the leading family: of two such that of fewer orders is believed."""
SAMPLES_A_WAVE = 2.5
"""Samples a turn that the highest order of a family needs, per order: 2 (Nyquist), and some for speeds that change."""
UNBIASED = int(np.argmin(np.abs(lanes.MEMORIES[: lanes.END[lanes.PLAIN]] - 1.0)))
"""Lane of the plain filter whose memory is a sample: ripple biases longer ones, shorter ones are noisy."""
SECOND_EVERY = 8.0
"""Samples between two looks at what the ripple's square adds: it changes slowly."""


@compiled
def samples_a_turn(status: Record) -> float:
    """At the speed of now."""
    return float(TURN / max(abs(status.speed) * status.interval, 1e-9))


@compiled
def is_resolved(status: Record, f: int, margin: float) -> bool:
    """Whether there are samples enough in a turn for the family's highest order."""
    return samples_a_turn(status) >= margin * SAMPLES_A_WAVE * status.lowest * lanes.WAVES[f]  # type: ignore[no-any-return]


@compiled
def is_observed(status: Record, f: int) -> bool:
    """Whether the family saw enough of the motion to know its ripple."""
    return status.travelled[f] * status.lowest >= SEEN_CYCLES * TURN  # type: ignore[no-any-return]


@compiled
def is_active(status: Record, f: int, turned: float) -> bool:
    """Whether a family works at this sample, `turned` [rad] after the one before; in the middle of a motion it begins,
    or begins anew, from the plain filter that ripple has biased least.
    """
    if f == 0:
        return True
    idle, speed = status.mode_probability[f] <= NO_WEIGHT, abs(status.speed)
    if idle and status.rest[f] > 0.0:
        memory = lanes.MEMORIES[status.best[status.leading]]
        status.rest[f] -= turned * min(max(samples_a_turn(status) / memory, 1.0), MOST_HURRY)
    elif idle:
        status.rest[f] -= turned
    else:
        status.rest[f], status.pause[f] = 0.0, FIRST_REST
    working = status.active[f] > 0.0 and not (idle and speed > FASTER * status.began[f])
    if not working and status.rest[f] <= 0.0 and is_resolved(status, f, 1.1):
        m = UNBIASED
        for row in range(9):
            status.start[row] = status.clock[row, m]
        initialise(status, f, status.scale[m])
        # How good sampled readings are is not learnt anew from a few; what passed for noise of edges is mostly ripple.
        for lane in range(lanes.FIRST[f], lanes.FIRST[f] if status.edges > 0.0 else lanes.END[f]):
            status.scale_samples[lane] = status.scale_samples[m]
        status.active[f], status.rest[f], status.travelled[f], status.mode_probability[f] = 1.0, 0.0, 0.0, 0.0
        status.began[f] = max(speed, standstill_speed(status))
    elif status.active[f] > 0.0 and not is_resolved(status, f, 0.9):
        status.active[f] = status.mode_probability[f] = 0.0
        status.mode_probability[0] = max(status.mode_probability[0], NEWCOMER)
    elif status.active[f] > 0.0 and status.rest[f] * status.lowest < -RESTLESS_CYCLES * TURN:
        if f < status.leading and status.mode_probability[f] > AS_GOOD:
            status.mode_probability[f] = 1.0
        else:
            status.active[f] = status.mode_probability[f] = 0.0
            status.rest[f] = status.pause[f] * (SIMPLER if f < status.leading else 1.0) * TURN / status.lowest
            status.pause[f] = min(2.0 * status.pause[f], LONGEST_REST)
    return status.active[f] > 0.0  # type: ignore[no-any-return]


@compiled
def update_mode_probabilities(status: Record, noise: float, turning: bool) -> None:
    """Take the reading in, and weigh the families by their likelihoods while the shaft turns."""
    least = least_scale(status, noise)
    plain, total, count = 0.0, 0.0, 0
    mode_probability = status.mode_probability
    for f in range(lanes.FAMILIES):
        if status.active[f] > 0.0:
            together = update_filters(status, f, noise, least)
            observed = f > 0 and is_observed(status, f)
            if observed and status.samples % SECOND_EVERY == 0.0:
                update_second_order(status, f)
            plain = together if f == 0 else plain
            mode_probability[f] *= together if turning else plain
            if observed and turning and mode_probability[f] == 0.0:
                mode_probability[f] = -1.0
            status.log_memory[f] = log_memory(status, f)
            total += max(mode_probability[f], 0.0)
            count += 1
    known = total * (NEWCOMER if status.ripple_tried > 0.0 else 1.0)
    for f in range(lanes.FAMILIES):
        if mode_probability[f] < 0.0:
            mode_probability[f] = known
            total += known
            status.ripple_tried = 1.0
    for f in range(lanes.FAMILIES):
        if mode_probability[f] > 0.0:
            mode_probability[f] = mode_probability[f] / total * (1.0 - BANK_SHARE) + BANK_SHARE / count


@compiled
def memory_of(status: Record, f: int) -> float:
    """Log memory for a family: its own while it has weight or works with fewer orders than the leading one has.

    Else that of the leading one, to be compared alike.
    """
    simpler = f < status.leading and status.active[f] > 0.0 and is_observed(status, f)
    own = f == 0 or status.mode_probability[f] > NO_WEIGHT or simpler
    return status.log_memory[f if own else status.leading]  # type: ignore[no-any-return]
