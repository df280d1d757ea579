"""Measure curves over one turn, for views: position by shaft angle, dwell and beat-up of a sley."""

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
from textile_twin_core.views.phases import PhaseRow, marks_of, phase_rows_of

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

_SAMPLES = 1440
_MM = 1e3
SLEY_NAMES = frozenset(("sley", "slay", "beater", "batten", "lay", "lathe", "reed"))
"""Names in use for the part of a loom that beats up the weft."""
_COLOURS = {
    "dwell": palette.FREE,
    "forward": palette.ADVANCING,
    "beat-up": palette.IN_BACKING,
    "back": palette.RETURNING,
}


class MeasureCurves:
    """Positions [mm] of the measures of a machine at shaft angles (n,) [rad]; empty for a machine without measures.

    Attributes:
        names: Names of the measures.
        angles: Shaft angles (k,) [rad] of one turn, or of its declared part.
        over_turn: Positions (k,) [mm] at `angles`, by measure.
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
        """Return the positions by measure."""
        if self._twin is None:
            return {}
        found = self._twin.evaluate(theta_rad, np.zeros_like(theta_rad), np.zeros_like(theta_rad))
        return {name: _MM * found[f"{name}_position_m"] for name in self.names}

    def canvas(self) -> AngleCanvas | None:
        """Return a canvas over the shaft angle that holds all curves; None for a machine without measures."""
        if not self.names:
            return None
        low = min(float(np.nanmin(curve)) for curve in self.over_turn.values())
        high = max(float(np.nanmax(curve)) for curve in self.over_turn.values())
        room = 0.08 * max(high - low, 1e-3)
        return AngleCanvas(low - room, high + room, *TORQUE_SIZE)


def phase_rows_for(machine: Machine) -> tuple[PhaseRow, ...]:
    """Build the rows of phases: needles in the backing, sleys between dwell and beat-up, strokes of other measures."""
    beats = {name: row for name, row in _beats(machine, set(_beating(machine))).items() if row is not None}
    plain = [row for row in phase_rows_of(machine.events()) if row.name.removesuffix("_stroke") not in beats]
    return (*plain, *beats.values())


def marks_for(machine: Machine) -> list[tuple[str, float]]:
    """Return name and angle [rad] of the marks over the shaft angle: events of loads and foremost points of arcs.

    The foremost point of a loom's sley is named beat-up; those of other arcs carry the name of the measure.
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
    """Return the arcs that beat up the weft, by the usual names of a sley."""
    arcs = [measure.name for measure in machine.measures if isinstance(measure, Arc)]
    return [name for name in arcs if SLEY_NAMES & set(name.lower().split("_"))]


def foremost(machine: Machine, name: str) -> list[float]:
    """Return the shaft angles [rad] of the turning points near the front of a measure's stroke, the farthest first.

    Turning points of a small oscillation during the dwell are excluded.
    """
    turns = [event.angle_rad for event in machine.events() if event.name == f"{name}_largest"]
    if not turns:
        return []
    curves = MeasureCurves(machine)
    curve = curves.over_turn[name]
    places = np.interp(turns, curves.angles, curve, period=TWO_PI)
    low, high = float(np.nanmin(curve)), float(np.nanmax(curve))
    front = high - DWELL_SHARE * (high - low)
    return [turns[k] for k in np.argsort(-places, kind="stable") if places[k] > front]


def _beats(machine: Machine, arcs: set[str]) -> Mapping[str, PhaseRow | None]:
    if not arcs or not machine.linkage.solved.turns_fully:
        return {}
    curves = MeasureCurves(machine)
    return {name: _beat(name, curves.angles, curves.over_turn[name]) for name in sorted(arcs)}


def _beat(name: str, angles: FloatArray, position: FloatArray) -> PhaseRow | None:
    """Build the row of dwell (rear 5 % of the stroke) and beat-up (front 5 %); None for a sley that beats twice."""
    low, high = float(position.min()), float(position.max())
    near = DWELL_SHARE * (high - low)
    state = np.where(position < low + near, 0, np.where(position > high - near, 2, 1))[:-1]
    begins = []
    for k in np.flatnonzero(state != np.roll(state, 1)):
        rising = position[k + 1] > position[k]
        begins.append((float(angles[k]), ("dwell", "forward" if rising else "back", "beat-up")[state[k]]))
    if sorted(phase for _, phase in begins) != sorted(_COLOURS):
        return None
    return PhaseRow(f"{name}_beat", tuple(begins), _COLOURS)
