"""Phases of the cycle, from the machine's events: in the backing or free, going in or coming back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.machine import Event
from textile_twin_core.views import palette

TWO_PI = 2.0 * np.pi
_BINS = 720
_REVERSAL_RAD = 0.02
"""So far a shaft has to turn back to count as turning that way: a resting one trembles."""
_BACKWARD = {"forward": "back", "back": "forward"}
"""What a phase of the stroke is when the shaft turns backward through it."""

#: The phase that begins at an event, by the end of the event's name, with its lane and its colour.
_BEGINS: dict[str, tuple[str, str, palette.Colour]] = {
    "_enters_backing": ("backing", "in backing", palette.IN_BACKING),
    "_leaves_backing": ("backing", "free", palette.FREE),
    "_largest": ("stroke", "back", palette.RETURNING),
    "_smallest": ("stroke", "forward", palette.ADVANCING),
}


@dataclass(frozen=True, slots=True)
class Lane:
    """One row of phases: what begins at which angle, turning forward, and each phase's colour."""

    name: str
    begins: tuple[tuple[float, str], ...]
    colours: Mapping[str, palette.Colour]

    def at(self, theta_rad: FloatArray, backward: BoolArray | None = None) -> list[str]:
        """The phase at each angle (n,); backward: (n,) where the shaft turns so, nowhere without it."""
        angles = np.array([angle for angle, _ in self.begins])
        place = np.searchsorted(angles, np.mod(theta_rad, TWO_PI), side="right") - 1
        states = [self.begins[k][1] for k in place]
        for k in () if backward is None else np.flatnonzero(backward):
            states[k] = _BACKWARD.get(states[k], states[k])
        return states


class Direction:
    """Which way a shaft turns, from unwrapped angles in blocks of any size."""

    def __init__(self) -> None:
        self._farthest, self._backward = math.nan, False

    def take(self, theta_rad: FloatArray) -> BoolArray:
        """Whether the shaft turns backward at each of the next angles (n,)."""
        found = []
        farthest, backward = self._farthest, self._backward
        for theta in theta_rad.tolist():
            ahead = farthest - theta if backward else theta - farthest
            if ahead < -_REVERSAL_RAD:
                backward = not backward
            if not -_REVERSAL_RAD <= ahead <= 0.0:
                farthest = theta
            found.append(backward)
        self._farthest, self._backward = farthest, backward
        return np.array(found, dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class StateChanges:
    """What begins when [s], in one lane."""

    lane: str
    time_s: FloatArray
    states: tuple[str, ...]

    def after(self, first: int) -> StateChanges:
        """The changes from number `first` on."""
        return StateChanges(self.lane, self.time_s[first:], self.states[first:])


def lanes_of(events: Sequence[Event]) -> tuple[Lane, ...]:
    """The lanes that the machine's events make up."""
    rows: dict[str, list[tuple[float, str]]] = {}
    colours: dict[str, dict[str, palette.Colour]] = {}
    for event in sorted(events, key=lambda event: event.angle_rad):
        for ending, (lane, state, colour) in _BEGINS.items():
            if event.name.endswith(ending):
                rows.setdefault(f"{event.name.removesuffix(ending)}_{lane}", []).append((event.angle_rad, state))
                colours.setdefault(f"{event.name.removesuffix(ending)}_{lane}", {})[state] = colour
    return tuple(Lane(name, tuple(row), colours[name]) for name, row in rows.items() if len(row) > 1)


def marks_of(events: Sequence[Event]) -> list[tuple[str, float]]:
    """What to mark in plots over the angle: (short name, angle [rad]) of all events but the turning points."""
    short = {"_enters_backing": "entry", "_leaves_backing": "exit"}
    marks = []
    for event in events:
        name = next((name for ending, name in short.items() if event.name.endswith(ending)), event.name)
        if not event.name.endswith(("_largest", "_smallest")):
            marks.append((name, event.angle_rad))
    return marks


def state_changes(lane: Lane, time_s: FloatArray, theta_rad: FloatArray, backward: BoolArray) -> StateChanges:
    """Changes of phase along an unwrapped angle (n,), their times interpolated; the first phase comes first.

    backward: (n,) where the shaft turns so.
    """
    if time_s.size == 0:
        return StateChanges(lane.name, np.empty(0), ())
    states = lane.at(theta_rad, backward)
    changed = np.array([a != b for a, b in zip(states[1:], states[:-1], strict=True)], dtype=np.bool_)
    where = np.flatnonzero(changed)
    times, names = [float(time_s[0])], [states[0]]
    for k in where:
        times.append(_crossing(lane, float(theta_rad[k]), float(theta_rad[k + 1]), time_s[k], time_s[k + 1]))
        names.append(states[k + 1])
    return StateChanges(lane.name, np.array(times), tuple(names))


def inside_backing(lanes: Sequence[Lane]) -> BoolArray:
    """Whether the needle is in the backing, (bins,) over one turn."""
    theta = np.arange(0.5, _BINS, dtype=np.float64) * (TWO_PI / _BINS)
    for lane in lanes:
        if lane.name.endswith("_backing"):
            return np.array([state == "in backing" for state in lane.at(theta)], dtype=np.bool_)
    return np.zeros(_BINS, dtype=np.bool_)


def _crossing(lane: Lane, before: float, after: float, start_s: float, end_s: float) -> float:
    """The time at which the angle passes the boundary between two samples, turning either way."""
    low, high = min(before, after), max(before, after)
    for angle, _ in lane.begins:
        level = angle + TWO_PI * np.ceil((low - angle) / TWO_PI)
        if low <= level <= high and high > low:
            return float(start_s + (level - before) / (after - before) * (end_s - start_s))
    return float(end_s)
