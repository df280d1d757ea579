"""Which topics carry a machine's predictions, and which outputs of the engine each needs."""

from __future__ import annotations

from dataclasses import dataclass

from textile_twin_core.machine import AnyMachine

TORQUE = "balancing_torque_Nm"


@dataclass(frozen=True)
class PredictedTopics:
    """What is published of a machine.

    has_torque: the balancing torque with its sigma and residual; points: topic -> the point of the machine whose
    place it tells; joints: name of each joint of joint_states -> its outputs for position and velocity.
    """

    has_torque: bool
    points: dict[str, str]
    joints: dict[str, tuple[str, str]]

    @property
    def outputs(self) -> list[str]:
        """The outputs to compile the machine for."""
        torque = [TORQUE] if self.has_torque else []
        places = [f"point_{point}_{axis}_m" for point in self.points.values() for axis in "xy"]
        return [*torque, *places, *(name for pair in self.joints.values() for name in pair)]


def predicted_topics(machine: AnyMachine) -> PredictedTopics:
    """The topics of a machine: needle/position and the like for each measure of a linkage, its joints, its torque.

    A machine of sliding elements has them as its joints, and no torque: its impacts are none that a sample could tell.
    """
    return PredictedTopics(
        has_torque=machine.tells_torque,
        points={f"{measure}/position": point for measure, point in machine.tools.items()},
        joints=dict(machine.joint_outputs),
    )
