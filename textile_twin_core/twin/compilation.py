"""compile(machine, outputs, method, tolerance): the twin of a machine for the outputs asked."""

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
    """Compile a machine into a twin that computes the outputs asked for and nothing else.

    Args:
        machine: from `ttc.machines` or `ttc.load_machine`.
        outputs: names of outputs, as `machine.outputs` lists them; those of the machine's scene without it.
        method: "exact" evaluates closed forms, "table" periodic tables, "auto" whichever is faster (see `Twin`); that
            of the machine's scene without it.
        tolerance: error over the peak that a table may have; that of the machine's scene without it.

    Returns:
        The twin: `evaluate` for shaft angles, speeds and accelerations, `session` for samples of an encoder. A
        HistoryTwin for a machine with impacts, an ElasticTwin for one with an elastic shaft.

    Raises:
        SceneError: an unknown output or method, or a tolerance that is not positive.
        MachineError: the machine lacks what an output needs, such as masses.

    Example:
        >>> import textile_twin_core as ttc
        >>> twin = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"])
        >>> round(twin.evaluate(1.0, 16.755, 0.0)["balancing_torque_Nm"], 3)
        14.108
    """
    return _twin(machine, *_scene(machine, outputs, method, tolerance))


def idle_twin(machine: AnyMachine) -> Twin | ElasticTwin | HistoryTwin:
    """Compile a machine for no output: its sessions follow the shaft alone."""
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
    """Compile a linkage machine as if its main shaft were rigid; arguments and errors as `compile_machine`."""
    return Twin(machine, *_scene(machine, outputs, method, tolerance))


def _scene(
    machine: AnyMachine, outputs: Sequence[str] | None, method: str | None, tolerance: float | None
) -> tuple[tuple[str, ...], str, float]:
    """Output names, method and tolerance, checked."""
    if isinstance(machine, (str, Path)):
        raise SceneError(f"compile takes a machine: ttc.machines.create('{machine}') or ttc.load_machine('{machine}')")
    if isinstance(outputs, str):
        raise SceneError(f"outputs must be a list of names, such as ['{outputs}']")
    # plain names, since those of a numpy array would not stand in the code that is written for them
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
