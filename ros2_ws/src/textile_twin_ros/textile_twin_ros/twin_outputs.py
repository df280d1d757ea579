# Copyright 2026 textile-twin contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
#
# SPDX-License-Identifier: Apache-2.0

"""The topics of the twin: which results of the engine each one needs, and how samples become its messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from operator import itemgetter
from typing import Protocol, TypeAlias

import textile_twin_core as ttc
from textile_twin_core.comparison.residual import Residual
from textile_twin_core.machine import AnyMachine
from textile_twin_core.recordings.message_types import FLOAT64, JOINT_STATE, POINT, WRENCH
from textile_twin_core.recordings.predicted_topics import predicted_topics
from textile_twin_core.twin import ElasticTwin, HistoryTwin, Twin, idle_twin
from textile_twin_core.twin.session import Sample
from textile_twin_ros import contact_events
from textile_twin_ros.messages import SECOND_NS, JointTemplate, PointTemplate, WrenchTemplate, float_message

TORQUE = "balancing_torque_Nm"
SHAFT_FRAME = "main_shaft"
BASE_FRAME = "base"
SIGMA_TOPIC = "balancing_torque/predicted_sigma"
RESIDUAL_TOPIC = "balancing_torque/residual"


CompiledTwin: TypeAlias = Twin | ElasticTwin | HistoryTwin
CompileTwin: TypeAlias = Callable[[tuple[str, ...]], CompiledTwin]


class Output(Protocol):
    """One topic that the twin publishes from samples."""

    topic: str
    msgtype: str
    needs: tuple[str, ...]

    def message(self, sample: Sample) -> bytes | None:
        """The message of this sample; None where its rate leaves the sample out."""


@dataclass
class TorqueOutput:
    """The predicted balancing torque, its standard deviation, or the torque in a piece of an elastic shaft."""

    topic: str
    value: Callable[[Sample], float]
    msgtype: str = WRENCH
    needs: tuple[str, ...] = (TORQUE,)
    frame: str = SHAFT_FRAME

    def __post_init__(self) -> None:
        self._template = WrenchTemplate(self.frame)

    def message(self, sample: Sample) -> bytes:
        """A WrenchStamped."""
        return self._template.message(sample.stamp, self.value(sample))


@dataclass
class PointOutput:
    """The place of one point of the machine in the frame `base`."""

    topic: str
    point: str
    z_m: float = 0.0
    msgtype: str = POINT

    def __post_init__(self) -> None:
        self.needs: tuple[str, ...] = (f"point_{self.point}_x_m", f"point_{self.point}_y_m")
        self._place = itemgetter(*self.needs)
        self._template = PointTemplate(BASE_FRAME, self.z_m)

    def message(self, sample: Sample) -> bytes:
        """A PointStamped."""
        return self._template.message(sample.stamp, *self._place(sample.outputs))


@dataclass
class NumberOutput:
    """A plain number, such as the twist of an elastic shaft."""

    topic: str
    output: str
    msgtype: str = FLOAT64

    def __post_init__(self) -> None:
        self.needs: tuple[str, ...] = (self.output,)

    def message(self, sample: Sample) -> bytes:
        """A Float64."""
        return float_message(sample.outputs[self.output])


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
    """Positions and velocities of every joint of a machine, passive ones too, at a limited rate."""

    topic = "joint_states"
    msgtype = JOINT_STATE

    def __init__(self, machine: AnyMachine, rate_hz: Callable[[], float]) -> None:
        self._template = JointTemplate(tuple(machine.joint_outputs))
        positions, velocities = zip(*machine.joint_outputs.values(), strict=True)
        self.needs = (*positions, *velocities)
        self._values, self._count = itemgetter(*self.needs), len(positions)
        self._thinning = Thinning(rate_hz)

    def message(self, sample: Sample) -> bytes | None:
        """A JointState."""
        if not self._thinning.keeps(sample.stamp):
            return None
        values = self._values(sample.outputs)
        return self._template.full_message(sample.stamp, values[: self._count], values[self._count :])


class ResidualMessages:
    """The residual's messages."""

    def __init__(self) -> None:
        self._template = WrenchTemplate(SHAFT_FRAME)

    def messages(self, residuals: Iterable[Residual]) -> Iterable[bytes]:
        """One WrenchStamped for each residual, with the stamp of the measured sample."""
        return (self._template.message(item.stamp_ns, item.residual_Nm) for item in residuals)


def outputs_of(machine: AnyMachine, joint_rate_hz: Callable[[], float]) -> list[Output]:
    """The topics that a machine has, without the residual.

    Each measure of a linkage (needle, beater, sley) gives the topic of its point's position; for an elastic shaft see
    `predicted_topics`.
    """
    outputs: list[Output] = []
    if machine.has_complete_torque:
        outputs.append(TorqueOutput("balancing_torque/predicted", lambda sample: sample.outputs[TORQUE]))
        outputs.append(TorqueOutput(SIGMA_TOPIC, lambda sample: sample.torque_sigma_Nm))
    topics = predicted_topics(machine)
    outputs += [PointOutput(topic, point, topics.depths_m.get(topic, 0.0)) for topic, point in topics.points.items()]
    outputs += [
        TorqueOutput(topic, _value_of(output), needs=(output,), frame=frame)
        for topic, (output, frame) in topics.pieces.items()
    ]
    outputs += [NumberOutput(topic, output) for topic, output in topics.numbers.items()]
    return [*outputs, JointOutput(machine, joint_rate_hz)]


def _value_of(output: str) -> Callable[[Sample], float]:
    return lambda sample: sample.outputs[output]


def topics_of(machine: AnyMachine) -> dict[str, str]:
    """Every topic that comes of a machine's samples, with its message type."""
    topics = {output.topic: output.msgtype for output in outputs_of(machine, lambda: 0.0)}
    if machine.has_complete_torque:
        topics[RESIDUAL_TOPIC] = WRENCH
    if machine.has_history:
        topics[contact_events.TOPIC] = contact_events.MSGTYPE
    return topics


def twins_of(machine: AnyMachine) -> CompileTwin:
    """Compiles twins of a machine and keeps each that it has made."""
    made: dict[tuple[str, ...], CompiledTwin] = {}

    def compile_twin(outputs: tuple[str, ...]) -> CompiledTwin:
        if outputs not in made:
            made[outputs] = ttc.compile(machine, outputs=outputs) if outputs else idle_twin(machine)
        return made[outputs]

    return compile_twin
