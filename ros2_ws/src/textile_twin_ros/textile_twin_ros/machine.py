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

"""Machine that a node is configured for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import textile_twin_core as ttc
from textile_twin_core.errors import SceneError
from textile_twin_core.machine import AnyMachine, with_encoder


def load_machine(name: str, encoder: Mapping[str, float] | None = None) -> AnyMachine:
    """A machine by its name, or from a machine file; `encoder`: other settings of its encoder.

    Raises:
        MachineError: no such machine, or a file that declares none, or an encoder that cannot be.
    """
    is_file = Path(name).suffix in (".yaml", ".yml")
    machine: AnyMachine = ttc.load_machine(name) if is_file else ttc.machines.create(name)
    return with_encoder(machine, encoder or {})


def load_linkage(name: str, encoder: Mapping[str, float] | None = None) -> ttc.Machine:
    """The same of a machine that is a linkage.

    Raises:
        MachineError: no such machine, or a file that declares none.
        SceneError: it is no linkage.
    """
    machine = load_machine(name, encoder)
    if not isinstance(machine, ttc.Machine):
        raise SceneError(f"machine '{name}' is no linkage: this node has nothing to show of it; choose another")
    return machine
