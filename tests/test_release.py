"""A release: one version everywhere; wheels of both packages are valid, equal from build to build, and install."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from shutil import copytree, ignore_patterns
from xml.etree import ElementTree

import pytest
import yaml
from packaging.metadata import Metadata

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "ros2_ws/src/textile_twin_ros"
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


def test_every_file_names_the_same_version() -> None:
    found = {
        "package.xml": ElementTree.parse(PACKAGE / "package.xml").findtext("version"),
        "setup.py": re.findall(r'^    version="(.+)",$', (PACKAGE / "setup.py").read_text(), re.MULTILINE)[0],
        "CITATION.cff": yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"],
        "CHANGELOG.md": re.findall(r"^## ([0-9.]+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[0],
        "CHANGELOG.rst": re.findall(r"^([0-9.]+) \(", (PACKAGE / "CHANGELOG.rst").read_text(), re.MULTILINE)[0],
    }
    assert found == dict.fromkeys(found, VERSION)


def wheel(source: Path, out: Path) -> Path:
    build = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q", "wheel", "--no-deps", "--no-index"]
    environment = {**os.environ, "SOURCE_DATE_EPOCH": "1790000000"}
    subprocess.run(
        [*build, "--no-build-isolation", "-w", str(out), str(source)], check=True, timeout=300, env=environment
    )
    (made,) = out.glob("*.whl")
    return made


@pytest.mark.slow
@pytest.mark.parametrize("package", ["core", pytest.param("ros", marks=pytest.mark.campaign)])
def test_a_wheel_is_valid_reproducible_and_installs(package: str, tmp_path: Path) -> None:
    made = []
    for number in range(2):
        source = tmp_path / f"source{number}"
        if package == "core":
            copytree(ROOT / "textile_twin_core", source / "textile_twin_core", ignore=ignore_patterns("__pycache__"))
            for name in ("pyproject.toml", "README.md", "LICENSE"):
                (source / name).write_bytes((ROOT / name).read_bytes())
        else:
            copytree(PACKAGE, source, ignore=ignore_patterns("__pycache__", "build", "*.egg-info"))
        made.append(wheel(source, tmp_path / f"out{number}"))
    assert made[0].name == made[1].name and made[0].read_bytes() == made[1].read_bytes()
    with zipfile.ZipFile(made[0]) as archive:
        names = archive.namelist()
        (metadata,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        described = Metadata.from_email(archive.read(metadata), validate=True)
    assert str(described.version) == VERSION
    assert package == "ros" or described.license_expression == "Apache-2.0"
    install = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q", "install", "--no-deps", "--no-index"]
    place = tmp_path / "place"
    subprocess.run([*install, "--target", str(place), str(made[0])], check=True, timeout=300)
    module = "textile_twin_core" if package == "core" else "textile_twin_ros"
    where = subprocess.run(
        [sys.executable, "-c", f"import {module}; print({module}.__file__)"], cwd=tmp_path, text=True, check=True,
        capture_output=True, env={**os.environ, "PYTHONPATH": str(place)}, timeout=100,
    ).stdout  # fmt: skip
    assert where.startswith(str(place))
