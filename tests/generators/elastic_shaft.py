"""A wide tufting machine on an elastic main shaft, integrated by explicit Runge-Kutta steps of 5 us.

Linkage kinematics come from `tufting_truth` at 50 digits, as Fourier series; the equations of motion are written in
absolute angles. The module shares no code with the engine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache

import numba
import numpy as np
import numpy.typing as npt

from tests.generators.tufting_truth import truth

Floats = npt.NDArray[np.float64]

TURN = 2.0 * math.pi
STEEL_SHEAR_MODULUS_PA = 7.9e10
STEEL_DENSITY_KG_M3 = 7850.0
ENTRY_RAD, EXIT_RAD = 0.38312100023839724, 3.3846508836082833
"""Crank angles of the needle's entry into and exit from the backing, to 16 digits."""
_HARMONICS_FROM = 128
_TABLE = 8192
_STEP_S = 5e-6


@dataclass(frozen=True)
class WideMachine:
    """Linkages on a round steel shaft; the drive's disc stands at its near end.

    Attributes:
        diameter_m, length_m, stations: of the shaft; pieces of equal length join the drive's disc and the stations.
        phases_rad: (stations,) crank angle of each linkage before the shaft angle; None: all 0.
        modal_damping: damping ratio of the first mode; pieces damp in proportion to their stiffness.
        drive_inertia_kgm2, slip_Nms_rad: J0 and s of J0 alpha0 = T - s (omega0 - omega_ref) - tau.
        backing_force_N: friction on each needle inside the backing.
        coulomb_Nm: dry friction of the main shaft, at the first linkage.
    """

    diameter_m: float = 0.06
    length_m: float = 4.0
    stations: int = 16
    phases_rad: tuple[float, ...] | None = None
    modal_damping: float = 0.015
    drive_inertia_kgm2: float = 1.0
    slip_Nms_rad: float = 80.0
    backing_force_N: float = 1000.0
    coulomb_Nm: float = 0.0

    @property
    def piece_stiffness_Nm_rad(self) -> float:
        """Stiffness G pi d^4 / 32 l of one piece [N m/rad]."""
        second_moment = math.pi * self.diameter_m**4 / 32.0
        return STEEL_SHEAR_MODULUS_PA * second_moment * self.stations / self.length_m

    @property
    def disc_inertias_kgm2(self) -> Floats:
        """Inertia (stations + 1,) of the steel at each station: half of each adjacent piece."""
        piece = STEEL_DENSITY_KG_M3 * math.pi * self.diameter_m**4 / 32.0 * self.length_m / self.stations
        steel = np.full(self.stations + 1, piece)
        steel[[0, -1]] *= 0.5
        return steel

    @property
    def first_mode_rad_s(self) -> float:
        """First natural frequency with the linkages' mean inertia."""
        inertia = self.disc_inertias_kgm2 + float(np.mean(_tables()[0]))
        inertia[0] = self.disc_inertias_kgm2[0] + self.drive_inertia_kgm2
        n, k = self.stations, self.piece_stiffness_Nm_rad
        stiffness = np.zeros((n + 1, n + 1))
        for i in range(n):
            stiffness[i : i + 2, i : i + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
        root = np.sqrt(inertia)
        return float(np.sqrt(np.linalg.eigvalsh(stiffness / np.outer(root, root))[1]))

    @property
    def piece_damping_Nms_rad(self) -> float:
        """Viscous damping of one piece."""
        return 2.0 * self.modal_damping * self.piece_stiffness_Nm_rad / self.first_mode_rad_s


@dataclass(frozen=True)
class Record:
    """Motion and sensor readings.

    Attributes:
        time_s: (n,) times [s].
        encoder_rad: (n,) unwrapped readings at the drive's end.
        measured_Nm: (n,) torque with noise.
        torque_Nm: (n,) true torque of the first piece.
        angles_rad, speeds_rad_s: (n, stations + 1) states of the stations.
        drive_torque_Nm: (n,) true air-gap torque T - s (omega0 - omega_ref).
    """

    time_s: Floats
    encoder_rad: Floats
    measured_Nm: Floats
    torque_Nm: Floats
    angles_rad: Floats
    speeds_rad_s: Floats
    drive_torque_Nm: Floats
    stamps_ns: npt.NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamps_ns", np.rint(self.time_s * 1e9).astype(np.int64))


def simulate(
    machine: WideMachine,
    rpm: float | Floats,
    duration_s: float,
    *,
    settle_s: float = 3.0,
    encoder_bits: int = 14,
    rate_hz: float = 1000.0,
    torque_noise_Nm: float = 1.0,
    motor_wander_Nm: float = 0.0,
    seed: int = 0,
) -> Record:
    """Integrate the machine and read its sensors.

    Args:
        machine: the machine.
        rpm: nominal speed, or (n,) its course over the samples of the record (then `settle_s` is 0).
        duration_s: length of the record [s].
        settle_s: time integrated before the record begins.
        encoder_bits: resolution.
        rate_hz: of both sensors.
        torque_noise_Nm: white noise of the torque sensor.
        motor_wander_Nm: standard deviation of the motor torque's slow change (over 1 s).
        seed: of noise.
    """
    rng = np.random.default_rng(seed)
    count = round(duration_s * rate_hz) + 1
    before = 0 if np.ndim(rpm) else round(settle_s * rate_hz)
    speed = np.empty(before + count)
    speed[:] = np.asarray(rpm, dtype=np.float64) * TURN / 60.0
    wander = np.zeros(speed.size)
    if motor_wander_Nm:
        keep = math.exp(-1.0 / rate_hz)
        kick = rng.normal(0.0, motor_wander_Nm * math.sqrt(1.0 - keep**2), speed.size)
        for i in range(1, wander.size):
            wander[i] = keep * wander[i - 1] + kick[i]
    phases = np.zeros(machine.stations) if machine.phases_rad is None else np.array(machine.phases_rad)
    substeps = math.ceil(1.0 / (rate_hz * _STEP_S))
    inertia = machine.disc_inertias_kgm2
    inertia[0] += machine.drive_inertia_kgm2
    mean = machine.stations * float(np.mean(_tables()[3])) * machine.backing_force_N / 1000.0
    drive = wander + (mean if speed[0] > 0.0 else 0.0)
    angles, speeds, motor = _integrate(
        1.0 / rate_hz, substeps, speed, drive, machine.slip_Nms_rad, inertia, phases,
        machine.piece_stiffness_Nm_rad, machine.piece_damping_Nms_rad, machine.backing_force_N / 1000.0,
        machine.coulomb_Nm, _tables(),
    )  # fmt: skip
    angles, speeds, motor = angles[before:], speeds[before:], motor[before:]
    torque = machine.piece_stiffness_Nm_rad * (angles[:, 0] - angles[:, 1])
    torque += machine.piece_damping_Nms_rad * (speeds[:, 0] - speeds[:, 1])
    step = TURN / 2**encoder_bits
    time = np.arange(count) / rate_hz
    measured = torque + rng.normal(0.0, torque_noise_Nm, count)
    return Record(time, np.rint(angles[:, 0] / step) * step, measured, torque, angles, speeds, motor)


def needle_m(angle_rad: Floats) -> Floats:
    """Compute the needle's position at crank angles of one linkage, downwards from C [m]."""
    table = _tables()[4]
    return np.asarray(np.interp(np.mod(angle_rad, TURN), np.arange(_TABLE + 1) * (TURN / _TABLE), table))


@cache
def _tables() -> Floats:
    """Tabulate (5, _TABLE + 1) J, J'/2, V', friction torque at 1000 N and needle position over a turn."""
    grid = np.arange(_HARMONICS_FROM) * (TURN / _HARMONICS_FROM)
    names = ("equivalent_inertia_kgm2", "equivalent_inertia_slope_kgm2", "torque_gravity_Nm", "needle_position_m")
    always = {"backing_plane_m": "0", "backing_force_N": "0"}
    rows = [truth(float(angle), 1.0, 0.0, 20, always, reactions=False) for angle in grid]
    sampled = np.array([[float(row[name]) for name in names] for row in rows]).T
    spectrum = np.fft.rfft(sampled, axis=1) / _HARMONICS_FROM
    order = np.arange(spectrum.shape[1])
    fine = np.arange(_TABLE + 1) * (TURN / _TABLE)
    weight = np.where(order == 0, 1.0, 2.0) * (order < 40)
    wave = np.exp(1j * np.outer(order, fine))
    inertia, slope, gravity, needle = ((spectrum * weight) @ wave).real
    per_angle = ((spectrum[3] * weight * 1j * order) @ wave).real
    return np.array([inertia, 0.5 * slope, gravity, 1000.0 * np.abs(per_angle), needle])


@numba.njit(cache=True)
def _accelerations(angle, speed, motor, inertia, phases, stiffness, damping, force, coulomb, tables, result):  # type: ignore[no-untyped-def]
    before = 0.0
    for i in range(angle.size):
        after = 0.0
        if i < angle.size - 1:
            after = stiffness * (angle[i] - angle[i + 1]) + damping * (speed[i] - speed[i + 1])
        torque, mass = before - after, inertia[i]
        if i == 0:
            torque += motor
        else:
            crank = angle[i] + phases[i - 1]
            turned = crank - 2.0 * math.pi * math.floor(crank / (2.0 * math.pi))
            place = turned * (8192.0 / (2.0 * math.pi))
            k = min(int(place), 8191)
            part = place - k
            mass += tables[0, k] + part * (tables[0, k + 1] - tables[0, k])
            torque -= (tables[1, k] + part * (tables[1, k + 1] - tables[1, k])) * speed[i] * speed[i]
            torque -= tables[2, k] + part * (tables[2, k + 1] - tables[2, k])
            if 0.38312100023839724 < turned < 3.3846508836082833 and speed[i] != 0.0:
                load = force * (tables[3, k] + part * (tables[3, k + 1] - tables[3, k]))
                # Friction builds up over 0.01 rad/s.
                torque -= load * max(-1.0, min(1.0, speed[i] / 0.01))
            if i == 1:
                torque -= coulomb * max(-1.0, min(1.0, speed[i] / 0.01))
        result[i] = torque / mass
        before = after


@numba.njit(cache=True)
def _advance(start, step, rate, end):  # type: ignore[no-untyped-def]
    """Write start + step * rate, by elements: expressions of whole arrays take three seconds to compile."""
    for i in range(start.size):
        end[i] = start[i] + step * rate[i]


@numba.njit(cache=True)
def _integrate(period, substeps, reference, drive, slip, inertia, phases, stiffness, damping, force, coulomb, tables):  # type: ignore[no-untyped-def]
    n, count, h = inertia.size, reference.size, period / substeps
    angle, speed = np.full(n, 0.05), np.full(n, reference[0])
    angles, speeds, motors = np.empty((count, n)), np.empty((count, n)), np.empty(count)
    place, a1, a2, a3, a4 = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    v2, v3, v4 = np.empty(n), np.empty(n), np.empty(n)
    for j in range(count):
        _advance(angle, 0.0, angle, angles[j])
        _advance(speed, 0.0, speed, speeds[j])
        motors[j] = drive[j] - slip * (speed[0] - reference[j])
        if j == count - 1:
            break
        for _ in range(substeps):
            t1 = drive[j] - slip * (speed[0] - reference[j])
            _accelerations(angle, speed, t1, inertia, phases, stiffness, damping, force, coulomb, tables, a1)
            _advance(speed, 0.5 * h, a1, v2)
            _advance(angle, 0.5 * h, speed, place)
            t2 = drive[j] - slip * (v2[0] - reference[j])
            _accelerations(place, v2, t2, inertia, phases, stiffness, damping, force, coulomb, tables, a2)
            _advance(speed, 0.5 * h, a2, v3)
            _advance(angle, 0.5 * h, v2, place)
            t3 = drive[j] - slip * (v3[0] - reference[j])
            _accelerations(place, v3, t3, inertia, phases, stiffness, damping, force, coulomb, tables, a3)
            _advance(speed, h, a3, v4)
            _advance(angle, h, v3, place)
            t4 = drive[j] - slip * (v4[0] - reference[j])
            _accelerations(place, v4, t4, inertia, phases, stiffness, damping, force, coulomb, tables, a4)
            for i in range(n):
                angle[i] += h / 6.0 * (speed[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i])
                speed[i] += h / 6.0 * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i])
    return angles, speeds, motors
