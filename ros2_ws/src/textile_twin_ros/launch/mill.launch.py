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

"""A mill: for each machine a twin and, if wanted, view, recorder, monitor and fault book, in a namespace of its own.

ros2 launch textile_twin_ros mill.launch.py machines:="m1 m2 m3" record:=out/recordings book:=out/faults
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def nodes(context: LaunchContext) -> list[Node]:
    """The nodes of all machines named."""
    names = ("mill", "machines", "record", "book", "view", "params_file")
    mill, machines, recordings, book, view, file = (LaunchConfiguration(name).perform(context) for name in names)
    if not Path(file).is_file():  # the nodes would run with their defaults
        raise FileNotFoundError(f"params_file:={file}: there is no such file")
    if not machines.split():
        raise ValueError('machines:=: name at least one, as in machines:="m1 m2"')
    parameters: dict[str, list[object]] = {"twin_node": [file]}
    if view.lower() == "true":
        parameters["view_node"] = [file]
    if recordings:
        parameters["record_node"] = [{"folder": recordings}]
    if book:
        parameters["monitor_node"] = [file, {"book": book}]
        parameters["fault_node"] = [{"book": book}]
    return [
        Node(
            package="textile_twin_ros",
            executable=node,
            namespace=f"/{mill}/{machine}",
            parameters=own,
            output="screen",
        )
        for machine in machines.split()
        for node, own in parameters.items()
    ]


def generate_launch_description() -> LaunchDescription:
    config = PathJoinSubstitution([FindPackageShare("textile_twin_ros"), "config", "mill.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("mill", default_value="mill", description="namespace of the mill"),
            DeclareLaunchArgument("machines", default_value="m1 m2", description="namespaces of its machines"),
            DeclareLaunchArgument("params_file", default_value=config, description="parameters of the nodes"),
            DeclareLaunchArgument("view", default_value="false", description="serve rerun viewers"),
            DeclareLaunchArgument("record", default_value="", description="folder of recordings; empty records none"),
            DeclareLaunchArgument("book", default_value="", description="folder of the fault book; empty keeps none"),
            OpaqueFunction(function=nodes),
        ]
    )
