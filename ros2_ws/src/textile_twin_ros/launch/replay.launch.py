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

"""A recording through the twin into a new recording, which ends by itself when all has been played.

ros2 launch textile_twin_ros replay.launch.py bag:=bags/tufting_160rpm_synthetic out:=out/recording rate:=4.0
"""

from launch import Action, LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from textile_twin_core.recordings import open_bag
from textile_twin_ros.machine import load_machine
from textile_twin_ros.outputs import topics_of

INPUTS = ["main_shaft/angle", "main_shaft/second_angle", "balancing_torque/measured"]
# Queues hold some minutes of 500 Hz: a busy computer then delays but loses nothing.
DEPTH = 100_000
# A lost message is sent again after three seconds, by Fast DDS's own settings: a pause of that is no end.
IDLE_S = 10.0


def nodes(context: LaunchContext) -> list[Action]:
    """Recorder, twin of the machine with all that it has to say, and the player."""
    machine, bag = (LaunchConfiguration(name).perform(context) for name in ("machine", "bag"))
    outputs = list(topics_of(load_machine(machine)))
    # A machine without a torque sensor has no torque in its recordings.
    inputs = [topic for topic in INPUTS if any(name.endswith(f"/{topic}") for name in open_bag(bag).topics)]
    recorder = Node(
        package="textile_twin_ros",
        executable="record_node",
        parameters=[
            {
                "bag": LaunchConfiguration("out"),
                "topics": inputs + outputs,
                "stop_when_idle_s": IDLE_S,
                "rate_hz": float(DEPTH),
                "queue_s": 1.0,
            }
        ],
        output="screen",
    )
    twin = Node(
        package="textile_twin_ros",
        executable="twin_node",
        parameters=[{"machine": machine, "wait_for": outputs, "qos_depth": DEPTH}],
        output="screen",
    )
    replay = Node(
        package="textile_twin_ros",
        executable="replay_node",
        parameters=[
            {
                "bag": bag,
                "rate": ParameterValue(LaunchConfiguration("rate"), value_type=float),
                "wait_for": [f"{topic}=2" for topic in inputs],
                "qos_depth": DEPTH,
            }
        ],
        output="screen",
    )
    done = RegisterEventHandler(OnProcessExit(target_action=recorder, on_exit=[Shutdown(reason="recorded")]))
    return [recorder, twin, replay, done]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="the recording to play"),
            DeclareLaunchArgument("out", default_value="out/recording", description="the recording to write"),
            DeclareLaunchArgument("machine", default_value="tufting", description="machine name or machine file"),
            DeclareLaunchArgument("rate", default_value="1.0", description="speed of playing"),
            OpaqueFunction(function=nodes),
        ]
    )
