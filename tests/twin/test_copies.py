"""Copies of machines, twins and predictions, in this process and in another, give the same results."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.machine import AnyMachine

_EXAMPLES = Path(__file__).parents[2] / "examples"
_FILES = ("six_bar_loom.yaml", "tufting_two_linkages.yaml")
_COPIES: dict[str, Callable[[Any], Any]] = {
    "pickled": lambda thing: pickle.loads(pickle.dumps(thing)),
    "deep": copy.deepcopy,
    "shallow": copy.copy,
}
_TURN = np.linspace(0.0, 2.0 * np.pi, 50, endpoint=False)
_IN_ANOTHER_PROCESS = """
import pickle, sys
given = pickle.load(sys.stdin.buffer)
pickle.dump([(twin.outputs, twin.evaluate(*motion)) for twin, motion in given], sys.stdout.buffer)
"""


_NAMES = (*ttc.machines.NAMES, *_FILES)


def _machine(name: str) -> AnyMachine:
    return ttc.load_machine(_EXAMPLES / name) if name in _FILES else ttc.machines.create(name)


@pytest.fixture(scope="module", params=_NAMES)
def machine(request: pytest.FixtureRequest) -> AnyMachine:
    return _machine(request.param)


def _outputs(machine: AnyMachine) -> list[str]:
    """Return outputs of each kind that the machine has."""
    missing = getattr(machine, "missing_for_torque", ())
    return [name for name in machine.outputs if not missing or name.endswith(("_m", "_m_s", "_m_s2", "_rad"))][::5]


def _motion(machine: AnyMachine) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    alpha = 2.0 if isinstance(machine, ttc.Machine) else 0.0
    return _TURN, np.full(50, 12.0), np.full(50, alpha)


def _same(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert one.keys() == other.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


@pytest.mark.parametrize("kind", [*_COPIES, "replaced"])
def test_a_copied_machine_gives_the_same_outputs(machine: AnyMachine, kind: str) -> None:
    again = dataclasses.replace(machine) if kind == "replaced" else _COPIES[kind](machine)
    assert again == machine and again is not machine
    assert again.parameters == machine.parameters and again.sensors == machine.sensors
    with pytest.raises(TypeError):
        again.parameters["l1_m"] = 1.0  # as read-only as the original's
    one, other = (ttc.compile(m, _outputs(machine)).evaluate(*_motion(m)) for m in (machine, again))
    _same(one, other)


@pytest.mark.parametrize("kind", _COPIES)
def test_a_copied_twin_gives_the_same_outputs(machine: AnyMachine, kind: str) -> None:
    twin = ttc.compile(machine, _outputs(machine)[:3])
    again = _COPIES[kind](twin)
    assert (again.outputs, again.method, again.tolerance) == (twin.outputs, twin.method, twin.tolerance)
    _same(twin.evaluate(*_motion(machine)), again.evaluate(*_motion(machine)))


def test_a_copied_table_is_rebuilt_to_the_same_tolerance() -> None:
    twin = ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm"], method="table", tolerance=1e-6)
    again = pickle.loads(pickle.dumps(twin))
    assert again.method == "table" and again.reached_error == twin.reached_error <= 1e-6
    _same(twin.evaluate(_TURN, 16.0, 0.0), again.evaluate(_TURN, 16.0, 0.0))


def test_twins_work_in_another_process() -> None:
    machines = [_machine(name) for name in _NAMES]
    given = [(ttc.compile(machine, _outputs(machine)[:4]), _motion(machine)) for machine in machines]
    command = [sys.executable, "-c", _IN_ANOTHER_PROCESS]
    answer = subprocess.run(command, input=pickle.dumps(given), stdout=-1, check=True)
    for (twin, motion), (outputs, values) in zip(given, pickle.loads(answer.stdout), strict=True):
        assert outputs == twin.outputs
        expected = twin.evaluate(*motion)
        for name in outputs:  # the other process may sum in another order
            np.testing.assert_allclose(values[name], expected[name], rtol=0, atol=1e-14 * np.abs(expected[name]).max())


def test_the_needle_transfer_keeps_its_events_and_laws_of_motion() -> None:
    machine = ttc.machines.needle_transfer(motion_law=lambda theta: 0.015 * (1.0 - float(np.cos(theta))))
    twin = ttc.compile(machine)
    twin.evaluate(_TURN, 20.0, 0.0)
    assert twin.events
    again = pickle.loads(pickle.dumps(twin))
    assert again.events == twin.events and again.machine.law == machine.law


@pytest.mark.parametrize("kind", _COPIES)
def test_predictions_are_copied_with_their_sigma(kind: str) -> None:
    session = ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm"]).session()
    samples = session.step(np.arange(500) * 2_000_000, np.arange(500) * 0.03)
    again = _COPIES[kind](samples)
    _same(dict(samples.outputs), dict(again.outputs))
    np.testing.assert_array_equal(samples.torque_sigma_Nm, again.torque_sigma_Nm)
    np.testing.assert_array_equal(samples.stamps, again.stamps)


def test_a_session_goes_on_with_a_copy_and_refuses_another_machine() -> None:
    machine = ttc.machines.tufting()
    session = ttc.compile(machine, ["balancing_torque_Nm"]).session()
    session.use(ttc.compile(copy.deepcopy(machine), ["needle_position_m"]))
    for other in (ttc.machines.tufting(l1_m=0.014), ttc.machines.handloom_beatup(), ttc.machines.needle_transfer()):
        with pytest.raises(ttc.SceneError, match=f"and the twin is of a different machine '{other.name}'"):
            session.use(ttc.compile(other))
