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

"""Impacts and touches of a machine with a history: as messages, and back."""

from __future__ import annotations

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from textile_twin_core.contact import ContactEvent
from textile_twin_core.twin.predictor import StampedEvent
from textile_twin_ros.messages import SECOND_NS

TOPIC = "contact_events"
MSGTYPE = "diagnostic_msgs/msg/DiagnosticArray"
_AMOUNTS = ("approach_speed_m_s", "impulse_Ns", "energy_lost_J", "drive_work_J")


def contact_message(events: Sequence[StampedEvent], machine: str) -> DiagnosticArray:
    """Message of the events since the last one, with the stamp of the first: a status is an event.

    Its name is the stop's or pad's, its message the kind (impact, rest, release, touch, leave, slack, push).
    """
    message = DiagnosticArray()
    seconds, nanoseconds = divmod(int(events[0].stamp), SECOND_NS)
    message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
    for stamp, event in events:
        values = {"stamp_ns": str(int(stamp)), "lower": event.bodies[0], "upper": event.bodies[1]}
        values |= {name: repr(float(getattr(event, name))) for name in _AMOUNTS}
        message.status.append(
            DiagnosticStatus(
                level=DiagnosticStatus.OK,
                name=event.name,
                message=event.kind,
                hardware_id=machine,
                values=[KeyValue(key=key, value=value) for key, value in values.items()],
            )
        )
    return message


def contact_events(message: DiagnosticArray) -> list[StampedEvent]:
    """Contact events of a message; other entries are skipped."""
    found = []
    for status in message.status:
        values = {each.key: each.value for each in status.values}
        try:
            stamp, bodies = int(values["stamp_ns"]), (values["lower"], values["upper"])
            amounts = {name: float(values[name]) for name in _AMOUNTS}
        except (KeyError, ValueError):
            continue
        time_s = stamp / SECOND_NS
        found.append(StampedEvent(stamp, ContactEvent(time_s, status.message, status.name, bodies, time_s, **amounts)))
    return found
