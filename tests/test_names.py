"""What a person sees at a prompt: names by tab completion, help with an example, and objects that say what they are."""

from __future__ import annotations

import doctest
import importlib
import rlcompleter

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.twin import compilation


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


def test_objects_say_what_they_are() -> None:
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
