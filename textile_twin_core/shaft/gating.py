"""Where a motion begins or breaks: the first two readings, leaps and changes, gaps, readings that follow nothing."""

from __future__ import annotations

import math

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import (
    RIPPLE_SIZE,
    initialise,
    open_manoeuvre,
    predict_reading,
    set_basis_at,
    update_filters,
)
from textile_twin_core.shaft.clock import wave
from textile_twin_core.shaft.families import FIRST_REST, is_resolved
from textile_twin_core.shaft.measurement_noise import (
    FIRST_JITTER,
    LEAP_GUESSED,
    measurement_variance,
    set_correlated,
    unwrap_reading,
)
from textile_twin_core.shaft.status import Record

SET_ASIDE = 2
"""Readings in a row that may be set aside as outliers before the motion is believed to have changed."""
CLEAN = 100.0
"""Readings without an outlier, from which only one is set aside first if the next is farther off to the same side."""
ALWAYS = 12.0
"""Times in a row that readings far off were motion, from which none is set aside first."""
FASTER = 1.25
"""By how much farther off the second must be."""
UNHEARD_OF = 2.0
"""Full speeds, as far as they are known, beyond which one more must have been set aside before: of many outliers a few
are on a line by chance."""
FORETOLD = 0.05
"""Standard deviation [rad] of a reading after a gap up to which the motion may go on: that one of another motion is
within three of it happens in 1 case of 20 at most, and the next readings tell."""
FALSE = 4.0
"""A start is false from which a reading is so many times farther off than from a line through those since."""
TOLD = 0.02
"""Part of a speed that a sensor tells by which it may be off."""


@compiled
def set_start(start: FloatArray, angle: float, rate: float, noise: float, step: float) -> None:
    """State and factor (9,) after two readings: what their noise leaves open, and a tenth more speed in a step."""
    root = math.sqrt(noise)
    start[lanes.ACCELERATION], start[lanes.RATE], start[lanes.ANGLE] = 0.0, rate, angle
    start[lanes.L00], start[lanes.L10], start[lanes.L20] = 0.1 * abs(rate) / step + root / step**2, 0.0, 0.0
    start[lanes.L11], start[lanes.L21], start[lanes.L22] = 1.5 * root / step, 0.7 * root, 0.7 * root


@compiled
def start(status: Record, step: float, angle: float) -> None:
    """Begin with two readings: what a straight line through them leaves open is the filters' uncertainty.

    A sensor's own speed that agrees with the line is better than its slope. It counts nowhere else: what a drive tells
    is mostly the slope of the same angles, smoothed and late, and as a reading beside them it made the acceleration ten
    times worse.
    """
    rate = (angle - status.first) / step
    status.interval = step
    if status.jitter_told == 0.0:
        status.jitter = (FIRST_JITTER * step) ** 2
    status.angle, status.speed, status.acceleration = angle, rate, 0.0
    status.read, status.kept, status.kept_at, status.moved, status.bent = angle, angle, status.time, 0.0, 0.0
    set_correlated(status)
    start, root = status.start, math.sqrt(measurement_variance(status, rate))
    set_start(start, angle, rate, root**2, step)
    if abs(status.sensor_speed - rate) <= 3.0 * start[lanes.L11]:
        start[lanes.RATE] = status.speed = status.sensor_speed
        start[lanes.L11], start[lanes.L21], start[lanes.L22] = TOLD * (abs(status.speed) + start[lanes.L11]), 0.0, root
    for f in range(lanes.FAMILIES):
        initialise(status, f, 1.0)
        status.active[f] = 1.0 if is_resolved(status, f, 1.0) else 0.0
        status.mode_probability[f] = status.travelled[f] = status.began[f] = status.rest[f] = 0.0
        status.pause[f] = FIRST_REST
    status.mode_probability[0] = 1.0
    status.leading = 0
    status.since = status.rejected_run = status.unconfirmed = status.off_before = status.off_last = (
        status.ripple_tried
    ) = 0.0


@compiled
def is_false_start(status: Record, reading: float, off: float, step: float) -> bool:
    """Whether the three readings after the first two follow a line, but not that of these: one of them was wrong.

    Readings whose stamps come in bunches follow lines, too, that are none.
    """
    if status.samples != 5.0 or step < 0.5 * status.interval:
        return False
    bend = reading - status.kept - status.moved * step / status.interval
    return abs(off) > FALSE * (abs(bend) + math.sqrt(measurement_variance(status, status.speed)))  # type: ignore[no-any-return]


@compiled
def is_dropout(status: Record) -> bool:
    """Whether those set aside only say again what the last reading said of a shaft that moved by many steps.

    A bus has dropped out; what lasts is a stop after all.
    """
    moved = abs(status.moved) > LEAP_GUESSED * status.resolution
    return moved and status.holding > status.rejected_run  # type: ignore[no-any-return]


