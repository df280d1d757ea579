"""What a machine's measures do over a turn, for views: position by shaft angle, dwell and beat-up of a sley."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine.events import DWELL_SHARE
from textile_twin_core.mechanism import Arc
from textile_twin_core.twin import compile_machine
from textile_twin_core.views import palette
from textile_twin_core.views.angle_canvas import TORQUE_SIZE, TWO_PI, AngleCanvas
from textile_twin_core.views.phases import Lane, lanes_of, marks_of

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

_SAMPLES = 1440
_MM = 1e3
SLEY_NAMES = frozenset(("sley", "slay", "beater", "batten", "lay", "lathe", "reed"))
"""What people call the part of a loom that beats up the weft."""
_COLOURS = {
    "dwell": palette.FREE,
    "forward": palette.ADVANCING,
    "beat-up": palette.IN_BACKING,
    "back": palette.RETURNING,
}


class Travels:
    """Positions [mm] of a machine's measures at shaft angles (n,), by measure; empty for a machine without any.

    `over_turn` holds them at the shaft angles `angles` (k,) [rad], one turn or the part of it that is declared.
    """

    def __init__(self, machine: Machine) -> None:
        self.names = tuple(measure.name for measure in machine.measures)
        outputs = [f"{name}_position_m" for name in self.names]
        self._twin = compile_machine(machine, outputs, method="exact") if outputs else None
        self.angles = TWO_PI * np.arange(_SAMPLES + 1) / _SAMPLES
        if not machine.linkage.solved.turns_fully:
            self.angles = machine.shaft_angles(_SAMPLES)
        self.over_turn = self(self.angles)

    def __call__(self, theta_rad: FloatArray) -> dict[str, FloatArray]:
        """The positions by measure."""
        if self._twin is None:
            return {}
        found = self._twin.evaluate(theta_rad, np.zeros_like(theta_rad), np.zeros_like(theta_rad))
        return {name: _MM * found[f"{name}_position_m"] for name in self.names}

    def canvas(self) -> AngleCanvas | None:
        """A plot over the shaft angle that holds them all; None without any."""
        if not self.names:
            return None
        low = min(float(np.nanmin(curve)) for curve in self.over_turn.values())
        high = max(float(np.nanmax(curve)) for curve in self.over_turn.values())
        room = 0.08 * max(high - low, 1e-3)
        return AngleCanvas(low - room, high + room, *TORQUE_SIZE)


def lanes_for(machine: Machine) -> tuple[Lane, ...]:
    """Rows of phases: of needles in and out of the backing, of a sley from dwell to beat-up, of what else moves."""
    beats = {name: lane for name, lane in _beats(machine, set(_beating(machine))).items() if lane is not None}
    plain = [lane for lane in lanes_of(machine.events()) if lane.name.removesuffix("_stroke") not in beats]
    return (*plain, *beats.values())


def marks_for(machine: Machine) -> list[tuple[str, float]]:
    """What to mark over the shaft angle: name and angle [rad] of loads' events and of the foremost points of arcs.

    A loom's sley beats up there; other arcs are named as the measure is.
    """
    beating = _beating(machine)
    arcs = [measure.name for measure in machine.measures if isinstance(measure, Arc)]
    fronts = [
        ("beat-up" if name in beating else f"{name.replace('_', ' ')} front", angle)
        for name in arcs
        for angle in foremost(machine, name)
    ]
    return [*marks_of(machine.events()), *sorted(fronts, key=lambda mark: mark[1])]


def _beating(machine: Machine) -> list[str]:
    """Arcs that beat up the weft: those of a loom's sley, by its names in the field."""
    arcs = [measure.name for measure in machine.measures if isinstance(measure, Arc)]
    return [name for name in arcs if SLEY_NAMES & set(name.lower().split("_"))]


def foremost(machine: Machine, name: str) -> list[float]:
    """Shaft angles [rad] where a measure turns back near the front of its stroke, the farthest first.

    A sley that swings a little while it rests turns back there, too: that is no beat.
    """
    turns = [event.angle_rad for event in machine.events() if event.name == f"{name}_largest"]
    if not turns:
        return []
    travels = Travels(machine)
    curve = travels.over_turn[name]
    places = np.interp(turns, travels.angles, curve, period=TWO_PI)
    low, high = float(np.nanmin(curve)), float(np.nanmax(curve))
    front = high - DWELL_SHARE * (high - low)
    return [turns[k] for k in np.argsort(-places, kind="stable") if places[k] > front]


def _beats(machine: Machine, arcs: set[str]) -> Mapping[str, Lane | None]:
    if not arcs or not machine.linkage.solved.turns_fully:
        return {}
    travels = Travels(machine)
    return {name: _beat(name, travels.angles, travels.over_turn[name]) for name in sorted(arcs)}


def _beat(name: str, angles: FloatArray, position: FloatArray) -> Lane | None:
    """Dwell within 5 % of the stroke from the rear, beat-up within 5 % from the front; None where it beats twice."""
    low, high = float(position.min()), float(position.max())
    near = DWELL_SHARE * (high - low)
    state = np.where(position < low + near, 0, np.where(position > high - near, 2, 1))[:-1]
    begins = []
    for k in np.flatnonzero(state != np.roll(state, 1)):
        rising = position[k + 1] > position[k]
        begins.append((float(angles[k]), ("dwell", "forward" if rising else "back", "beat-up")[state[k]]))
    if sorted(phase for _, phase in begins) != sorted(_COLOURS):
        return None
    return Lane(f"{name}_beat", tuple(begins), _COLOURS)
