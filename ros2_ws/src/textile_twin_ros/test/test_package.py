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

"""Contract of the package where colcon builds it: its commands start, its files parse."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import json
import re
import runpy
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy")

from textile_twin_ros.machine_namespace import MachineNamespace

PACKAGE = Path(__file__).parent.parent
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
TORQUE_IN = "balancing_torque/measured=2"


@pytest.mark.parametrize("node", NODES)
def test_every_command_has_its_main(node: str) -> None:
    if node == "view_node":
        pytest.importorskip("rerun")
    assert callable(importlib.import_module(f"textile_twin_ros.{node}").main)


def test_parameter_files_name_parameters_that_there_are() -> None:
    known = {"bag"}
    for node in ("twin", "record"):
        module = importlib.import_module(f"textile_twin_ros.{node}_node")
        known |= {field.name for field in dataclasses.fields(getattr(module, f"{node.capitalize()}Parameters"))}
    files = sorted((PACKAGE / "config").glob("*.yaml"))
    assert files
    for file in files:
        for node, content in yaml.safe_load(file.read_text()).items():
            assert node.startswith("/"), f"{file.name}: {node} would not match a node in a namespace"
            assert set(content["ros__parameters"]) <= known, file.name


@pytest.mark.parametrize("node", NODES)
def test_the_readme_tells_every_parameter(node: str) -> None:
    if node == "view_node":
        pytest.importorskip("rerun")
    module = importlib.import_module(f"textile_twin_ros.{node}")
    declaration = getattr(module, f"{node.removesuffix('_node').title().replace('_', '')}Parameters")
    section = (PACKAGE / "README.md").read_text().split(f"## {node}\n")[1].split("\n## ")[0]
    for field in dataclasses.fields(declaration):
        row = next(line for line in section.splitlines() if line.startswith(f"| `{field.name}` |"))
        assert field.metadata["description"] in row


def test_launch_files_are_python() -> None:
    files = sorted((PACKAGE / "launch").glob("*.launch.py"))
    assert files
    for file in files:
        compile(file.read_text(), str(file), "exec")


@pytest.mark.parametrize(
    ("machine", "outputs", "inputs"),
    [
        ("tufting", {"needle/position", "balancing_torque/residual"}, ["main_shaft/angle=2", TORQUE_IN]),
        ("handloom_beatup", {"beater/position", "balancing_torque/residual"}, ["main_shaft/angle=2", TORQUE_IN]),
        ("elliptic_gear_beatup", {"sley/position", "joint_states"}, ["main_shaft/angle=2"]),
        ("needle_transfer", {"joint_states", "contact_events"}, ["main_shaft/angle=2"]),
    ],
)
def test_a_recording_of_any_machine_is_launched(
    machine: str, outputs: set[str], inputs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Check the nodes' arguments without the launch system, which the wheels do not have."""
    recordings = pytest.importorskip("textile_twin_core.recordings")
    with recordings.BagWriter(tmp_path / "bag") as bag:
        bag.write_joint_states("main_shaft/angle", np.arange(3), ["main_shaft"], np.zeros(3))
        if TORQUE_IN in inputs:
            bag.write_wrenches("balancing_torque/measured", np.arange(3), np.zeros(3))
    arguments = {"machine": machine, "bag": str(tmp_path / "bag")}
    for name in ("", ".actions", ".event_handlers", ".substitutions"):
        monkeypatch.setitem(sys.modules, f"launch{name}", MagicMock())
    for name in ("", ".actions", ".parameter_descriptions"):
        monkeypatch.setitem(sys.modules, f"launch_ros{name}", MagicMock())
    sys.modules["launch.substitutions"].LaunchConfiguration = lambda name: MagicMock(perform=lambda _: arguments[name])
    sys.modules["launch_ros.actions"].Node = MagicMock(side_effect=lambda **told: told)
    told = runpy.run_path(str(PACKAGE / "launch" / "replay.launch.py"))["nodes"](None)
    parameters = {node["executable"]: node["parameters"][0] for node in told if isinstance(node, dict)}
    assert set(parameters["twin_node"]["wait_for"]) >= outputs
    assert not {topic for topic in parameters["twin_node"]["wait_for"] if topic.endswith("/position")} - outputs
    assert set(parameters["record_node"]["topics"]) >= outputs
    assert parameters["replay_node"]["wait_for"] == inputs
    heartbeat_s = 3.0  # of a reliable writer, by Fast DDS's own settings: until then it may send nothing again
    assert parameters["record_node"]["stop_when_idle_s"] > 2.0 * heartbeat_s


