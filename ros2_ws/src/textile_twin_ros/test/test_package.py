"""What the package promises where colcon builds it: its commands start, its files parse."""

from __future__ import annotations

import dataclasses
import importlib
import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml

from textile_twin_ros.own_topics import OwnTopics

PACKAGE = Path(__file__).parent.parent
NODES = ("twin_node", "replay_node", "record_node", "shaft_node", "view_node", "plc_node", "opcua_node", "monitor_node")


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
    declaration = getattr(module, f"{node.removesuffix('_node').capitalize()}Parameters")
    section = (PACKAGE / "README.md").read_text().split(f"## {node}\n")[1].split("\n## ")[0]
    for field in dataclasses.fields(declaration):
        row = next(line for line in section.splitlines() if line.startswith(f"| `{field.name}` |"))
        assert field.metadata["description"] in row


def test_launch_files_are_python() -> None:
    files = sorted((PACKAGE / "launch").glob("*.launch.py"))
    assert files
    for file in files:
        compile(file.read_text(), str(file), "exec")


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
        assert OwnTopics("/").has(topic) and not OwnTopics("/").has(f"/other{topic}"), topic


def test_the_manifest_is_of_a_python_package() -> None:
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert manifest.findtext("name") == "textile_twin_ros"
    assert manifest.findtext("export/build_type") == "ament_python"
