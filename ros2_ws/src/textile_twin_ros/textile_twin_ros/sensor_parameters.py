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

"""Parameters of every node with the machine's sensors as inputs: message types and known properties."""

from __future__ import annotations

from dataclasses import dataclass

from textile_twin_core.machine import ENCODER_OPTIONS
from textile_twin_ros.messages import ANGLE_READERS, TORQUE_READERS
from textile_twin_ros.parameters import parameter

_FILE = "from the machine file"


@dataclass
class EncoderParameters:
    """The machine, and settings of the encoder that its file leaves open."""

    machine: str = parameter("tufting", "machine name, or path of a machine file")
    encoder_teeth: int = parameter(0, f"{ENCODER_OPTIONS['teeth']}; 0: {_FILE}", between=(0, 100_000))
    encoder_missing_teeth: int = parameter(-1, f"{ENCODER_OPTIONS['missing_teeth']}; -1: {_FILE}", between=(-1, 1000))
    encoder_cycle_turns: int = parameter(0, f"{ENCODER_OPTIONS['cycle_turns']}; 0: {_FILE}", between=(0, 1000))
    encoder_resolution_rad: float = parameter(
        0.0, f"{ENCODER_OPTIONS['resolution_rad']}; 0: {_FILE}", between=(0.0, 7.0)
    )
    encoder_stamp_jitter_s: float = parameter(
        -1.0, f"{ENCODER_OPTIONS['stamp_jitter_s']}; -1: {_FILE}", between=(-1.0, 10.0)
    )

    def encoder(self) -> dict[str, float]:
        """Configured settings of the encoder, by name."""
        unset = {"missing_teeth": -1, "stamp_jitter_s": -1.0}
        given = {name: getattr(self, f"encoder_{name}") for name in ENCODER_OPTIONS}
        return {name: value for name, value in given.items() if value != unset.get(name, 0)}


@dataclass
class SensorParameters(EncoderParameters):
    """The inputs of the shaft's angle and torque."""

    angle_type: str = parameter(
        "joint_state", "type of main_shaft/angle; edges: a std_msgs/Header for each tooth", choices=tuple(ANGLE_READERS)
    )
    angle_unit_rad: float = parameter(
        1.0,
        "radians of one unit of main_shaft/angle where it does not hold radians: 0.01745329252 for degrees",
        between=(1e-12, 1e3),
    )
    index: bool = parameter(False, "index pulses give the zero: a std_msgs/Header on main_shaft/index for each turn")
    torque_type: str = parameter("wrench", "type of balancing_torque/measured", choices=tuple(TORQUE_READERS))
    torque_unit_Nm: float = parameter(
        1.0,
        "N m of one unit of the measured torque; for a motor's current its torque constant times the gear ratio",
        between=(-1e6, 1e6),
    )
    joint: str = parameter("main_shaft", "name of the shaft's joint in JointState inputs")
    rate_hz: float = parameter(1000.0, "samples a second at most: queues hold five seconds of them", between=(1.0, 1e5))
    qos_reliability: str = parameter(
        "auto", "of the inputs; auto goes by the publishers", choices=("auto", "reliable", "best_effort")
    )
    no_data_timeout_s: float = parameter(
        2.0, "report an input that is silent for longer than this", between=(0.1, 1e6), live=True
    )
