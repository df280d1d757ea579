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

"""A machine in the address space of an OPC UA server, by OPC 40001-1 (Machinery): identification and state.

Names and numbers of nodes are those of the published models, http://opcfoundation.org/UA/Machinery/ 1.03 and
http://opcfoundation.org/UA/DI/ 1.04; of either only the part that one machine needs is there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

MACHINERY, DI = "http://opcfoundation.org/UA/Machinery/", "http://opcfoundation.org/UA/DI/"
OWN = "urn:textile-twin:machine"

STATES = {"NotAvailable": (5005, 0), "OutOfService": (5004, 1), "NotExecuting": (5007, 2), "Executing": (5006, 3)}
"""Node and number of each state of MachineryItemState."""
_OF_MACHINERY = ("Location", "InitialOperationDate", "MonthOfConstruction", "YearOfConstruction")
"""Properties of the identification that are not in the namespace of DI."""
_LOCALIZED = ("Manufacturer", "Model")
_UNITS = {"rad": "C81", "rad/s": "2A", "N·m": "NU"}
"""Common codes of UNECE Recommendation 20."""


class MachineSpace:
    """Nodes of one machine: variables with units, identification, state."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self.variables: dict[str, Any] = {}

    async def build(self, name: str, identification: Mapping[str, str], variables: Mapping[str, str]) -> None:
        """Create the nodes.

        Args:
            name: of the machine.
            identification: values of MachineIdentificationType by browse name; empty ones are left out.
            variables: units by browse name.
        """
        from asyncua import ua

        server, ids = self._server, ua.ObjectIds
        self.own = await server.register_namespace(OWN)
        di, machinery = await server.register_namespace(DI), await server.register_namespace(MACHINERY)
        self._machinery = machinery
        folder, states = (
            server.get_node(ua.NodeId(ids.FolderType)),
            server.get_node(ua.NodeId(ids.FiniteStateMachineType)),
        )
        group = await _type(folder, di, 1005, "FunctionalGroupType")
        item = await _type(group, machinery, 1004, "MachineryItemIdentificationType")
        identity = await _type(item, machinery, 1012, "MachineIdentificationType")
        state_machine = await _type(states, machinery, 1002, "MachineryItemState_StateMachineType")
        for state, (node, number) in STATES.items():
            label = ua.QualifiedName(state, machinery)
            made = await self.add(state_machine, ua.NodeId(node, machinery), label, ids.StateType)
            await made.add_property(0, "StateNumber", number, ua.VariantType.UInt32)
        objects, label = server.nodes.objects, ua.QualifiedName("Machines", machinery)
        machines = await self.add(objects, ua.NodeId(1001, machinery), label, ids.FolderType, ids.Organizes)
        label = ua.QualifiedName(name, self.own)
        self.machine = await self.add(machines, name, label, ids.BaseObjectType, ids.Organizes)
        label = ua.QualifiedName("Identification", di)
        own = await self.add(self.machine, f"{name}.Identification", label, identity.nodeid, ids.HasAddIn)
        for key, value in identification.items():
            if value:
                label = ua.QualifiedName(key, machinery if key in _OF_MACHINERY else di)
                text = ua.LocalizedText(value) if key in _LOCALIZED else value
                await own.add_property(ua.NodeId(f"{name}.Identification.{key}", self.own), label, text)
        label = ua.QualifiedName("MachineryBuildingBlocks", machinery)
        blocks = await self.add(self.machine, f"{name}.MachineryBuildingBlocks", label, ids.FolderType)
        await blocks.add_reference(own, ids.HasAddIn)
        label, place = ua.QualifiedName("MachineryItemState", machinery), f"{name}.MachineryItemState"
        machine_state = await self.add(blocks, place, label, state_machine.nodeid, ids.HasAddIn)
        label, first = ua.QualifiedName("CurrentState", 0), ua.Variant(ua.LocalizedText(""))
        current = await self.add(
            machine_state, f"{place}.CurrentState", label, ids.FiniteStateVariableType, value=first
        )
        identifier = await current.add_property(0, "Id", ua.NodeId(), ua.VariantType.NodeId)
        count = await current.add_property(0, "Number", 0, ua.VariantType.UInt32)
        self._state = current, identifier, count
        await self.set_state("NotAvailable")
        for key, unit in variables.items():
            label, zero = ua.QualifiedName(key, self.own), ua.Variant(0.0)
            node = await self.add(self.machine, f"{name}.{key}", label, ids.AnalogUnitType, value=zero)
            await node.add_property(0, "EngineeringUnits", _unit(unit))
            bad = ua.StatusCode(ua.StatusCodes.BadWaitingForInitialData)
            await node.write_value(ua.DataValue(zero, StatusCode=bad))
            self.variables[key] = node

    async def set_state(self, name: str) -> None:
        """Enter a state of `STATES`."""
        from asyncua import ua

        node, number = STATES[name]
        text, identifier, count = self._state
        await text.write_value(ua.Variant(ua.LocalizedText(name)))
        await identifier.write_value(ua.Variant(ua.NodeId(node, self._machinery)))
        await count.write_value(ua.Variant(number, ua.VariantType.UInt32))

    async def add(
        self, parent: Any, node_id: Any, name: Any, kind: Any, reference: int | None = None, value: Any = None
    ) -> Any:
        """Add an object, or with a value a variable, without the optional children of its type.

        Args:
            parent: the node above.
            node_id: its id; a text is one in the machine's own namespace.
            name: its browse name.
            kind: id of its type.
            reference: from the parent; default: HasComponent.
            value: the first value of a variable.
        """
        from asyncua import ua

        attributes: Any = ua.ObjectAttributes()
        if value is not None:
            attributes = ua.VariableAttributes(Value=value, DataType=ua.NodeId(value.VariantType.value), ValueRank=-1)
            attributes.AccessLevel = attributes.UserAccessLevel = ua.AccessLevel.CurrentRead.mask
        attributes.DisplayName = ua.LocalizedText(name.Name)
        item = ua.AddNodesItem(
            RequestedNewNodeId=ua.NodeId(node_id, self.own) if isinstance(node_id, str) else node_id,
            BrowseName=name,
            NodeClass=ua.NodeClass.Object if value is None else ua.NodeClass.Variable,
            ParentNodeId=parent.nodeid,
            ReferenceTypeId=ua.NodeId(ua.ObjectIds.HasComponent if reference is None else reference),
            TypeDefinition=ua.NodeId(kind) if isinstance(kind, int) else kind,
            NodeAttributes=attributes,
        )
        (result,) = await self._server.iserver.isession.add_nodes([item])
        result.StatusCode.check()
        return self._server.get_node(result.AddedNodeId)


async def _type(above: Any, space: int, number: int, name: str) -> Any:
    from asyncua import ua

    return await above.add_object_type(ua.NodeId(number, space), ua.QualifiedName(name, space))


def _unit(name: str) -> Any:
    """The unit as OPC 10000-8, 5.6.3 writes it: the letters of its code as the bytes of a number."""
    from asyncua import ua

    return ua.EUInformation(
        NamespaceUri="http://www.opcfoundation.org/UA/units/un/cefact",
        UnitId=int.from_bytes(_UNITS[name].encode(), "big"),
        DisplayName=ua.LocalizedText(name),
        Description=ua.LocalizedText(name),
    )
