"""The topics of the twin: which results of the engine each one needs, and how samples become its messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import textile_twin_core as ttc
from textile_twin_core.comparison.residual import Residual
from textile_twin_ros.messages import (
    JOINT_STATE,
    POINT,
    SECOND_NS,
    WRENCH,
    JointTemplate,
    PointTemplate,
    WrenchTemplate,
)

TORQUE = "balancing_torque_Nm"
SHAFT_FRAME = "main_shaft"
BASE_FRAME = "base"
RESIDUAL_TOPIC = "balancing_torque/residual"


CompileTwin: TypeAlias = Callable[[tuple[str, ...]], Any]


class Output(Protocol):
    """One topic that the twin publishes from samples."""

    topic: str
    msgtype: str
    needs: tuple[str, ...]

    def messages(self, samples: Any) -> Iterable[bytes]:
        """The messages of these samples."""


@dataclass
class TorqueOutput:
    """The predicted balancing torque, or its standard deviation."""

    topic: str
    values: Callable[[Any], Any]
    msgtype: str = WRENCH
    needs: tuple[str, ...] = (TORQUE,)

    def __post_init__(self) -> None:
        self._template = WrenchTemplate(SHAFT_FRAME)

    def messages(self, samples: Any) -> Iterable[bytes]:
        """One WrenchStamped for each sample."""
        return map(self._template.message, samples.stamps.tolist(), self.values(samples).tolist())


@dataclass
class PointOutput:
    """The place of one point of the machine in the frame `base`."""

    topic: str
    point: str
    msgtype: str = POINT

    def __post_init__(self) -> None:
        self.needs: tuple[str, ...] = (f"point_{self.point}_x_m", f"point_{self.point}_y_m")
        self._template = PointTemplate(BASE_FRAME)

    def messages(self, samples: Any) -> Iterable[bytes]:
        """One PointStamped for each sample."""
        x, y = (samples[name].tolist() for name in self.needs)
        return map(self._template.message, samples.stamps.tolist(), x, y)


class JointOutput:
    """Positions and velocities of every joint, passive ones too, at a limited rate.

    They are evaluated by a twin of their own, and only for the samples that are due.

    Args:
        machine: whose joints.
        rate_hz: returns the largest rate, 0 for no limit; samples are chosen by their stamps.
        compile_twin: compiles a twin of the machine for these outputs.
    """

    topic = "joint_states"
    msgtype = JOINT_STATE
    needs: tuple[str, ...] = ()

    def __init__(self, machine: Any, rate_hz: Callable[[], float], compile_twin: CompileTwin) -> None:
        names = [joint.name for joint in machine.joints if joint.kind != "fixed"]
        self._template = JointTemplate(names)
        self._positions = [f"joint_{name}_position" for name in names]
        self._velocities = [f"joint_{name}_velocity" for name in names]
        self._rate_hz, self._compile = rate_hz, compile_twin
        self._twin: Any = None
        self._slot: int | None = None

    def messages(self, samples: Any) -> Iterable[bytes]:
        """One JointState for each sample that is due."""
        if self._twin is None:
            self._twin = self._compile((*self._positions, *self._velocities))
        columns = (samples.stamps, samples.theta_rad, samples.omega_rad_s, samples.alpha_rad_s2)
        for stamp, *state in zip(*(column.tolist() for column in columns), strict=True):
            if self._due(stamp):
                values = self._twin.evaluate(*state)
                yield self._template.full_message(
                    stamp, [values[name] for name in self._positions], [values[name] for name in self._velocities]
                )

    def _due(self, stamp_ns: int) -> bool:
        """True for the first sample in each period of the rate."""
        rate = self._rate_hz()
        if rate <= 0.0:
            return True
        slot = int(stamp_ns * rate) // SECOND_NS
        due, self._slot = slot != self._slot, slot
        return due


class ResidualMessages:
    """The residual's messages."""

    def __init__(self) -> None:
        self._template = WrenchTemplate(SHAFT_FRAME)

    def messages(self, residuals: Iterable[Residual]) -> Iterable[bytes]:
        """One WrenchStamped for each residual, with the stamp of the measured sample."""
        return (self._template.message(item.stamp_ns, item.residual_Nm) for item in residuals)


def outputs_of(machine: Any, joint_rate_hz: Callable[[], float], compile_twin: CompileTwin) -> list[Output]:
    """The topics that a machine has, without the residual.

    A measure that follows a point of the machine (needle, beater, sley) gives the topic of that point's position.
    """
    points = [PointOutput(f"{measure.name}/position", measure.point) for measure in machine.measures]
    joints = JointOutput(machine, joint_rate_hz, compile_twin)
    if TORQUE not in machine.outputs:
        return [*points, joints]
    return [
        TorqueOutput("balancing_torque/predicted", lambda samples: samples[TORQUE]),
        TorqueOutput("balancing_torque/predicted_sigma", lambda samples: samples.torque_sigma_Nm),
        *points,
        joints,
    ]


def twins_of(machine: Any) -> CompileTwin:
    """Compiles twins of a machine and keeps each that it has made."""
    made: dict[tuple[str, ...], Any] = {}

    def compile_twin(outputs: tuple[str, ...]) -> Any:
        if outputs not in made:
            made[outputs] = ttc.compile(machine, outputs=outputs)
        return made[outputs]

    return compile_twin
