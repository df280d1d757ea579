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

"""The nodes as commands of the shell: a signal ends one well from its first moment on, while it still imports, too."""

from __future__ import annotations

import os
import signal
import sys
from functools import partial
from importlib import import_module

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_CORE = "textile_twin_core"
_HOW_TO_GET = {
    _CORE: "it is the Python package of the repository: see docs/ros_installation.md",
    "rclpy": "source a ROS installation (. /opt/ros/jazzy/setup.bash), or use launch_scripts/suite.sh",
}


def start(node: str) -> int:
    """Import one node and run it; the exit code of the process."""
    # There is nothing to close yet, and an exception in the middle of an import may come out as another one.
    for number in ENDING_SIGNALS:
        signal.signal(number, lambda *_: os._exit(0))
    try:
        module = import_module(f"textile_twin_ros.{node}")
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        how = _HOW_TO_GET.get(package, f"install it into the Python that runs this node, {sys.executable}")
        print(f"{node}: the package {package} is missing; {how}", file=sys.stderr)
        return 2
    return int(module.main())


twin_node = partial(start, "twin_node")
replay_node = partial(start, "replay_node")
record_node = partial(start, "record_node")
shaft_node = partial(start, "shaft_node")
view_node = partial(start, "view_node")
plc_node = partial(start, "plc_node")
opcua_node = partial(start, "opcua_node")
monitor_node = partial(start, "monitor_node")
fault_node = partial(start, "fault_node")
opcua_server_node = partial(start, "opcua_server_node")
