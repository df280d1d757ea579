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

"""Variables of an OPC UA server: every change of some of them, none left out, and values written into others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from textile_twin_ros.plc_registers import TYPES, nearest

if TYPE_CHECKING:
    from asyncua.client.client import Client

_PUBLISHING_MS = 10.0
_OVERFLOW = 0x480
"""Status bits (OPC 10000-4, 7.39.1): of a data value, and a queue that ran over."""
_NUMPY_NAMES = {"SByte": "int8", "Byte": "uint8", "Float": "float32", "Double": "float64"}
"""Of the types that OPC UA calls otherwise."""
_NUMBERS = ("int8", "uint8", *TYPES)
_COUNTER_WIDTHS = {"Int16": 1 << 16, "UInt16": 1 << 16, "Int32": 1 << 32, "UInt32": 1 << 32}
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_STAMP_SECONDS = 1 << 31
"""Seconds since 1970 that a stamp of ROS holds."""


@dataclass(frozen=True)
class Value:
    """One change of a variable.

    Attributes:
        number: None where it is no number, or the server marks it as bad.
        stamp_ns: by the clock of `clock`; None without any.
        clock: "source"; "server" where the source gives no time; "" without any.
        counter_width: range of a whole number of 16 or 32 bits; None for other types.
        overflow: changes before it are lost, since the server's queue ran over.
    """

    number: float | None
    stamp_ns: int | None
    clock: str
    counter_width: int | None
    overflow: bool


class NodeName:
    """A variable as a user writes it: ns=2;s=Loom.Angle, or nsu=URI;s=Loom.Angle with the URI of its namespace.

    Args:
        text: what the user wrote.

    Raises:
        ValueError: it is no node id.
    """

    def __init__(self, text: str) -> None:
        from asyncua import ua

        self.text = text
        self._uri = ""
        if text.startswith("nsu="):
            self._uri, separator, text = text.removeprefix("nsu=").rpartition(";")
            if not separator or not self._uri:
                raise ValueError("write nsu=URI;s=NAME, with the URI of its namespace")
        try:
            self._node_id = ua.NodeId.from_string(text)
        except ua.UaError as error:
            raise ValueError(str(error)) from error

    async def at(self, client: Client) -> Any:
        """Return the node id on this server, whose namespaces may have other numbers after a restart.

        Raises:
            UaError: the server has no namespace of this URI.
        """
        from asyncua import ua

        if not self._uri:
            return self._node_id
        there = await client.get_namespace_array()
        if self._uri not in there:
            raise ua.UaError(f"{self.text}: the server has no namespace {self._uri}; available: {', '.join(there)}")
        return ua.NodeId(self._node_id.Identifier, there.index(self._uri), self._node_id.NodeIdType)


class Values:
    """The variables of one connection.

    Args:
        client: asyncua's client, connected.
        queue: changes of a variable that the server keeps until they are fetched.
        sampling_ms: how often it looks; 0: as fast as it can.
    """

    def __init__(self, client: Client, queue: int, sampling_ms: float) -> None:
        self._client, self._queue, self._sampling_ms = client, queue, sampling_ms
        self._takers: dict[Any, Callable[[Value], None]] = {}
        self._types: dict[Any, Any] = {}
        self.gone = ""
        """Variable that the server has no longer; empty while all are there."""

    async def subscribe(self, variables: Mapping[str, Any], takers: Mapping[str, Callable[[Value], None]]) -> None:
        """Call each variable's taker with every change; also with an equal value that is written again.

        Raises:
            UaError: the server has no such variable.
        """
        from asyncua import ua
        from asyncua.ua.attribute_ids import AttributeIds
        from asyncua.ua.uaerrors import UaError

        subscription = await self._client.create_subscription(_PUBLISHING_MS, self)
        requests = []
        for handle, (name, node_id) in enumerate(variables.items(), start=1):
            self._takers[node_id] = takers[name]
            wanted = ua.MonitoringParameters(
                ClientHandle=handle,
                SamplingInterval=self._sampling_ms,
                Filter=ua.DataChangeFilter(Trigger=ua.DataChangeTrigger.StatusValueTimestamp),
                QueueSize=self._queue,
                DiscardOldest=True,
            )
            place = ua.ReadValueId(NodeId=node_id, AttributeId=AttributeIds.Value)
            requests.append(
                ua.MonitoredItemCreateRequest(
                    ItemToMonitor=place, MonitoringMode=ua.MonitoringMode.Reporting, RequestedParameters=wanted
                )
            )
        for name, result in zip(variables, await subscription.create_monitored_items(requests), strict=True):
            if isinstance(result, ua.StatusCode):
                raise UaError(f"{name}, {variables[name].to_string()}: {result.name}")

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        """Take a change; asyncua calls this."""
        from asyncua import ua

        change = data.monitored_item.Value
        status = change.StatusCode
        if status is not None and status.value == ua.StatusCodes.BadNodeIdUnknown:
            self.gone = node.nodeid.to_string()
        stamp_ns, clock = _stamp_ns(change.SourceTimestamp), "source"
        if stamp_ns is None:
            stamp_ns, clock = _stamp_ns(change.ServerTimestamp), "server"
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        number = float(value) if is_number and (status is None or status.is_good()) else None
        overflow = status is not None and status.value & _OVERFLOW == _OVERFLOW
        width = _COUNTER_WIDTHS.get(change.Value.VariantType.name) if change.Value is not None else None
        self._takers[node.nodeid](Value(number, stamp_ns, "" if stamp_ns is None else clock, width, overflow))

    async def write(self, node_id: Any, number: float) -> None:
        """Write a number as the type that the variable has, the nearest that it can hold.

        Raises:
            UaError: the server does not take it.
        """
        from asyncua import ua

        node = self._client.get_node(node_id)
        if node_id not in self._types:
            self._types[node_id] = await node.read_data_type_as_variant_type()
        kind = self._types[node_id]
        name = _NUMPY_NAMES.get(kind.name, kind.name.lower())
        value = nearest(name, number) if name in _NUMBERS else number
        await node.write_value(ua.DataValue(ua.Variant(value, kind)))


def _stamp_ns(moment: datetime | None) -> int | None:
    """Nanoseconds since 1970 of a time, which is UTC where it names no zone; None where no stamp can hold it.

    OPC UA writes the lack of a time as 0, too, which is the beginning of 1601 (OPC 10000-6, 5.2.2.5).
    """
    if moment is None:
        return None
    since = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)) - _EPOCH
    seconds = since.days * 86400 + since.seconds
    return (seconds * 1_000_000 + since.microseconds) * 1000 if 0 <= seconds < _STAMP_SECONDS else None
