"""Names at a prompt: tab completion, help with examples that run, and objects that describe themselves."""

from __future__ import annotations

import doctest
import importlib
import rlcompleter
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.twin import compilation

PACKAGE = Path(ttc.__file__).parent


def module_of(path: Path) -> str:
    """Return the dotted name of a module of the package by its file."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@pytest.mark.parametrize("package", ["", ".machines", ".views", ".recordings", ".files"])
def test_completion_shows_what_a_package_offers_and_nothing_else(package: str) -> None:
    module = importlib.import_module(f"textile_twin_core{package}")
    assert dir(module) == sorted(module.__all__)
    completer = rlcompleter.Completer({"module": module})
    found = []
    while (text := completer.complete("module.", len(found))) is not None:
        found.append(text.removeprefix("module.").rstrip("()"))
    assert sorted(found) == sorted(module.__all__)
    assert all(getattr(module, name) is not None for name in found)


def test_the_help_of_compile_has_parameters_and_an_example_that_runs() -> None:
    text = ttc.compile.__doc__ or ""
    assert all(f"{name}: " in text for name in ("machine", "outputs", "method", "tolerance"))
    tests = doctest.DocTestFinder().find(ttc.compile, globs={})
    assert sum(len(test.examples) for test in tests) == 3
    runner = doctest.DocTestRunner(verbose=False)
    assert sum(runner.run(test).failed for test in tests) == 0
    assert compilation.compile_machine is ttc.compile


EXAMPLES = [
    test
    for path in sorted(PACKAGE.rglob("*.py"))
    if path.relative_to(PACKAGE).parts[0] not in ("bench", "cli", "explore", "views")
    for test in doctest.DocTestFinder().find(importlib.import_module(module_of(path)))
    if test.examples
]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_the_examples_of_docstrings_run(example: doctest.DocTest) -> None:
    assert doctest.DocTestRunner().run(example).failed == 0


def test_the_names_of_the_catalogue_and_of_files_have_examples() -> None:
    names = {example.name.rpartition(".")[2] for example in EXAMPLES}
    assert {"tufting", "create", "load_machine_file", "write_table", "TorqueOverTime", "Machine"} <= names


def test_objects_describe_themselves() -> None:
    machine = ttc.machines.tufting()
    twin = ttc.compile(machine, outputs=["balancing_torque_Nm", *machine.outputs[:6]])
    session = twin.session()
    samples = session.step(np.arange(50) * 0.002, np.arange(50) * 0.03)
    assert repr(machine).startswith("<Machine 'tufting': 6 links, 1 load, measures needle; ")
    assert repr(twin).startswith("<Twin of 'tufting', auto: balancing_torque_Nm, ") and repr(twin).endswith("more>")
    assert repr(session).startswith("<Session of <Twin of 'tufting'") and "50 of 50 samples used" in repr(session)
    assert repr(samples).startswith("<Samples: 48, 0.004 to 0.098 s; outputs balancing_torque_Nm, ")
    nothing = twin.session().step(np.empty(0), np.empty(0))
    assert "no time" in repr(nothing)
    assert repr(ttc.machines.needle_transfer()).startswith("<ContactMachine 'needle_transfer': element_1, ")
