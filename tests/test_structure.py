"""Rules of the project that no other tool checks: places of imports, and unique class names."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
FOLDERS = (ROOT, ROOT / "ros2_ws/src/textile_twin_ros")
PACKAGES = ("textile_twin_core", "textile_twin_ros")


def module_name(path: Path, folder: Path) -> str:
    parts = path.relative_to(folder).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> dict[str, ast.Module]:
    """Parse every module of both packages."""
    return {
        module_name(path, folder): ast.parse(path.read_text(encoding="utf-8"))
        for folder, package in zip(FOLDERS, PACKAGES, strict=True)
        for path in (folder / package).rglob("*.py")
    }


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
REQUIRED = {*sys.stdlib_module_names, *(Requirement(each).name for each in PROJECT["project"]["dependencies"])}


def is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def imported(node: ast.AST) -> list[str]:
    """List the full names that one statement imports."""
    if isinstance(node, ast.Import):
        return [each.name for each in node.names]
    return [f"{node.module}.{each.name}" for each in node.names] if isinstance(node, ast.ImportFrom) else []


def loaded(body: Iterable[ast.stmt]) -> Iterator[str]:
    """Yield the names that statements of a module import at its import."""
    for node in body:
        yield from imported(node)
        if isinstance(node, (ast.If, ast.Try)) and not is_for_types(node):
            handlers = [each for handler in getattr(node, "handlers", ()) for each in handler.body]
            yield from loaded([*node.body, *node.orelse, *handlers])


@cache
def loaded_by(module: str) -> tuple[str, ...]:
    return tuple(loaded(modules()[module].body))


@cache
def home(name: str) -> str | None:
    """Return our module that defines an imported name, also for lazily imported names of a package."""
    while name and name not in modules():
        name, _, attribute = name.rpartition(".")
        for node in modules()[name].body if name in modules() else ():
            if is_for_types(node):
                names = [each for inner in node.body for each in imported(inner)]
                found = next((each for each in names if each.endswith(f".{attribute}")), None)
                if found:
                    return home(found)
    return name or None


@cache
def needs(name: str) -> frozenset[str]:
    """Return the optional packages without which a name cannot be imported."""
    found, met, left = set[str](), set[str](), [name]
    while left:
        name = left.pop()
        module = home(name)
        if module is None:
            found |= {name.partition(".")[0]} - REQUIRED
        while module and module not in met:
            met.add(module)
            left += loaded_by(module)
            module = module.rpartition(".")[0]
    return frozenset(found)


def test_an_import_inside_a_function_is_for_an_optional_package() -> None:
    misplaced = [
        f"{module}:{node.lineno} {name}"
        for module, tree in modules().items()
        for function in ast.walk(tree)
        if isinstance(function, (ast.FunctionDef, ast.AsyncFunctionDef))
        for node in ast.walk(function)
        for name in imported(node)
        if not needs(name)
    ]
    assert not misplaced


@pytest.mark.parametrize(
    ("name", "packages"),
    [
        ("math", set()),
        ("numba", set()),
        ("textile_twin_core.twin.compile_machine", set()),
        ("textile_twin_core.files.staged", set()),
        ("textile_twin_core.files.load_machine_file", {"yaml"}),
        ("pyarrow.csv", {"pyarrow"}),
        ("textile_twin_core.views.plot_linkage.draw_linkage", {"matplotlib"}),
    ],
)
def test_what_an_import_needs_is_known(name: str, packages: set[str]) -> None:
    assert needs(name) == packages


def test_a_class_has_a_name_of_its_own() -> None:
    """A class name occurs once in the package, so that it always means the same class."""
    places = defaultdict(list)
    for module, tree in modules().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(module)
    assert not {name: modules for name, modules in places.items() if len(modules) > 1}


def test_parts_of_scipy_come_when_they_are_used() -> None:
    # They are a third of the files that a node or a command reads at its start.
    program = (
        "import sys, textile_twin_core.twin, textile_twin_core.comparison;"
        " print([name for name in ('scipy.optimize', 'scipy.interpolate', 'scipy.integrate') if name in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert said.stdout == "[]\n"
