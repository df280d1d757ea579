"""Result of a drive run: motion at the requested times, events, and the energy account."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from textile_twin_core.arrays import FloatArray


@dataclass(frozen=True)
class DriveEvent:
    """An event of the run: a load steps (kind "leaps", load names in `loads`), the shaft stops, starts or reverses."""

    kind: str
    time_s: float
    theta_rad: float
    omega_rad_s: float
    loads: tuple[str, ...] = ()


@dataclass(frozen=True)
class DriveResult:
    """Motion of the shaft at the requested times, (n,) arrays, and its energy account.

    Attributes:
        time_s: times [s].
        theta_rad, omega_rad_s, alpha_rad_s2: angle, speed and acceleration of the shaft [rad, rad/s, rad/s^2].
        drive_torque_Nm: torque of the drive at the same instants [N m].
        kinetic_energy_J, potential_energy_J: energies [J].
        drive_work_J: work of the drive since the first time [J].
        load_work_J: work of each load by name [J]; negative for friction.
        events: starts, stops, and steps of loads.
        evaluations: number of evaluations of the equation of motion.
        steps: number of steps of the integrator.

    Examples:
        >>> import textile_twin_core as ttc
        >>> run = ttc.drive(ttc.machines.tufting(), 20.0, theta0=0.3, omega0=0.0, t=0.2)  # [N m], [rad], [rad/s], [s]
        >>> sorted(run.load_work_J)
        ['backing']
    """

    time_s: FloatArray
    theta_rad: FloatArray
    omega_rad_s: FloatArray
    alpha_rad_s2: FloatArray
    drive_torque_Nm: FloatArray
    kinetic_energy_J: FloatArray
    potential_energy_J: FloatArray
    drive_work_J: FloatArray
    load_work_J: Mapping[str, FloatArray]
    events: tuple[DriveEvent, ...]
    evaluations: int
    steps: int

    @property
    def energy_error_J(self) -> FloatArray:
        """(n,) energy gain that no work explains [J]: the integrator's error."""
        energy = self.kinetic_energy_J + self.potential_energy_J
        account: FloatArray = energy - energy[0] - self.drive_work_J
        for work in self.load_work_J.values():
            account = account - work
        return account
