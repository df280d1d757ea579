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

"""Latched topics of a machine: robot description, path of the tool, backing."""

from __future__ import annotations

import math
from copy import deepcopy

import numpy as np
from geometry_msgs.msg import Point
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import Marker, MarkerArray

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.loads import Backing
from textile_twin_core.machine import AnyMachine
from textile_twin_core.machine.linkage_row import linkage_row
from textile_twin_core.mechanism import Travel
from textile_twin_ros.endpoints import latched_qos
from textile_twin_ros.outputs import BASE_FRAME

_PATH_POINTS = 361
_LINE_M = 0.001
_BACKING_M = (0.15, 0.002, 0.1)
"""How wide, thick and deep the piece of backing is that is drawn."""
_PATH_COLOUR = ColorRGBA(r=0.85, g=0.45, b=0.15, a=1.0)
_BACKING_COLOUR = ColorRGBA(r=0.55, g=0.5, b=0.4, a=0.6)


class Description:
    """Publishes robot_description and, of a linkage, markers; both are latched.

    Args:
        node: the node that publishes.
        machine: what is described.
    """

    def __init__(self, node: Node, machine: AnyMachine) -> None:
        self._node = node
        self._publishers: list[Publisher] = []
        self._publish(String, "robot_description", String(data=machine.urdf()))
        if isinstance(machine, ttc.Machine):
            self._publish(MarkerArray, "markers", MarkerArray(markers=markers_of(machine)))

    def destroy(self) -> None:
        """Remove the topics."""
        for publisher in self._publishers:
            self._node.destroy_publisher(publisher)

    def _publish(self, msgtype: type, topic: str, message: object) -> None:
        publisher = self._node.create_publisher(msgtype, topic, latched_qos())
        publisher.publish(message)
        self._publishers.append(publisher)


def markers_of(machine: ttc.Machine) -> list[Marker]:
    """The path of each tool over a turn of the shaft, and a piece of the backing at the height where it is entered.

    With an elastic shaft they stand at every linkage.
    """
    markers = _markers_of_one(machine)
    return [_moved(marker, row.number, row.z_m) for row in linkage_row(machine) for marker in markers]


def _markers_of_one(machine: ttc.Machine) -> list[Marker]:
    markers = []
    for measure in machine.measures:
        point = measure.tool(machine.linkage.solved)
        columns = [f"point_{point}_x_m", f"point_{point}_y_m", f"{measure.name}_position_m"]
        theta = np.linspace(*machine.range_rad, _PATH_POINTS)
        found = ttc.compile(machine, outputs=columns).evaluate(theta, np.zeros_like(theta), np.zeros_like(theta))
        x, y, travel = (np.asarray(found[name]) for name in columns)
        markers.append(_path(measure.name, x, y))
        if isinstance(measure, Travel):
            direction = np.array(measure.direction) / math.hypot(*measure.direction)
            for load in machine.loads:
                if isinstance(load, Backing) and load.on == measure.name:
                    place = np.array([x[0], y[0]]) + direction * (load.entry_plane_m - travel[0])
                    markers.append(_backing(measure.name, place, direction))
    return markers


def _moved(marker: Marker, number: int, z_m: float) -> Marker:
    """The same marker along the shaft, with a number of its own."""
    moved = deepcopy(marker)
    moved.id = number
    moved.pose.position.z = float(z_m)
    return moved


def _marker(kind: int, namespace: str, number: int, colour: ColorRGBA) -> Marker:
    marker = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD, color=colour)
    marker.header.frame_id = BASE_FRAME
    marker.pose.orientation.w = 1.0
    return marker


def _path(name: str, x_m: FloatArray, y_m: FloatArray) -> Marker:
    marker = _marker(Marker.LINE_STRIP, f"{name}_path", 0, _PATH_COLOUR)
    marker.scale.x = _LINE_M
    marker.points = [Point(x=float(x), y=float(y), z=0.0) for x, y in zip(x_m, y_m, strict=True)]
    return marker


def _backing(name: str, place_m: FloatArray, direction: FloatArray) -> Marker:
    marker = _marker(Marker.CUBE, f"{name}_backing", 0, _BACKING_COLOUR)
    marker.pose.position.x, marker.pose.position.y = (float(value) for value in place_m)
    # Its thin side, y, lies along the travel of the tool.
    half = 0.5 * (math.atan2(float(direction[1]), float(direction[0])) - math.pi / 2)
    marker.pose.orientation.z, marker.pose.orientation.w = math.sin(half), math.cos(half)
    marker.scale.x, marker.scale.y, marker.scale.z = _BACKING_M
    return marker
