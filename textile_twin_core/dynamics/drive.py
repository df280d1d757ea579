"""Forward motion from a drive torque, with exact load steps and standstills and an energy account."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NoReturn

import numpy as np
import scipy

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.drive_result import DriveEvent, DriveResult
from textile_twin_core.dynamics.drive_torque import DriveTorque
from textile_twin_core.dynamics.motion_equation import TURN, MotionEquation, Stretch
from textile_twin_core.errors import MotionError

_EVENTS_LARGEST = 1_000_000
_TINY = 1e-8
_ENERGY_ERROR = 2.0
"""Largest energy error of a step over tolerance times energy, as caused by a relative speed error of the tolerance."""
_HELPS = 0.1
"""Halving a step must at smallest reduce its error to this share of the whole step's; at a toggle it does not."""
_ROUNDING = 1e-15
_SCAN = 1000
"""Evaluations of the torque on a shaft at standstill, over the remaining time, in search of its start."""


class Drive:
    """One run: angle, speed, work of the drive and work of each load, integrated from event to event."""

    def __init__(
        self,
        equation: MotionEquation,
        torque: DriveTorque,
        load_names: Sequence[str],
        tolerance: float,
        fastest_rad_s: float = math.inf,
        report: Callable[[float], object] | None = None,
    ) -> None:
        self.equation, self.torque, self.load_names, self.tolerance = equation, torque, tuple(load_names), tolerance
        self.fastest_rad_s, self._report = fastest_rad_s, report
        self.breaks: tuple[float, ...] = tuple(getattr(torque, "breaks", ()))
        self.events: list[DriveEvent] = []
        self.evaluations = self.steps = 0

    def run(self, theta0: float, omega0: float, times: FloatArray) -> DriveResult:
        """Integrate over the increasing times and return the motion there. Raises MotionError for a runaway."""
        # Trial steps that are far too long overflow; the integrator discards and shortens them.
        with np.errstate(over="ignore", invalid="ignore"):
            return self._run(theta0, omega0, times)

    def _run(self, theta0: float, omega0: float, times: FloatArray) -> DriveResult:
        self._times, self._rows = times, np.empty((times.size, 4 + self.equation.load_count))
        self._torques = np.empty(times.size)
        self._next = 0
        self._scales = self._error_scales(theta0, omega0)
        time = float(times[0])
        state = np.zeros(3 + self.equation.load_count)
        state[:2] = theta0, omega0
        direction = before = int(np.sign(omega0))
        for _ in range(_EVENTS_LARGEST):
            if direction == 0:
                direction, moment = self._leave_standstill(time, state)
                if direction * before < 0 and moment == time:
                    self._note("reverses", time, state)
                time = moment
            if direction == 0 or time >= times[-1]:
                break
            before = direction
            time, direction = self._advance(time, state, direction)
        else:
            raise MotionError(f"the shaft has met {_EVENTS_LARGEST} events by {time:.6g} s; ask for a shorter time")
        self._record_standstill(math.inf, state)
        return self._result()

    def _error_scales(self, theta0: float, omega0: float) -> FloatArray:
        """Compute absolute errors that count as 1: an angle of 1 rad, and the expected largest speed and energy."""
        turn = [found for angle in np.linspace(0.0, TURN, 37).tolist() if (found := self._energies_of_speed_one(angle))]
        turn.append(self._energies_of_speed_one(theta0) or self._refuse(theta0, float(self._times[0])))
        inertia = 2.0 * min(kinetic for kinetic, _ in turn)
        if not inertia > 0.0:
            raise MotionError("the machine has no inertia that a torque could accelerate; give its bodies masses")
        heights = [potential for _, potential in turn]
        torque = abs(self._torque_at(float(self._times[0]), theta0, omega0))
        energy = max(self.equation.energies(theta0, omega0)[0], max(heights) - min(heights), torque, 1e-9)
        scales = np.full(3 + self.equation.load_count, energy)
        scales[:2] = 1.0, math.sqrt(2.0 * energy / inertia)
        return scales

    def _energies_of_speed_one(self, theta: float) -> tuple[float, float] | None:
        """Compute kinetic (at 1 rad/s) and potential energy [J]; None where the chain is open."""
        try:
            return self.equation.energies(theta, 1.0)
        except (ValueError, ZeroDivisionError):
            return None

    def _refuse(self, theta: float, time: float) -> NoReturn:
        raise MotionError(
            f"the machine cannot close at a shaft angle of {math.degrees(theta):.4f} deg, reached at {time:.6g} s"
        ) from None

    def _torque_at(self, time: float, theta: float, omega: float) -> float:
        value = float(self.torque(time, theta, omega))
        if not math.isfinite(value):
            raise MotionError(f"the drive torque is {value} at {time:.6g} s and {theta:.6g} rad; it must be finite")
        return value

    def _slopes(self, time: float, state: FloatArray, stretch: Stretch) -> FloatArray:
        theta, omega = float(state[0]), float(state[1])
        if not math.isfinite(theta):  # NaN makes the integrator shorten a trial step that is far too long
            return np.full(state.size, math.nan)
        if self.equation.is_open(stretch):
            self._refuse(theta, time)
        try:
            inertia, half_slope, weight, *loads = self.equation.terms(theta, omega, *stretch.values)
        except (ValueError, ZeroDivisionError):
            self._refuse(theta, time)
        torque = self._torque_at(time, theta, omega)
        alpha = (torque + sum(loads) - half_slope * omega * omega - weight) / inertia
        return np.array([omega, alpha, torque * omega, *(load * omega for load in loads)])

    def _leave_standstill(self, time: float, state: FloatArray) -> tuple[int, float]:
        """Find the direction and time at which the shaft starts from standstill; direction 0 if it stays there."""

        def pushed(moment: float) -> int:
            for direction in (1, -1):
                stretch = self.equation.stretch(float(state[0]), direction)
                if direction * self._slopes(moment, state, stretch)[1] > 0.0:
                    return direction
            return 0

        direction = pushed(time)
        if direction:
            return direction, time
        self._note("stops", time, state)
        end = float(self._times[-1])
        samples = np.union1d(np.linspace(time, end, _SCAN + 1), [b for b in self.breaks if time < b < end])
        for low, high in zip(samples[:-1].tolist(), samples[1:].tolist(), strict=True):
            if not pushed(high):
                continue
            while low < (middle := 0.5 * (low + high)) < high:
                low, high = (low, middle) if pushed(middle) else (middle, high)
            self._record_standstill(high, state)
            self._note("starts", high, state)
            return pushed(high), high
        return 0, end

    def _advance(self, time: float, state: FloatArray, direction: int) -> tuple[float, int]:
        """Integrate `state` in place to the next event or the end; return time and direction (0 at standstill)."""
        stretch = self.equation.stretch(float(state[0]), direction)
        bound = stretch.bound(direction)
        end = min([b for b in self.breaks if b > time] + [float(self._times[-1])])
        solver = self._solver(time, state, end, stretch)
        while solver.status == "running":
            begin, start = float(solver.t), solver.y.copy()
            solver = self._step(solver, stretch)
            if direction * (solver.y[0] - bound) >= 0.0 or direction * solver.y[1] <= 0.0:
                return self._land(begin, start, solver, state, stretch, direction)
            if self._next < self._times.size and self._times[self._next] <= solver.t:
                self._record(solver.dense_output(), stretch)
        state[:] = solver.y
        return float(solver.t), direction

    def _land(
        self,
        begin: float,
        start: FloatArray,
        solver: scipy.integrate.DOP853,
        state: FloatArray,
        stretch: Stretch,
        direction: int,
    ) -> tuple[float, int]:
        """Advance exactly from the start of the last step to the first event: standstill or the stretch's end."""
        dense, bound, time = solver.dense_output(), stretch.bound(direction), float(solver.t)
        which, target = 1, 0.0
        if direction * solver.y[1] <= 0.0:
            time = _root(lambda t: dense(t)[1], begin, time)
        if direction * (dense(time)[0] - bound) >= 0.0:
            which, target = 0, bound
            time = _root(lambda t: dense(t)[0] - bound, begin, time)
        pieces: list[scipy.integrate.DenseOutput] = []
        end = start
        for _ in range(5):  # Newton's method, with a separate integration step per iteration
            if not time > begin:
                break
            end, pieces = self._cross(begin, start, time, stretch)
            slopes = self._slopes(time, end, stretch)
            late = float((end[which] - target) / slopes[which]) if slopes[which] else 0.0
            if abs(late) > 0.5 * (time - begin):
                break
            time -= late
            if abs(late) < _TINY * (time - begin):  # linear interpolation is exact to rounding at this distance
                end = end - late * slopes
                break
        for piece in pieces:
            self._record(piece, stretch)
        state[:] = end
        state[which] = target
        if which == 1:
            return time, 0
        after = self.equation.stretch(bound, direction)
        leaping = self.equation.leaping_loads(stretch, after, bound, float(state[1]))
        if leaping:
            self._note("leaps", time, state, [self.load_names[i] for i in leaping])
        return time, direction

    def _cross(
        self, begin: float, start: FloatArray, end: float, stretch: Stretch
    ) -> tuple[FloatArray, list[scipy.integrate.DenseOutput]]:
        """Integrate the state from one time to another, in one step if its error allows."""
        solver, pieces = self._solver(begin, start, end, stretch, end - begin), []
        while solver.status == "running":
            solver = self._step(solver, stretch)
            pieces.append(solver.dense_output())
        return solver.y, pieces

    def _solver(
        self, time: float, state: FloatArray, end: float, stretch: Stretch, first_step: float | None = None
    ) -> scipy.integrate.DOP853:
        def slopes(t: float, y: FloatArray) -> FloatArray:
            self.evaluations += 1
            return self._slopes(t, y, stretch)

        absolute = self.tolerance * self._scales
        return scipy.integrate.DOP853(
            slopes, time, state.copy(), end, rtol=self.tolerance, atol=absolute, first_step=first_step
        )

    def _step(self, solver: scipy.integrate.DOP853, stretch: Stretch) -> scipy.integrate.DOP853:
        """Make one step and return the solver at its end.

        The integrator's own error estimate is occasionally far too small, where its two parts cancel. The energy
        account is an independent check: a step that violates it is repeated in halves.
        """
        begin, start, end, smallest = float(solver.t), solver.y.copy(), solver.t_bound, math.inf
        while True:
            message = solver.step()
            self.steps += 1
            if solver.status == "failed":
                raise MotionError(
                    f"the motion cannot be followed beyond {solver.t:.6g} s, angle {solver.y[0]:.6g} rad, speed "
                    f"{solver.y[1]:.6g} rad/s ({message}); is the drive torque smooth and the tolerance not too small?"
                )
            lost = self._lost_energy(start, solver.y)
            if lost <= 1.0 or lost > _HELPS * smallest:
                self._report_progress(float(solver.t))
                self._refuse_runaway(solver)
                return solver
            smallest = lost
            solver = self._solver(begin, start, end, stretch, 0.5 * (solver.t - begin))

    def _report_progress(self, now: float) -> None:
        """Report the completed share of the time."""
        if self._report is not None:
            first, last = float(self._times[0]), float(self._times[-1])
            self._report((now - first) / (last - first))

    def _refuse_runaway(self, solver: scipy.integrate.DOP853) -> None:
        """Raise MotionError if the speed exceeds the limit or is not finite."""
        omega = float(solver.y[1])
        if not abs(omega) <= self.fastest_rad_s:
            raise MotionError(
                f"the motion runs away: {omega * 30.0 / math.pi:.6g} rpm at {float(solver.t):.6g} s, more than this"
                f" machine turns ({self.fastest_rad_s * 30.0 / math.pi:.6g} rpm); take less torque or a shorter time"
            )

    def _lost_energy(self, start: FloatArray, end: FloatArray) -> float:
        """Return a step's energy error beyond the allowance for tolerance and rounding."""
        before, after = ([*self.equation.energies(*y[:2].tolist()), *(-y[2:]).tolist()] for y in (start, end))
        size = float(self._scales[-1]) + max(before[0], after[0])
        rounding = _ROUNDING * math.fsum(abs(part) for part in (*before, *after))
        lost = abs(math.fsum(after) - math.fsum(before))
        return float(lost / (_ENERGY_ERROR * self.tolerance * size + rounding))

    def _record(self, dense: scipy.integrate.DenseOutput, stretch: Stretch) -> None:
        """Record the motion at the requested times up to the end of a step."""
        while self._next < self._times.size and self._times[self._next] <= dense.t_max:
            time = float(self._times[self._next])
            state = dense(time)
            self._write(state, float(self._slopes(time, state, stretch)[1]), time)

    def _record_standstill(self, until: float, state: FloatArray) -> None:
        """Record standstill at the requested times before `until`."""
        while self._next < self._times.size and self._times[self._next] < until:
            self._write(state, 0.0, float(self._times[self._next]))

    def _write(self, state: FloatArray, alpha: float, time: float) -> None:
        self._rows[self._next] = state[0], state[1], alpha, *state[2:]
        self._torques[self._next] = self._torque_at(time, float(state[0]), float(state[1]))
        self._next += 1

    def _note(self, kind: str, time: float, state: FloatArray, loads: Sequence[str] = ()) -> None:
        self.events.append(DriveEvent(kind, time, float(state[0]), float(state[1]), tuple(loads)))

    def _result(self) -> DriveResult:
        theta, omega, alpha, drive_work, *load_work = self._rows.T.copy()
        energies = [self.equation.energies(a, w) for a, w in zip(theta.tolist(), omega.tolist(), strict=True)]
        kinetic, potential = np.array(energies).T.copy()
        return DriveResult(
            self._times,
            theta,
            omega,
            alpha,
            self._torques,
            kinetic,
            potential,
            drive_work,
            dict(zip(self.load_names, load_work, strict=True)),
            tuple(self.events),
            self.evaluations,
            self.steps,
        )


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Find the zero of a function; an end of the range where rounding hides the change of sign."""
    if function(low) * function(high) > 0.0:
        return high
    return float(scipy.optimize.brentq(function, low, high, xtol=1e-300, rtol=1e-14))
