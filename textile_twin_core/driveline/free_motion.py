"""drive: the motion of a machine under a drive torque, with a rigid or an elastic main shaft."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np
import numpy.typing as npt
import scipy

from textile_twin_core.arrays import FloatArray
from textile_twin_core.driveline.chain import ElasticShaft, elastic_shaft
from textile_twin_core.driveline.free_equation import (
    WORKS,
    FreeModes,
    change,
    energies,
    first_modes,
    free_modes,
    free_slopes,
    monitors,
)
from textile_twin_core.driveline.motion import ChainMotion
from textile_twin_core.driveline.profile import evaluate
from textile_twin_core.driveline.runs import twist_statically
from textile_twin_core.driveline.step import chain_state
from textile_twin_core.dynamics.drive_result import DriveResult
from textile_twin_core.dynamics.drive_torque import DriveTorque
from textile_twin_core.errors import MotionError
from textile_twin_core.machine import Machine, MainShaft
from textile_twin_core.machine.drive import drive as drive_rigid
from textile_twin_core.machine.drive import sample_times

_MOST_CHANGES = 10_000_000
_ROUNDING = 1e-14


@dataclass(frozen=True)
class ElasticDriveResult(DriveResult):
    """Motion of an elastic shaft under a drive torque.

    theta_rad, omega_rad_s and alpha_rad_s2 are those of the drive's station, reduced to the main shaft, and
    `motion` has every station and piece. The potential energy holds that of the twisted pieces. load_work_J has the
    loads together and the damping of shaft, bearings and play; single events are not listed.
    """

    motion: ChainMotion


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
    """Compute the motion of a machine under a drive torque: run-up, coast-down, speed ripple.

    Args:
        machine: A linkage machine; with a `shaft` the whole chain moves and the result is an ElasticDriveResult.
        drive_torque: Torque of the drive [N m]: a number, a function of (time, theta, omega), or one of the tables
            TorqueOverTime and TorqueOverAngle. With a `shaft` it acts at the drive's station, with that station's own
            angle and speed; the slip of the machine file is not added.
        theta0: Angle of the main shaft at the first time [rad].
        omega0: Its speed there [rad/s]. An elastic shaft that turns begins with the twist of uniform acceleration, one
            that stands without twist.
        t: Rising times [s], or one number: a thousand steps from 0 to it.
        tolerance: Relative error of a step.
        fastest_rad_s: Speed beyond which the motion is refused as one that runs away [rad/s].
        report: Called with the share of the time that is done.

    Returns:
        The motion at the times, with the energy account.

    Raises:
        MotionError: For a motion that cannot be followed, or a bad argument.
        MachineError: For a machine without masses, or a chain that cannot be.

    Examples:
        >>> import textile_twin_core as ttc
        >>> run = ttc.drive(ttc.machines.tufting(), 0.0, theta0=1.0, omega0=16.76, t=0.5)  # coast-down
        >>> bool(run.omega_rad_s[-1] < run.omega_rad_s[0])
        True
    """
    shaft: MainShaft | None = getattr(machine, "shaft", None)
    if shaft is None:
        return drive_rigid(machine, drive_torque, theta0, omega0, t, tolerance, fastest_rad_s, report)
    times = sample_times(theta0, omega0, tolerance, t)
    torque: DriveTorque
    if isinstance(drive_torque, Real):
        constant = float(drive_torque)
        torque = lambda time, theta, omega: constant  # noqa: E731
    elif callable(drive_torque):
        torque = drive_torque
    else:
        raise MotionError(f"drive_torque must be a number or a function of (t, theta, omega), not {drive_torque!r}")
    without_slip = replace(shaft, drive=replace(shaft.drive, slip_Nms_rad=None))
    run = _FreeRun(elastic_shaft(replace(machine, shaft=without_slip)), torque, tolerance, fastest_rad_s, report)
    return run.run(float(theta0), float(omega0), times)


class _FreeRun:
    """One run, from change to change, by DOP853 (Hairer, Norsett and Wanner 1993)."""

    def __init__(
        self,
        elastic: ElasticShaft,
        torque: DriveTorque,
        tolerance: float,
        fastest_rad_s: float,
        report: Callable[[float], object] | None,
    ) -> None:
        self.elastic, self.chain, self.tolerance = elastic, elastic.chain, tolerance
        self.fastest_rad_s, self.report = fastest_rad_s, report
        self.station = elastic.shaft.drive_station
        self.ratio = float(elastic.ratios[self.station])
        self._torque = torque
        self.breaks = tuple(getattr(torque, "breaks", ()))
        n = elastic.stations
        self.n, self.size = n, 2 * n + WORKS
        self.modes: FreeModes = free_modes(self.chain)
        self._slope = np.zeros(self.size)
        self._monitors = np.zeros(n + 2 * self.chain.phase.size + 2 * (n - 1))
        self.evaluations = self.steps = 0
        self.last_step: float | None = None

    def run(self, theta0: float, omega0: float, times: FloatArray) -> ElasticDriveResult:
        """Integrate over the rising times and give the motion there."""
        self.times, self.next = times, 0
        self.rows = np.empty((times.size, self.size))
        self.torques = np.empty(times.size)
        self.accelerations = np.empty((times.size, self.n))
        self.pieces = np.empty((times.size, self.n - 1))
        time, y = float(times[0]), self._start(theta0, omega0, float(times[0]))
        first_modes(self.chain, self.modes, y, self.station, self.torque(time, y), self._slope)
        self._record_row(time, y)
        scales = self._scales(y)
        for _ in range(_MOST_CHANGES):
            if time >= times[-1]:
                return self._result()
            time, y = self._advance(time, y, scales)
        raise MotionError(f"the shaft has met {_MOST_CHANGES} changes by {time:.6g} s; ask for a shorter time")

    def torque(self, time: float, y: FloatArray) -> float:
        """Drive torque, reduced to the main shaft [N m]."""
        angle = (float(y[0]) - float(y[1 : 1 + self.station].sum())) * self.ratio
        omega = float(y[self.n + self.station]) * self.ratio
        value = float(self._torque(time, angle, omega))
        if not math.isfinite(value):
            raise MotionError(f"the drive torque is {value} at {time:.6g} s and {angle:.6g} rad; it must be finite")
        return value * self.ratio

    def _start(self, theta0: float, omega0: float, time: float) -> FloatArray:
        """The state at the first time."""
        y = np.zeros(self.size)
        y[0], y[self.n : 2 * self.n] = theta0, omega0
        if omega0 == 0.0:
            return y
        first_modes(self.chain, self.modes, y, self.station, 0.0, self._slope)
        free_slopes(self.chain, self.modes, y, self.station, self.torque(time, y), self._slope)
        alpha = float(self.modes.net.sum() / self.modes.mass.sum())
        state = chain_state(self.chain)
        twist_statically(self.chain, state, theta0, omega0, alpha, self.station, np.zeros(self.n))
        y[0] += state.psi[0]
        y[1 : self.n] = state.psi[:-1] - state.psi[1:]
        return y

    def _scales(self, y: FloatArray) -> FloatArray:
        """(state,) sizes that an error is measured by."""
        inertia = self.elastic.mean_inertia_kgm2
        turn = np.linspace(0.0, 2.0 * math.pi, 90)
        heights = [
            np.ptp(evaluate([p.potential], turn)[0]) * (self.chain.profile == k).sum()
            for k, p in enumerate(self.elastic.profiles)
        ]
        omega = float(np.abs(y[self.n : 2 * self.n]).max())
        torque = abs(self.torque(float(self.times[0]), y))
        energy = max(0.5 * float(inertia.sum()) * omega**2, float(sum(heights)), torque, 1e-9)
        speed = math.sqrt(2.0 * energy / float(inertia.sum()))
        twist = math.sqrt(2.0 * energy / float(self.chain.stiffness.max()))
        return np.concatenate([[1.0], np.full(self.n - 1, twist), np.full(self.n, speed), np.full(WORKS, energy)])

    def _slopes(self, time: float, y: FloatArray) -> FloatArray:
        self.evaluations += 1
        slope = np.empty(self.size)
        free_slopes(self.chain, self.modes, y, self.station, self.torque(time, y), slope)
        return slope

    def _watch(self, time: float, y: FloatArray) -> FloatArray:
        """Monitors at an instant."""
        monitors(self.chain, self.modes, y, self.station, self.torque(time, y), self._slope, self._monitors)
        return self._monitors

    def _solver(
        self, time: float, y: FloatArray, end: float, scales: FloatArray, first: float | None
    ) -> scipy.integrate.DOP853:
        return scipy.integrate.DOP853(
            self._slopes, time, y.copy(), end, rtol=self.tolerance, atol=self.tolerance * scales, first_step=first
        )

    def _advance(self, time: float, y: FloatArray, scales: FloatArray) -> tuple[float, FloatArray]:
        """Integrate to the next change or the end of a piece of the drive torque."""
        end = min([b for b in self.breaks if b > time] + [float(self.times[-1])])
        began = self._watch(time, y).copy()
        step = self.last_step
        solver = self._solver(time, y, end, scales, None if step is None else min(0.2 * step, end - time))
        while solver.status == "running":
            begin, start = float(solver.t), solver.y.copy()
            message = solver.step()
            self.steps += 1
            if solver.status == "failed":
                raise MotionError(
                    f"the motion cannot be followed beyond {solver.t:.6g} s ({message}); is the drive torque smooth and"
                    " the tolerance not too small?"
                )
            self._check(solver)
            after = self._watch(float(solver.t), solver.y)
            passed = np.flatnonzero((after < 0.0) & (after < began - _ROUNDING))
            if passed.size:
                return self._land(begin, start, solver, scales, passed)
            began = after.copy()
            if solver.t < end:
                self.last_step = float(solver.t) - begin
            if self.next < self.times.size and self.times[self.next] <= solver.t:
                self._record(solver.dense_output())
        return float(solver.t), solver.y.copy()

    def _check(self, solver: scipy.integrate.DOP853) -> None:
        omega = float(solver.y[self.n + self.station])
        if not abs(omega) <= self.fastest_rad_s:
            raise MotionError(
                f"the motion runs away: {omega * 30.0 / math.pi:.6g} rpm at {float(solver.t):.6g} s, more than this"
                f" machine turns ({self.fastest_rad_s * 30.0 / math.pi:.6g} rpm); take less torque or a shorter time"
            )
        if self.report is not None:
            first, last = float(self.times[0]), float(self.times[-1])
            self.report((float(solver.t) - first) / (last - first))

    def _land(
        self,
        begin: float,
        start: FloatArray,
        solver: scipy.integrate.DOP853,
        scales: FloatArray,
        passed: npt.NDArray[np.int64],
    ) -> tuple[float, FloatArray]:
        """Go from the beginning of the last step exactly onto the first change, and let it happen."""
        dense = solver.dense_output()
        moments = [(self._root(dense, k, begin, float(solver.t)), k) for k in passed.tolist()]
        moment, which = min(moments)
        y = start
        if moment > begin:
            exact = self._solver(begin, start, moment, scales, moment - begin)
            while exact.status == "running":
                exact.step()
                self.steps += 1
                if self.next < self.times.size and self.times[self.next] <= exact.t:
                    self._record(exact.dense_output())
            y = exact.y.copy()
        change(self.chain, self.modes, y, self.station, self.torque(moment, y), self._slope, which)
        return moment, y

    def _root(self, dense: scipy.integrate.DenseOutput, which: int, low: float, high: float) -> float:
        """Time at which a monitor passes zero within a step."""

        def level(time: float) -> float:
            return float(self._watch(time, dense(time))[which])

        at_low, at_high = level(low), level(high)
        if at_low <= 0.0 or at_high > 0.0:
            return low if at_low <= 0.0 else high
        return float(scipy.optimize.brentq(level, low, high, xtol=1e-300, rtol=1e-15))

    def _record(self, dense: scipy.integrate.DenseOutput) -> None:
        """Keep the state at the times up to the end of a step."""
        while self.next < self.times.size and self.times[self.next] <= dense.t_max:
            time = float(self.times[self.next])
            self._record_row(time, dense(time))

    def _record_row(self, time: float, y: FloatArray) -> None:
        n, chain = self.n, self.chain
        slope = self._slopes(time, y)
        reach = y[1:n] - self.modes.side * chain.half_play
        torque = chain.stiffness * reach + chain.damping * slope[1:n]
        self.rows[self.next], self.torques[self.next] = y, self.torque(time, y) / self.ratio
        self.accelerations[self.next] = slope[n : 2 * n]
        self.pieces[self.next] = np.where(self.modes.side == 0, 0.0, torque)
        self.next += 1

    def _result(self) -> ElasticDriveResult:
        n, ratios, rows = self.n, self.elastic.ratios, self.rows
        twist, omega = rows[:, 1:n], rows[:, n : 2 * n]
        theta = rows[:, :1] - np.hstack([np.zeros((rows.shape[0], 1)), np.cumsum(twist, axis=1)])
        angles = np.empty((rows.shape[0], self.chain.phase.size))
        kinetic, elastic = np.array([energies(self.chain, y, at) for y, at in zip(rows, angles, strict=True)]).T.copy()
        potential = elastic
        for k, number in enumerate(self.chain.profile.tolist()):
            potential = potential + evaluate([self.elastic.profiles[number].potential], angles[:, k].copy())[0]
        motion = ChainMotion(
            self.elastic.shaft.names,
            self.times,
            theta * ratios,
            omega * ratios,
            self.accelerations * ratios,
            self.elastic.piece_torques(self.pieces),
            twist * ratios[1:],
            self.torques,
            0,
        )
        at = self.station
        works = rows[:, 2 * n :].T.copy()
        return ElasticDriveResult(
            self.times, theta[:, at].copy(), omega[:, at].copy(), self.accelerations[:, at].copy(), self.torques,
            kinetic, potential, works[0], {"loads": works[1], "damping": works[2]}, (), self.evaluations, self.steps,
            motion,
        )  # fmt: skip
