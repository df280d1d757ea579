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

"""Shell words before --ros-args: help is shown, anything else is a mistake with a suggestion."""

from __future__ import annotations

import dataclasses
import re
import sys
import textwrap
from itertools import takewhile

from textile_twin_core.errors import SceneError

_SOURCE_PLACE = re.compile(r", at \S+:\d+")
_REMAP_RULES = {
    "__ns:=": "a namespace begins with / and has letters, digits and _ alone, as in -r __ns:=/machine_2",
    "__node:=": "a node's name has letters, digits and _ alone, no digit first",
    "": "write -r FROM:=TO, topics of letters, digits, _ and /, no digit first",
}


def read_words(command: str, summary: str, declaration: type, arguments: list[str] | None) -> str | None:
    """The help text when it is asked for, None when there is nothing to say.

    Args:
        command: the node's command.
        summary: what it does, one line.
        declaration: the dataclass of its parameters.
        arguments: the command line with its first word; None is that of the process.

    Raises:
        SceneError: there are words that the node does not know.
    """
    given = sys.argv if arguments is None else arguments
    words = list(takewhile(lambda word: word != "--ros-args", given[1:]))
    if not words:
        return None
    if {"-h", "--help"} & set(words):
        return help_text(command, summary, declaration)
    fields = {field.name: field.default for field in dataclasses.fields(declaration)}
    first = words[0]
    if first.startswith("-") or ":=" in first:
        option = "" if first.startswith("-") else "-p "
        raise SceneError(f"'{first}' stands before --ros-args; write: {command} --ros-args {option}{' '.join(words)}")
    meant = next((name for name in ("machine", "bag") if name in fields), next(iter(fields)))
    raise SceneError(f"'{first}' is no option; write: {command} --ros-args -p {meant}:={first} (--help lists all)")


def explain(error: Exception) -> str:
    """Message of rcl on words after --ros-args, without places in its source and with a correction."""
    text = _SOURCE_PLACE.sub("", str(error))
    wrong = re.search(r"remap rule: '(?:-r|--remap) (.*?)'", text)
    if wrong is None:
        return text
    return f"-r {wrong[1]}: {next(rule for beginning, rule in _REMAP_RULES.items() if beginning in wrong[1])}"


def help_text(command: str, summary: str, declaration: type) -> str:
    """Usage, and every parameter with its default."""
    first = next(iter(dataclasses.fields(declaration)))
    lines = [
        f"usage: {command} --ros-args [-p NAME:=VALUE ...] [--params-file FILE] [-r __ns:=/MACHINE] [-r FROM:=TO]",
        "",
        summary,
        "",
        "parameters, each with its default:",
    ]
    for field in dataclasses.fields(declaration):
        lines.append(f"  {field.name}:={_shown(field.default)}")
        choices = field.metadata["choices"]
        text = field.metadata["description"] + (f" (one of {', '.join(choices)})" if choices else "")
        lines += textwrap.wrap(text, 110, initial_indent=" " * 6, subsequent_indent=" " * 6)
    example = "FOLDER" if first.name == "bag" else _shown(first.default)
    return "\n".join([*lines, "", f"for example: {command} --ros-args -p {first.name}:={example}"])


def _shown(default: object) -> str:
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, tuple):
        return "[" + ", ".join(default) + "]"
    return str(default) or "''"
