"""Additional outputs of a machine with an elastic main shaft."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from textile_twin_core.machine.declaration import Declaration
from textile_twin_core.machine.linkage_row import linkage_row

TWIST, LAG, SPREAD = "twist_rad", "lag_rad", "spread_m"
PIECE_TORQUE, ANGLE, SPEED, ACCELERATION, POSITION = (
    "torque",
    "angle_rad",
    "speed_rad_s",
    "acceleration_rad_s2",
    "position_m",
)
PLACED = "placed"
PARTS = ("torque_gravity_Nm", "torque_load_Nm")
SUMS = (
    *PARTS,
    "equivalent_inertia_kgm2",
    "equivalent_inertia_slope_kgm2",
    "kinetic_energy_J",
    "potential_energy_J",
    "balancing_torque_newton_euler_Nm",
)
"""Sums over the linkages, each at its own station's motion."""


@dataclass(frozen=True)
class ElasticOutput:
    """One output of an elastic shaft.

    Attributes:
        kind: kind of quantity.
        number: number of the piece, station or linkage.
        measure: name of the measure, for a quantity of a measure.
        of_linkage: output of a single linkage, for a quantity of the linkage `number`.
    """

    kind: str
    number: int = 0
    measure: str = field(default="")
    of_linkage: str = field(default="")


def elastic_outputs(machine: Declaration) -> Mapping[str, ElasticOutput]:
    """Return the outputs by name that only an elastic shaft has; empty for a rigid one.

    - `torque_piece_A_B_Nm`: torque in the piece from station A to B, positive if it drives B.
    - `twist_rad`: angle of the first station beyond the last, reduced to the main shaft.
    - `station_S_angle_rad`, `_speed_rad_s`, `_acceleration_rad_s2`: of station S itself, behind its gears.
    - `M_at_S_position_m`: measure M of the first linkage at station S.
    - `point_P_at_S_x_m`, `_y_m`: position of a tool's point P of the first linkage at station S.
    - `joint_J_at_S_position`, `_velocity`: of joint J of the linkage at station S; the first linkage has the usual
      names.
    - `M_lag_rad`: angle of the last linkage behind the encoder's station.
    - `M_spread_m`: largest less smallest deviation of M, over the linkages, from its position on a rigid shaft.
    """
    shaft = machine.shaft
    if shaft is None:
        return {}
    found = {
        f"torque_piece_{piece.from_station}_{piece.to_station}_Nm": ElasticOutput(PIECE_TORQUE, k)
        for k, piece in enumerate(shaft.pieces)
    }
    found[TWIST] = ElasticOutput(TWIST)
    for kind in (ANGLE, SPEED, ACCELERATION):
        found |= {f"station_{name}_{kind}": ElasticOutput(kind, k) for k, name in enumerate(shaft.names)}
    for measure in machine.measures:
        for k, place in reversed(list(enumerate(machine.linkages))):
            found[f"{measure.name}_at_{place.at}_{POSITION}"] = ElasticOutput(POSITION, k, measure.name)
        found[f"{measure.name}_{LAG}"] = ElasticOutput(LAG, measure=measure.name)
        found[f"{measure.name}_{SPREAD}"] = ElasticOutput(SPREAD, measure=measure.name)
    for k, place in reversed(list(enumerate(machine.linkages))):
        for name in (f"point_{point}" for point in machine.tools.values()):
            found |= {
                f"{name}_at_{place.at}_{axis}_m": ElasticOutput(PLACED, k, of_linkage=f"{name}_{axis}_m")
                for axis in "xy"
            }
    for row in linkage_row(machine)[1:]:
        for name in (f"joint_{joint.name}" for joint in machine.joints if joint.kind != "fixed"):
            found |= {
                f"{name}{row.suffix}_{what}": ElasticOutput(PLACED, row.number, of_linkage=f"{name}_{what}")
                for what in ("position", "velocity")
            }
    return found
