"""Phases of the cycle from the events of a machine: in the backing or free, forward or back."""

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
"""Least angle that counts as a reversal; the angle of a shaft at standstill is noisy."""
_BACKWARD = {"forward": "back", "back": "forward"}
"""Phase of the stroke while the shaft turns backward."""

#: Row, phase and colour that begin at an event, by the suffix of the event's name.
_BEGINS: dict[str, tuple[str, str, palette.Colour]] = {
    "_enters_backing": ("backing", "in backing", palette.IN_BACKING),
    "_leaves_backing": ("backing", "free", palette.FREE),
    "_largest": ("stroke", "back", palette.RETURNING),
    "_smallest": ("stroke", "forward", palette.ADVANCING),
}


@dataclass(frozen=True, slots=True)
class PhaseRow:
    """Row of phases: the angle and name of each phase in forward rotation, and the colour of each phase."""

    name: str
    begins: tuple[tuple[float, str], ...]
    colours: Mapping[str, palette.Colour]

    def at(self, theta_rad: FloatArray, backward: BoolArray | None = None) -> list[str]:
        """Return the phase at each angle (n,) [rad]; `backward` (n,) is true where the shaft turns backward."""
        angles = np.array([angle for angle, _ in self.begins])
        place = np.searchsorted(angles, np.mod(theta_rad, TWO_PI), side="right") - 1
        states = [self.begins[k][1] for k in place]
        for k in () if backward is None else np.flatnonzero(backward):
            states[k] = _BACKWARD.get(states[k], states[k])
        return states


class Direction:
    """Detector of the direction of rotation from unwrapped angles in blocks of any size."""

    def __init__(self) -> None:
        self._farthest, self._backward = math.nan, False

    def take(self, theta_rad: FloatArray) -> BoolArray:
        """Return (n,) true where the shaft turns backward, for the next angles (n,) [rad]."""
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
    """Start times [s] and names of the phases of one row."""

    row: str
    time_s: FloatArray
    states: tuple[str, ...]

    def after(self, first: int) -> StateChanges:
        """Return the changes from number `first` on."""
        return StateChanges(self.row, self.time_s[first:], self.states[first:])


def phase_rows_of(events: Sequence[Event]) -> tuple[PhaseRow, ...]:
    """Build the rows of phases from the events of a machine."""
    rows: dict[str, list[tuple[float, str]]] = {}
    colours: dict[str, dict[str, palette.Colour]] = {}
    for event in sorted(events, key=lambda event: event.angle_rad):
        for ending, (suffix, state, colour) in _BEGINS.items():
            if event.name.endswith(ending):
                rows.setdefault(f"{event.name.removesuffix(ending)}_{suffix}", []).append((event.angle_rad, state))
                colours.setdefault(f"{event.name.removesuffix(ending)}_{suffix}", {})[state] = colour
    return tuple(PhaseRow(name, tuple(row), colours[name]) for name, row in rows.items() if len(row) > 1)


def marks_of(events: Sequence[Event]) -> list[tuple[str, float]]:
    """Return (short name, angle [rad]) of the events to mark over the angle: all but the turning points."""
    short = {"_enters_backing": "entry", "_leaves_backing": "exit"}
    marks = []
    for event in events:
        name = next((name for ending, name in short.items() if event.name.endswith(ending)), event.name)
        if not event.name.endswith(("_largest", "_smallest")):
            marks.append((name, event.angle_rad))
    return marks


def state_changes(row: PhaseRow, time_s: FloatArray, theta_rad: FloatArray, backward: BoolArray) -> StateChanges:
    """Find the changes of phase along an unwrapped angle (n,), at interpolated times; the initial phase comes first.

    `backward` (n,) is true where the shaft turns backward.
    """
    if time_s.size == 0:
        return StateChanges(row.name, np.empty(0), ())
    states = row.at(theta_rad, backward)
    changed = np.array([a != b for a, b in zip(states[1:], states[:-1], strict=True)], dtype=np.bool_)
    where = np.flatnonzero(changed)
    times, names = [float(time_s[0])], [states[0]]
    for k in where:
        times.append(_crossing(row, float(theta_rad[k]), float(theta_rad[k + 1]), time_s[k], time_s[k + 1]))
        names.append(states[k + 1])
    return StateChanges(row.name, np.array(times), tuple(names))


def inside_backing(phase_rows: Sequence[PhaseRow]) -> BoolArray:
    """Return (bins,) over one turn, true where the needle is in the backing."""
    theta = np.arange(0.5, _BINS, dtype=np.float64) * (TWO_PI / _BINS)
    for row in phase_rows:
        if row.name.endswith("_backing"):
            return np.array([state == "in backing" for state in row.at(theta)], dtype=np.bool_)
    return np.zeros(_BINS, dtype=np.bool_)


def _crossing(row: PhaseRow, before: float, after: float, start_s: float, end_s: float) -> float:
    """Interpolate the time at which the angle passes the boundary between two samples, in either direction."""
    low, high = min(before, after), max(before, after)
    for angle, _ in row.begins:
        level = angle + TWO_PI * np.ceil((low - angle) / TWO_PI)
        if low <= level <= high and high > low:
            return float(start_s + (level - before) / (after - before) * (end_s - start_s))
    return float(end_s)
