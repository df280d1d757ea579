"""Forward dynamics of a machine: drive(machine, drive_torque, theta0, omega0, t)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from numbers import Real

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.drive import Drive
from textile_twin_core.dynamics.drive_result import DriveResult
from textile_twin_core.dynamics.drive_torque import DriveTorque
from textile_twin_core.dynamics.loads.load import Load
from textile_twin_core.dynamics.motion_equation import MotionEquation
from textile_twin_core.errors import MachineError, MotionError
from textile_twin_core.expression import Expr
from textile_twin_core.machine.declared import type_tag
from textile_twin_core.machine.machine import Machine
from textile_twin_core.machine.model import total

_TIMES = 1001


def drive(
    machine: Machine,
    drive_torque: DriveTorque | float,
    theta0: float,
    omega0: float,
    t: npt.ArrayLike,
    tolerance: float = 1e-10,
    fastest_rad_s: float = math.inf,
    report: Callable[[float], object] | None = None,
) -> DriveResult:
    """Integrate the motion of a machine under a drive torque: run-up, coast-down, speed ripple.

    An explicit Runge-Kutta method of order 8 with adaptive steps integrates the equation of motion. A step whose energy
    and work disagree is repeated in halves. Steps end exactly where a load is discontinuous and where the shaft comes
    to a standstill. Dry friction holds the shaft at standstill until the driving torques exceed it.

    Args:
        machine: machine with masses.
        drive_torque: torque of the drive [N m]: a number, a function of (time, theta, omega), TorqueOverTime or
            TorqueOverAngle.
        theta0: shaft angle at the first time [rad].
        omega0: shaft speed at the first time [rad/s].
        t: increasing times of the result [s], or one number for a thousand steps from 0 to it.
        tolerance: relative error of a step.
        fastest_rad_s: speed above which the motion counts as a runaway [rad/s].
        report: called with the completed share of the time.

    Returns:
        Motion at the times, events and energy account.

    Raises:
        MotionError: for a motion that cannot be integrated, or a bad argument.
        MachineError: for a machine without masses.

    References:
        Dormand and Prince; Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed. 1993.
    """
    if not isinstance(machine, Machine):
        raise MachineError(f"'{getattr(machine, 'name', machine)}' is no linkage machine: drive has no law for it")
    times = sample_times(theta0, omega0, tolerance, t)
    if isinstance(drive_torque, Real):
        constant = float(drive_torque)
        torque: DriveTorque = lambda time, theta, omega: constant  # noqa: E731
    elif callable(drive_torque):
        torque = drive_torque
    else:
        raise MotionError(f"drive_torque must be a number or a function of (t, theta, omega), not {drive_torque!r}")
    run = Drive(motion_equation(machine), torque, load_names(machine.loads), tolerance, fastest_rad_s, report)
    return run.run(float(theta0), float(omega0), times)


def motion_equation(machine: Machine) -> MotionEquation:
    """Build the machine's equation of motion, for all linkages on the shaft together."""
    model = machine.model
    return MotionEquation(
        model.output("equivalent_inertia_kgm2"),
        0.5 * model.output("equivalent_inertia_slope_kgm2"),
        model.output("potential_energy_J"),
        model.output("torque_gravity_Nm"),
        load_torques(machine),
    )


def load_torques(machine: Machine) -> list[Expr]:
    """Express the torque of each load on the shaft, for all linkages together [N m]."""
    return [
        total(load.unit_force(k.load_context) * k.intensity(i) for k in machine.model.linkages)
        for i, load in enumerate(machine.loads)
    ]


def load_names(loads: Sequence[Load]) -> tuple[str, ...]:
    """Name each load as its machine file does, by its own name or its type; the second of a name has `#2` behind it."""
    seen, names = Counter[str](), []
    for load in loads:
        name = getattr(load, "name", "") or type_tag(type(load))
        seen[name] += 1
        names.append(f"{name}#{seen[name]}" if seen[name] > 1 else name)
    return tuple(names)


def sample_times(theta0: float, omega0: float, tolerance: float, t: npt.ArrayLike) -> FloatArray:
    """Return the times of a run and check its other numbers. Raises MotionError for impossible values."""
    for what, value in (("theta0", theta0), ("omega0", omega0)):
        if not math.isfinite(value):
            raise MotionError(f"{what} must be a finite number, not {value!r}")
    if not 0.0 < tolerance < 1.0:
        raise MotionError(f"tolerance must lie between 0 and 1, not {tolerance!r}")
    times = np.asarray(t, dtype=np.float64)
    if times.ndim == 0 and times > 0.0:
        times = np.linspace(0.0, float(times), _TIMES)
    if times.ndim != 1 or times.size < 2 or not np.isfinite(times).all() or not (np.diff(times) > 0.0).all():
        raise MotionError("t must be two or more rising times in seconds, or one time after 0")
    return times
