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

"""Alarms of the fault book as conditions of an OPC UA server (OPC 10000-9), one for each kind of fault."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from textile_twin_core.comparison.fault_naming import SIDE
from textile_twin_core.errors import TwinError
from textile_twin_core.recordings.fault_book import Fault, FaultBook
from textile_twin_ros.opcua_machinery import MachineSpace

_SEVERITY = {"sensor": 400, "drive": 700, "needle": 700}
"""Of 1 to 1000 (OPC 10000-5, 6.4.2): medium and high."""


class Alarms:
    """Conditions of type AlarmCondition under a machine's object `Faults`, with the method Acknowledge.

    A condition shows the latest fault of its kind. Its EventId names the fault, so that an acknowledgement holds
    across a restart of the server.

    Args:
        server: asyncua's server.
        space: the machine's nodes.
        book: the fault book.
        source: namespace of the machine's monitor.
    """

    def __init__(self, server: Any, space: MachineSpace, book: FaultBook, source: str) -> None:
        self._server, self._space, self._book, self._source = server, space, book, source
        self._conditions: dict[str, Any] = {}
        self._shown: dict[str, Fault] = {}
        self._version = -1

    async def build(self) -> None:
        """Create the nodes."""
        from asyncua import ua

        space, ids, own = self._space, ua.ObjectIds, self._space.own
        place = f"{space.machine.nodeid.Identifier}.Faults"
        label = ua.QualifiedName("Faults", own)
        self._folder = await space.add(space.machine, place, label, ids.FolderType)
        self._counts = {
            name: await self._folder.add_variable(
                ua.NodeId(f"{place}.{name}", own), ua.QualifiedName(name, own), 0, ua.VariantType.UInt32
            )
            for name in ("Standing", "NotAcknowledged")
        }
        for kind in SIDE:
            node = await self._folder.add_object(
                ua.NodeId(f"{place}.{kind}", own),
                ua.QualifiedName(kind, own),
                objecttype=ua.NodeId(ids.AlarmConditionType),
                instantiate_optional=False,
            )
            self._conditions[kind] = node
            await self._show(node, "EnabledState", ua.LocalizedText("Enabled"), True)
            await self._show(node, "ActiveState", ua.LocalizedText("Inactive"), False)
            await self._show(node, "AckedState", ua.LocalizedText("Acknowledged"), True)
            self._server.link_method(await node.get_child("0:Acknowledge"), self._acknowledge)
        # A client may also call the method of the type, with the condition as its object.
        method = ua.NodeId(ids.AcknowledgeableConditionType_Acknowledge)
        self._server.link_method(self._server.get_node(method), self._acknowledge)
        await self._server.nodes.server.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
        await space.machine.set_event_notifier([ua.EventNotifier.SubscribeToEvents])

    async def look(self) -> None:
        """Show the changes of the book.

        Raises:
            TwinError: the book cannot be read.
        """
        from asyncua import ua

        version = self._book.version()
        if version == self._version:
            return
        faults = self._book.faults(self._source)
        counts = {
            "Standing": sum(fault.cleared_ns is None for fault in faults),
            "NotAcknowledged": sum(fault.acknowledged_ns is None for fault in faults),
        }
        for name, count in counts.items():
            await self._counts[name].write_value(ua.Variant(count, ua.VariantType.UInt32))
        for kind, fault in {fault.kind: fault for fault in faults}.items():
            before = self._shown.get(kind)
            if before is None or _state(before) != _state(fault):
                await self._send(self._conditions[kind], fault, silent=before is None and fault.is_over)
                self._shown[kind] = fault
        self._version = version

    async def _show(self, node: Any, name: str, text: Any, value: bool) -> None:
        child = await node.get_child(f"0:{name}")
        await child.write_value(text)
        await (await child.get_child("0:Id")).write_value(value)

    async def _send(self, node: Any, fault: Fault, silent: bool) -> None:
        """Write a condition's variables and send its event."""
        from asyncua import ua
        from asyncua.common.event_objects import AlarmCondition

        stands, known = fault.cleared_ns is None, fault.acknowledged_ns is not None
        active = ua.LocalizedText("Active" if stands else "Inactive")
        acked = ua.LocalizedText("Acknowledged" if known else "Unacknowledged")
        event: Any = AlarmCondition(node.nodeid, fault.text, _SEVERITY[fault.side])
        event.add_property("NodeId", node.nodeid, ua.VariantType.NodeId)
        event.emitting_node = ua.NodeId(ua.ObjectIds.Server)
        event.SourceNode, event.SourceName = self._space.machine.nodeid, fault.machine
        event.EventId = _event_id(fault)
        changed_ns = max(time for time in (fault.raised_ns, fault.acknowledged_ns, fault.cleared_ns) if time)
        event.Time = event.ReceiveTime = datetime.fromtimestamp(changed_ns * 1e-9, UTC)
        event.ConditionName, event.BranchId, event.Retain = fault.kind, ua.NodeId(), not fault.is_over
        event.ConditionClassId = ua.NodeId(ua.ObjectIds.ProcessConditionClassType)
        event.ConditionClassName = ua.LocalizedText("ProcessConditionClass")
        event.InputNode, event.SuppressedOrShelved = ua.NodeId(), False
        event.Quality = ua.StatusCode()
        event.Comment = ua.LocalizedText(fault.acknowledged_by or "")
        setattr(event, "EnabledState/Id", True)
        setattr(event, "ActiveState/Id", stands)
        setattr(event, "AckedState/Id", known)
        event.EnabledState, event.ActiveState, event.AckedState = ua.LocalizedText("Enabled"), active, acked
        for name in ("EventId", "SourceNode", "SourceName", "Time", "ReceiveTime", "Message", "Severity", "Comment"):
            await self._write(node, name, ua.Variant(getattr(event, name), event.data_types[name]))
        for name in ("ConditionName", "BranchId", "Retain"):
            await self._write(node, name, ua.Variant(getattr(event, name), event.data_types[name]))
        await self._show(node, "ActiveState", active, stands)
        await self._show(node, "AckedState", acked, known)
        if not silent:
            await self._server.iserver.subscription_service.trigger_event(event)

    @staticmethod
    async def _write(node: Any, name: str, value: Any) -> None:
        await (await node.get_child(f"0:{name}")).write_value(value)

    async def _acknowledge(self, _condition: Any, event_id: Any, comment: Any) -> Any:
        """The method Acknowledge(EventId, Comment); faults of the kind that came before are acknowledged, too."""
        from asyncua import ua

        codes = ua.StatusCodes
        fault = next((fault for fault in self._shown.values() if _event_id(fault) == event_id.Value), None)
        if fault is None:
            return ua.StatusCode(codes.BadEventIdUnknown)
        remark = (comment.Value.Text if comment.Value is not None else None) or ""
        try:
            earlier = [
                each.number
                for each in self._book.faults(self._source)
                if each.kind == fault.kind and each.number <= fault.number
            ]
            fresh = self._book.acknowledge(earlier, f"OPC UA: {remark}" if remark else "OPC UA")
            await self.look()
        except TwinError:
            return ua.StatusCode(codes.BadResourceUnavailable)
        return ua.StatusCode(codes.Good if fresh else codes.BadConditionBranchAlreadyAcked)


def _state(fault: Fault) -> tuple[int, bool, bool]:
    return fault.number, fault.acknowledged_ns is not None, fault.cleared_ns is not None


def _event_id(fault: Fault) -> bytes:
    """The fault and its state at the event."""
    return f"fault {fault.number}".encode()