def test_a_mill_launches_every_node_of_every_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check the nodes' arguments without the launch system, which the wheels do not have."""
    pytest.importorskip("rerun")
    file = PACKAGE / "config" / "mill.yaml"
    arguments = {"mill": "hall", "machines": "m1 m2", "record": "", "book": "", "view": "false"}
    arguments["params_file"] = str(file)
    for name in ("launch", "launch.actions", "launch.substitutions", "launch_ros.actions", "launch_ros.substitutions"):
        monkeypatch.setitem(sys.modules, name, MagicMock())
    sys.modules["launch.substitutions"].LaunchConfiguration = lambda name: MagicMock(perform=lambda _: arguments[name])
    sys.modules["launch_ros.actions"].Node = MagicMock(side_effect=lambda **words: words)
    nodes = runpy.run_path(str(PACKAGE / "launch" / "mill.launch.py"))["nodes"]
    assert [node["executable"] for node in nodes(None)] == ["twin_node", "twin_node"]
    arguments |= {"record": "out/recordings", "book": "out/faults", "view": "true"}
    made = nodes(None)
    started = {(node["namespace"], node["executable"]) for node in made}
    every = {"twin_node", "view_node", "record_node", "monitor_node", "fault_node"}
    assert started == {(f"/hall/{machine}", node) for machine in ("m1", "m2") for node in every}
    shared = yaml.safe_load(file.read_text())["/**"]["ros__parameters"]
    for node in made:  # each knows the parameters that it is given
        module = importlib.import_module(f"textile_twin_ros.{node['executable']}")
        declaration = getattr(module, f"{node['executable'].removesuffix('_node').capitalize()}Parameters")
        known = {field.name for field in dataclasses.fields(declaration)}
        for given in node["parameters"]:
            assert set(shared if given == str(file) else given) <= known, node["executable"]


def test_layouts_show_topics_of_the_suite() -> None:
    foxglove = json.loads((PACKAGE / "layouts" / "foxglove.json").read_text())
    panels = foxglove["configById"]
    shown = [path["value"].split(".")[0] for panel in panels.values() for path in panel.get("paths", ())]
    shown += [topic for panel in panels.values() for topic in panel.get("topics", ())]

    def leaves(tree: object) -> list[object]:
        return leaves(tree["first"]) + leaves(tree["second"]) if isinstance(tree, dict) else [tree]

    assert sorted(map(str, leaves(foxglove["layout"]))) == sorted(panels)
    juggler = ElementTree.parse(PACKAGE / "layouts" / "plotjuggler.xml").getroot()
    curves = [str(curve.get("name")) for curve in juggler.iter("curve")]
    for suffix in ("/wrench/torque/z", "/point/y", "/main_shaft/position", "/main_shaft/velocity"):
        curves = [curve.removesuffix(suffix) for curve in curves]
    # A name that only a machine has, in a namespace that is not the root's, would be another machine's.
    for topic in shown + curves:
        assert MachineNamespace("/").has(topic) and not MachineNamespace("/").has(f"/other{topic}"), topic


def test_the_manifest_is_of_a_python_package() -> None:
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert manifest.findtext("name") == "textile_twin_ros"
    assert manifest.findtext("export/build_type") == "ament_python"


def test_the_manifest_names_every_package_that_is_imported() -> None:
    """Extras of the core (OPC UA, Modbus, the viewer, Parquet) stay optional: a node that needs one says so."""
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    declared = {each.text for each in manifest.iter("exec_depend")}
    keys = {"numpy": "python3-numpy", "yaml": "python3-yaml", "textile_twin_core": "python3-textile-twin-core-pip"}
    optional = {"asyncua", "cryptography", "pyarrow", "pymodbus", "rerun"}
    imported: set[str] = set()
    for file in sorted((PACKAGE / "textile_twin_ros").glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [each.name for each in node.names] if isinstance(node, ast.Import) else []
            imported |= {name.partition(".")[0] for name in names}
    imported -= sys.stdlib_module_names | optional | {"textile_twin_ros"}
    assert {"rcl_interfaces", "yaml", "rclpy"} <= imported
    assert {keys.get(name, name) for name in imported} <= declared


def test_the_package_asks_for_the_core_s_python() -> None:
    core = (PACKAGE.parents[2] / "pyproject.toml").read_text()
    oldest = re.search(r'requires-python = "(>=3[.]\d+)', core)
    assert oldest is not None and f'python_requires="{oldest[1]}"' in (PACKAGE / "setup.py").read_text()


def test_analyzers_take_every_status_of_the_suite_once() -> None:
    """Apply the rule of GenericAnalyzer: a name that contains one of its words."""
    (content,) = yaml.safe_load((PACKAGE / "diagnostics" / "analyzers.yaml").read_text()).values()
    groups = {key: value for key, value in content["ros__parameters"].items() if isinstance(value, dict)}
    assert {group["type"] for group in groups.values()} == {"diagnostic_aggregator/GenericAnalyzer"}
    publishers = [
        node for node in NODES if "DiagnosticsPublisher(" in (PACKAGE / "textile_twin_ros" / f"{node}.py").read_text()
    ]
    assert len(publishers) >= 6
    for node in publishers:
        for name in (f"{node}: plc", f"loom_7/{node}: twin"):
            assert [key for key, group in groups.items() if any(word in name for word in group["contains"])], name
            assert sum(any(word in name for word in group["contains"]) for group in groups.values()) == 1, name
    assert {word.removesuffix(": ") for group in groups.values() for word in group["contains"]} == set(publishers)
