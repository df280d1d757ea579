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

"""Parameter files: entries for another node than the one that reads the file, which ROS ignores without a word."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from rclpy.node import Node

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
