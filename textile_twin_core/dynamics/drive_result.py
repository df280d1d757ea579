"""What a drive gives: the motion at the times asked, what happened on the way, and where the energy went."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from textile_twin_core.arrays import FloatArray


@dataclass(frozen=True)
class DriveEvent:
    """Something that happened: a load `leaps` (`loads` says which), the shaft `stops`, `starts` or `reverses`."""

    kind: str
    time_s: float
    theta_rad: float
    omega_rad_s: float
    loads: tuple[str, ...] = ()


@dataclass(frozen=True)
class DriveResult:
    """Motion of the shaft at the times asked, (n,) arrays, and its energy account.

    alpha_rad_s2 and drive_torque_Nm belong to the same instants. drive_work_J is what the drive has put in since
    the first time, load_work_J what each load has (friction: negative), by load. evaluations counts those of
    the equation of motion, steps the integrator's.
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
        """(n,) energy gained that no work accounts for [J]: the integrator's error."""
        energy = self.kinetic_energy_J + self.potential_energy_J
        account: FloatArray = energy - energy[0] - self.drive_work_J
        for work in self.load_work_J.values():
            account = account - work
        return account
