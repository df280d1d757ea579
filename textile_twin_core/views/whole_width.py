"""Whole width of a machine with an elastic main shaft: every linkage at its station, the twist enlarged."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine.linkage_row import linkage_row, station_places_m
from textile_twin_core.twin import compile_machine
from textile_twin_core.views import palette
from textile_twin_core.views.scene import MachineScene, PointPositions
from textile_twin_core.views.solids import circle, extrude
from textile_twin_core.views.static_scene import mesh

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

LINKS = "world/base/links"
_DRAWN_TWIST_RAD = 0.4
"""Upper bound of the drawn twist; the scale is the largest round number below it."""
_TURN_SAMPLES = 720


class WholeWidth:
    """Drawing of all linkages of a machine and of its elastic shaft.

    Args:
        machine: Machine with an elastic shaft.
        scene: Scene of one linkage.
        twist_rad: Largest twist to show [rad]; by default the largest over a turn at nominal speed.

    Attributes:
        scale: Enlargement of the twist: a round number.
        places_m: (stations,) distances along the shaft from the first linkage [m].
    """

    def __init__(self, machine: Machine, scene: MachineScene, twist_rad: float | None = None) -> None:
        assert machine.shaft is not None
        self._machine, self._scene, self._shaft = machine, scene, machine.shaft
        self.row, self.places_m = linkage_row(machine), station_places_m(machine)
        ratios = np.array(self._shaft.speed_ratios)
        self._ratios = ratios / ratios[self.row[0].station]
        self._phases = [place.phase_rad for place in machine.linkages]
        self._positions = PointPositions(machine)
        self.scale = _round_scale(self._nominal_twist() if twist_rad is None else twist_rad)

    @property
    def text(self) -> str:
        """Description of the picture, for its title."""
        return f"{len(self.row)} linkages over {np.ptp(self.places_m):.3g} m, twist drawn x{self.scale:g}"

    def prepare(self, stream: rr.RecordingStream) -> None:
        """Draw the static parts: the shaft, and the solids of every linkage but the first, which the scene has."""
        for place in self.row[1:]:
            under = f"world/base/row/{place.number}"
            stream.log(under, rr.Transform3D(translation=[0.0, 0.0, place.z_m]), static=True)
            stream.log(f"{under}/fixed", mesh(self._scene.fixed), static=True)
            for part in self._scene.moving:
                stream.log(f"{under}/links/{part.name}", mesh(part.solid), static=True)
        axis, radius = self._axis_m, self._radius_m
        rod = extrude(circle(radius), float(self.places_m[0]), float(self.places_m[-1]), palette.DARK_STEEL)
        stream.log("world/base/shaft", mesh(rod.moved((*axis, 0.0))), static=True)
        style = rr.LineStrips3D.from_fields(radii=[0.25 * radius], colors=[palette.MEASURED])
        stream.log("world/base/shaft/line", style, static=True)

    def angles(self, stations_rad: FloatArray) -> FloatArray:
        """Return the angles as drawn, from the angles of the stations (n, stations) [rad]."""
        reduced = stations_rad / self._ratios
        encoder = reduced[:, [self._shaft.encoder_station]]
        return np.asarray(encoder + self.scale * (reduced - encoder))

    def points(self, number: int, drawn_rad: FloatArray) -> dict[str, FloatArray]:
        """Return the positions (n, 2) of the points of a linkage at angles as drawn (n, stations) [rad]."""
        place = self.row[number]
        return self._positions(drawn_rad[:, place.station] + self._phases[number] - self._phases[0])

    def line(self, drawn_rad: FloatArray) -> FloatArray:
        """Return a line (n, stations, 3) along the side of the shaft; it is straight while the shaft has no twist."""
        side = 1.1 * self._radius_m
        x, y = (self._axis_m[k] + side * function(drawn_rad) for k, function in enumerate((np.cos, np.sin)))
        return np.stack([x, y, np.broadcast_to(self.places_m, x.shape)], axis=2)

    @property
    def _axis_m(self) -> tuple[float, float]:
        """Position of the main shaft: the start of the link that turns with it."""
        link = self._machine.linkage.shaft_link
        start = next((part.start for part in self._scene.moving if part.name == link), "")
        return self._scene.fixed_points.get(start, (0.0, 0.0))

    @property
    def _radius_m(self) -> float:
        """Radius of the shaft where known, with a lower bound so that its line is visible."""
        known = max((piece.diameter_m or 0.0 for piece in self._shaft.pieces), default=0.0)
        return max(0.5 * known, 0.02 * self._scene.size_m)

    def _nominal_twist(self) -> float:
        """Compute the largest twist between the encoder and any station over a turn at nominal speed [rad]."""
        speed = self._machine.nominal_speed_rad_s
        time: FloatArray = np.linspace(0.0, 4.0 * math.pi / speed, 2 * _TURN_SAMPLES + 1)
        twin = compile_machine(self._machine, station_outputs(self._machine))
        found = twin.evaluate(np.asarray(speed * time), np.full(time.size, speed), np.zeros(time.size), time=time)
        return largest_twist(self._machine, np.stack(list(found.values()), axis=1))


def station_outputs(machine: Machine) -> list[str]:
    """Return the names of the outputs for the station angles, in their order; empty for a rigid shaft."""
    return [] if machine.shaft is None else [f"station_{name}_angle_rad" for name in machine.shaft.names]


def largest_twist(machine: Machine, stations_rad: FloatArray) -> float:
    """Return the largest angle [rad] between any station and the encoder's, reduced to the encoder's speed; (n,
    stations).
    """
    assert machine.shaft is not None
    reduced = stations_rad / np.array(machine.shaft.speed_ratios)
    off = np.abs(reduced - reduced[:, [machine.shaft.encoder_station]])
    return float(np.nanmax(off, initial=0.0))


def _round_scale(twist_rad: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, .. that draws the twist no larger than _DRAWN_TWIST_RAD; 1 at least."""
    most = _DRAWN_TWIST_RAD / max(twist_rad, 1e-9)
    decade = 10.0 ** math.floor(math.log10(max(most, 1.0)))
    return max(decade * step for step in (1.0, 2.0, 5.0) if step == 1.0 or decade * step <= most)
