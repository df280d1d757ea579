"""Lock files: pinned, hashed, without servers, and sufficient for pyproject.toml."""

from __future__ import annotations

import ast
import re
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
LOCKS = {
    "requirements.lock": "ros files view design plc",
    "requirements-tests.lock": "ros files view design plc logs cluster docs dev",
    "requirements-peers.lock": "files design dev peers",
}
PYTHONS = ("3.11.0", "3.12.0", "3.13.0", "3.14.0")

each_lock = pytest.mark.parametrize("lock", LOCKS)


def entries(lock: str) -> list[str]:
    return re.sub(r" *\\\n *", " ", (ROOT / lock).read_text()).splitlines()


def platform_of(python: str) -> dict[str, str]:
    """This Python on 64-bit Linux, as markers of requirements name it."""
    here = {"python_version": python[:4], "python_full_version": python, "sys_platform": "linux"}
    here |= {"platform_machine": "x86_64", "platform_system": "Linux", "implementation_name": "cpython"}
    here |= {"platform_python_implementation": "CPython", "os_name": "posix"}
    return here


def locked(lock: str, python: str) -> dict[str, str]:
    """Return name -> version of the packages installed with this Python on 64-bit Linux."""
    here = platform_of(python)
    requirements = [Requirement(entry.split(" --hash")[0]) for entry in entries(lock)]
    taken = [r for r in requirements if r.marker is None or r.marker.evaluate(here)]
    return {canonicalize_name(r.name): str(r.specifier).removeprefix("==") for r in taken}


@each_lock
def test_every_entry_is_pinned_and_hashed(lock: str) -> None:
    pinned = re.compile(r"[a-z0-9.-]+==[0-9a-z.+]+( ; [^\\]+?)?( --hash=sha256:[0-9a-f]{64})+")
    assert entries(lock)
    assert [entry[:60] for entry in entries(lock) if not pinned.fullmatch(entry)] == []


@each_lock
def test_names_no_server_and_no_path(lock: str) -> None:
    assert not re.search(r"://|--index|--find-links|\.whl|(^|\s)[.~]?/", (ROOT / lock).read_text())


@each_lock
@pytest.mark.parametrize("python", PYTHONS)
def test_gives_what_the_project_asks_for(lock: str, python: str) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [project["optional-dependencies"][name] for name in LOCKS[lock].split()]
    versions = locked(lock, python)
    for text in [*project["dependencies"], *(requirement for extra in extras for requirement in extra)]:
        requirement = Requirement(text)
        if requirement.marker is not None and not requirement.marker.evaluate(platform_of(python)):
            continue
        version = versions.get(canonicalize_name(requirement.name))
        assert version is not None, f"{requirement.name} is not in {lock}: run launch_scripts/lock.sh"
        assert requirement.specifier.contains(version), f"{text}: {version} is locked: run launch_scripts/lock.sh"


def test_every_extra_is_locked() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert set(project["optional-dependencies"]) == {name for names in LOCKS.values() for name in names.split()}


@each_lock
def test_one_version_for_every_python(lock: str) -> None:
    """Check all Pythons; some packages apply to some of them only."""
    versions: dict[str, str] = {}
    for python in PYTHONS:
        for name, version in locked(lock, python).items():
            assert versions.setdefault(name, version) == version, name


@pytest.mark.parametrize("python", PYTHONS)
def test_the_lock_for_tests_extends_the_lock_for_running(python: str) -> None:
    """Check that an environment of the demonstration can be completed by the tests."""
    assert locked("requirements.lock", python).items() <= locked("requirements-tests.lock", python).items()


@pytest.mark.slow
def test_the_package_imports_no_test_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    runs = [*project["dependencies"], *(text for name in extras.keys() - {"dev"} for text in extras[name])]
    needed = {canonicalize_name(Requirement(text).name) for text in runs}
    tests_alone = {canonicalize_name(Requirement(text).name) for text in extras["dev"]} - needed
    packages = {name for name, by in packages_distributions().items() if set(map(canonicalize_name, by)) <= tests_alone}
    assert {"pytest", "mpmath", "hypothesis"} <= packages
    for folder in ("textile_twin_core", "ros2_ws/src/textile_twin_ros/textile_twin_ros", "launch_scripts"):
        for file in (ROOT / folder).rglob("*.py"):
            imports = [
                node for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.Import | ast.ImportFrom)
            ]
            names = {name.name for node in imports for name in node.names if isinstance(node, ast.Import)}
            names |= {node.module for node in imports if isinstance(node, ast.ImportFrom) and node.module}
            assert not {name.split(".")[0] for name in names} & packages, file
