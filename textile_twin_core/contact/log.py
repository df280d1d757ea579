"""Log of an integration: events and stretches of motion as rows of numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import by_reference, compiled
from textile_twin_core.contact.plant import Plant
from textile_twin_core.contact.state import ContactState

IMPACT, REST, RELEASE, TOUCH, LEAVE, SLACKENS, PUSHES = range(7)
"""Kinds of events; the first three belong to stops, the others to pads."""

TIME, KIND, NUMBER, BOOKED, APPROACH, IMPULSE, LOST, WORK = range(8)
"""Columns of an event."""

_COEFFICIENTS = 31
IMPACT_ROUNDS = 500
"""Impact rounds in one instant before stops close without restitution."""
_ROWS = 16


@by_reference
class Log(NamedTuple):
    """Rows written so far, in arrays with free capacity."""

    counts: IntArray
    """(2,): events, stretches"""
    events: FloatArray
    """(rows, 8), see the columns"""
    heads: FloatArray
    """(rows, 3 + pads): start [s], span [s], order, states of the pads"""
    series: FloatArray
    """(rows, movers + pads + stops, 31): power series of positions and forces"""


def empty_log(plant: Plant) -> Log:
    """Return an empty log."""
    pads, stops = plant.pad_places.size, plant.limits.size
    return Log(
        np.zeros(2, np.int64),
        np.empty((_ROWS + (IMPACT_ROUNDS + 1) * stops, 8)),
        np.empty((_ROWS, 3 + pads)),
        np.empty((_ROWS, plant.constant.size + pads + stops, _COEFFICIENTS)),
    )


def with_room(log: Log) -> Log:
    """Return the same rows with twice the capacity."""
    events, heads, series = (np.concatenate((rows, np.empty_like(rows))) for rows in log[1:])
    return Log(log.counts, events, heads, series)


def written(log: Log) -> Log:
    """Return a copy of the written rows without the free capacity."""
    events, stretches = log.counts
    rows = log.events[:events], log.heads[:stretches], log.series[:stretches]
    return Log._make(each.copy() for each in (log.counts, *rows))


@compiled
def is_full(plant: Plant, log: Log) -> bool:
    """Return whether one more stretch, with the instant at its end, may exceed the capacity."""
    events, stretches = log.events.shape[0] - log.counts[0], log.heads.shape[0] - log.counts[1]
    return stretches == 0 or events < 1 + (IMPACT_ROUNDS + 1) * plant.limits.size


@compiled
def add_stretch(log: Log, state: ContactState, span_s: float, series: FloatArray, forces: FloatArray) -> None:
    """Append a stretch of motion that begins at the state."""
    at = log.counts[1]
    head, table = log.heads[at], log.series[at]
    head[0], head[1], head[2] = state.clock[0], span_s, series.shape[1] - 1
    for pad in range(state.pads.size):
        head[3 + pad] = state.pads[pad]
    for row in range(table.shape[0]):
        source, own = (series, row) if row < series.shape[0] else (forces, row - series.shape[0])
        for k in range(table.shape[1]):
            table[row, k] = source[own, k] if k < source.shape[1] else 0.0
    log.counts[1] += 1


@compiled
def add_event(
    log: Log,
    time_s: float,
    kind: int,
    number: int,
    booked_s: float,
    approach: float,
    impulse: float,
    lost: float,
    work: float,
) -> None:
    """Append an event."""
    at = log.counts[0]
    row = log.events[at]
    row[TIME], row[KIND], row[NUMBER], row[BOOKED] = time_s, kind, number, booked_s
    row[APPROACH], row[IMPULSE], row[LOST], row[WORK] = approach, impulse, lost, work
    log.counts[0] += 1


@compiled
def take_back_release(log: Log, stop: int) -> None:
    """Remove the last release of a stop."""
    for at in range(log.counts[0] - 1, -1, -1):
        if log.events[at, KIND] == RELEASE and log.events[at, NUMBER] == stop:
            for later in range(at, log.counts[0] - 1):
                for column in range(log.events.shape[1]):
                    log.events[later, column] = log.events[later + 1, column]
            log.counts[0] -= 1
            return
