"""What the package promises where colcon builds it: its commands start, its files parse."""

from __future__ import annotations

import dataclasses
import importlib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml

PACKAGE = Path(__file__).parent.parent
NODES = ("twin_node", "replay_node", "record_node", "shaft_node", "view_node")


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


def test_the_manifest_is_of_a_python_package() -> None:
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert manifest.findtext("name") == "textile_twin_ros"
    assert manifest.findtext("export/build_type") == "ament_python"
