"""Entry point `compile`: the twin of a machine for the requested outputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import overload

from textile_twin_core.errors import SceneError
from textile_twin_core.machine import AnyMachine, ContactMachine, Machine
from textile_twin_core.twin.compiled import Twin
from textile_twin_core.twin.elastic import ElasticTwin
from textile_twin_core.twin.history import HistoryTwin

METHODS = ("exact", "table", "auto")


@overload
def compile_machine(
    machine: Machine, outputs: Sequence[str] | None = None, method: str | None = None, tolerance: float | None = None
) -> Twin | ElasticTwin: ...


@overload
def compile_machine(
    machine: ContactMachine,
    outputs: Sequence[str] | None = None,
    method: str | None = None,
    tolerance: float | None = None,
) -> HistoryTwin: ...


@overload
def compile_machine(
    machine: AnyMachine, outputs: Sequence[str] | None = None, method: str | None = None, tolerance: float | None = None
) -> Twin | ElasticTwin | HistoryTwin: ...


def compile_machine(
    machine: AnyMachine,
    outputs: Sequence[str] | None = None,
    method: str | None = None,
    tolerance: float | None = None,
) -> Twin | ElasticTwin | HistoryTwin:
    """Compile a machine into a twin that computes the requested outputs and nothing else.

    Args:
        machine: A machine from `ttc.machines` or `ttc.load_machine`.
        outputs: Names from `machine.outputs`; the outputs of the machine's scene by default.
        method: "exact" evaluates closed forms, "table" evaluates periodic tables, "auto" selects the faster one (see
            `Twin`); the method of the machine's scene by default.
        tolerance: Largest error over the peak for a table; the tolerance of the machine's scene by default.

    Returns:
        The twin: `evaluate` takes shaft angles, speeds and accelerations, `session` takes samples of an encoder.
            The type is
        HistoryTwin for a machine with impacts, ElasticTwin for one with an elastic shaft, and Twin otherwise.

    Raises:
        SceneError: An output or the method is unknown, or the tolerance is not positive.
        MachineError: The machine lacks data that an output needs, such as masses.

    Examples:
        >>> import textile_twin_core as ttc
        >>> twin = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"])
        >>> round(twin.evaluate(1.0, 16.755, 0.0)["balancing_torque_Nm"], 3)
        14.108
    """
    return _twin(machine, *_scene(machine, outputs, method, tolerance))


def idle_twin(machine: AnyMachine) -> Twin | ElasticTwin | HistoryTwin:
    """Compile a machine for no output, so that its sessions estimate the shaft only."""
    return _twin(machine, (), "exact", machine.scene.tolerance)


def _twin(
    machine: AnyMachine, names: tuple[str, ...], method: str, tolerance: float
) -> Twin | ElasticTwin | HistoryTwin:
    if isinstance(machine, ContactMachine):
        if method == "table":
            raise SceneError(f"machine '{machine.name}' has a history, which no table holds; use method 'exact'")
        return HistoryTwin(machine, names, tolerance)
    if not isinstance(machine, Machine):
        raise SceneError(f"there is no law for a machine of type {type(machine).__name__}")
    if machine.shaft is None:
        return Twin(machine, names, method, tolerance)
    if method == "table":
        raise SceneError(f"the elastic shaft of machine '{machine.name}' has a state; no table holds it: use 'exact'")
    return ElasticTwin(machine, names, tolerance)


def compile_rigid(
    machine: Machine, outputs: Sequence[str] | None = None, method: str | None = None, tolerance: float | None = None
) -> Twin:
    """Compile a linkage machine as if its main shaft were rigid; arguments and errors as in `compile_machine`."""
    return Twin(machine, *_scene(machine, outputs, method, tolerance))


def _scene(
    machine: AnyMachine, outputs: Sequence[str] | None, method: str | None, tolerance: float | None
) -> tuple[tuple[str, ...], str, float]:
    """Check and return output names, method and tolerance."""
    if isinstance(machine, (str, Path)):
        raise SceneError(f"compile takes a machine: ttc.machines.create('{machine}') or ttc.load_machine('{machine}')")
    if isinstance(outputs, str):
        raise SceneError(f"outputs must be a list of names, such as ['{outputs}']")
    # Convert numpy strings to str, since the names appear in generated code.
    names = tuple(dict.fromkeys(str(name) for name in (machine.scene.outputs if outputs is None else outputs)))
    method = machine.scene.method if method is None else method
    tolerance = machine.scene.tolerance if tolerance is None else tolerance
    if not names:
        raise SceneError("no outputs are asked for; name at least one, for example balancing_torque_Nm")
    if method not in METHODS:
        raise SceneError(f"there is no method '{method}'; choose one of {', '.join(METHODS)}")
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise SceneError(f"tolerance must be a positive number, not {tolerance!r}")
    return names, method, tolerance
