"""Machines whose numbers are numpy's, of single precision too: the same machine as with Python's numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.dynamics.loads import ShaftFriction
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import Crank, Linkage, RRRDyad

MACHINES = ("tufting", "handloom_beatup", "elliptic_gear_beatup")
OUTPUTS = ("torque_inertial_Nm", "torque_load_Nm", "alpha_3_rad_s2")


def as_python(value: Any) -> Any:
    return float(value) if isinstance(value, np.generic) else value


def numbers_of(name: str) -> dict[str, Any]:
    """The parameters, all in single precision."""
    known = ttc.machines.parameters_of(name)
    return {key: np.float32(value) for key, value in known.items() if isinstance(value, float)}


def linkage(number: Any) -> Machine:
    one = number(1.0)
    dyad = RRRDyad(
        "l2",
        "l3",
        from_point="A",
        ground="C",
        end="B",
        lengths_m=(one * number(0.2), one * number(0.23)),
        branch="left",
    )
    return Machine(
        "loom",
        {"O": (number(0.0), number(0.0)), "C": (number(0.3), number(0.01))},
        (Crank("l1", at="O", end="A", length_m=number(0.0625)), dyad),
        bodies=(ttc.dynamics.Body("l2", number(0.4), number(1.5e-3)),),
        loads=(ShaftFriction(number(0.01), number(0.1)),),
        gravity_m_s2=(number(0.0), number(-9.81)),
    )


@pytest.mark.parametrize("name", MACHINES)
def test_a_published_machine(name: str) -> None:
    given = numbers_of(name)
    single = ttc.machines.create(name, **given)
    same = ttc.machines.create(name, **{key: as_python(value) for key, value in given.items()})
    theta = np.linspace(0.1, 6.2, 50)
    outputs = OUTPUTS if single.has_complete_torque else OUTPUTS[-1:]
    found, right = (ttc.compile(machine, list(outputs)).evaluate(theta, 16.0, 0.0) for machine in (single, same))
    for output in outputs:
        np.testing.assert_array_equal(found[output], right[output])


@pytest.mark.parametrize("kind", [np.float32, np.float16, np.longdouble])
def test_a_declared_machine_is_exactly_the_same(kind: Any) -> None:
    single, same = linkage(kind), linkage(lambda value: float(kind(value)))
    theta = np.linspace(0.1, 6.2, 50)
    found, right = (ttc.compile(machine, list(OUTPUTS)).evaluate(theta, 16.0, 0.0) for machine in (single, same))
    for output in OUTPUTS:
        np.testing.assert_array_equal(found[output], right[output])
    assert Linkage(single.points, single.groups).solved.turns_fully


def test_a_drive_torque() -> None:
    machine = linkage(float)
    single = ttc.drive(machine, np.float32(0.5), theta0=np.float32(0.25), omega0=np.float32(10.0), t=np.float32(0.125))
    same = ttc.drive(machine, 0.5, theta0=0.25, omega0=10.0, t=0.125)
    assert single.omega_rad_s[-1] == same.omega_rad_s[-1]
