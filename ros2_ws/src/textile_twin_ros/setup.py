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

"""The ROS 2 nodes of textile-twin: built by colcon into a workspace, or by pip into an environment."""

from pathlib import Path

from setuptools import setup

PACKAGE = "textile_twin_ros"
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


def files(pattern: str) -> list[str]:
    """The package's files of this pattern, relative to this folder as setuptools wants them."""
    here = Path(__file__).parent
    return sorted(str(path.relative_to(here)) for path in here.glob(pattern))


setup(
    name=PACKAGE,
    version="1.0.0",
    description="ROS 2 nodes of textile-twin: the digital twin of a textile machine, from the angle of its main shaft",
    long_description=(Path(__file__).parent / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    packages=[PACKAGE],
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml", "LICENSE", "rosdep.yaml"]),
        (f"share/{PACKAGE}/launch", files("launch/*.launch.py")),
        (f"share/{PACKAGE}/config", files("config/*.yaml")),
        (f"share/{PACKAGE}/diagnostics", files("diagnostics/*.yaml")),
        (f"share/{PACKAGE}/layouts", files("layouts/*")),
    ],
    python_requires=">=3.11",
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [f"{node} = {PACKAGE}.commands:{node}" for node in NODES],
        "textile_twin.status": [f"show = {PACKAGE}.status:show"],
    },
)
