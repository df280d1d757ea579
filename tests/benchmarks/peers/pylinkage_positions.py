"""Pylinkage: positions over a turn, without forces.

Timed: `step_fast`, its compiled simulation of uniformly driven cranks, for the batch, and one `step` for the
single call;
both include reading the travel of the needle. Arbitrary angles are not supported, so the error is that of its own turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pylinkage

from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import MAIN_SHAFT, Crank, RigidArm, RRPDyad, RRRDyad, Travel
from textile_twin_core.twin import compile_machine

from .turn import SteadyTurn

_SAMPLES = 10_000


class Positions:
    """Machine in pylinkage, starting at theta = 0, with its crank turned by `step_rad` per step."""

    def __init__(self, machine: Machine, step_rad: float) -> None:
        names = [f"point_{p}_{axis}_m" for p in machine.point_names for axis in "xy"]
        found = compile_machine(machine, names, "exact").evaluate(0.0, 0.0, 0.0)
        stand = {p: (float(found[f"point_{p}_x_m"]), float(found[f"point_{p}_y_m"])) for p in machine.point_names}
        links = {link.name: link for link in machine.links}
        self.parts: list[Any] = []
        self.part: dict[str, Any] = {}
        self.beyond: dict[str, tuple[str, FloatArray]] = {}  # tips of sliders: joint of the slider, and offset from it
        for name, at in machine.points.items():
            self._add(name, pylinkage.Ground(*at))
        for group in machine.groups:
            match group:
                case Crank() if group.driven_by == MAIN_SHAFT and group.phase_rad == 0.0:
                    self._add(group.end, pylinkage.Crank(self.part[group.at], group.length_m, step_rad, 0.0))
                case RRRDyad():
                    x, y = stand[group.end]
                    before, ground = self._anchor(group.from_point), self._anchor(group.ground)
                    self._add(group.end, pylinkage.RRRDyad(before, ground, *group.lengths_m, x=x, y=y))
                case RigidArm():
                    link = links[group.on]
                    start, end = self._anchor(link.start), self._anchor(link.end)
                    self._add(group.end, pylinkage.FixedDyad(start, end, group.length_m, group.angle_rad))
                case RRPDyad() if group.guide_on is None:
                    (x, y), along = stand[group.end], np.array(group.guide_direction) / np.hypot(*group.guide_direction)
                    line = [pylinkage.Ground(*(np.array(group.guide_point_m) + k * along)) for k in (-1.0, 1.0)]
                    self.parts += line
                    rod = pylinkage.RRPDyad(
                        self._anchor(group.from_point), line[0], line[1], group.lengths_m[0], x=x, y=y
                    )
                    self._add(group.end, rod)
                    self.beyond[group.tip] = (group.end, group.lengths_m[1] * along)
                case _:
                    raise NotImplementedError(f"pylinkage has no part like '{group.name}'")
        self.linkage = pylinkage.Linkage(self.parts)
        self._stand: list[Any] = self.linkage.get_coords()

    def _add(self, point: str, part: Any) -> None:
        self.part[point] = part
        self.parts.append(part)

    def _anchor(self, point: str) -> Any:
        part = self.part[point]
        return part.output if isinstance(part, pylinkage.Crank) else part

    def turn(self, steps: int) -> FloatArray:
        """Return the positions of all parts after each step from theta = 0 on [m], shape (steps, parts, 2)."""
        self.linkage.set_coords(self._stand)
        places: FloatArray = self.linkage.step_fast(steps)
        return places

    def travel(self, places: FloatArray, measure: Travel) -> FloatArray:
        """Return the travel from positions of shape (.., parts, 2) [m]."""
        point, beyond = self.beyond.get(measure.point, (measure.point, np.zeros(2)))
        way = places[..., self.parts.index(self.part[point]), :] + beyond
        origin = places[..., self.parts.index(self.part[measure.origin]), :]
        along: FloatArray = (way - origin) @ (np.array(measure.direction) / np.hypot(*measure.direction))
        return along


def candidates(scene: Workload) -> Iterator[Candidate]:
    """Build the travel of the machine's measure."""
    measure = next((m for m in scene.machine.measures if scene.outputs == (f"{m.name}_position_m",)), None)
    if not isinstance(measure, Travel):
        return
    turn = SteadyTurn.of(scene, min(_SAMPLES, scene.samples))
    fast, slow = (Positions(scene.machine, 2.0 * np.pi / turn.samples) for _ in range(2))

    def found() -> FloatArray:
        return fast.travel(fast.turn(turn.samples), measure)

    yield Candidate(
        "step_fast",
        "pylinkage",
        batch=found,
        samples=turn.samples,
        single=lambda: slow.travel(np.array(next(slow.linkage.step(1))), measure),
        error=lambda: turn.error({scene.outputs[0]: found()}),
        note="in order, over its own turn",
    )
