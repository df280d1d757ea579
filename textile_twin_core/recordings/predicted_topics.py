"""Topics of a machine's predictions, and the outputs that each needs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.machine.elastic_outputs import LAG, PIECE_TORQUE, SPREAD, TWIST, elastic_outputs
from textile_twin_core.machine.linkage_row import station_places_m

TORQUE = "balancing_torque_Nm"
_FORBIDDEN = re.compile(r"\W", re.ASCII)


@dataclass(frozen=True)
class PredictedTopics:
    """Published topics of a machine.

    Attributes:
        has_torque: True for the balancing torque with its sigma and residual.
        points: Topic -> point of the machine whose position it carries.
        joints: Joint of joint_states -> its outputs for position and velocity.
        depths_m: Topic of a point -> its z [m]; 0 by default.
        pieces: Topic -> output for the torque of a piece of an elastic shaft, and the frame at its far end.
        numbers: Topic -> output of a plain number.
    """

    has_torque: bool
    points: dict[str, str]
    joints: dict[str, tuple[str, str]]
    depths_m: Mapping[str, float] = field(default_factory=dict)
    pieces: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    numbers: Mapping[str, str] = field(default_factory=dict)

    @property
    def outputs(self) -> list[str]:
        """Outputs to compile the machine for."""
        torque = [TORQUE] if self.has_torque else []
        places = [f"point_{point}_{axis}_m" for point in self.points.values() for axis in "xy"]
        elastic = [*(output for output, _ in self.pieces.values()), *self.numbers.values()]
        return [*torque, *places, *(name for pair in self.joints.values() for name in pair), *elastic]


def predicted_topics(machine: AnyMachine) -> PredictedTopics:
    """List the topics of a machine: positions such as needle/position for each measure, its joints, its torque.

    A machine of sliding elements has them as its joints and no torque, since samples cannot represent impacts. A
    machine with an elastic main shaft also has the tool of every station, such as needle_at_s3/position, and the
    outputs of the shaft (see `elastic_outputs`), each under its own name.
    """
    points = {f"{measure}/position": point for measure, point in machine.tools.items()}
    joints = dict(machine.joint_outputs)
    if not isinstance(machine, Machine) or machine.shaft is None:
        return PredictedTopics(machine.has_complete_torque, points, joints)
    depths, pieces, numbers = dict[str, float](), dict[str, tuple[str, str]](), dict[str, str]()
    along = station_places_m(machine)
    for place in machine.linkages:
        for measure, point in machine.tools.items():
            topic = topic_name(f"{measure}_at_{place.at}") + "/position"
            points[topic] = f"{point}_at_{place.at}"
            depths[topic] = float(along[machine.shaft.station(place.at, "at")])
    for name, output in elastic_outputs(machine).items():
        if output.kind == PIECE_TORQUE:
            pieces[topic_name(name)] = name, f"station_{machine.shaft.pieces[output.number].to_station}"
        elif output.kind in (TWIST, LAG, SPREAD):
            numbers[topic_name(name)] = name
    return PredictedTopics(machine.has_complete_torque, points, joints, depths, pieces, numbers)


def topic_name(name: str) -> str:
    """Convert a name to a part of a topic: characters that ROS forbids become `_`."""
    return _FORBIDDEN.sub("_", name)
