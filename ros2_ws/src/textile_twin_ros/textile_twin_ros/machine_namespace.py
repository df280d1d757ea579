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

"""Topics of one machine: a namespace is a machine, and topics in another's are not ours."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from textile_twin_core.recordings.schemas import FLOAT64, HEADER, JOINT_STATE, POINT, WRENCH

#: Topics that all machines share.
SHARED = ("/diagnostics", "/clock", "/tf", "/tf_static")
NODES = (
    "twin_node",
    "replay_node",
    "record_node",
    "shaft_node",
    "view_node",
    "plc_node",
    "opcua_node",
    "monitor_node",
    "fault_node",
    "opcua_server_node",
)
# Only a machine has these: other topics in the same namespace are that machine's, too.
_OF_A_MACHINE = (
    "twin_node/transition_event",
    "main_shaft/angle",
    "balancing_torque/measured",
    "balancing_torque/predicted",
)
INDEX = "main_shaft/index"
SECOND_ANGLE = "main_shaft/second_angle"
#: Topics of a machine's sensors.
INPUTS = ("main_shaft/angle", INDEX, SECOND_ANGLE, "balancing_torque/measured")
FORCE_PEAK, WORK = "process/force_peak", "process/work"
#: Topics of monitor_node.
PROCESS = (FORCE_PEAK, WORK)
#: Published once, for late listeners too.
DESCRIPTIONS = ("robot_description", "markers")
OUTPUTS = (
    "balancing_torque/predicted",
    "balancing_torque/predicted_sigma",
    "balancing_torque/residual",
    "needle/position",
    "beater/position",
    "sley/position",
    "joint_states",
    "contact_events",
    *DESCRIPTIONS,
)
_ANGLE = "main_shaft/angle"
_ANGLE_TYPES = (JOINT_STATE, FLOAT64, HEADER)
_OF_A_TWIN = (
    "balancing_torque/predicted",
    "balancing_torque/predicted_sigma",
    "balancing_torque/residual",
    "contact_events",
    "twin_node/transition_event",
)
_OF_AN_ELASTIC_SHAFT = re.compile(r"(^|/)(torque_piece_\w+_Nm|twist_rad|\w+_lag_rad|\w+_spread_m)$")
_NAMES = (*_OF_A_MACHINE, *INPUTS, *OUTPUTS, *PROCESS)


def published_by_twins(topics: Mapping[str, str]) -> set[str]:
    """Topics of a recording that a running twin or its monitor publishes again from the others.

    Joint states alone may be a machine's own sensors: they are a twin's where another topic can be its shaft angle.

    Args:
        topics: message types by names.

    Returns:
        Names of topics; none where no topic would remain to predict from.
    """
    angles = {topic for topic, msgtype in topics.items() if msgtype in _ANGLE_TYPES}
    places = {place for topic in topics if (place := _namespace(topic, (*_OF_A_TWIN, _ANGLE))) is not None}
    found = {topic for topic in topics if _namespace(topic, _OF_A_TWIN) is not None}
    found |= {topic for topic, msgtype in topics.items() if topic.endswith("/position") and msgtype == POINT}
    found |= {topic for topic in topics if _namespace(topic, PROCESS) is not None}
    found |= {topic for topic, msgtype in topics.items() if _is_of_an_elastic_shaft(topic, msgtype)}
    general = {f"{place}{name}" for place in places for name in ("joint_states", *DESCRIPTIONS)} & topics.keys()
    if angles - general:
        found |= general
    if not found or not angles - found:
        return set()
    return found | ({"/diagnostics"} & topics.keys())  # nodes of the suite report there, too


class MachineNamespace:
    """Tells the topics of the machine in a namespace from those of machines in other namespaces.

    Args:
        namespace: the machine's namespace, "/" for none.
    """

    def __init__(self, namespace: str) -> None:
        self._own = namespace.rstrip("/") + "/"
        self._others: set[str] = set()

    def learn(self, topics: Iterable[str]) -> None:
        """Take note of the machines that these topics show."""
        for topic in topics:
            place = _namespace(topic, _OF_A_MACHINE)
            if place is not None and place != self._own:
                self._others.add(place)

    def has(self, topic: str) -> bool:
        """Return whether a topic is this machine's or shared by all."""
        if topic in SHARED:
            return True
        if not topic.startswith(self._own) or _namespace(topic, _NAMES) not in (None, self._own):
            return False
        return not any(topic.startswith(other) for other in self._others if len(other) > len(self._own))

    def speaks_of(self, status_name: str) -> bool:
        """Return whether a status, named as `machine_3/twin_node: what`, is not of another machine's node."""
        node = "/" + status_name.partition(":")[0].strip("/ ")
        place, _, name = node.rpartition("/")
        return name not in NODES or place + "/" == self._own


def _namespace(topic: str, names: Iterable[str]) -> str | None:
    """The namespace, with a slash at its end, before one of these names; None for another topic."""
    for name in names:
        if topic.endswith(f"/{name}"):
            return topic.removesuffix(name)
    return None


def _is_of_an_elastic_shaft(topic: str, msgtype: str) -> bool:
    """Return true if a topic has the name and type of an elastic shaft's output, other than positions."""
    return msgtype in (FLOAT64, WRENCH) and _OF_AN_ELASTIC_SHAFT.search(topic) is not None