@compiled
def is_continued(status: Record, off: float) -> bool:
    """Whether a reading is off to the same side as the last one that was set aside, and farther."""
    return off * status.off_last >= 0.0 and abs(off) > FASTER * abs(status.off_last)  # type: ignore[no-any-return]


@compiled
def is_manoeuvre(status: Record, off: float, step: float, noise: float, row: Record) -> bool:
    """Whether readings far off are the shaft's motion and not outliers: the last three, at least, follow a line.

    Outliers on both sides of the motion follow one, too: all three must lie on one side. Where there were no outliers
    of late two are enough, or this one where such were always motion. Then the motion is opened: where they are equally
    far off (an encoder that slipped) the angle alone, else speed and acceleration too.
    """
    if status.rejected_run < SET_ASIDE and status.rejected_run >= SET_ASIDE - (status.clean >= CLEAN) - (
        status.motions >= ALWAYS
    ):
        span, grown, slipped = step, off - status.off_last, False
        straight = is_continued(status, off)
    else:
        span, grown = step + status.step_last, off - status.off_before
        slipped = abs(grown) < 0.25 * abs(off)
        one_side = min(off * status.off_last, off * status.off_before) > 0.0
        bend = off - 2.0 * status.off_last + status.off_before
        straight = (
            one_side and abs(bend) <= 0.5 * max(abs(off), abs(status.off_before)) and status.rejected_run >= SET_ASIDE
        )
    unheard_of = not slipped and 0.0 < UNHEARD_OF * status.fastest < abs(status.speed + grown / span)
    if not straight or is_dropout(status) or (unheard_of and status.rejected_run <= SET_ASIDE):
        status.off_before, status.off_last, status.step_last = status.off_last, off, step
        return False
    status.motions += 1.0
    rate = 0.0 if slipped else grown / span
    by_rate = 0.0 if slipped else (math.sqrt(noise) + abs(grown)) / span
    for f in range(lanes.FAMILIES):
        open_manoeuvre(status, f, off, rate, math.sqrt(noise) + RIPPLE_SIZE * abs(off), by_rate, abs(rate) / span)
    row.cut = 1.0 if slipped else 2.0
    row.unit += (RIPPLE_SIZE * off) ** 2
    status.jumps += row.cut == 1.0
    status.outliers -= status.rejected_run
    status.unconfirmed += max(status.rejected_run, 1.0)
    return True


@compiled
def is_predicted(status: Record, step: float, reading: float) -> bool:
    """Whether the best filter foresees a reading [rad] `step` [s] after the one before: the motion goes on as it did.

    The variance is that of `kinematics.time_update`, without its rotations: nothing is moved on yet.
    """
    f, half, interval = status.leading, 0.5 * step * step, step / status.interval
    m, clock, noise = status.best[f], status.clock, measurement_variance(status, status.speed)
    set_basis_at(status, reading, lanes.WAVES[f])
    g = wave(status.ripple[m], status.second[f], lanes.WAVES[f], status.lowest, status.basis)
    off = reading + g[0] - clock[lanes.ANGLE, m] - step * clock[lanes.RATE, m] - half * clock[lanes.ACCELERATION, m]
    p0 = clock[lanes.L20, m] + step * clock[lanes.L10, m] + half * clock[lanes.L00, m]
    p1, p2 = clock[lanes.L21, m] + step * clock[lanes.L11, m], clock[lanes.L22, m]
    jerk = status.jerk_strength[m] ** 2 * interval**5 / 20.0
    variance = status.scale[m] * (p0 * p0 + p1 * p1 + p2 * p2 + (1.0 + jerk) * noise)
    return variance <= FORETOLD**2 and off * off <= 9.0 * variance  # type: ignore[no-any-return]


@compiled
def bridge_gap(status: Record, step: float, raw: float, row: Record) -> None:
    """After a pause the ripple is still known, the motion is not."""
    reading = unwrap_reading(status, raw, status.angle + status.speed * step)
    row.unit = measurement_variance(status, status.speed)
    row.reading, row.cut, row.noise = reading, 1.0, row.unit * status.scale[status.best[status.leading]]
    root = math.sqrt(row.noise)
    by_rate = 0.5 * abs(status.speed) + root / status.interval
    for f in range(lanes.FAMILIES):
        open_manoeuvre(status, f, reading - status.angle, 0.0, RIPPLE_SIZE, by_rate, by_rate / (10.0 * status.interval))
        if status.active[f] > 0.0:
            predict_reading(status, f, 0.0, reading, reading, row.unit)
            update_filters(status, f, row.unit, 0.0)
    status.angle = status.read = reading
    status.since = 0.0


@compiled
def restart(status: Record, reading: float, rate: float, step: float, row: Record) -> None:
    """Readings that follow no motion: begin anew with this one and a speed."""
    status.losses += 1.0
    status.first = reading - rate * step
    start(status, step, reading)
    row.reading, row.cut = reading, 1.0
    row.noise = row.unit = measurement_variance(status, status.speed)
