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

"""Parameters declared in one place per node: a dataclass whose fields carry default, description, range and choices."""

from __future__ import annotations

import dataclasses
import difflib
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from textile_twin_core.errors import SceneError

Declaration = TypeVar("Declaration")


def parameter(
    default: bool | int | float | str | tuple[str, ...],
    description: str,
    *,
    between: tuple[float, float] | None = None,
    choices: Sequence[str] = (),
    live: bool = False,
) -> Any:
    """One field of a node's parameter dataclass.

    Args:
        default: value when it is not set; its type is the parameter's type.
        description: one line, with the unit.
        between: smallest and largest value allowed.
        choices: the values allowed, for strings.
        live: True when it can be changed while the node runs; otherwise it is read-only.
    """
    metadata = {"description": description, "between": between, "choices": tuple(choices), "live": live}
    return dataclasses.field(default=default, metadata=metadata)


def declare(node: Node, declaration: type[Declaration], on_change: Callable[[str], None] | None = None) -> Declaration:
    """Declare every field of a parameter dataclass on a node and return the values that hold.

    Live parameters are written into the returned object when they are set; `on_change` is then called with the name.

    Raises:
        SceneError: a value given at the start has the wrong type, is out of range or not among the choices.
    """
    warn_of_ignored_files(node)
    fields = {field.name: field for field in dataclasses.fields(declaration)}  # type: ignore[arg-type]
    values = {name: _declare_one(node, field) for name, field in fields.items()}
    held = declaration(**values)

    def check(changes: list[Parameter]) -> SetParametersResult:
        for change in changes:
            if change.name in fields:
                try:
                    _checked(fields[change.name], change.value)
                except ValueError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def take(changes: list[Parameter]) -> None:
        for change in changes:
            if change.name in fields:
                setattr(held, change.name, _checked(fields[change.name], change.value))
                if on_change is not None:
                    on_change(change.name)

    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(take)
    _warn_of_unknown(node, fields)
    return held


def _declare_one(node: Node, field: dataclasses.Field[Any]) -> Any:
    kind = Parameter.Type.from_parameter_value(field.default)
    descriptor = ParameterDescriptor(
        description=_described(field),
        read_only=not field.metadata["live"],
        # `rate:=2` is what people write for a float: whole numbers are taken too, and checked here.
        dynamic_typing=kind is Parameter.Type.DOUBLE,
    )
    if kind is Parameter.Type.DOUBLE and field.metadata["between"]:
        low, high = field.metadata["between"]
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)]
    try:
        # An empty list has no type of its own in a parameter, and `ros2 param dump` stops at one that is unset.
        default = list(field.default) or [""] if isinstance(field.default, tuple) else field.default
        given = node.declare_parameter(field.name, default, descriptor).value
        return _checked(field, given)
    except InvalidParameterTypeException as error:
        raise SceneError(f"parameter '{field.name}' must be {_kind_name(field)}: {error}") from error
    except ValueError as error:
        raise SceneError(str(error)) from error
    except ParameterException as error:
        raise SceneError(f"parameter '{field.name}': {error}") from error


def _checked(field: dataclasses.Field[Any], value: Any) -> Any:
    """The value in the field's type.

    Raises:
        ValueError: with a line for the person who set it.
    """
    name, default = field.name, field.default
    if isinstance(default, tuple):
        if not isinstance(value, Sequence) or not all(isinstance(item, str) for item in value):
            raise ValueError(f"parameter '{name}' must be {_kind_name(field)}, not {value!r}")
        return tuple(filter(None, value))
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not type(default):
        raise ValueError(f"parameter '{name}' must be {_kind_name(field)}, not {value!r}")
    if field.metadata["choices"] and value not in field.metadata["choices"]:
        raise ValueError(f"parameter '{name}' is '{value}': choose one of {', '.join(field.metadata['choices'])}")
    if field.metadata["between"]:
        low, high = field.metadata["between"]
        if not low <= value <= high:
            raise ValueError(f"parameter '{name}' is {value}: it must lie between {low:g} and {high:g}")
    return value


def _described(field: dataclasses.Field[Any]) -> str:
    choices = field.metadata["choices"]
    description: str = field.metadata["description"]
    return f"{description} (one of {', '.join(choices)})" if choices else description


def _kind_name(field: dataclasses.Field[Any]) -> str:
    names = {bool: "true or false", int: "a whole number", float: "a number", str: "a text", tuple: "a list of texts"}
    return names[type(field.default)]


def _warn_of_unknown(node: Node, known: dict[str, Any]) -> None:
    """ROS ignores a parameter that no node declares: a slip of the pen would go unnoticed."""
    own = {"use_sim_time", "start_type_description_service"}
    for name in getattr(node, "_parameter_overrides", {}):
        if name in known or name in own or name.startswith("qos_overrides."):
            continue
        nearest = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean '{nearest[0]}'?" if nearest else f"; available: {', '.join(sorted(known))}"
        node.get_logger().warning(f"parameter '{name}' is not one of this node's{hint}")


_PARAMETERS = "ros__parameters"
_OPTION = "--params-file"


def warn_of_ignored_files(node: Node, words: Sequence[str] | None = None) -> None:
    """Say in one line for each parameter file which entries ROS ignores, though they are meant for such a node.

    Args:
        node: the node that has started.
        words: the command line; None is that of the process. Its first word ends in the node's name without a remap.
    """
    words = sys.argv if words is None else words
    command = Path(words[0]).name
    for option, file in pairwise(words):
        if option == _OPTION:
            text = ignored_entries(_entries_of(file), node.get_fully_qualified_name(), command)
            if text:
                node.get_logger().warning(f"parameter file {file}: {text}")


def ignored_entries(entries: Sequence[str], full_name: str, command: str) -> str:
    """Message on entries for such a node under another full name; empty without such entries.

    Args:
        entries: names of nodes in the file, as they are written there.
        full_name: the node's name with its namespace.
        command: the node's name without a remap.
    """
    matching = [entry for entry in entries if _matches(entry, full_name)]
    own_names = {command, full_name.rpartition("/")[2]}
    # An entry with a namespace may be of another machine, for which the file is used, too.
    ignored = [
        entry
        for entry in entries
        if entry not in matching
        and entry.rpartition("/")[2] in own_names
        and ("/" not in entry.strip("/") or not matching)
    ]
    if not ignored:
        return ""
    named = ", ".join(f"'{entry}'" for entry in ignored)
    return (
        f"the entry {named} is for {', '.join('/' + entry.strip('/') for entry in ignored)} and is ignored, as this"
        f" node is {full_name}: write {full_name}, or /**/{full_name.rpartition('/')[2]} for any namespace"
    )


def _matches(entry: str, full_name: str) -> bool:
    """Return whether ROS takes an entry for a node: `*` is one part of a name, `**` any number of them."""
    pattern = ""
    for part in entry.strip("/").split("/"):
        pattern += r"(/\w+)*" if part == "**" else "/" + re.escape(part).replace(r"\*", r"\w+")
    return re.fullmatch(pattern, full_name) is not None


def _entries_of(file: str) -> list[str]:
    """Names of nodes in a parameter file; none where it cannot be read, which ROS itself reports."""
    import yaml

    try:
        content = yaml.safe_load(Path(file).read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        return []
    return list(_names(content)) if isinstance(content, Mapping) else []


def _names(content: Mapping[Any, Any], above: str = "") -> Iterator[str]:
    for key, value in content.items():
        if key == _PARAMETERS:
            yield above
        elif isinstance(value, Mapping):
            yield from _names(value, f"{above}/{key}" if above else str(key))
