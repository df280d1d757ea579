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

"""One machine in a namespace of its own: its twin and, if wanted, view, recorder, fault book and a simulated shaft.

ros2 launch textile_twin_ros twin.launch.py machine:=tufting namespace:=/mill/m1 view:=true record:=out/recordings
ros2 launch textile_twin_ros twin.launch.py machine:=tufting shaft:=simulated
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import (
    EqualsSubstitution,
    LaunchConfiguration,
    NotEqualsSubstitution,
    PathJoinSubstitution,
)
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def check(context: LaunchContext) -> None:
    """Refuse a parameter file that is not there: without it the nodes would run with their defaults."""
    file = LaunchConfiguration("params_file").perform(context)
    if not Path(file).is_file():
        raise FileNotFoundError(f"params_file:={file}: there is no such file")


def generate_launch_description() -> LaunchDescription:
    config = PathJoinSubstitution([FindPackageShare("textile_twin_ros"), "config", "twin.yaml"])
    machine, namespace = LaunchConfiguration("machine"), LaunchConfiguration("namespace")
    parameters, recordings = LaunchConfiguration("params_file"), LaunchConfiguration("record")
    book = LaunchConfiguration("book")
    has_book = IfCondition(NotEqualsSubstitution(book, ""))
    simulated = EqualsSubstitution(LaunchConfiguration("shaft"), "simulated")
    return LaunchDescription(
        [
            DeclareLaunchArgument("machine", default_value="tufting", description="machine name or machine file"),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of the machine's topics"),
            DeclareLaunchArgument("params_file", default_value=config, description="parameters of the nodes"),
            DeclareLaunchArgument("view", default_value="false", description="serve rerun viewers"),
            DeclareLaunchArgument("record", default_value="", description="folder of recordings; empty records none"),
            DeclareLaunchArgument("book", default_value="", description="folder of the fault book; empty keeps none"),
            DeclareLaunchArgument(
                "shaft",
                default_value="machine",
                choices=["machine", "simulated"],
                description="simulated: a dry run by shaft_node",
            ),
            OpaqueFunction(function=check),
            Node(
                package="textile_twin_ros",
                executable="twin_node",
                namespace=namespace,
                parameters=[parameters, {"machine": machine}],
                output="screen",
            ),
            Node(
                package="textile_twin_ros",
                executable="view_node",
                namespace=namespace,
                parameters=[{"machine": machine}],
                condition=IfCondition(LaunchConfiguration("view")),
                output="screen",
            ),
            Node(
                package="textile_twin_ros",
                executable="record_node",
                namespace=namespace,
                parameters=[{"folder": recordings}],
                condition=IfCondition(NotEqualsSubstitution(recordings, "")),
                output="screen",
            ),
            Node(
                package="textile_twin_ros",
                executable="monitor_node",
                namespace=namespace,
                parameters=[{"machine": machine, "book": book}],
                condition=has_book,
                output="screen",
            ),
            Node(
                package="textile_twin_ros",
                executable="fault_node",
                namespace=namespace,
                parameters=[{"book": book}],
                condition=has_book,
                output="screen",
            ),
            Node(
                package="textile_twin_ros",
                executable="shaft_node",
                namespace=namespace,
                parameters=[{"machine": machine}],
                condition=IfCondition(simulated),
                output="screen",
            ),
        ]
    )
