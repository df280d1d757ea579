"""The topics of the twin: which results of the engine each one needs, and how samples become its messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import textile_twin_core as ttc
from textile_twin_core.comparison.residual import Residual
from textile_twin_core.machines import AnyMachine
from textile_twin_core.twin.session import Sample
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
SIGMA_TOPIC = "balancing_torque/predicted_sigma"
RESIDUAL_TOPIC = "balancing_torque/residual"


CompileTwin: TypeAlias = Callable[[tuple[str, ...]], Any]


class Output(Protocol):
    """One topic that the twin publishes from samples."""

    topic: str
    msgtype: str
    needs: tuple[str, ...]

    def message(self, sample: Sample) -> bytes | None:
        """The message of this sample; None where its rate leaves the sample out."""


@dataclass
class TorqueOutput:
    """The predicted balancing torque, or its standard deviation."""

    topic: str
    value: Callable[[Sample], float]
    msgtype: str = WRENCH
    needs: tuple[str, ...] = (TORQUE,)

    def __post_init__(self) -> None:
        self._template = WrenchTemplate(SHAFT_FRAME)

    def message(self, sample: Sample) -> bytes:
        """A WrenchStamped."""
        return self._template.message(sample.stamp, self.value(sample))


@dataclass
class PointOutput:
    """The place of one point of the machine in the frame `base`."""

    topic: str
    point: str
    msgtype: str = POINT

    def __post_init__(self) -> None:
        self.needs: tuple[str, ...] = (f"point_{self.point}_x_m", f"point_{self.point}_y_m")
        self._template = PointTemplate(BASE_FRAME)

    def message(self, sample: Sample) -> bytes:
        """A PointStamped."""
        x, y = self.needs
        return self._template.message(sample.stamp, sample.outputs[x], sample.outputs[y])


class Thinning:
    """Chooses by their stamps which samples a limited rate leaves over.

    Args:
        rate_hz: returns the largest rate, 0 for no limit.
    """

    def __init__(self, rate_hz: Callable[[], float]) -> None:
        self._rate_hz = rate_hz
        self._slot: int | None = None

    def keeps(self, stamp_ns: int) -> bool:
        """True for the first sample in each period of the rate."""
        rate = self._rate_hz()
        if rate <= 0.0:
            return True
        slot = int(stamp_ns * rate) // SECOND_NS
        first, self._slot = slot != self._slot, slot
        return first


class JointOutput:
    """Positions and velocities of every joint of a linkage, passive ones too, at a limited rate.

    They are evaluated by a twin of their own, and only for the samples that are sent.
    """

    topic = "joint_states"
    msgtype = JOINT_STATE
    needs: tuple[str, ...] = ()

    def __init__(self, machine: ttc.Machine, rate_hz: Callable[[], float], compile_twin: CompileTwin) -> None:
        names = [joint.name for joint in machine.joints if joint.kind != "fixed"]
        self._template = JointTemplate(names)
        self._count = len(names)
        self._values = *(f"joint_{name}_position" for name in names), *(f"joint_{name}_velocity" for name in names)
        self._thinning, self._compile = Thinning(rate_hz), compile_twin
        self._twin: Any = None

    def message(self, sample: Sample) -> bytes | None:
        """A JointState."""
        if not self._thinning.keeps(sample.stamp):
            return None
        if self._twin is None:
            self._twin = self._compile(self._values)
        values = (*self._twin.evaluate(sample.theta_rad, sample.omega_rad_s, sample.alpha_rad_s2).values(),)
        return self._template.full_message(sample.stamp, values[: self._count], values[self._count :])


class ElementOutput:
    """Positions and velocities of a machine's sliding elements, as joints of their names, at a limited rate."""

    topic = "joint_states"
    msgtype = JOINT_STATE

    def __init__(self, elements: Sequence[str], rate_hz: Callable[[], float]) -> None:
        self._template = JointTemplate(elements)
        self._positions = tuple(f"{element}_position_m" for element in elements)
        self._velocities = tuple(f"{element}_velocity_m_s" for element in elements)
        self.needs = (*self._positions, *self._velocities)
        self._thinning = Thinning(rate_hz)

    def message(self, sample: Sample) -> bytes | None:
        """A JointState."""
        if not self._thinning.keeps(sample.stamp):
            return None
        positions, velocities = (
            [sample.outputs[name] for name in names] for names in (self._positions, self._velocities)
        )
        return self._template.full_message(sample.stamp, positions, velocities)


class ResidualMessages:
    """The residual's messages."""

    def __init__(self) -> None:
        self._template = WrenchTemplate(SHAFT_FRAME)

    def messages(self, residuals: Iterable[Residual]) -> Iterable[bytes]:
        """One WrenchStamped for each residual, with the stamp of the measured sample."""
        return (self._template.message(item.stamp_ns, item.residual_Nm) for item in residuals)


def outputs_of(machine: AnyMachine, joint_rate_hz: Callable[[], float], compile_twin: CompileTwin) -> list[Output]:
    """The topics that a machine has, without the residual.

    Each measure of a linkage (needle, beater, sley) gives the topic of its point's position.
    """
    if not isinstance(machine, ttc.Machine):
        suffix = "_position_m"
        elements = [name.removesuffix(suffix) for name in machine.outputs if name.endswith(suffix)]
        return [ElementOutput(elements, joint_rate_hz)]
    outputs: list[Output] = []
    if has_torque(machine):
        outputs.append(TorqueOutput("balancing_torque/predicted", lambda sample: sample.outputs[TORQUE]))
        outputs.append(TorqueOutput(SIGMA_TOPIC, lambda sample: sample.torque_sigma_Nm))
    motion = machine.linkage.solved
    outputs += [PointOutput(f"{measure.name}/position", measure.tool(motion)) for measure in machine.measures]
    return [*outputs, JointOutput(machine, joint_rate_hz, compile_twin)]


def has_torque(machine: AnyMachine) -> bool:
    """Whether a balancing torque of this machine can be told: it has one, and no mass is missing."""
    return isinstance(machine, ttc.Machine) and TORQUE in machine.outputs and not machine.missing_for_torque


def twins_of(machine: AnyMachine) -> CompileTwin:
    """Compiles twins of a machine and keeps each that it has made."""
    made: dict[tuple[str, ...], Any] = {}

    def compile_twin(outputs: tuple[str, ...]) -> Any:
        if outputs not in made:
            made[outputs] = ttc.compile(machine, outputs=outputs)
        return made[outputs]

    return compile_twin
